//! The report: one self-contained HTML file that prints as it is displayed: verdicts and contents first, then the runs, grouped by track.

use super::label::sign;
use super::text::{escape, html, prose};
use crate::posterior::{Comparison, Interval, Summary};
use std::fmt::Write;

/// A figure on the page.
#[derive(Clone, Debug)]
pub struct Figure {
    /// What it shows.
    pub caption: String,
    /// The figure itself.
    pub svg: String,
}

/// One run on the page.
#[derive(Clone, Copy, Debug)]
pub struct PageRun<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its summary.
    pub summary: &'a Summary,
    /// Comparison of the first run of its group with this one; `None` for the first, and where the parameters differ.
    pub comparison: Option<&'a Comparison>,
    /// Its `config.toml`.
    pub config: &'a str,
    /// Its figures.
    pub figures: &'a [Figure],
}

/// Runs of the same data: fits of one track, or populations of the same streams.
#[derive(Clone, Debug)]
pub struct Group<'a> {
    /// What they have in common: the name of the track.
    pub name: String,
    /// The runs.
    pub runs: Vec<PageRun<'a>>,
    /// Figures of all of them together.
    pub figures: &'a [Figure],
}

/// The style of the page.
const STYLE: &str = include_str!("page.css");

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

/// The page: the verdict of every run, contents, then each group with the comparison of its runs and each run in full.
#[must_use]
pub fn page(title: &str, groups: &[Group<'_>]) -> String {
    let mut out = HEAD.to_owned();
    put!(
        out,
        "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">"
    );
    put!(
        out,
        "<title>{}</title><style>{STYLE}</style></head><body>",
        escape(title)
    );
    put!(out, "<h1>{}</h1>", escape(title));
    for (g, group) in groups.iter().enumerate() {
        for (r, run) in group.runs.iter().enumerate() {
            verdict(&mut out, run, &run_anchor(g, r));
        }
    }
    contents(&mut out, groups);
    for (g, group) in groups.iter().enumerate() {
        heading(&mut out, "h2", &group_anchor(g), &group.name);
        if group.runs.len() > 1 {
            comparison(&mut out, &group.runs);
        }
        figures(&mut out, group.figures);
        for (r, run) in group.runs.iter().enumerate() {
            let s = run.summary;
            heading(&mut out, "h3", &run_anchor(g, r), run.name);
            notes(&mut out, s);
            parameters(&mut out, s);
            figures(&mut out, run.figures);
            modes(&mut out, s);
            streams(&mut out, s);
            influence(&mut out, s);
            predictive(&mut out, s);
            evidence(&mut out, s);
            model_error(&mut out, s);
            checks(&mut out, s);
            again(&mut out, run);
        }
    }
    put!(out, "</body></html>");
    out
}

fn group_anchor(group: usize) -> String {
    format!("group-{}", group + 1)
}

fn run_anchor(group: usize, run: usize) -> String {
    format!("{}-run-{}", group_anchor(group), run + 1)
}

/// A heading that is a link to itself.
fn heading(out: &mut String, level: &str, anchor: &str, text: &str) {
    put!(
        out,
        "<{level} id=\"{anchor}\"><a href=\"#{anchor}\">{}</a></{level}>",
        escape(text)
    );
}

fn contents(out: &mut String, groups: &[Group<'_>]) {
    put!(out, "<nav aria-label=\"Contents\"><h2>Contents</h2><ul>");
    for (g, group) in groups.iter().enumerate() {
        let runs = group.runs.iter().enumerate().map(|(r, run)| {
            let name = escape(run.name);
            format!("<li><a href=\"#{}\">{name}</a></li>", run_anchor(g, r))
        });
        put!(
            out,
            "<li><a href=\"#{}\">{}</a><ul>{}</ul></li>",
            group_anchor(g),
            escape(&group.name),
            runs.collect::<String>()
        );
    }
    put!(out, "</ul></nav>");
}

fn verdict(out: &mut String, run: &PageRun<'_>, anchor: &str) {
    let s = run.summary;
    let model = s.model_checks.iter().all(|check| check.pass);
    let measured = !s.population.as_ref().is_some_and(|p| p.measures_nothing());
    let class = if s.converged && model && measured {
        "verdict"
    } else {
        "verdict bad"
    };
    put!(
        out,
        "<div class=\"{class}\"><a href=\"#{anchor}\"><b>{}</b></a>: {} {} {}",
        escape(run.name),
        prose(&s.verdict()),
        prose(&s.model_verdict().unwrap_or_default()),
        prose(&s.measured_verdict().unwrap_or_default())
    );
    if let Some(q) = &s.q {
        put!(
            out,
            " <i>q</i> = {:.3}, 68 % in [{:.3}, {:.3}], 95 % in [{:.3}, {:.3}].",
            q.median,
            q.lo68,
            q.hi68,
            q.lo95,
            q.hi95
        );
    }
    put!(out, "</div>");
}

/// What was assumed, what failed and what helps, and warnings.
fn notes(out: &mut String, s: &Summary) {
    let failed = s.checks.iter().chain(&s.model_checks).filter(|g| !g.pass);
    let assumed = s.assumptions.iter().map(|a| format!("Assumed: {a}"));
    let notes: String = assumed
        .chain(failed.map(|g| format!("{}: {}", g.name, g.message)))
        .chain(s.warnings.iter().cloned())
        .chain(s.model_warnings.iter().cloned())
        .map(|note| format!("<li>{}</li>", prose(&note)))
        .collect();
    if !notes.is_empty() {
        put!(out, "<ul>{notes}</ul>");
    }
}

/// A number with about four significant digits; whole numbers as they are.
fn number(x: f64) -> String {
    let size = x.abs();
    let text = if !x.is_finite() {
        x.to_string()
    } else if size >= 1e6 || (size > 0.0 && size < 1e-3) {
        format!("{x:.3e}")
    } else if x.fract().abs() < f64::MIN_POSITIVE {
        format!("{x:.0}")
    } else if size >= 100.0 {
        format!("{x:.1}")
    } else {
        format!("{x:.3}")
    };
    minus(&text)
}

/// A number as text, with the sign of typography.
fn minus(text: &str) -> String {
    text.replace('-', "\u{2212}")
}

/// A table, which can be moved sideways where it is wider than the screen.
fn table(out: &mut String, head: &str, rows: &str) {
    table_of(out, "", head, rows);
}

/// A table of a class of the style sheet.
fn table_of(out: &mut String, class: &str, head: &str, rows: &str) {
    if !rows.is_empty() {
        put!(
            out,
            "<div class=\"scroll\"><table class=\"{class}\"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
        );
    }
}

fn comparison(out: &mut String, runs: &[PageRun<'_>]) {
    put!(
        out,
        "<h4>Do the runs agree?</h4><p>The first run minus each other run: differences of ln <i>Z</i> and of means in combined standard \
         errors, shift of the median of <i>q</i> in half-widths of the 68 % interval.</p>"
    );
    if runs
        .iter()
        .any(|run| run.comparison.is_some_and(|c| !c.one_model))
    {
        put!(
            out,
            "<p>A run with <i>odds</i> is of another host or family than the first, or has another prior or other errors of the data, and need not agree with it: exp(\u{394} ln <i>Z</i>) are the odds for the \
             first, if both were equally probable before.</p>"
        );
    }
    let dash = || "\u{2013}".to_owned();
    let row = |run: &PageRun<'_>| {
        let (s, c) = (run.summary, run.comparison);
        let q = c.and_then(|c| c.marginals.iter().find(|m| m.name == "q"));
        let worst = c.and_then(Comparison::worst_marginal);
        format!(
            "<tr><td class=\"together\">{}</td><td>{}</td><td class=\"together\">{} \u{b1} {:.2}</td><td>{}</td><td>{}</td><td>{}</td>\
             <td class=\"together\">{}</td><td>{:.0}</td><td>{}</td><td>{}</td><td>{:.1}</td></tr>",
            escape(run.name),
            if s.converged { "yes" } else { "NO" },
            minus(&format!("{:.2}", s.ln_z.value)),
            s.ln_z.error,
            c.map_or_else(dash, delta_ln_z),
            s.q.as_ref()
                .map_or_else(dash, |q| format!("{:.3}", q.median)),
            q.map_or_else(dash, |q| minus(&format!("{:+.2}", q.shift))),
            worst.map_or_else(dash, |m| {
                let difference = minus(&format!("{:+.2}", m.sigma));
                format!("{} {difference}", html(&sign(&m.name, "").0))
            }),
            s.ess,
            s.cost.calls,
            s.cost.gradients,
            s.cost.cpu_seconds
        )
    };
    let rows: String = runs.iter().map(row).collect();
    table(
        out,
        "<th>run</th><th>converged</th><th>ln <i>Z</i></th><th class=\"together\">\u{394} ln <i>Z</i> / \u{3c3}</th><th><i>q</i></th>\
         <th>shift of <i>q</i></th><th>largest difference</th><th>effective draws</th><th>calls</th><th>gradients</th><th>CPU [s]</th>",
        &rows,
    );
}

/// The difference of ln Z: of one model in standard errors, of two as it is.
fn delta_ln_z(c: &Comparison) -> String {
    if c.one_model {
        return minus(&format!("{:+.1}", c.ln_z_sigma));
    }
    let [a, b] = &c.ln_z;
    let difference = minus(&format!("{:+.2}", a.value - b.value));
    format!("odds: {difference} \u{b1} {:.2}", a.error.hypot(b.error))
}

fn figures(out: &mut String, figures: &[Figure]) {
    for Figure { caption, svg } in figures {
        put!(
            out,
            "<figure>{svg}<figcaption>{}</figcaption></figure>",
            escape(caption)
        );
    }
}

/// Words for the numbers of the best fit; others have their own name.
const NUMBERS: [(&str, &str); 15] = [
    ("best_fit_chi2", "\u{3c7}\u{b2} of the best fit"),
    ("best_fit_bins", "bins of the track"),
    (
        "posterior_predictive_p",
        "posterior predictive p of \u{3c7}\u{b2}",
    ),
    (
        "best_fit_chi2_velocity",
        "\u{3c7}\u{b2} of the best fit by velocities",
    ),
    ("best_fit_velocities", "bins with a velocity"),
    (
        "best_fit_chi2_star_velocity",
        "\u{3c7}\u{b2} of the best fit by velocities of stars",
    ),
    ("best_fit_star_velocities", "stars with a velocity"),
    (
        "best_fit_chi2_width",
        "\u{3c7}\u{b2} of the best fit by widths",
    ),
    ("best_fit_widths", "bins with a width"),
    (
        "best_fit_chi2_density",
        "\u{3c7}\u{b2} of the best fit by densities",
    ),
    ("best_fit_densities", "bins with a density"),
    (
        "star_scatter",
        "variance of means over the stars of bins, by the best fit, over that of the data",
    ),
    (
        "least_density_msun_kpc3",
        "host's density at the progenitor's radius, on the halo's symmetry axis or across it [M\u{2299} kpc\u{207b}\u{b3}]",
    ),
    (
        "bounded_tidal_radius",
        "releases whose tidal radius was bounded",
    ),
    (
        "ambiguous_windings",
        "eighths of particle steps whose winding is ambiguous",
    ),
];

/// The numbers behind the model's checks, of shorter steps and of more particles.
const MODEL_ERRORS: [(&str, &str); 6] = [
    ("ln_likelihood_shift", "median change of ln L"),
    (
        "ln_likelihood_spread",
        "half of the 68 % range of the change of ln L",
    ),
    (
        "q_shift",
        "move of the mean of q, in half-widths of its 68 % interval",
    ),
    ("q_shift_error", "standard error of this move"),
    (
        "q_width_change",
        "relative change of the width of this interval",
    ),
    ("rejected", "fraction of the draws that are rejected"),
];

/// The two changes of the model by which its error is measured, as they begin the names of numbers.
const CHANGES: [(&str, &str); 2] = [("steps", "shorter steps"), ("particles", "more particles")];

fn evidence(out: &mut String, s: &Summary) {
    put!(out, "<h4>Evidence and cost</h4>");
    let mut rows = String::new();
    let mut row = |name: &str, value: String| {
        put!(
            rows,
            "<tr><td>{}</td><td class=\"words\">{}</td></tr>",
            escape(name),
            escape(&value)
        );
    };
    row(
        "ln Z",
        format!("{} \u{b1} {}", number(s.ln_z.value), number(s.ln_z.error)),
    );
    for (name, x) in &s.ln_z_estimates {
        row(&format!("ln Z by {name}"), number(*x));
    }
    row("information [nat]", number(s.information));
    row("effective draws", format!("{:.0}", s.ess));
    row(
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
        let rejected = s.cost.rejected.iter();
        let causes: Vec<String> = rejected.map(|(cause, n)| format!("{cause} {n}")).collect();
        row("rejected points", causes.join(", "));
    }
    let of_model = |name: &str| CHANGES.iter().any(|(start, _)| name.starts_with(start));
    for (name, x) in s.diagnostics.iter().filter(|(name, _)| !of_model(name)) {
        let words = NUMBERS.iter().find(|(key, _)| key == name);
        row(words.map_or(name.as_str(), |(_, words)| words), number(*x));
    }
    table(
        out,
        "<th>quantity</th><th class=\"words\">value</th>",
        &rows,
    );
}

/// How much the posterior changes with a better model.
fn model_error(out: &mut String, s: &Summary) {
    let mut rows = String::new();
    for (end, words) in MODEL_ERRORS {
        let values = CHANGES.map(|(start, _)| s.diagnostics.get(&format!("{start}_{end}")));
        if values.iter().any(Option::is_some) {
            let cell = |x: Option<&f64>| x.map_or_else(|| "\u{2013}".to_owned(), |x| number(*x));
            let cells = values.map(|x| format!("<td>{}</td>", cell(x))).concat();
            put!(rows, "<tr><td>{words}</td>{cells}</tr>");
        }
    }
    if !rows.is_empty() {
        let heads = CHANGES.map(|(_, words)| format!("<th>{words}</th>"));
        put!(out, "<h4>Error of the model</h4>");
        table(out, &format!("<th>with</th>{}", heads.concat()), &rows);
    }
}

/// Intervals; the columns of units and of R-hat are there where a quantity has one.
fn parameters(out: &mut String, s: &Summary) {
    let mut all = s.parameters.iter().chain(&s.derived);
    let has_units = all.any(|(name, interval)| !sign(name, &interval.unit).1.is_empty());
    let with_r_hat = |cell: String| {
        if s.r_hat.is_empty() {
            String::new()
        } else {
            cell
        }
    };
    let with_units = |cell: String| if has_units { cell } else { String::new() };
    let row = |name: &str, i: &Interval, r_hat: Option<&f64>| {
        let (symbol, unit) = sign(name, &i.unit);
        format!(
            "<tr><td class=\"together\">{}</td><td class=\"name\">{}</td>{}<td>{}</td><td>[{}, {}]</td><td>[{}, {}]</td>{}</tr>",
            html(&symbol),
            escape(name),
            with_units(format!("<td>{}</td>", html(&unit))),
            number(i.median),
            number(i.lo68),
            number(i.hi68),
            number(i.lo95),
            number(i.hi95),
            with_r_hat(format!(
                "<td>{}</td>",
                r_hat.map_or_else(|| "\u{2013}".to_owned(), |r| format!("{r:.3}"))
            ))
        )
    };
    let free = s.parameters.iter().enumerate();
    let mut rows: String = free
        .map(|(k, (name, interval))| row(name, interval, s.r_hat.get(k)))
        .collect();
    rows.extend((s.derived.iter()).map(|(name, interval)| row(name, interval, None)));
    table(
        out,
        &format!(
            "<th>quantity</th><th class=\"words name\">name in files</th>{}<th>median</th><th>68 %</th><th>95 %</th>{}",
            with_units("<th>unit</th>".to_owned()),
            with_r_hat("<th>R-hat</th>".to_owned()),
        ),
        &rows,
    );
}

fn modes(out: &mut String, s: &Summary) {
    let sign = |positive| if positive { "+" } else { "\u{2212}" };
    let modes = s.modes.iter().flatten();
    let rows: String = modes
        .map(|m| {
            format!(
                "<tr><td>{}</td><td>{}</td><td>{}</td><td>{:.4} \u{b1} {:.4}</td></tr>",
                if m.mode.prolate { "prolate" } else { "oblate" },
                sign(m.mode.dir_x_positive),
                sign(m.mode.dir_y_positive),
                m.probability.weight,
                m.probability.error
            )
        })
        .collect();
    table(
        out,
        "<th>orientation mode</th><th>sign of <i>n</i><sub>x</sub></th><th>sign of <i>n</i><sub>y</sub></th><th>weight</th>",
        &rows,
    );
}

fn streams(out: &mut String, s: &Summary) {
    let Some(population) = &s.population else {
        return;
    };
    let mut rows = String::new();
    for stream in &population.streams {
        let (own, given) = (&stream.q, &stream.q_given_population);
        put!(
            rows,
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
    table(
        out,
        "<th>stream</th><th><i>q</i> in its fit</th><th>68 %</th><th><i>q</i> given the population</th><th>68 %</th>\
         <th>effective draws</th><th>Pareto k</th><th>variance of ln <i>L</i></th>",
        &rows,
    );
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
        let name = html(&sign(name, "").0);
        format!("<th>{name}</th><th>move</th><th>width ratio</th>")
    });
    let head = format!(
        "<th>without</th>{}<th>ln predictive density</th><th>Pareto k</th>",
        names.collect::<String>()
    );
    let mut rows = String::new();
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
            rows,
            "<tr><td>{}</td>{}<td>{:+.2}</td><td>{}</td></tr>",
            escape(&stream.name),
            cells.collect::<String>(),
            without.ln_predictive_density,
            number(without.pareto_k)
        );
    }
    table(out, &head, &rows);
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
    table(
        out,
        "<th>predictive check</th><th>streams</th><th>95 %</th><th>population</th><th>95 %</th><th>p-value</th>",
        &rows,
    );
}

fn checks(out: &mut String, s: &Summary) {
    put!(out, "<h4>Checks</h4>");
    let all = s.checks.iter().chain(&s.model_checks);
    let rows: String = all
        .map(|g| {
            format!(
                "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"words\">{}</td></tr>",
                escape(&g.name),
                number(g.value),
                number(g.limit),
                if g.pass { "yes" } else { "NO" },
                prose(&g.message)
            )
        })
        .collect();
    table_of(
        out,
        "checks",
        "<th>check</th><th>value</th><th>limit</th><th>passed</th><th class=\"words\">meaning</th>",
        &rows,
    );
}

fn again(out: &mut String, run: &PageRun<'_>) {
    let s = run.summary;
    // A function of the Python package has its full name.
    let program = if s.command.starts_with("oblate.") {
        ""
    } else {
        "oblate "
    };
    put!(out, "<h4>How to make it again</h4>");
    put!(
        out,
        "<pre>{program}{}\nseed {}, oblate {}, random streams version {}, inputs {}</pre>",
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
