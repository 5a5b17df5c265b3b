//! The target of the samplers, draws of its prior, the fit in memory, and the settings of the coarse fit.

mod best_fit;
mod information;

use oblate::data::ObservedTrack;
use oblate::inference::{
    Fit, FitSettings, Profile, Sampler, Speed, StreamTarget, diagnose, fit_with,
    posterior_predictive_p, prior_draws,
};
use oblate::likelihood::Coverage;
use oblate::run::{Destination, IfExists, Monitor};
use oblate::spray::SamplingScheme;
use oblate::stream::{Model, Precision};
use oblate::track::BinEdges;
use oblate_samplers::control::Silent;
use oblate_samplers::diagnostics::{chi2_tail, ln_sum_exp};
use oblate_samplers::output::{Method, Status};
use oblate_samplers::{Control, Event, Marginal, Observer, Outcome, Prior, Target, nested};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// A gala track.
fn example_track() -> ObservedTrack {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/tracks/s2_spherical.ecsv");
    ObservedTrack::read(&path).unwrap()
}

/// The gala track with all but the halo's mass and shape known.
fn target(coverage: Coverage) -> StreamTarget {
    let mut config: FitSettings = toml::from_str(
        r#"
        model = { releases = { particles = 512 } }
        [prior.fixed]
        r_s_halo_kpc = 15.0
        log10_m_prog = 7.7
        r_s_prog_kpc = 1.0
        x0_kpc = 60.0
        z0_kpc = 30.0
        vx0_km_s = 30.0
        vy0_km_s = 140.0
        vz0_km_s = 45.0
        age_gyr = 3.0
        "#,
    )
    .unwrap();
    config.likelihood.coverage = coverage;
    StreamTarget::from_track(&example_track(), &config).unwrap()
}

#[test]
fn rejecting_and_penalising_uncovered_bins_give_the_same_posterior() {
    let (penalty, reject) = (target(Coverage::default()), target(Coverage::Reject));
    let settings = nested::Settings {
        n_live: 60,
        kernel: nested::Kernel::Differential,
        steps: Some(8),
        ..nested::Settings::default()
    };
    let run = nested::run(&penalty, &settings, 5, &mut Control::new(&mut Silent)).unwrap();
    // The posterior under rejection, by reweighting the draws: rejection never gives the larger likelihood.
    let ln_ratio: Vec<f64> = (0..run.draws.len())
        .map(|i| {
            let Outcome::Value(l) = reject.ln_likelihood(run.draws.theta_row(i)) else {
                return f64::NEG_INFINITY;
            };
            let gain = l - run.draws.ln_likelihood[i];
            assert!(gain < 1e-9, "{gain}");
            gain
        })
        .collect();
    let reweighted: Vec<f64> = run
        .draws
        .ln_weight
        .iter()
        .zip(&ln_ratio)
        .map(|(w, r)| w + r)
        .collect();
    let shift_of_ln_z = ln_sum_exp(&reweighted);
    assert!(
        shift_of_ln_z.abs() < run.evidence.error,
        "ln Z: {shift_of_ln_z} of {}",
        run.evidence.error
    );
    let q: Vec<f64> = (0..run.draws.len())
        .map(|i| run.draws.derived[i * run.draws.derived_dim])
        .collect();
    let mean = |ln_w: &[f64]| -> f64 {
        let norm = ln_sum_exp(ln_w);
        q.iter().zip(ln_w).map(|(q, w)| q * (w - norm).exp()).sum()
    };
    let (before, after) = (mean(&run.draws.ln_weight), mean(&reweighted));
    let variance: f64 = q
        .iter()
        .zip(&run.draws.ln_weight)
        .map(|(q, w)| (q - before).powi(2) * w.exp())
        .sum();
    let error = (variance / run.ess.quoted).sqrt();
    assert!(
        (after - before).abs() < error,
        "q: {before} {after} +- {error}"
    );
}

/// Two parameters and their sum.
struct Sum(Prior);

impl Target for Sum {
    fn prior(&self) -> &Prior {
        &self.0
    }

    fn ln_likelihood(&self, _: &[f64]) -> Outcome {
        Outcome::Value(0.0)
    }

    fn derived_names(&self) -> Vec<(String, String)> {
        vec![("sum".to_owned(), String::new())]
    }

