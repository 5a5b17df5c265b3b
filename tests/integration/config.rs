//! Settings that follow from others.

use oblate::inference::{FitSettings, Profile};
use oblate::likelihood::Coverage;
use oblate::track::BinEdges;

#[test]
fn a_coarse_model_is_smoother_than_the_fit_that_it_begins() {
    let fine = FitSettings::default();
    let coarse = fine.coarse(8.0).expect("2,560 particles have one");
    assert_eq!(coarse.model.releases.particles, fine.coarse_particles);
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
    assert!(coarse.model.orbit_steps < fine.model.orbit_steps);
    // Everything else is the fit's, and it has no coarse model of its own.
    assert_eq!((&coarse.prior, coarse.seed), (&fine.prior, fine.seed));
    assert_eq!(coarse.sampling, fine.sampling);
    assert_eq!(coarse.coarse(8.0), None);
    // What is gentle or short already stays so.
    let mut gentle = fine.clone();
    gentle.model.orbit_steps = 64;
    gentle.likelihood.coverage = Coverage::Penalty {
        z_miss: 3.0,
        lambda: 10.0,
    };
    let coarse = gentle.coarse(8.0).expect("as many particles");
    assert_eq!(coarse.model.orbit_steps, 64);
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
