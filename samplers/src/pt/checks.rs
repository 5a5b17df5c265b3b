//! Convergence checks of a tempered run, each with a remedy.

use super::check_names;
use super::evidence::Estimate;
use super::posterior_draws::Agreement;
use super::record::Record;
use super::schedule::round_trip_rate;
use super::state::Finished;
use crate::diagnostics::chi2_p_value;
use crate::hmc::MAX_STEP;
use crate::output::{Check, MIN_ESS};

/// The numbers that the checks need.
pub(super) struct CheckInputs<'a> {
    pub(super) record: &'a Record,
    pub(super) estimate: &'a Estimate,
    /// Rounds that ended before the one that is checked.
    pub(super) history: &'a [Finished],
    /// Step of each temperature.
    pub(super) steps: &'a [f64],
    /// How well the chain sets agree.
    pub(super) agreement: &'a Agreement,
    /// Effective draws that the run aims at.
    pub(super) target_ess: f64,
    /// Whether slice updates are made as well. Then round trips, R-hat and effective sample sizes measure how far
    /// states move, and short trajectories are no failure.
    pub(super) slices: bool,
    /// Whether HMC transitions follow the gradient of ln L. Moves along a surrogate meet no rejected point.
    pub(super) hmc: bool,
}

/// All checks of a run.
pub(super) fn checks(run: &CheckInputs<'_>) -> Vec<Check> {
    let mut checks = index_processes(run);
    checks.extend(schedule(run));
    checks.extend(evidence(run.estimate));
    checks.extend(draws(run.agreement, run.target_ess));
    checks.extend(moves(run));
    checks
}

fn index_processes(run: &CheckInputs<'_>) -> Vec<Check> {
    let index_processes = run.record.index_processes();
    let scans = run.record.scans();
    let part = run.record.last_long_enough();
    let replicas = (index_processes.len() * part.traces.temperatures()) as f64;
    let fewest = index_processes
        .iter()
        .map(|(trips, _)| *trips)
        .min()
        .unwrap_or(0);
    let restarts: u64 = index_processes.iter().map(|(_, restarts)| restarts).sum();
    let trips = run.record.round_trips() as f64;
    let rate = trips / (scans * index_processes.len()).max(1) as f64;
    let expected = round_trip_rate(&part.mean_rejection());
    vec![
        Check::at_least(
            check_names::ROUND_TRIPS_WORST_CHAIN_SET,
            fewest as f64,
            10.0,
            "round trips from reference to posterior and back, of the chain set that has fewest; if too few, allow more `extensions`, or add rounds: each doubles them",
        ),
        Check::at_least(
            check_names::ROUND_TRIPS,
            trips,
            100.0,
            "round trips of all chain sets; if too few, allow more `extensions`, or add rounds",
        ),
        Check::at_least(
            check_names::RESTARTS_PER_REPLICA,
            restarts as f64 / replicas,
            1.0,
            "arrivals at the posterior from a new draw of the reference, per replica; if too few, allow more `extensions`, or add rounds",
        ),
        Check::at_least(
            check_names::ROUND_TRIP_RATE,
            rate / expected,
            0.3,
            "round-trip rate over that with independent local samples; if too small, local moves are too slow: raise `slice_updates`, `hmc_transitions` or `max_leapfrogs`",
        ),
    ]
}

/// Barrier in units of which a smaller one may change. Two temperatures belong to a barrier of 1, so that a tenth of this changes their number by one. Barriers of
/// about 1 differ by 0.1 from one fit of the reference to the next (docs/decisions.md, section 3).
const LEAST_BARRIER: f64 = 5.0;

fn schedule(run: &CheckInputs<'_>) -> Vec<Check> {
    // Over all parts: a reference that misses a mode slows one part of a long run, and the next fit mends it.
    let [worst, communication_barrier] = mean_over_parts(
        run.record
            .long_enough()
            .map(|part| (part.traces.scans(), part.mean_rejection())),
    );
    let before = run
        .history
        .last()
        .map_or(0.0, |round| round.communication_barrier);
    let change = (communication_barrier - before).abs() / before.max(LEAST_BARRIER);
    let change = if run.history.is_empty() { 1.0 } else { change };
    vec![
        Check::at_most(
            check_names::SWAP_REJECTION,
            worst,
            0.75,
            "largest swap rejection between neighbouring temperatures, mean over the parts of the run; if too large, raise `temperatures` or `max_temperatures`, or add rounds so that temperatures can adapt",
        ),
        Check::at_most(
            check_names::COMMUNICATION_BARRIER_CHANGE,
            change,
            0.1,
            "relative change of the communication barrier, a mean over parts of the run, since the round before; if too large, temperatures are not adapted yet: add rounds",
        ),
    ]
}