    fn derived(&self, theta: &[f64], out: &mut Vec<f64>) {
        out.push(theta[0] + theta[1]);
    }
}

#[test]
fn prior_draws_follow_the_prior_and_have_its_derived_quantities() {
    let prior = Prior::new([
        ("a", "kpc", Marginal::Uniform { lo: 2.0, hi: 6.0 }),
        ("b", "", Marginal::Normal { mean: 1.0, sd: 3.0 }),
    ])
    .unwrap();
    let draws = prior_draws(&Sum(prior), 4000, 9);
    let mean = |x: Vec<f64>| x.iter().sum::<f64>() / x.len() as f64;
    // Standard errors 1.155 / sqrt(4000) and 3 / sqrt(4000); four of them.
    assert!((mean(draws.column(0)) - 4.0).abs() < 4.0 * 1.155 / 4000_f64.sqrt());
    assert!((mean(draws.column(1)) - 1.0).abs() < 4.0 * 3.0 / 4000_f64.sqrt());
    assert!((draws.derived_row(17)[0] - draws.theta_row(17).iter().sum::<f64>()).abs() < 1e-12);
}

#[test]
fn a_fit_in_memory_has_the_bits_of_the_fit_in_a_folder() {
    let mut settings: FitSettings = toml::from_str(
        r#"
        coarse_particles = 64
        model = { releases = { particles = 128 }, step_phase = 2.0, max_halvings = 3 }
        prior.fixed = { r_s_halo_kpc = 15.0, dir_x = 0.1, dir_y = 0.2, r_s_prog_kpc = 1.0, x0_kpc = 60.0, z0_kpc = 30.0, vx0_km_s = 30.0, vy0_km_s = 140.0, vz0_km_s = 45.0, age_gyr = 3.0 }
        "#,
    )
    .unwrap();
    settings.sampling.sampler = Sampler::Nested;
    settings.sampling.nested.n_live = 40;
    // So many that the target of the coarse fit, which is half of this one, decides how long it goes on.
    settings.sampling.nested.max_batches = 8;
    settings.sampling.nested.target_ess = Some(120.0);
    settings.sampling.nested.kernel = nested::Kernel::RandomSlice;
    settings.sampling.nested.steps = Some(6);
    settings.sampling.bridge.smc_particles = 60;
    settings.sampling.bridge.mcmc_steps = 4;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/tracks/s2_spherical.ecsv");
    let track = ObservedTrack::read(&path).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let destination = Destination {
        folder: &folder.path().join("fit"),
        if_exists: IfExists::Refuse,
        command: "",
    };
    let mut monitor = Monitor {
        observer: &mut Silent,
        interrupt: Arc::default(),
        checkpoint_every: Duration::MAX,
        max_wall: Duration::MAX,
    };
    let written = oblate::run::fit(&track, &settings, destination, &mut monitor).unwrap();
    let fit = oblate::fit(&track, &settings).unwrap();
    assert_eq!(fit.run.bits(), written.run.bits());
    assert_eq!(fit.summary.parameters, written.summary.parameters);
    let text = fit.summary.to_string();
    assert!(
        text.contains("ln Z = ") && text.contains("log10_m_halo"),
        "{text}"
    );
    a_model_that_does_not_fit_is_told(&track, &settings, &fit);
    errors_are_compared_with_the_stars_of_bins(track, &settings, &fit);
}

