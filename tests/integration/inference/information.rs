//! Which posteriors are told to be only their priors.

use super::example_track;
use crate::runs;
use oblate::inference::{FitSettings, StreamTarget, prior_draws, summarize};
use oblate::posterior::{MIN_ESS_FOR_INFORMATION, Summary};
use oblate_samplers::output::{Draws, Status};
use oblate_samplers::{Run, Target};

/// A target with few particles, and its summary of draws that are worth as many independent ones. An interrupted run has no checks of the model, which take
/// time.
struct Fit(StreamTarget);

impl Fit {
    fn new(settings: &str) -> Self {
        let mut settings: FitSettings = toml::from_str(settings).unwrap();
        settings.model.releases.particles = 64;
        Self(StreamTarget::from_track(&example_track(), &settings).unwrap())
    }

    fn summary(&self, draws: Draws, ess: f64) -> Summary {
        let prior = self.0.prior();
        let mut run = Run {
            status: Status::Interrupted,
            names: prior.names().to_vec(),
            units: prior.units().to_vec(),
            derived_names: self.0.derived_names(),
            draws,
            ..runs::nested(1, 1)
        };
        run.ess.quoted = ess;
        summarize(&self.0, &example_track(), &run, "", "", &mut |_, _| {
            std::ops::ControlFlow::Continue(())
        })
        .unwrap()
    }
}

/// The draws in which q is in a range, in number `count`.
fn with_q(draws: &Draws, range: (f64, f64), count: usize) -> Draws {
    let mut kept = Draws {
        theta: Vec::new(),
        derived: Vec::new(),
        ..draws.clone()
    };
    for row in 0..draws.len() {
        let derived = &draws.derived[row * draws.derived_dim..][..draws.derived_dim];
        if range.0 < derived[0]
            && derived[0] < range.1
            && kept.derived.len() < count * derived.len()
        {
            kept.theta.extend_from_slice(draws.theta_row(row));
            kept.derived.extend_from_slice(derived);
        }
    }
    assert_eq!(kept.theta.len(), count * kept.dim);
    for column in [&mut kept.ln_likelihood, &mut kept.ln_weight] {
        column.truncate(count);
    }
    kept.ln_weight.fill(-(count as f64).ln());
    kept.chain.truncate(count);
    kept.cluster.truncate(count);
    kept
}

fn about(summary: &Summary, name: &str) -> Option<f64> {
    let mut all = summary.marginal_information.iter();
    all.find(|(own, _)| own == name).map(|(_, nats)| *nats)
}

/// The names in the line that says so.
fn not_measured(summary: &Summary) -> String {
    let text = summary.to_string();
    let line = text.lines().find(|line| line.starts_with("NOT MEASURED: "));
    let line = line.map(|line| line.split_once(" equal").expect("a verb").0);
    line.unwrap_or_default().to_owned()
}

#[test]
fn draws_of_the_prior_measure_nothing_and_narrow_ones_measure_q() {
    let fit = Fit::new("");
    let prior = prior_draws(&fit.0, 4_000, 3);
    let count = 2_000;
    let n = count as f64;
    let of_prior = fit.summary(with_q(&prior, (0.5, 1.5), count), n);
    let named: Vec<&str> = of_prior
        .marginal_information
        .iter()
        .map(|(name, _)| name.as_str())
        .collect();
    let expected: Vec<&str> = (fit.0.prior().names().iter().map(String::as_str))
        .chain(["q"])
        .collect();
    assert_eq!(named, expected);
    for (name, nats) in &of_prior.marginal_information {
        // Twice the count times the sum is chi-square of 19 degrees of freedom, whose mean is subtracted: five standard deviations of 6.2.
        assert!(*nats < 5.0 * 6.2 / (2.0 * n), "{name}: {nats}");
    }
    let all = format!("NOT MEASURED: the posteriors of {}", expected.join(", "));
    assert_eq!(not_measured(&of_prior), all);

    // Two of the twenty cells of q: ln 10, less 19 / (2 n), and chi-square of one degree of freedom over 2 n by the counts of both.
    let few = 300;
    let narrow = fit.summary(with_q(&prior, (0.85, 0.95), few), few as f64);
    let nats = about(&narrow, "q").unwrap();
    let expected = 10.0_f64.ln() - 19.0 / (2.0 * few as f64);
    assert!(
        (-1e-9..16.0 / (2.0 * few as f64)).contains(&(nats - expected)),
        "{nats} {expected}"
    );
    let names = not_measured(&narrow);
    assert!(
        names.contains("age_gyr") && names.contains("log10_m_halo"),
        "{names}"
    );
    assert!(!names.split_whitespace().any(|name| name == "q"), "{names}");
}

#[test]
fn too_few_draws_say_nothing_and_q_has_no_information_without_a_uniform_prior() {
    let fit = Fit::new("");
    let prior = prior_draws(&fit.0, 200, 4);
    let draws = || with_q(&prior, (0.5, 1.5), 100);
    let few = fit.summary(draws(), MIN_ESS_FOR_INFORMATION.next_down());
    assert!(few.marginal_information.is_empty());
    assert_eq!(not_measured(&few), "");
    let enough = fit.summary(draws(), MIN_ESS_FOR_INFORMATION);
    assert_eq!(enough.marginal_information.len(), 14);
    assert!(not_measured(&enough).contains("age_gyr"));

    let fit = Fit::new("prior.fixed = { dir_z = 0.3 }");
    let prior = prior_draws(&fit.0, 2_000, 4);
    let summary = fit.summary(with_q(&prior, (0.5, 1.5), 1_500), 1_500.0);
    assert_eq!(summary.marginal_information.len(), 12);
    assert_eq!(about(&summary, "q"), None);
    assert!(not_measured(&summary).contains("age_gyr"));
}