/// The largest swap rejection and the communication barrier, means over parts of so many scans with these rejections.
fn mean_over_parts(parts: impl Iterator<Item = (usize, Vec<f64>)>) -> [f64; 2] {
    let (mut all, mut sums) = (0.0_f64, [0.0; 2]);
    for (scans, rejection) in parts {
        let scans = scans as f64;
        let worst = rejection.iter().copied().fold(0.0, f64::max);
        all += scans;
        sums[0] += scans * worst;
        sums[1] += scans * rejection.iter().sum::<f64>();
    }
    sums.map(|sum| sum / all.max(1.0))
}

fn evidence(estimate: &Estimate) -> Vec<Check> {
    let error = estimate.error();
    let gap = (estimate.forward - estimate.backward).abs();
    // Chain sets are equivalent, so each gets the mean of their variances: one that has missed a small mode
    // underestimates its own error.
    let squares = estimate.chain_set_errors.iter().map(|e| e * e);
    let variance = squares.sum::<f64>() / estimate.chain_sets.len() as f64;
    let scatter = estimate
        .chain_sets
        .iter()
        .map(|l| (l - estimate.ln_z).powi(2));
    // A flat likelihood has no error but that of rounding.
    let chi2 = scatter.sum::<f64>() / variance.max(1e-12);
    let p = chi2_p_value(chi2, estimate.chain_sets.len());
    vec![
        Check::at_most(
            check_names::LN_Z_ERROR,
            error,
            0.5,
            "standard error of ln Z in nats; if too large, allow more `extensions`, or add rounds",
        ),
        Check::at_most(
            check_names::FORWARD_BACKWARD_DIFFERENCE,
            if gap.is_finite() { gap } else { f64::INFINITY },
            (3.0 * error).max(0.2),
            "difference of the two one-sided (stepping-stone) estimates of ln Z; if too large, add rounds or temperatures",
        ),
        Check::at_least(
            check_names::LN_Z_AGREEMENT_OF_CHAIN_SETS,
            if error.is_finite() { p } else { 0.0 },
            0.01,
            "p-value of the differences of ln Z between the chain sets, given the error of each from its own scans; if too small, some chain set misses a part of the posterior: allow more `extensions`, or add rounds",
        ),
    ]
}

/// Minimum effective size of the draws of the newest extension alone, as a fraction of the target.
const NEWEST_ESS: f64 = 0.5;

/// Largest R-hat above 1, times the target ESS: the usual 1.01 where 400 draws are wanted. What independent draws have is as small as
/// one over their number.
const R_HAT_EXCESS: f64 = 0.01 * MIN_ESS;

/// Minimum p-value of an agreement of chain sets.
const MIN_P: f64 = 0.01;

/// Checks that a pass is no coincidence: the draws of the newest extension, which nobody has looked at before, its ln Z beside that of the
/// earlier ones, and the number of looks in succession at which all other checks passed.
pub(super) fn confirmation(
    newest: &Agreement,
    earlier_and_newest: Option<&[Estimate; 2]>,
    looks_passed: usize,
    target_ess: f64,
) -> Vec<Check> {
    vec![
        Check::at_most(
            check_names::NEWEST_LN_Z,
            earlier_and_newest.map_or(f64::INFINITY, deviation),
            3.0,
            "difference of ln Z between the newest extension and the earlier ones, in standard errors; if too large, states come to a part of the posterior only slowly: allow more `extensions`",
        ),
        Check::at_least(
            check_names::NEWEST_ESS,
            newest.ess.quoted,
            NEWEST_ESS * target_ess,
            "smallest bulk or tail ESS over parameters of the newest extension alone; if too small, allow more `extensions`",
        ),
        Check::at_least(
            check_names::NEWEST_MODE_AGREEMENT,
            newest.modes,
            MIN_P,
            "p-value that in the newest extension all chain sets give two modes (or halves) of the posterior the same weights; if too small, allow more `extensions`",
        ),
        Check::at_least(
            check_names::LOOKS_PASSED,
            looks_passed as f64,
            2.0,
            "looks in succession, one after each extension, at which all checks of the draws so far passed: a single pass may be chance; allow more `extensions`",
        ),
    ]
}