/// The p-value is that of the best draw's chi-square where all draws are alike, and small where the errors are.
fn a_model_that_does_not_fit_is_told(track: &ObservedTrack, settings: &FitSettings, fit: &Fit) {
    let p = |times: f64| {
        let mut track = track.clone();
        for column in [&mut track.r_err_lo_kpc, &mut track.r_err_hi_kpc] {
            column.iter_mut().for_each(|error| *error *= times);
        }
        let target = StreamTarget::from_track(&track, settings).unwrap();
        posterior_predictive_p(&target, &fit.run).unwrap()
    };
    let stated = fit.summary.diagnostics["posterior_predictive_p"];
    assert_eq!(p(1.0).to_bits(), stated.to_bits());
    // With large errors every residual is small.
    assert!(p(30.0) > 0.99, "{}", p(30.0));
    assert!(p(0.1) < 1e-6, "{}", p(0.1));
    // One draw alone: the tail of its chi-square.
    let target = StreamTarget::from_track(track, settings).unwrap();
    let mut alone = fit.run.clone();
    let best = alone.draws.best().unwrap();
    for (row, ln_weight) in alone.draws.ln_weight.iter_mut().enumerate() {
        *ln_weight = if row == best { 0.0 } else { f64::NEG_INFINITY };
    }
    let mut residuals = Vec::new();
    target.ln_likelihood_and_residuals(alone.draws.theta_row(best), &mut residuals);
    let chi2: f64 = residuals.iter().map(|z| z * z).sum();
    let expected = chi2_tail(chi2, track.len() as f64);
    let found = posterior_predictive_p(&target, &alone).unwrap();
    assert!((found - expected).abs() < 1e-12, "{found} {expected}");
}

/// The stars of gala's bins are thousands. Means over one of 3,000 of them err by more than the errors of the track.
fn errors_are_compared_with_the_stars_of_bins(
    mut track: ObservedTrack,
    settings: &FitSettings,
    fit: &Fit,
) {
    let target = StreamTarget::from_track(&track, settings).unwrap();
    let mut diagnose_with = |times: f64| {
        track.n.iter_mut().flatten().for_each(|n| *n *= times);
        let found = diagnose(&target, &track, &fit.run);
        let warned = found.warnings.iter().any(|w| w.contains("`r_err`"));
        (found.numbers.get("star_scatter").copied(), warned)
    };
    let (many, warned) = diagnose_with(1.0);
    assert!(many.is_some_and(|s| s < 0.5) && !warned, "{many:?}");
    let (few, warned) = diagnose_with(1.0 / 3_000.0);
    let times = few.zip(many).map(|(few, many)| few / many);
    assert!(
        times.is_some_and(|t| (t - 3_000.0).abs() < 1e-3) && few > Some(1.2) && warned,
        "{few:?}"
    );
    track.n = None;
    let found = diagnose(&target, &track, &fit.run);
    assert!(!found.numbers.contains_key("star_scatter"));
    // Errors are those that ln L has: the track's are 2 %.
    let mut floored = settings.clone();
    floored.likelihood.error_floor_percent = 20.0;
    let target = StreamTarget::from_track(&track, &floored).unwrap();
    let with_floor = diagnose(&target, &track, &fit.run);
    let chi2 = "best_fit_chi2";
    let ratio = found.numbers[chi2] / with_floor.numbers[chi2];
    assert!((ratio - 100.0).abs() < 5.0, "{ratio}");
}

#[test]
fn a_coarse_model_is_smoother_than_the_fit_that_it_begins() {
    let mut fine = FitSettings::default();
    fine.model.precision = Precision::Double;
    let coarse = fine.coarse(8.0).expect("2,560 particles have one");
    assert_eq!(coarse.model.releases.particles, fine.coarse_particles);
    assert_eq!(coarse.model.precision, Precision::Single);
    assert!(coarse.model.step_phase > fine.model.step_phase);
    assert_eq!(
        coarse.likelihood.edges,
        BinEdges::Soft {
            half_width_deg: 4.0
        }
    );
    let z_miss = |config: &FitSettings| match config.likelihood.coverage {
        Coverage::Penalty { z_miss, .. } => z_miss,
        Coverage::Reject => f64::INFINITY,
    };
    assert!(z_miss(&coarse) < z_miss(&fine));
    // It aims at half of the draws; everything else is as in the fit, and it has no coarse model of its own.
    assert_eq!((&coarse.prior, coarse.seed), (&fine.prior, fine.seed));
    let mut sampling = fine.sampling.clone();
    sampling.pt_hmc.target_ess *= 0.5;
    sampling.nested.target_ess = sampling.nested.target_ess.map(|target| 0.5 * target);
    assert_eq!(coarse.sampling, sampling);
    assert_eq!(coarse.coarse(8.0), None);
    // The smallest targets that a fit may have are not halved: half of them would be refused.
    let mut small = fine.clone();
    (
        small.sampling.pt_hmc.target_ess,
        small.sampling.nested.target_ess,
    ) = (50.0, Some(1.0));
    assert!(small.check().is_ok() && small.coarse(8.0).unwrap().check().is_ok());
    // A penalty that is small already is not changed.
    let mut gentle = fine.clone();
    gentle.likelihood.coverage = Coverage::Penalty {
        z_miss: 3.0,
        lambda: 10.0,
    };
    let coarse = gentle.coarse(8.0).expect("as many particles");
    assert_eq!(coarse.likelihood.coverage, gentle.likelihood.coverage);
}

