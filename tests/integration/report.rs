//! Figures and the page: what they must contain, counted in their text. `OBLATE_FIGURES=folder` keeps the figures drawn here.

use crate::runs;
use oblate::data::{Measured, ObservedTrack};
use oblate::params::QPrior;
use oblate::population::PopulationDensity;
use oblate::posterior::{
    Column, Interval, MeanWithoutStream, PopulationSummary, StreamInPopulation, Summary,
    SummaryContext, WithoutStream, columns, compare, mode_weights, modes_of_draws,
};
use oblate::potential::{HaloParameters, SecondAxis};
use oblate::report::{
    CornerColumn, Curve, Figure, FitPicture, Group, MeasuredPicture, ModePicture, PageRun, QCurve,
    corner, diagnostics, influence, modes, outline, page, population_density, q_posterior,
    streams_of_population,
};
use oblate::scalar::Vec3;
use oblate::track::BinQuantity;
use oblate_samplers::output::{Check, Run, Status};
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

fn picture_of(particles: &[(f64, f64)]) -> String {
    let (data, best, draws) = track();
    FitPicture {
        track: &data,
        draws: &draws,
        best: &best,
        particles,
        phi_zero_deg: 0.0,
        progenitor_kpc: 60.0,
    }
    .svg()
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

#[test]
fn fit_overlay_shows_every_datum_and_its_residual() {
    let svg = sound("fit", picture_of(&[]));
    assert_eq!(svg.matches("class=\"datum\"").count(), 12);
    assert_eq!(svg.matches("class=\"residual\"").count(), 12);
    assert!(svg.contains("[kpc]<") && svg.contains("[deg]<") && svg.contains("NGC 0000 south"));
}

#[test]
fn a_figure_of_velocities_shows_those_that_are_measured() {
    let (mut data, best, draws) = track();
    let svg = |data: &ObservedTrack| {
        MeasuredPicture {
            track: data,
            quantity: BinQuantity::Velocity,
            draws: &draws,
            best: &best,
        }
        .svg()
    };
    assert_eq!(svg(&data), None);
    let velocity = |(i, r): (usize, &f64)| {
        (i % 3 == 0).then_some(Measured {
            value: *r,
            error: 2.0,
        })
    };
    let rows = data.r_kpc.iter().enumerate().map(velocity).collect();
    data.measured.insert(BinQuantity::Velocity, rows);
    let svg = sound("velocities", svg(&data).expect("a figure"));
    assert_eq!(svg.matches("class=\"datum\"").count(), 4);
    assert!(svg.contains("velocity") && svg.contains("[deg]<") && svg.contains("NGC 0000 south"));
}

/// The centres of the dots of a class.
fn places(svg: &str, class: &str) -> Vec<(f64, f64)> {
    let start = format!("<circle class=\"{class}\" ");
    let number = |text: &str| text.split('"').nth(1).unwrap().parse().unwrap();
    svg.split(&start)
        .skip(1)
        .map(|dot| (number(dot), number(dot.split_once("cy=").unwrap().1)))
        .collect()
}

#[test]
fn the_legend_of_a_fit_overlay_is_above_its_panels() {
    let svg = picture_of(&[(1.0, 2.0)]);
    let legend = places(&svg, "legend");
    assert_eq!(legend.len(), 3);
    let lowest = legend.iter().map(|(_, y)| *y).fold(0.0, f64::max);
    for class in ["datum", "residual", "sky-datum", "progenitor"] {
        let highest = places(&svg, class)
            .iter()
            .map(|(_, y)| *y)
            .fold(f64::INFINITY, f64::min);
        assert!(highest > lowest + 5.0, "{class}: {highest}, {lowest}");
    }
}

#[test]
fn the_outline_of_a_halo_is_that_of_the_projected_ellipsoid() {
    let extent_of = |halo: HaloParameters<f64>| {
        let points = outline(&halo, 10.0);
        let largest = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).fold(0.0, f64::max);
        [largest(|p| p.0.abs()), largest(|p| p.1.abs())]
    };
    let of = |axis: [f64; 3], q: f64| HaloParameters::from_q(1e12, 15.0, q, Vec3::from(axis));
    let extent = |axis: [f64; 3], q: f64| extent_of(of(axis, q));
    let near = |a: [f64; 2], b: [f64; 2]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.01);
    // Edge-on: the axis ratio itself, along the axis. Face-on: a circle. Between: by the inclination.
    assert!(near(extent([1.0, 0.0, 0.0], 0.5), [5.0, 10.0]));
    assert!(near(extent([0.0, 1.0, 0.0], 1.4), [10.0, 14.0]));
    assert!(near(extent([0.0, 0.0, 1.0], 0.5), [10.0, 10.0]));
    let inclined = extent([0.6, 0.0, 0.8], 0.5);
    assert!(
        near(inclined, [10.0 * 0.73_f64.sqrt(), 10.0]),
        "{inclined:?}"
    );
    // Three axes, p along x and q along the line of sight.
    let halo = HaloParameters {
        second: SecondAxis {
            flattening: 1.0 / (0.8 * 0.8) - 1.0,
            axis: Vec3::new(1.0, 0.0, 0.0),
        },
        ..of([0.0, 0.0, 1.0], 0.5)
    };
    assert!(near(extent_of(halo), [8.0, 10.0]));
}