/// Difference of two estimates of ln Z in combined standard errors.
fn deviation([a, b]: &[Estimate; 2]) -> f64 {
    // A flat likelihood has no error but that of rounding.
    (a.ln_z - b.ln_z).abs() / a.error().hypot(b.error()).max(1e-6)
}

/// Checks of the draws at the posterior.
pub(super) fn draws(agreement: &Agreement, target_ess: f64) -> Vec<Check> {
    let [bulk, tail] = agreement.ess.checks(
        target_ess,
        "allow more `extensions`, add rounds, or raise `slice_updates` or `hmc_transitions`",
    );
    vec![
        Check::at_most(
            check_names::R_HAT,
            agreement.worst_r_hat,
            1.0 + R_HAT_EXCESS / target_ess.min(MIN_ESS),
            "largest rank-normalised split R-hat of coordinates, their squares and ln L; if too large, the chain sets do not agree yet: allow more `extensions`, or add rounds",
        ),
        bulk,
        tail,
        Check::at_least(
            check_names::MODE_AGREEMENT_OF_CHAIN_SETS,
            agreement.modes,
            MIN_P,
            "p-value that all chain sets give two modes (or halves) of the posterior the same weights; if too small, allow more `extensions`, or add rounds",
        ),
    ]
}

fn moves(run: &CheckInputs<'_>) -> Vec<Check> {
    let locals = &run.record.last_long_enough().locals[1..];
    let acceptance = |local: &super::record::Local| local.mean_acceptance();
    let lowest = locals.iter().map(acceptance).fold(1.0, f64::min);
    // The acceptance at the maximum step is not tested, because such a step cannot be lengthened.
    let highest = locals
        .iter()
        .zip(&run.steps[1..])
        .filter(|(_, step)| **step < 0.99 * MAX_STEP)
        .map(|(local, _)| acceptance(local))
        .fold(0.0, f64::max);
    let worst_fraction = |count: fn(&super::record::Local) -> u64| {
        locals
            .iter()
            .map(|local| count(local) as f64 / local.moves.max(1) as f64)
            .fold(0.0, f64::max)
    };
    let rejected = run.hmc.then(|| {
        Check::at_most(
            check_names::REJECTED_TRANSITIONS,
            worst_fraction(|local| local.rejected),
            0.2,
            "fraction of HMC transitions that met a rejected point, at the worst temperature; if too large, replace rejection by a smooth penalty",
        )
    });
    if run.slices {
        return rejected.into_iter().collect();
    }
    let mut checks = vec![
        Check::at_least(
            check_names::LOWEST_ACCEPTANCE,
            lowest,
            0.5,
            "mean acceptance of HMC transitions at the worst temperature; if too small, step sizes are not adapted yet: add rounds",
        ),
        Check::at_most(
            check_names::HIGHEST_ACCEPTANCE,
            highest,
            0.95,
            "mean acceptance of HMC transitions at the best temperature; if too large, steps are shorter than needed: add rounds",
        ),
        Check::at_most(
            check_names::TRUNCATED_TRAJECTORIES,
            worst_fraction(|local| local.capped),
            0.01,
            "fraction of transitions stopped by `max_leapfrogs`, at the worst temperature; if too large, raise it",
        ),
    ];
    checks.extend(rejected);
    checks
}

#[cfg(test)]
mod tests {
    use super::super::posterior_draws::PosteriorDraws;
    use super::super::settings::Settings;
    use super::*;
    use crate::diagnostics::error_of_mean;
    use crate::rng::{Domain, standard_normal, stream, unit_open};
    use rayon::prelude::*;

    fn estimate(chain_sets: Vec<f64>, error: f64) -> Estimate {
        let ln_z = chain_sets.iter().sum::<f64>() / chain_sets.len() as f64;
        Estimate {
            ln_z,
            forward: ln_z,
            backward: ln_z,
            thermodynamic: None,
            valid: 1.0,
            chain_set_errors: vec![error; chain_sets.len()],
            chain_sets,
            error_chain_sets: 0.1,
            error_scans: 0.1,
        }
    }

    fn passes(name: &str, estimate: &Estimate) -> bool {
        let checks = evidence(estimate);
        checks.iter().find(|g| g.name == name).unwrap().pass
    }

