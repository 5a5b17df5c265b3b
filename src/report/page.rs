//! The report: one self-contained HTML file, verdict first, that prints as it is displayed.

use super::canvas::escape;
use crate::posterior::{Comparison, Interval, Summary};
use std::fmt::Write;

/// One run on the page.
#[derive(Clone, Copy, Debug)]
pub struct PageRun<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its summary.
    pub summary: &'a Summary,
    /// Comparison of the first run with this one; `None` for the first, and where the parameters differ.
    pub comparison: Option<&'a Comparison>,
    /// Its `config.toml`.
    pub config: &'a str,
    /// Its figures: caption and SVG.
    pub figures: &'a [(String, String)],
}

/// Figures that belong to all runs together.
#[derive(Clone, Debug)]
pub struct Section {
    /// Heading.
    pub heading: String,
    /// Figures: caption and SVG.
    pub figures: Vec<(String, String)>,
}

const STYLE: &str = "body{font:15px/1.45 Helvetica,Arial,sans-serif;color:#1a1a1a;max-width:60rem;margin:2rem auto;\
padding:0 1rem}h1{font-size:1.5rem}h2{font-size:1.2rem;border-bottom:1px solid #8c8c8c;margin-top:2.2rem}\
table{border-collapse:collapse;margin:.8rem 0;font-size:.88rem}th,td{padding:.2rem .7rem;text-align:right;\
border-bottom:1px solid #ddd}th:first-child,td:first-child,td.words{text-align:left}thead th{border-bottom:1px solid #1a1a1a}\
.verdict{padding:.6rem .9rem;border-left:6px solid #009E73;background:#f3f3f3}.verdict.bad{border-color:#D55E00;\
font-weight:bold}figure{margin:1.2rem 0;break-inside:avoid}figcaption{font-size:.85rem;color:#444}\
svg{max-width:100%;height:auto}pre{background:#f3f3f3;padding:.6rem;overflow-x:auto;font-size:.8rem;\
white-space:pre-wrap}@media print{body{margin:0;max-width:none;font-size:10pt}h2{break-after:avoid}\
details{display:block}}";

/// The beginning of every page, by which a file is recognised as a page.
const HEAD: &str = "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n<meta name=\"generator\" content=\"oblate\">\n";

/// Whether a file is a [`page`], by how it begins.
#[must_use]
pub fn is_page(file: &[u8]) -> bool {
    file.starts_with(HEAD.as_bytes())
}

/// Appends to the page; writing to a string cannot fail.
macro_rules! put {
    ($out:expr, $($arg:tt)*) => {
        let _ = writeln!($out, $($arg)*);
    };
}