#[test]
fn every_orientation_mode_is_a_panel_with_its_data() {
    let run = runs::nested(2000, 4);
    let of_draws = modes_of_draws(&run).unwrap();
    let weights = mode_weights(&run).unwrap();
    let each = run.draws.weights();
    for (index, mode) in weights.iter().enumerate() {
        let rows = (0..each.len()).filter(|row| of_draws[*row] == index);
        let weight: f64 = rows.map(|row| each[row]).sum();
        assert!((weight - mode.probability.weight).abs() < 1e-9);
    }
    let (data, best, _) = track();
    let pictures: Vec<ModePicture> = weights[..4]
        .iter()
        .map(|weight| ModePicture {
            weight: *weight,
            halo: HaloParameters::from_q(1e12, 15.0, 0.7, Vec3::new(0.6, 0.0, 0.8)),
            particles: vec![(50.0, 3.0); 20],
            curve: best.clone(),
            phi_zero_deg: 10.0,
        })
        .collect();
    let svg = sound("modes", modes(&data, &pictures).unwrap());
    assert_eq!(svg.matches("class=\"sky-datum\"").count(), 4 * 12);
    assert_eq!(svg.matches("class=\"particle\"").count(), 4 * 20);
    assert_eq!(svg.matches("stroke-dasharray=\"3 2\"").count(), 4 * 3);
    assert_eq!(modes(&data, &[]), None);
}

#[test]
fn the_density_of_uniform_draws_is_flat_to_the_ends_of_the_prior() {
    let q: Vec<f64> = (0..1000)
        .map(|i| 0.5 + (f64::from(i) + 0.5) / 1000.0)
        .collect();
    let height = |ess: f64| {
        let curve = QCurve {
            name: "uniform".to_owned(),
            weights: vec![1e-3; q.len()],
            q: q.clone(),
            ess,
        };
        let svg = q_posterior(&[curve], Some(QPrior::Uniform { lo: 0.5, hi: 1.5 }), None);
        let line = svg
            .lines()
            .find(|line| line.contains("fill=\"none\""))
            .unwrap();
        let d = line.split('"').nth(1).unwrap().trim_start_matches('M');
        let y = d
            .split('L')
            .map(|p| p.split_once(' ').unwrap().1.parse::<f64>().unwrap());
        let y: Vec<f64> = y.collect();
        // Without the two feet; the panel ends at 182 points.
        y[1..y.len() - 1]
            .iter()
            .map(|y| 182.0 - y)
            .collect::<Vec<_>>()
    };
    for ess in [50.0, 1000.0] {
        let heights = height(ess);
        let [lo, hi] = [f64::min, f64::max].map(|f| heights.iter().copied().reduce(f).unwrap());
        assert!(hi / lo < 1.02, "{ess}: {lo} {hi}");
    }
}

#[test]
fn fit_overlay_shows_the_sky_when_given_particles() {
    let particles: Vec<(f64, f64)> = (0..1500)
        .map(|i| {
            let mut rng = stream(6, Domain::Test, 0, i);
            let phi = 30.0 * standard_normal(&mut rng);
            let r = 60.0 + 0.2 * phi + phi * phi / 150.0 + 2.5 * standard_normal(&mut rng);
            (r * phi.to_radians().cos(), r * phi.to_radians().sin())
        })
        .collect();
    let svg = sound("fit_sky", picture_of(&particles));
    assert_eq!(svg.matches("class=\"particle\"").count(), 1500);
    assert_eq!(svg.matches("class=\"sky-datum\"").count(), 12);
    assert!(svg.contains(">x</tspan>") && svg.contains(">y</tspan>"));
}