    #[test]
    fn one_part_with_a_poor_reference_does_not_decide_for_a_long_run() {
        let good = || (1_000, vec![0.25, 0.5]);
        let parts = [good(), good(), good(), (1_000, vec![0.75, 1.0])];
        let [worst, barrier] = mean_over_parts(parts.into_iter());
        assert!((worst - 0.625).abs() < 1e-12 && (barrier - 1.0).abs() < 1e-12);
        // Short parts count less, and a run of one part has its own.
        let [worst, _] = mean_over_parts([(300, vec![0.2]), (100, vec![0.6])].into_iter());
        assert!((worst - 0.3).abs() < 1e-12);
        let bits = |numbers: [f64; 2]| numbers.map(f64::to_bits);
        let one = mean_over_parts([good()].into_iter());
        assert_eq!(bits(one), bits([0.5, 0.75]));
        assert_eq!(bits(mean_over_parts(std::iter::empty())), [0; 2]);
    }

    #[test]
    fn chain_sets_that_disagree_on_the_evidence_are_refused() {
        let name = "ln-z-agreement-of-chain-sets";
        assert!(passes(name, &estimate(vec![-3.0, -3.1, -2.9, -3.05], 0.1)));
        // One chain set missed a mode that holds half of the mass.
        assert!(!passes(name, &estimate(vec![-3.0, -3.1, -2.9, -3.7], 0.1)));
        assert!(!passes(name, &estimate(vec![-3.0, -3.1], f64::NAN)));
    }

    #[test]
    fn one_sided_estimates_that_disagree_are_refused() {
        let name = "forward-backward-difference";
        let mut different = estimate(vec![-3.0; 4], 0.1);
        assert!(passes(name, &different));
        different.forward -= 0.5;
        assert!(!passes(name, &different));
        different.forward = f64::NEG_INFINITY;
        assert!(!passes(name, &different));
    }

    #[test]
    fn a_newest_extension_with_another_evidence_does_not_confirm() {
        let draws = PosteriorDraws {
            positions: vec![Vec::new(); 4],
            ln_likelihood: vec![Vec::new(); 4],
        };
        let passes = |earlier_and_newest: Option<[f64; 2]>| {
            let estimates = earlier_and_newest.map(|l| l.map(|l| estimate(vec![l; 4], 0.1)));
            let checks = confirmation(&draws.agreement(1, 4), estimates.as_ref(), 2, MIN_ESS);
            checks
                .iter()
                .find(|c| c.name == "newest-ln-z")
                .unwrap()
                .pass
        };
        // Three combined errors are 0.42.
        assert!(passes(Some([-43.0, -43.4])));
        assert!(!passes(Some([-43.0, -43.45])));
        assert!(!passes(Some([f64::NAN, -43.4])));
        assert!(!passes(None));
    }

    /// Weight of the mode that simulated chains visit rarely.
    const WEIGHT: f64 = 0.05;

    /// A simulated run that is confirmed: the weight of the mode, its error by its own effective size, and scans.
    struct Confirmed {
        weight: f64,
        error: f64,
        scans: f64,
    }

    /// A run of four chain sets whose states at the posterior leave a mode, six deviations away, after `stay` scans on average, with so many
    /// effective draws as its target; none if it is not confirmed.
    fn sticky(run: u64, stay: f64, target_ess: f64) -> Option<Confirmed> {
        // Every eighth scan of a last round of 256 scans and its extensions.
        let settings = Settings {
            first_scans: 8,
            rounds: 3,
            extensions: 13,
            target_ess,
            ..Settings::default()
        };
        let all = settings.scans_with(settings.extensions);
        let chain_sets: Vec<(Vec<f64>, Vec<f64>)> = (0..4)
            .map(|chain_set| {
                let mut rng = stream(1, Domain::Test, run, chain_set);
                let mut inside = unit_open(&mut rng) < WEIGHT;
                (0..all)
                    .map(|_| {
                        let leave = 8.0 / stay * if inside { 1.0 } else { WEIGHT / (1.0 - WEIGHT) };
                        inside ^= unit_open(&mut rng) < leave;
                        let mode = f64::from(u8::from(inside));
                        (mode, 6.0 * mode + standard_normal(&mut rng))
                    })
                    .unzip()
            })
            .collect();
        let burn_in = settings.scans_of_extension(0);
        let agreeing = [0; 2].map(|_| estimate(vec![0.0; 4], 0.1));
        let mut passed_before = false;
        for extensions in 1..=settings.extensions {
            let counted = burn_in..settings.scans_with(extensions);
            let part = |of: fn(&(Vec<f64>, Vec<f64>)) -> &Vec<f64>| -> Vec<Vec<f64>> {
                let own = |c: &(Vec<f64>, Vec<f64>)| of(c)[counted.clone()].to_vec();
                chain_sets.iter().map(own).collect()
            };
            let x = part(|c| &c.1);
            let drawn = PosteriorDraws {
                ln_likelihood: x.clone(),
                positions: x,
            };
            let newest = drawn.newest(settings.scans_of_extension(extensions), 1);
            let passed = draws(&drawn.agreement(1, 4), target_ess);
            let passed = passed.iter().all(|check| check.pass);
            let looks = usize::from(passed) + usize::from(passed && passed_before);
            let confirmed =
                confirmation(&newest.agreement(1, 4), Some(&agreeing), looks, target_ess);
            if passed && confirmed.iter().all(|check| check.pass) {
                let modes = part(|c| &c.0);
                let modes: Vec<&[f64]> = modes.iter().map(Vec::as_slice).collect();
                return Some(Confirmed {
                    weight: modes.concat().iter().sum::<f64>() / (4 * counted.len()) as f64,
                    error: error_of_mean(&modes),
                    scans: 8.0 * counted.end as f64,
                });
            }
            passed_before = passed;
        }
        None
    }