/// The page of some runs: verdict, comparison (of two or more), sections of shared figures, then each run in full.
#[must_use]
pub fn page(title: &str, runs: &[PageRun<'_>], sections: &[Section]) -> String {
    let mut out = HEAD.to_owned();
    put!(
        out,
        "<meta name=\"viewport\" content=\"width=device-width\">"
    );
    put!(
        out,
        "<title>{}</title><style>{STYLE}</style></head><body>",
        escape(title)
    );
    put!(out, "<h1>{}</h1>", escape(title));
    for run in runs {
        verdict(&mut out, run);
    }
    if runs.len() > 1 {
        comparison(&mut out, runs);
    }
    for section in sections {
        put!(out, "<h2>{}</h2>", escape(&section.heading));
        figures(&mut out, &section.figures);
    }
    for run in runs {
        put!(out, "<h2>{}</h2>", escape(run.name));
        evidence(&mut out, run.summary);
        parameters(&mut out, run.summary);
        figures(&mut out, run.figures);
        modes(&mut out, run.summary);
        streams(&mut out, run.summary);
        influence(&mut out, run.summary);
        predictive(&mut out, run.summary);
        checks(&mut out, run.summary);
        again(&mut out, run);
    }
    put!(out, "</body></html>");
    out
}

fn verdict(out: &mut String, run: &PageRun<'_>) {
    let s = run.summary;
    let prior = s.measured_verdict();
    let model = s.model_checks.iter().all(|check| check.pass);
    let measured = !s.population.as_ref().is_some_and(|p| p.measures_nothing());
    let class = if s.converged && model && measured {
        "verdict"
    } else {
        "verdict bad"
    };
    put!(
        out,
        "<div class=\"{class}\"><b>{}</b>: {} {} {}",
        escape(run.name),
        escape(&s.verdict()),
        escape(&s.model_verdict().unwrap_or_default()),
        escape(&prior.unwrap_or_default())
    );
    if let Some(q) = &s.q {
        put!(
            out,
            " q = {:.3}, 68 % in [{:.3}, {:.3}], 95 % in [{:.3}, {:.3}].",
            q.median,
            q.lo68,
            q.hi68,
            q.lo95,
            q.hi95
        );
    }
    let failed = s.checks.iter().chain(&s.model_checks).filter(|g| !g.pass);
    let assumed = s.assumptions.iter().map(|a| format!("Assumed: {a}"));
    let notes: Vec<String> = assumed
        .chain(failed.map(|g| format!("{}: {}", g.name, g.message)))
        .chain(s.warnings.iter().cloned())
        .chain(s.model_warnings.iter().cloned())
        .collect();
    if !notes.is_empty() {
        put!(out, "<ul>");
        for note in notes {
            put!(out, "<li>{}</li>", escape(&note));
        }
        put!(out, "</ul>");
    }
    put!(out, "</div>");
}

/// A number with about four significant digits.
fn number(x: f64) -> String {
    let size = x.abs();
    if !x.is_finite() {
        x.to_string()
    } else if size >= 1e6 || (size > 0.0 && size < 1e-3) {
        format!("{x:.3e}")
    } else if size >= 100.0 {
        format!("{x:.1}")
    } else {
        format!("{x:.3}")
    }
}

fn comparison(out: &mut String, runs: &[PageRun<'_>]) {
    put!(
        out,
        "<h2>Do the runs agree?</h2><p>The first run minus each other run: differences of ln Z and of means in combined standard \
         errors, shift of the median of q in half-widths of the 68 % interval.</p>"
    );
    put!(
        out,
        "<table><thead><tr><th>run</th><th>converged</th><th>ln Z</th><th>\u{394} ln Z / \u{3c3}</th><th>q</th>\
         <th>shift of q</th><th>largest difference</th><th>ESS</th><th>calls</th><th>gradients</th><th>CPU [s]</th></tr></thead><tbody>"
    );
    let dash = || "\u{2013}".to_owned();
    for run in runs {
        let (s, c) = (run.summary, run.comparison);
        let q = c.and_then(|c| c.marginals.iter().find(|m| m.name == "q"));
        let worst = c.and_then(Comparison::worst_marginal);
        put!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{:.2} \u{b1} {:.2}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>\
             <td>{:.0}</td><td>{}</td><td>{}</td><td>{:.1}</td></tr>",
            escape(run.name),
            if s.converged { "yes" } else { "NO" },
            s.ln_z.value,
            s.ln_z.error,
            c.map_or_else(dash, |c| format!("{:+.1}", c.ln_z_sigma)),
            s.q.as_ref()
                .map_or_else(dash, |q| format!("{:.3}", q.median)),
            q.map_or_else(dash, |q| format!("{:+.2}", q.shift)),
            worst.map_or_else(dash, |m| format!("{} {:+.2}", escape(&m.name), m.sigma)),
            s.ess,
            s.cost.calls,
            s.cost.gradients,
            s.cost.cpu_seconds
        );
    }
    put!(out, "</tbody></table>");
}

fn figures(out: &mut String, figures: &[(String, String)]) {
    for (caption, svg) in figures {
        put!(
            out,
            "<figure>{svg}<figcaption>{}</figcaption></figure>",
            escape(caption)
        );
    }
}

fn evidence(out: &mut String, s: &Summary) {
    put!(out, "<table><tbody>");
    let row = |out: &mut String, name: &str, value: String| {
        put!(
            out,
            "<tr><td>{name}</td><td class=\"words\">{}</td></tr>",
            escape(&value)
        );
    };
    row(
        out,
        "ln Z",
        format!("{} \u{b1} {}", number(s.ln_z.value), number(s.ln_z.error)),
    );
    for (name, x) in &s.ln_z_estimates {
        row(out, &format!("ln Z by {}", escape(name)), number(*x));
    }
    row(out, "information [nat]", number(s.information));
    row(out, "effective sample size", format!("{:.0}", s.ess));
    row(
        out,
        "cost",
        format!(
            "{} calls, {} gradients, {} s of CPU, {} s of wall time",
            s.cost.calls,
            s.cost.gradients,
            number(s.cost.cpu_seconds),
            number(s.cost.wall_seconds)
        ),
    );
    if !s.cost.rejected.is_empty() {
        let causes: Vec<String> = s
            .cost
            .rejected
            .iter()
            .map(|(cause, n)| format!("{cause} {n}"))
            .collect();
        row(out, "rejected points", causes.join(", "));
    }
    for (name, x) in &s.diagnostics {
        row(out, &escape(name), number(*x));
    }
    put!(out, "</tbody></table>");
}

fn parameters(out: &mut String, s: &Summary) {
    put!(
        out,
        "<table><thead><tr><th>parameter</th><th>unit</th><th>median</th><th>68 %</th><th>95 %</th><th>R-hat</th></tr></thead><tbody>"
    );
    let row = |out: &mut String, name: &str, i: &Interval, r_hat: Option<&f64>| {
        put!(
            out,
            "<tr><td>{}</td><td class=\"words\">{}</td><td>{}</td><td>[{}, {}]</td><td>[{}, {}]</td><td>{}</td></tr>",
            escape(name),
            escape(&i.unit),
            number(i.median),
            number(i.lo68),
            number(i.hi68),
            number(i.lo95),
            number(i.hi95),
            r_hat.map_or_else(|| "\u{2013}".to_owned(), |r| format!("{r:.3}"))
        );
    };
    for (k, (name, interval)) in s.parameters.iter().enumerate() {
        row(out, name, interval, s.r_hat.get(k));
    }
    for (name, interval) in &s.derived {
        row(out, name, interval, None);
    }
    put!(out, "</tbody></table>");
}

fn modes(out: &mut String, s: &Summary) {
    let Some(modes) = &s.modes else { return };
    put!(
        out,
        "<table><thead><tr><th>orientation mode</th><th>weight</th><th>error</th></tr></thead><tbody>"
    );
    let sign = |positive| if positive { "+" } else { "\u{2212}" };
    for m in modes {
        put!(
            out,
            "<tr><td>dir_x {}, dir_y {}, {}</td><td>{:.4}</td><td>{:.4}</td></tr>",
            sign(m.mode.dir_x_positive),
            sign(m.mode.dir_y_positive),
            if m.mode.prolate { "prolate" } else { "oblate" },
            m.probability.weight,
            m.probability.error
        );
    }
    put!(out, "</tbody></table>");
}

fn streams(out: &mut String, s: &Summary) {
    let Some(population) = &s.population else {
        return;
    };
    put!(
        out,
        "<table><thead><tr><th>stream</th><th>q in its fit</th><th>68 %</th><th>q given the population</th><th>68 %</th>\
         <th>effective draws</th><th>Pareto k</th><th>variance of ln L</th></tr></thead><tbody>"
    );
    for stream in &population.streams {
        let (own, given) = (&stream.q, &stream.q_given_population);
        put!(
            out,
            "<tr><td>{}</td><td>{}</td><td>[{}, {}]</td><td>{}</td><td>[{}, {}]</td><td>{:.0}</td><td>{}</td><td>{}</td></tr>",
            escape(&stream.name),
            number(own.median),
            number(own.lo68),
            number(own.hi68),
            number(given.median),
            number(given.lo68),
            number(given.hi68),
            stream.effective_draws,
            number(stream.pareto_k),
            number(stream.ln_likelihood_variance)
        );
    }
    put!(out, "</tbody></table>");
}

/// How the hyperparameters move without each stream.
fn influence(out: &mut String, s: &Summary) {
    let Some(population) = &s.population else {
        return;
    };
    let Some((_, first)) = population.left_out().next() else {
        return;
    };
    if let Some(sentence) = population.influence() {
        put!(out, "<p>{}</p>", escape(&sentence));
    }
    let names = first.parameters.iter().map(|(name, _)| {
        let name = escape(name);
        format!("<th>{name}</th><th>move</th><th>width ratio</th>")
    });
    put!(
        out,
        "<table><thead><tr><th>without</th>{}<th>ln predictive density</th><th>Pareto k</th></tr></thead><tbody>",
        names.collect::<String>()
    );
    for (stream, without) in population.left_out() {
        let cells = without.parameters.iter().map(|(_, moved)| {
            format!(
                "<td>{} &plusmn; {}</td><td>{:+.2}</td><td>{:.2}</td>",
                number(moved.mean),
                number(moved.sd),
                moved.mean_move,
                moved.width_ratio
            )
        });
        put!(
            out,
            "<tr><td>{}</td>{}<td>{:+.2}</td><td>{}</td></tr>",
            escape(&stream.name),
            cells.collect::<String>(),
            without.ln_predictive_density,
            number(without.pareto_k)
        );
    }
    put!(out, "</tbody></table>");
}

/// The posterior predictive check of a population.
fn predictive(out: &mut String, s: &Summary) {
    let quantities = s.population.iter().flat_map(|p| &p.predictive);
    let rows: String = quantities
        .map(|quantity| {
            let cells = [&quantity.streams, &quantity.population].map(|i| {
                let [median, lo, hi] = [i.median, i.lo95, i.hi95].map(number);
                format!("<td>{median}</td><td>[{lo}, {hi}]</td>")
            });
            format!(
                "<tr><td>{} of q</td>{}<td>{}</td></tr>",
                escape(&quantity.name),
                cells.concat(),
                number(quantity.p_value)
            )
        })
        .collect();
    if rows.is_empty() {
        return;
    }
    put!(
        out,
        "<table><thead><tr><th>predictive check</th><th>streams</th><th>95 %</th><th>population</th><th>95 %</th><th>p-value</th></tr></thead>\
         <tbody>{rows}</tbody></table>"
    );
}

fn checks(out: &mut String, s: &Summary) {
    put!(
        out,
        "<table><thead><tr><th>check</th><th>value</th><th>limit</th><th>passed</th><th>meaning</th></tr></thead><tbody>"
    );
    for g in s.checks.iter().chain(&s.model_checks) {
        put!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"words\">{}</td></tr>",
            escape(&g.name),
            number(g.value),
            number(g.limit),
            if g.pass { "yes" } else { "NO" },
            escape(&g.message)
        );
    }
    put!(out, "</tbody></table>");
}

fn again(out: &mut String, run: &PageRun<'_>) {
    let s = run.summary;
    put!(out, "<h3>How to make it again</h3>");
    put!(
        out,
        "<pre>{}\nseed {}, oblate {}, random streams version {}, inputs {}</pre>",
        escape(&s.command),
        s.seed,
        escape(&s.version),
        s.stream_version,
        escape(&s.input_hash)
    );
    put!(
        out,
        "<details><summary>config.toml</summary><pre>{}</pre></details>",
        escape(run.config)
    );
}