#[test]
fn a_bin_that_the_best_fit_misses_is_crossed_not_drawn() {
    let (data, mut best, draws) = track();
    best.phi_deg.truncate(12);
    best.values.truncate(12);
    let missed = data.phi_deg.iter().filter(|p| **p > 35.0).count();
    assert!(missed > 0);
    let svg = FitPicture {
        track: &data,
        draws: &draws,
        best: &best,
        particles: &[],
        phi_zero_deg: 0.0,
        progenitor_kpc: 60.0,
    }
    .svg();
    let svg = sound("fit_missed", svg);
    assert_eq!(svg.matches("class=\"residual\"").count(), 12 - missed);
    assert_eq!(svg.matches('\u{d7}').count(), missed);
}

#[test]
fn corner_of_the_thirteen_and_q_has_all_panels_and_labels() {
    let run = runs::nested(6000, 21);
    let svg = sound(
        "corner",
        corner(&corner_columns(&run, 14), &run.draws.weights(), "corner"),
    );
    // 14 marginals and 91 pairs, each framed; one truth dot per pair of parameters, 13 of them.
    assert_eq!(svg.matches("<rect x=").count(), 14 + 91);
    assert_eq!(svg.matches("class=\"truth\"").count(), 13 * 12 / 2);
    assert!(svg.contains("[km s<") && svg.contains("[Gyr]") && svg.contains("[kpc]"));
}

#[test]
fn corner_of_a_population_has_three_panels() {
    let values = |k: u64, mean: f64, sd: f64| -> Vec<f64> {
        (0..3000)
            .map(|i| mean + sd * standard_normal(&mut stream(8, Domain::Test, k, i)))
            .collect()
    };
    let column = |name: &str, values: Vec<f64>, truth| CornerColumn {
        column: Column {
            name: name.to_owned(),
            unit: String::new(),
            values,
        },
        ess: 3000.0,
        truth: Some(truth),
    };
    let columns = [
        column("mu_pop", values(1, 0.9, 0.05), 0.92),
        column("sigma_pop", values(2, 0.2, 0.03), 0.18),
    ];
    let svg = sound("population", corner(&columns, &[1.0; 3000], "population"));
    assert_eq!(svg.matches("<rect x=").count(), 3);
    assert_eq!(svg.matches("class=\"truth\"").count(), 1);
}

#[test]
fn titles_of_a_corner_fit_above_their_panels_and_have_no_negative_zero() {
    let run = runs::nested(3000, 5);
    let titles = |count: usize| {
        let mut all = corner_columns(&run, count);
        all[0].column.values = (0..3000).map(|i| f64::from(i) * 1e-3 - 1.501).collect();
        let weights = [1.0; 3000];
        let svg = sound(&format!("corner_{count}"), corner(&all, &weights, "titles"));
        let texts = svg.split('>').filter(|text| text.contains(" \u{2212}"));
        let texts = texts.filter_map(|text| text.split('<').next());
        texts.map(str::to_owned).collect::<Vec<_>>()
    };
    assert!(titles(2)[0].starts_with("0.0 +1.0 "), "{:?}", titles(2));
    // Fourteen panels are narrow: the median has a line of its own.
    let narrow = titles(14);
    assert_eq!(narrow.len(), 14);
    for title in narrow {
        assert!(
            title.starts_with('+') && title.chars().count() <= 13,
            "{title}"
        );
    }
}

/// A constant column has no density to draw: the figure must still be valid.
#[test]
fn corner_of_a_constant_column_is_drawn() {
    let mut all = corner_columns(&runs::nested(300, 2), 2);
    all[0].column.values.fill(3.0);
    sound("corner_constant", corner(&all, &[1.0; 300], "constant"));
}