#[test]
fn few_particles_and_a_likelihood_with_zeros_have_no_coarse_model() {
    let mut few = FitSettings::default();
    few.model.releases.particles = 2 * few.coarse_particles - 1;
    assert_eq!(few.coarse(8.0), None);
    let paper = FitSettings {
        likelihood: Profile::Paper.likelihood(),
        ..FitSettings::default()
    };
    assert_eq!(paper.coarse(8.0), None);
}

/// Random releases have a fixed number of release times, of which both tails have a whole number of particles each.
#[test]
fn the_coarse_model_of_random_releases_has_whole_release_times() {
    let mut settings = FitSettings::default();
    settings.model.releases.sampling_scheme = SamplingScheme::Random;
    settings.model.releases.particles = 10_000;
    let coarse = settings.coarse(8.0).unwrap();
    assert_eq!(coarse.model.releases.particles, 600);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/tracks/s2_spherical.ecsv");
    let track = ObservedTrack::read(&path).unwrap();
    assert!(StreamTarget::from_track(&track, &coarse).is_ok());
}

/// The spherical track, and settings of a short fit of it with changed settings of the model.
fn short(model: &str) -> (ObservedTrack, FitSettings) {
    let mut settings: FitSettings = toml::from_str(&format!(
        r#"
        coarse_particles = 0
        model = {model}
        prior.fixed = {{ r_s_halo_kpc = 15.0, dir_x = 0.1, dir_y = 0.2, log10_m_prog = 7.7, r_s_prog_kpc = 1.0, x0_kpc = 60.0, z0_kpc = 30.0, vx0_km_s = 30.0, vy0_km_s = 140.0, vz0_km_s = 45.0, age_gyr = 3.0 }}
        "#
    ))
    .unwrap();
    settings.sampling.sampler = Sampler::Nested;
    settings.sampling.nested.n_live = 60;
    settings.sampling.nested.max_batches = 1;
    settings.sampling.nested.kernel = nested::Kernel::Differential;
    settings.sampling.nested.steps = Some(4);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/tracks/s2_spherical.ecsv");
    (ObservedTrack::read(&path).unwrap(), settings)
}

/// Such a fit.
fn short_fit(model: &str) -> (StreamTarget, Fit) {
    let (track, settings) = short(model);
    let target = StreamTarget::from_track(&track, &settings).unwrap();
    (target, oblate::fit(&track, &settings).unwrap())
}

/// Interrupts a run at its tenth event.
struct Tenth(u32);

impl Observer for Tenth {
    fn event(&mut self, _: &Event) -> ControlFlow<()> {
        self.0 += 1;
        if self.0 < 10 {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(())
        }
    }
}

#[test]
fn an_interrupted_fit_ends_without_evaluating_its_model_again() {
    let (track, settings) = short("{ releases = { particles = 64 } }");
    let fit = fit_with(&track, &settings, &mut Control::new(&mut Tenth(0))).unwrap();
    assert_eq!(fit.run.status, Status::Interrupted);
    assert!(!fit.run.draws.is_empty() && fit.summary.model_checks.is_empty());
}

fn passes(fit: &Fit, name: &str) -> bool {
    let mut checks = fit.summary.model_checks.iter();
    checks.find(|check| check.name == name).unwrap().pass
}

#[test]
fn long_steps_and_few_particles_fail_the_checks_of_the_model() {
    let (_, good) = short_fit("{ releases = { particles = 512 } }");
    assert!(passes(&good, "steps-ln-likelihood") && passes(&good, "steps-q"));
    assert!(passes(&good, "particles-ln-likelihood"));
    let (_, long) = short_fit("{ releases = { particles = 512 }, step_phase = 4.0 }");
    assert!(!passes(&long, "steps-ln-likelihood"));
    let text = long.summary.to_string();
    assert!(
        text.contains("MODEL NOT ACCURATE ENOUGH") && text.contains("decrease `model.step_phase`"),
        "{text}"
    );
    let (_, few) = short_fit("{ releases = { particles = 64 } }");
    assert!(
        passes(&few, "steps-q")
            && !(passes(&few, "particles-ln-likelihood") && passes(&few, "particles-q")),
        "{:?}",
        few.summary.model_checks
    );
}

