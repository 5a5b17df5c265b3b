//! The memory that settings need together: refused before it is taken, and as much as was estimated.

use crate::haloes::THETA;
use oblate::Error;
use oblate::inference::SamplerSettings;
use oblate::likelihood::{DataBin, LikelihoodSettings, StreamLikelihood, TrackLikelihood};
use oblate::params::{QRange, StreamParams};
use oblate::samplers::control::Silent;
use oblate::samplers::{Control, Marginal, Outcome, Prior, Run, Target, nested, pt};
use oblate::spray::SamplingScheme;
use oblate::stream::{Model, ModelSettings, StepRule};

#[test]
fn settings_that_need_too_much_memory_together_are_refused_before_it_is_taken() {
    let refused = |change: &dyn Fn(&mut ModelSettings)| {
        let mut settings = ModelSettings::default();
        settings.releases.sampling_scheme = SamplingScheme::Random;
        change(&mut settings);
        match Model::new(&settings) {
            Err(Error::TooMuchMemory(much)) => much.to_string(),
            other => panic!("{other:?}"),
        }
    };
    let steps = refused(&|s| {
        (s.releases.particles, s.releases.release_times, s.steps) = (1_000_000, 500_000, 100_000);
    });
    assert!(
        steps.contains("GB") && steps.contains("`model.steps`"),
        "{steps}"
    );
    // All limits at once.
    let all = refused(&|s| {
        (s.releases.particles, s.releases.release_times) = (10_000_000, 5_000_000);
        (s.steps, s.orbit_steps) = (100_000, 100_000);
    });
    assert!(all.contains("GB are allowed"), "{all}");
}

#[test]
fn too_much_memory_of_a_bridge_is_refused_with_the_table_of_its_setting() {
    let mut sampling = SamplerSettings::for_streams();
    assert!(sampling.check_bridge(13).is_ok());
    (sampling.bridge.smc_particles, sampling.bridge.max_batches) = (1_000_000, 1_000);
    match sampling.check_bridge(13) {
        Err(Error::TooMuchMemory(much)) => assert_eq!(much.key, "sampling.bridge.smc_particles"),
        other => panic!("{other:?}"),
    }
}

/// The most memory that `work` holds at once.
fn peak(work: impl FnOnce()) -> f64 {
    allocation_counter::measure(work).bytes_max as f64
}

#[test]
fn the_memory_of_a_model_and_its_gradient_is_what_was_estimated() {
    let mut dense = ModelSettings::default();
    dense.releases.sampling_scheme = SamplingScheme::Random;
    dense.step_rule = StepRule::Uniform;
    dense.steps = 120;
    let mut few = dense;
    dense.releases.particles = 40_000;
    (few.releases.particles, few.releases.release_times) = (1_000, 500);
    (few.steps, few.orbit_steps) = (2_000, 4_000);
    for settings in [dense, few, ModelSettings::default()] {
        let measured = peak(|| {
            let model = Model::new(&settings).expect("a model");
            let stream = model
                .stream(&StreamParams::from_array(THETA))
                .expect("a stream");
            let data: Vec<DataBin> = stream
                .track(10.0)
                .expect("a track")
                .bins
                .iter()
                .map(|b| DataBin::symmetric(b.bin, b.r_kpc, 1.0))
                .collect();
            let track = TrackLikelihood::new(
                &LikelihoodSettings::default(),
                10.0,
                &data,
                &settings.releases,
            );
            let q_range = QRange::default();
            let likelihood = StreamLikelihood::new(model, track.expect("data"), q_range);
            likelihood.gradient(&THETA).expect("a gradient");
        });
        // The stream of the data is in memory as well.
        let estimate = settings.memory(1).bytes() + 56.0 * settings.releases.particles as f64;
        let ratio = measured / estimate;
        // Adaptive steps are estimated as if all were halved as often as they may be.
        let adaptive = settings.step_rule == StepRule::Adaptive;
        let least = if adaptive { 0.0 } else { 0.5 };
        assert!((least..1.05).contains(&ratio), "{measured} of {estimate}");
    }
}

/// A normal likelihood in the middle of a wide normal prior.
struct Bell(Prior);

impl Bell {
    fn new() -> Self {
        let wide = Marginal::Normal {
            mean: 0.0,
            sd: 10.0,
        };
        Self(Prior::new(["a", "b", "c"].map(|name| (name, "", wide))).expect("a prior"))
    }
}

impl Target for Bell {
    fn prior(&self) -> &Prior {
        &self.0
    }

    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        Outcome::from_ln_likelihood(-0.5 * theta.iter().map(|x| x * x).sum::<f64>())
    }

    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        for (slot, x) in gradient.iter_mut().zip(theta) {
            *slot = -x;
        }
        self.ln_likelihood(theta)
    }

    fn gradient_cost(&self) -> Option<f64> {
        Some(1.0)
    }
}

/// The most memory that a run of one thread holds at once.
fn peak_of_run(work: impl FnOnce() -> Run + Send) -> f64 {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    pool.expect("a pool").install(|| peak(|| drop(work())))
}

#[test]
fn the_memory_of_samplers_is_within_what_was_estimated() {
    let bell = Bell::new();
    let nested = nested::Settings {
        n_live: 400,
        steps: Some(3),
        ..nested::Settings::default()
    };
    let dynamic = nested::Settings {
        target_ess: Some(1e6),
        max_batches: 2,
        ..nested.clone()
    };
    let many = pt::Settings {
        smc_particles: 400,
        rounds: 3,
        ..pt::Settings::default()
    };
    let long = pt::Settings {
        rounds: 7,
        slice_updates: 2,
        mixture_rounds: 7,
        ..pt::Settings::default()
    };
    let surrogate = pt::Settings {
        surrogate: true,
        hmc_transitions: 0,
        slice_updates: 1,
        ..many.clone()
    };
    let control = |work: &dyn Fn(&mut Control<'_>) -> Run| work(&mut Control::new(&mut Silent));
    let run_nested = |settings: &nested::Settings| {
        peak_of_run(|| {
            control(&|control| nested::run(&Bell::new(), settings, 1, control).expect("a run"))
        })
    };
    let run_pt = |settings: &pt::Settings| {
        peak_of_run(|| {
            control(&|control| pt::run(&Bell::new(), settings, 1, control).expect("a run"))
        })
    };
    let dim = bell.dim();
    for (name, measured, estimate) in [
        ("nested", run_nested(&nested), nested.memory(dim)),
        ("dynamic", run_nested(&dynamic), dynamic.memory(dim)),
        ("many", run_pt(&many), many.memory(dim)),
        ("long", run_pt(&long), long.memory(dim)),
        ("surrogate", run_pt(&surrogate), surrogate.memory(dim)),
    ] {
        let ratio = measured / estimate.bytes();
        assert!(
            (0.05..1.0).contains(&ratio),
            "{name}: {measured} {estimate:?}"
        );
    }
}