#[test]
fn regions_of_a_normal_hold_68_and_95_per_cent() {
    // Read off the drawing: for a round normal, the 68 % region has the area 2 pi ln(1 / 0.32) = 7.16 sd^2. The drawn
    // panel spans 5.5 sd and a margin; smoothing by 1.2 of 44 cells widens it by 2 %.
    let values = |k: u64| -> Vec<f64> {
        (0..40_000)
            .map(|i| standard_normal(&mut stream(9, Domain::Test, k, i)))
            .collect()
    };
    let columns = [1, 2].map(|k| CornerColumn {
        column: Column {
            name: format!("x{k}"),
            unit: String::new(),
            values: values(k),
        },
        ess: 40_000.0,
        truth: None,
    });
    let svg = corner(&columns, &vec![1.0; 40_000], "normal");
    let rings: Vec<Vec<(f64, f64)>> = svg
        .lines()
        .filter(|l| {
            l.contains("fill-rule=\"evenodd\"")
                && l.contains("Z")
                && l.contains("fill-opacity=\"0.6\"")
        })
        .map(|l| {
            let d = l.split('"').nth(1).unwrap();
            d.trim_start_matches('M')
                .trim_end_matches('Z')
                .split('L')
                .map(|p| {
                    let (x, y) = p.split_once(' ').unwrap();
                    (x.parse().unwrap(), y.parse().unwrap())
                })
                .collect()
        })
        .collect();
    assert_eq!(rings.len(), 1);
    let ring = &rings[0];
    let area: f64 = (0..ring.len())
        .map(|i| {
            let (a, b) = (ring[i], ring[(i + 1) % ring.len()]);
            0.5 * (a.0 * b.1 - b.0 * a.1)
        })
        .sum::<f64>()
        .abs();
    // Panel of 150 points over the 0.3 to 99.7 % range (2 x 2.748 sd) with 6 % margins.
    let point_per_sd = 150.0 / (2.0 * 2.748 * 1.12);
    let ratio =
        area / (point_per_sd * point_per_sd) / (2.0 * std::f64::consts::PI * (1.0 / 0.32_f64).ln());
    assert!((ratio - 1.02).abs() < 0.06, "{ratio}");
}

#[test]
fn q_figure_overlays_runs_with_truth_and_prior() {
    let curve = |name: &str, run: &Run| QCurve {
        name: name.to_owned(),
        q: run.draws.derived_column(0),
        weights: run.draws.weights(),
        ess: 4000.0,
    };
    let curves = [
        curve("nested", &runs::nested(4000, 3)),
        curve("pt-hmc", &runs::tempered(4000, 4)),
    ];
    let svg = q_posterior(
        &curves,
        Some(QPrior::Uniform { lo: 0.5, hi: 1.5 }),
        Some(0.83),
    );
    let svg = sound("q", svg);
    assert_eq!(svg.matches("class=\"median\"").count(), 2);
    for word in ["prior", "truth", "nested", "pt-hmc"] {
        assert!(svg.contains(word), "{word}");
    }
    sound("q_bare", q_posterior(&curves[..1], None, None));
}

#[test]
fn the_density_of_a_population_is_drawn_with_its_bands() {
    let q: Vec<f64> = (0..=100).map(|i| 0.5 + 0.01 * f64::from(i)).collect();
    let bell = |scale: f64| -> Vec<f64> {
        q.iter()
            .map(|q| scale * (-50.0 * (q - 0.8) * (q - 0.8)).exp())
            .collect()
    };
    let svg = sound(
        "population_density",
        population_density(&PopulationDensity {
            mean: bell(4.0),
            median: bell(3.9),
            lo68: bell(3.0),
            hi68: bell(5.0),
            lo95: bell(2.0),
            hi95: bell(6.0),
            q: q.clone(),
        }),
    );
    // Two bands; two curves and their keys, the line at q = 1.
    assert_eq!(svg.matches("fill-rule").count(), 2);
    assert!(
        svg.matches("stroke-dasharray=\"4 2\"").count() == 2,
        "median and its key"
    );
    let flat = PopulationDensity {
        mean: vec![0.0; 101],
        median: vec![0.0; 101],
        lo68: vec![0.0; 101],
        hi68: vec![0.0; 101],
        lo95: vec![0.0; 101],
        hi95: vec![0.0; 101],
        q,
    };
    sound("population_density_of_zeros", population_density(&flat));
}

#[test]
fn the_streams_of_a_population_are_drawn_twice_each() {
    let interval = |centre: f64, half: f64| Interval {
        median: centre,
        lo68: centre - half,
        hi68: centre + half,
        lo95: centre - 2.0 * half,
        hi95: centre + 2.0 * half,
        unit: String::new(),
    };
    let streams: Vec<StreamInPopulation> = (0..3)
        .map(|i| StreamInPopulation {
            name: format!("a stream of a long name <{i}>"),
            q: interval(0.8 + 0.1 * f64::from(i), 0.1),
            q_given_population: interval(0.9, 0.05),
            effective_draws: 100.0,
            pareto_k: f64::NEG_INFINITY,
            ln_likelihood_variance: 0.1,
            without: None,
        })
        .collect();
    let svg = sound("streams_of_population", streams_of_population(&streams));
    assert_eq!(svg.matches("<circle").count(), 6);
    assert!(svg.contains("a stream of a long\u{2026}"), "names are cut");
    sound("streams_of_no_population", streams_of_population(&[]));
    // Runs of earlier versions do not know what each stream moves.
    let mut population = PopulationSummary {
        streams,
        ..PopulationSummary::default()
    };
    assert_eq!(influence(&population), None);
    for (k, stream) in (0_u8..).zip(&mut population.streams) {
        let moved = MeanWithoutStream {
            mean: 1.0,
            sd: 0.1,
            mean_move: 0.3 * f64::from(k),
            width_ratio: 1.1,
        };
        stream.without = Some(WithoutStream {
            ln_predictive_density: -0.1,
            pareto_k: 0.4 * f64::from(k),
            parameters: ["mu_pop", "sigma_pop"]
                .map(|name| (name.to_owned(), moved))
                .to_vec(),
        });
    }
    let svg = sound("influence", influence(&population).expect("a figure"));
    assert_eq!(svg.matches("<circle").count(), 6);
    assert_eq!(
        svg.matches("fill-opacity=\"0.3\"").count(),
        2,
        "the last weights are not reliable"
    );
    assert!(svg.contains(">\u{3c3}</tspan>") && svg.contains(">pop</tspan>"));
}

