//! The page: its contents, its verdicts and its comparison of runs.

use super::{keep, one_group};
use crate::runs;
use oblate::posterior::{Summary, SummaryContext, compare};
use oblate::report::{Figure, Group, PageRun, diagnostics, page};
use oblate_samplers::output::{Check, Run, Status};

#[test]
fn the_contents_lead_to_every_group_and_run_and_groups_of_one_run_compare_nothing() {
    let summary = Summary::new(&runs::nested(500, 3), &SummaryContext::default());
    let run = |name| PageRun {
        name,
        summary: &summary,
        comparison: None,
        config: "",
        figures: &[],
    };
    let groups = [("one track", "a"), ("another", "b"), ("population", "c")];
    let groups = groups.map(|(name, only)| Group {
        name: name.to_owned(),
        runs: vec![run(only)],
        figures: &[],
    });
    let html = page("three groups", &groups);
    let targets: Vec<&str> = html
        .split("href=\"#")
        .skip(1)
        .map(|rest| rest.split('"').next().unwrap())
        .collect();
    // Each group and run in the contents and at its heading, and each run at its verdict.
    assert_eq!(targets.len(), 3 * 2 + 3 * 3);
    for target in targets {
        assert_eq!(
            html.matches(&format!("id=\"{target}\"")).count(),
            1,
            "{target}"
        );
    }
    assert!(!html.contains("Do the runs agree?"));
    let together = [Group {
        name: "one track".to_owned(),
        runs: vec![run("a"), run("b")],
        figures: &[],
    }];
    assert!(page("one group", &together).contains("Do the runs agree?"));
}

#[test]
fn the_page_shows_the_comparison_with_the_first_run() {
    let mut other = runs::nested(2000, 9);
    other.evidence.ln_z += 1.0;
    let first = runs::nested(2000, 9);
    let comparison = compare("a", &first, "b", &other).unwrap();
    assert!((comparison.ln_z_sigma + 1.0 / 0.125_f64.hypot(0.125)).abs() < 1e-12);
    let of = |run: &Run| Summary::new(run, &SummaryContext::default());
    let (a, b) = (of(&first), of(&other));
    let shown = |name, summary, comparison| PageRun {
        name,
        summary,
        comparison,
        config: "",
        figures: &[],
    };
    let html = one_group(
        "two runs",
        &[shown("a", &a, None), shown("b", &b, Some(&comparison))],
    );
    let rows: Vec<&str> = html.split("<tr><td class=\"together\">").collect();
    let row = rows.iter().find(|row| row.starts_with("b</td>")).unwrap();
    assert!(
        row.contains("<td>\u{2212}5.7</td>") && row.contains("<td>+0.00</td>"),
        "{row}"
    );
}

#[test]
fn page_says_first_that_a_run_has_not_converged_and_why() {
    let mut bad = runs::tempered(2000, 6);
    bad.status = Status::BudgetSpent;
    bad.checks.push(Check::at_most(
        "r_hat",
        1.2,
        1.01,
        "chains <disagree>; run longer",
    ));
    let good = runs::nested(4000, 5);
    let of = |run: &Run| {
        let context = SummaryContext {
            command: "oblate fit track.ecsv --seed 5".to_owned(),
            model_checks: vec![Check::at_most("steps-q", 0.7, 0.5, "shorter <steps>")],
            ..SummaryContext::default()
        };
        Summary::new(run, &context)
    };
    let (a, b) = (of(&good), of(&bad));
    let drawn = |run: &Run| {
        vec![Figure {
            caption: "Diagnostics of the sampler.".to_owned(),
            svg: diagnostics(run),
        }]
    };
    let (fa, fb) = (drawn(&good), drawn(&bad));
    let runs_shown = [
        PageRun {
            name: "nested",
            summary: &a,
            comparison: None,
            config: "seed = 5\n",
            figures: &fa,
        },
        PageRun {
            name: "pt-hmc",
            summary: &b,
            comparison: None,
            config: "seed = 6\n",
            figures: &fb,
        },
    ];
    let html = one_group("NGC 0000 south", &runs_shown);
    assert!(html.contains("MODEL NOT ACCURATE ENOUGH: 1 of 1 checks failed (steps-q)."));
    assert!(html.contains("<li>steps-q: shorter &lt;steps&gt;</li>"));
    keep("page.html", &html);
    let body = html.split("<body>").nth(1).unwrap();
    let verdict = body.find("NOT CONVERGED").unwrap();
    assert!(verdict < body.find("<table").unwrap() && verdict < body.find("<svg").unwrap());
    assert!(body.contains("chains &lt;disagree&gt;; run longer"));
    assert!(body.contains("before the end; resume it") && body.contains("--seed 5"));
    // Self-contained: no address except the namespace of SVG.
    let addresses = html.matches("http").count();
    assert_eq!(
        addresses,
        html.matches("http://www.w3.org/2000/svg").count()
    );
    assert!(!html.contains("<script") && !html.contains("<link") && !html.contains("src="));
    for name in runs::PARAMETERS.iter().map(|p| p.0) {
        assert!(html.contains(name), "{name}");
    }
}