    /// What became of simulated runs.
    struct Outcomes {
        /// Fraction of the runs that are confirmed.
        confirmed: f64,
        /// Of these, the fraction whose weight of the mode is wrong by more than a factor of two.
        wrong: f64,
        /// And the fraction whose weight is within two of its errors.
        covered: f64,
        /// Their mean weight.
        weight: f64,
        /// Their mean number of scans.
        scans: f64,
    }

    fn outcomes(runs: u64, stay: f64, target_ess: f64) -> Outcomes {
        let ended: Vec<Confirmed> = (0..runs)
            .into_par_iter()
            .filter_map(|run| sticky(run, stay, target_ess))
            .collect();
        let mean =
            |of: fn(&Confirmed) -> f64| ended.iter().map(of).sum::<f64>() / ended.len() as f64;
        Outcomes {
            confirmed: ended.len() as f64 / runs as f64,
            wrong: mean(|run| f64::from(u8::from(!(0.025..=0.1).contains(&run.weight)))),
            covered: mean(|run| {
                f64::from(u8::from((run.weight - WEIGHT).abs() <= 2.0 * run.error))
            }),
            weight: mean(|run| run.weight),
            scans: mean(|run| run.scans),
        }
    }

    /// The recorded rates are those of 1,000 runs (docs/targets.md, section 3).
    #[test]
    fn confirmed_runs_rarely_miss_what_chains_visit_rarely() {
        let runs = 200;
        let above = |rate: f64| rate + 3.0 * (rate * (1.0 - rate) / runs as f64).sqrt();
        // Target, stay, and the rates of wrong weights and of weights that are not within two errors.
        for (target_ess, stay, wrong, uncovered) in [
            (MIN_ESS, 20.0, 0.002, 0.08),
            (MIN_ESS, 100.0, 0.087, 0.17),
            (0.5 * MIN_ESS, 20.0, 0.026, 0.10),
            (0.5 * MIN_ESS, 100.0, 0.232, 0.27),
        ] {
            let found = outcomes(runs, stay, target_ess);
            assert!(
                found.confirmed > 0.95
                    && found.wrong <= above(wrong)
                    && 1.0 - found.covered <= above(uncovered),
                "{target_ess} {stay}: {} {} {}",
                found.confirmed,
                found.wrong,
                found.covered
            );
        }
    }

    #[test]
    #[ignore = "prints a table, ten minutes"]
    fn table_of_confirmed_runs() {
        println!(
            "| target ESS | stay, scans | confirmed | of these wrong | weight within two errors | mean weight | mean scans |\n|---|---|---|---|---|---|---|"
        );
        for target_ess in [400.0, 200.0] {
            for stay in [20.0, 100.0, 600.0] {
                let Outcomes {
                    confirmed,
                    wrong,
                    covered,
                    weight,
                    scans,
                } = outcomes(1_000, stay, target_ess);
                println!(
                    "| {target_ess} | {stay} | {confirmed:.3} | {wrong:.3} | {covered:.2} | {weight:.4} | {scans:.0} |"
                );
            }
        }
    }
}
