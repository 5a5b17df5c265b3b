//! Figures and the page: what they must contain, counted in their text. `OBLATE_FIGURES=folder` keeps the figures drawn here.

mod corner;
mod diagnostics;
mod fit;
mod measured;
mod modes;
mod names;
mod page;
mod population;
mod q_posterior;

use crate::runs;
use oblate::data::ObservedTrack;
use oblate::posterior::columns;
use oblate::report::{CornerColumn, Curve, Group, PageRun};
use oblate_samplers::output::Run;
use oblate_samplers::rng::{Domain, standard_normal, stream};

/// Checks a figure for what no figure may have; keeps it if `OBLATE_FIGURES` is set.
fn sound(name: &str, svg: String) -> String {
    for bad in ["NaN", "inf", "<image", "href", "font-face"] {
        assert!(!svg.contains(bad), "{name} has {bad}");
    }
    assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
    assert_eq!(svg.matches("<svg").count(), svg.matches("</svg>").count());
    let document = roxmltree::Document::parse(&svg);
    assert!(document.is_ok(), "{name}: {document:?}");
    assert!(svg.contains("<title>"));
    keep(&format!("{name}.svg"), &svg);
    svg
}

/// Writes a file into the folder that `OBLATE_FIGURES` names, if it is set.
fn keep(name: &str, text: &str) {
    if let Ok(folder) = std::env::var("OBLATE_FIGURES") {
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(std::path::Path::new(&folder).join(name), text).unwrap();
    }
}

/// A curve with noise of its error: 12 bins with one missing, whose truth is `r = 60 + phi/5 + phi^2/150`.
fn track() -> (ObservedTrack, Curve, Vec<Curve>) {
    let truth = |phi: f64| 60.0 + 0.2 * phi + phi * phi / 150.0;
    let phi: Vec<f64> = (-6..7)
        .filter(|k| *k != 2)
        .map(|k| (f64::from(k) + 0.5) * 10.0)
        .collect();
    let mut rng = stream(5, Domain::Test, 0, 0);
    let r: Vec<f64> = phi
        .iter()
        .map(|p| truth(*p) * (1.0 + 0.02 * standard_normal(&mut rng)))
        .collect();
    let data = ObservedTrack::new(
        "NGC 0000 south",
        &phi,
        10.0,
        &r,
        &r.iter().map(|r| 0.02 * r).collect::<Vec<_>>(),
    )
    .unwrap();
    let grid: Vec<f64> = (-8..9).map(|k| (f64::from(k) + 0.5) * 10.0).collect();
    let model = |shift: f64, tilt: f64| Curve {
        phi_deg: grid.clone(),
        values: grid.iter().map(|p| truth(*p) + shift + tilt * p).collect(),
    };
    let draws = (0..200)
        .map(|_| {
            model(
                0.4 * standard_normal(&mut rng),
                0.02 * standard_normal(&mut rng),
            )
        })
        .collect();
    (data, model(0.0, 0.0), draws)
}

fn corner_columns(run: &Run, count: usize) -> Vec<CornerColumn> {
    columns(run)
        .into_iter()
        .take(count)
        .enumerate()
        .map(|(i, column)| CornerColumn {
            truth: runs::PARAMETERS.get(i).map(|p| p.2),
            ess: run.draws.len() as f64,
            column,
        })
        .collect()
}

/// A page of runs of one track.
fn one_group(name: &str, runs: &[PageRun<'_>]) -> String {
    let group = Group {
        name: name.to_owned(),
        runs: runs.to_vec(),
        figures: &[],
    };
    oblate::report::page(name, &[group])
}