#[test]
fn the_move_of_q_by_the_particles_is_that_of_all_draws() {
    let (target, fit) = short_fit("{ releases = { particles = 512 } }");
    let mut settings = *target.likelihood().model().settings();
    settings.releases.particles *= 4;
    settings.releases.seed ^= 1;
    let other = target
        .likelihood()
        .with_model(Model::new(&settings).unwrap());
    let draws = &fit.run.draws;
    let points: Vec<_> = (0..draws.len())
        .map(|i| target.params(draws.theta_row(i)).to_array())
        .collect();
    let change: Vec<f64> = other
        .ln_likelihoods(&points)
        .iter()
        .zip(&draws.ln_likelihood)
        .map(|(value, before)| {
            value
                .as_ref()
                .map_or(0.0, |v| (v.ln_likelihood - before).clamp(-5.0, 5.0))
        })
        .collect();
    let weights = draws.weights();
    let mean = |x: &[f64]| -> f64 { x.iter().zip(&weights).map(|(x, w)| x * w).sum() };
    let q = draws.derived_column(0);
    let products: Vec<f64> = q.iter().zip(&change).map(|(q, d)| q * d).collect();
    let interval = fit.summary.q.as_ref().unwrap();
    let all =
        (mean(&products) - mean(&q) * mean(&change)) / (0.5 * (interval.hi68 - interval.lo68));
    let number = |name: &str| fit.summary.diagnostics[name];
    let (few, error) = (
        number("particles_q_shift"),
        number("particles_q_shift_error"),
    );
    // 256 draws against all of them: four standard errors.
    assert!((few - all).abs() < 4.0 * error, "{few} +- {error}, {all}");
    assert!(error < 0.3, "{error}");
}

/// A nested run without a target keeps no checkpoint: if it were taken up again, it would be sampled again.
#[test]
fn only_a_run_that_gains_by_it_goes_on_under_settings_that_allow_more() {
    let before = FitSettings::default();
    let (mut longer, mut further) = (before.clone(), before.clone());
    longer.sampling.pt_hmc.extensions += 1;
    further.sampling.bridge.max_batches += 1;
    let methods = [Method::PtHmc, Method::Bridge];
    assert_eq!(methods.map(|m| longer.may_go_on(&before, m)), [true; 2]);
    assert_eq!(
        methods.map(|m| further.may_go_on(&before, m)),
        [false, true]
    );
    let nested = |settings: FitSettings| settings.with_sampler(Sampler::Nested);
    let (mut before, mut longer) = (nested(before), nested(longer));
    assert!(!longer.may_go_on(&before, Method::Nested));
    assert!(!further.may_go_on(&before, Method::Nested));
    longer.sampling.nested.max_batches += 1;
    assert_eq!(methods.map(|m| longer.may_go_on(&before, m)), [true; 2]);
    assert!(longer.may_go_on(&before, Method::Nested));
    (
        before.sampling.nested.target_ess,
        longer.sampling.nested.target_ess,
    ) = (None, None);
    assert!(!longer.may_go_on(&before, Method::Nested));
}

#[test]
fn a_fit_takes_time_in_proportion_to_its_free_parameters_and_a_bridge_only_after_a_coarse_model() {
    let speed = |coarse, free| Speed {
        model: 1_000.0,
        coarse,
        free,
    };
    let seconds = |coarse, free| speed(coarse, free).seconds_of_fit();
    for k in 0..3 {
        let [all, some] = [13, 5].map(|free| seconds(Some(4_000.0), free)[k]);
        assert!((some / all - 5.0 / 13.0).abs() < 1e-12, "{some} {all}");
        // One model as fast as both takes less by the bridge.
        let [bridged, alone] = [Some(1_000.0), None].map(|coarse| seconds(coarse, 5)[k]);
        assert!(alone < bridged, "{alone} {bridged}");
    }
}