#[test]
fn diagnostics_show_every_kind_of_run() {
    let svg = sound("diagnostics_nested", diagnostics(&runs::nested(6000, 5)));
    assert!(svg.contains("ln X") && svg.contains("insertion rank"));
    let svg = sound(
        "diagnostics_tempered",
        diagnostics(&runs::tempered(4000, 6)),
    );
    assert_eq!(svg.matches("class=\"gap\"").count(), 7);
    assert_eq!(svg.matches("class=\"acceptance\"").count(), 8);
    assert!(svg.contains("31, 28, 35, 30"));
    let svg = sound("diagnostics_refined", diagnostics(&runs::bridged(2000, 6)));
    assert_eq!(svg.matches("class=\"step\"").count(), 6);
}

/// Names come from track headers and folders, and may have any characters.
#[test]
fn a_name_of_any_characters_makes_sound_figures_and_a_sound_page() {
    let name: String = (0..0xa0)
        .chain([0xad, 0xfffd, 0xfffe, 0xffff, 0x1_f30c])
        .filter_map(char::from_u32)
        .collect();
    let run = runs::nested(500, 3);
    let (mut data, best, draws) = track();
    data.name.clone_from(&name);
    let fit = FitPicture {
        track: &data,
        draws: &draws,
        best: &best,
        particles: &[(1.0, 2.0)],
        phi_zero_deg: 0.0,
        progenitor_kpc: 60.0,
    };
    let curve = || QCurve {
        name: name.clone(),
        q: run.draws.derived_column(0),
        weights: run.draws.weights(),
        ess: 500.0,
    };
    let mut columns = corner_columns(&run, 2);
    columns[0].column.name.clone_from(&name);
    columns[0].column.unit.clone_from(&name);
    let figures = [
        sound("fit_named", fit.svg()),
        sound("q_named", q_posterior(&[curve(), curve()], None, None)),
        sound(
            "corner_named",
            corner(&columns, &run.draws.weights(), &name),
        ),
    ];
    let context = SummaryContext {
        command: name.clone(),
        warnings: vec![name.clone()],
        ..SummaryContext::default()
    };
    let mut summary = Summary::new(&run, &context);
    summary.parameters[0].0.clone_from(&name);
    let html = one_group(
        &name,
        &[PageRun {
            name: &name,
            summary: &summary,
            comparison: None,
            config: &name,
            figures: &figures.map(|svg| Figure {
                caption: name.clone(),
                svg,
            }),
        }],
    );
    let foreign = html
        .chars()
        .find(|c| c.is_control() && !['\t', '\n', '\r'].contains(c));
    assert_eq!(foreign, None);
    // All characters of a name that text can have are still there.
    assert!(html.contains("xyz") && html.contains("&lt;=&gt;") && html.contains('\u{1f30c}'));
}

/// A page of runs of one track.
fn one_group(name: &str, runs: &[PageRun<'_>]) -> String {
    let group = Group {
        name: name.to_owned(),
        runs: runs.to_vec(),
        figures: &[],
    };
    page(name, &[group])
}

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

#[test]
fn an_axis_of_numbers_that_doubles_cannot_count_has_an_end() {
    let mut run = runs::nested(100, 1);
    if let oblate_samplers::output::History::Nested { ln_x, .. } = &mut run.history {
        // Two neighbouring doubles.
        for (k, x) in ln_x.iter_mut().enumerate() {
            *x = if k < 50 { -1e17 } else { -1e17 - 16.0 };
        }
    }
    sound("far", diagnostics(&run));
}
