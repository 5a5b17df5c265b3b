//! Convergence checks of a nested run.

use super::check_names;
use super::results::{CheckInputs, Errors, MIN_LINEAGES};
use super::settings::Kernel;
use super::state::{Context, State};
use super::tuning::{MAX_SEED_CORRELATION, mean};
use crate::output::{Check, Ess};
use crate::rng::{Domain, stream};

/// Task number of the random stream that turns insertion ranks into continuous numbers.
const SPREAD: u64 = 3;

/// Maximum ratio of the bootstrap error of ln Z, from the scatter of recent lineages, to the simulated one of
/// independent draws. The larger of the two is quoted; docs/targets.md, section 1, has how well it holds below this
/// limit. Larger ratios have not been tested.
const MAX_BOOTSTRAP_TO_SIMULATED: f64 = 2.5;

/// What makes more effective draws of a nested run.
pub(super) const MORE_DRAWS: &str =
    "allow more `max_batches`, double `n_live`, or merge runs of several seeds";

/// All checks that apply to a run with these targets and this kernel.
pub(super) fn checks(
    context: &Context<'_>,
    state: &State,
    measured: &CheckInputs,
    ess: &Ess,
) -> Vec<Check> {
    let settings = context.settings;
    let mut checks = vec![
        Check::at_most(
            check_names::REMAINING_EVIDENCE,
            state.delta_ln_z(settings),
            settings.dlnz,
            "how much the live points could still add to ln Z; if too much, resume the run with more time",
        ),
        Check::at_most(
            check_names::INSERTION_RANK,
            state.ranks.z_score(0).abs(),
            3.0,
            "normal deviate of the mean insertion rank; if too large, new points are not uniform above the likelihood bound: double `steps`, or use `kernel = \"differential\"`",
        ),
    ];
    let mut rng = stream(context.seed, Domain::Post, SPREAD, 0);
    let windows = state.ranks.ks_windows(20 * settings.n_live, &mut rng);
    checks.push(Check::at_least(
        check_names::INSERTION_RANK_WINDOWS,
        windows.iter().copied().fold(1.0, f64::min),
        0.01 / windows.len() as f64,
        "smallest Kolmogorov-Smirnov p-value of the insertion ranks over windows of the run; if too small, double `steps` or raise `n_live`",
    ));
    checks.extend(by_lineages(measured));
    if let Some(target) = settings.target_ess {
        checks.push(Check::at_least(
            check_names::TARGET_ESS,
            ess.quoted,
            target,
            "effective sample size, with the target as its limit; if too small, allow more `max_batches`",
        ));
    }
    if let Some(target) = settings.target_ln_z_error {
        checks.push(Check::at_most(
            check_names::TARGET_LN_Z_ERROR,
            measured.errors.simulated,
            target,
            "simulated error of ln Z, with the target as its limit; if too large, allow more `max_batches`",
        ));
    }
    if state.bounded_points > 0 {
        checks.extend(of_kernel(context, state));
    }
    checks
}

/// Checks by lineages and recent lineages.
pub(super) fn by_lineages(measured: &CheckInputs) -> [Check; 3] {
    let Errors {
        simulated,
        bootstrapped,
        ..
    } = measured.errors;
    let ratio = if bootstrapped > 0.0 {
        bootstrapped / simulated
    } else {
        0.0
    };
    let [even, odd] = measured.halves;
    // Each half has half of the points: the difference has twice the error of the run.
    let error = 2.0 * simulated.max(bootstrapped);
    let difference = (even - odd).abs();
    [
        Check::at_least(
            check_names::EFFECTIVE_LINEAGES,
            measured.lineages,
            MIN_LINEAGES,
            "effective number of lineages among the posterior's draws; if too small, effective sizes and errors of mode weights are not reliable: allow more `max_batches`, double `n_live`, or merge runs of several seeds",
        ),
        Check::at_most(
            check_names::BOOTSTRAP_TO_SIMULATED,
            ratio,
            MAX_BOOTSTRAP_TO_SIMULATED,
            "bootstrap error of ln Z (over recent lineages) over the simulated error (of independent draws); if too large, new points depend on their seeds: double `steps`",
        ),
        Check::at_most(
            check_names::LINEAGE_HALVES,
            if difference > 0.0 {
                difference / error
            } else {
                0.0
            },
            3.0,
            "difference of ln Z between two halves of the recent lineages, in standard errors; if too large, it is random which modes are found: allow more `max_batches`, or double `n_live`",
        ),
    ]
}

fn of_kernel(context: &Context<'_>, state: &State) -> Vec<Check> {
    let points = state.bounded_points as f64;
    let mut checks = Vec::new();
    match context.kernel() {
        Kernel::Auto | Kernel::Uniform => checks.push(Check::at_least(
            check_names::BOUND_EFFICIENCY,
            points / state.bounded_calls.max(1) as f64,
            1e-3,
            "new points per call drawn from the ellipsoids; if too small, the ellipsoids do not fit the posterior: use `kernel = \"differential\"`",
        )),
        Kernel::RandomWalk
        | Kernel::RandomSlice
        | Kernel::Differential
        | Kernel::Surrogate
        | Kernel::Galilean => {
            if !state.tuning.jump_distances.is_empty() {
                checks.push(Check::at_least(
                    check_names::RELATIVE_JUMP_DISTANCE,
                    mean(&state.tuning.jump_distances),
                    0.2,
                    "distance of new points from their seeds over that between live points; if too small, chains stay close to their seeds: double `steps`",
                ));
                checks.push(Check::at_most(
                    check_names::SEED_RANK_CORRELATION,
                    mean(&state.tuning.seed_correlations),
                    MAX_SEED_CORRELATION,
                    "rank correlation of a new point's likelihood with its seed's; if too large, ln Z is too high: double `steps`",
                ));
            }
        }
    }
    if matches!(context.kernel(), Kernel::RandomWalk | Kernel::Galilean) {
        checks.push(Check::at_most(
            check_names::NO_MOVE,
            state.tuning.stayed as f64 / points,
            0.01,
            "fraction of chains that ended where they began; if too large, double `steps`",
        ));
    }
    checks
}
