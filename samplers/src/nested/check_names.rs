//! Names of the checks of nested runs and of merged ones.

/// What the live points could still add to ln Z.
pub const REMAINING_EVIDENCE: &str = "remaining-evidence";

/// Mean rank of new points among the live ones.
pub const INSERTION_RANK: &str = "insertion-rank";

/// Ranks of new points in windows of the run.
pub const INSERTION_RANK_WINDOWS: &str = "insertion-rank-windows";

/// Effective number of lineages.
pub const EFFECTIVE_LINEAGES: &str = "effective-lineages";

/// Ratio of two errors of ln Z.
pub const BOOTSTRAP_TO_SIMULATED: &str = "bootstrap-to-simulated";

/// Difference of ln Z between two halves of the lineages.
pub const LINEAGE_HALVES: &str = "lineage-halves";

/// Effective sample size of a run with a target for it.
pub const TARGET_ESS: &str = "target-ess";

/// Error of ln Z of a run with a target for it.
pub const TARGET_LN_Z_ERROR: &str = "target-ln-z-error";

/// New points per call.
pub const BOUND_EFFICIENCY: &str = "bound-efficiency";

/// Distance of new points from their seeds.
pub const RELATIVE_JUMP_DISTANCE: &str = "relative-jump-distance";

/// Rank correlation of new points with their seeds.
pub const SEED_RANK_CORRELATION: &str = "seed-rank-correlation";

/// Fraction of chains that ended where they began.
pub const NO_MOVE: &str = "no-move";

/// Differences of ln Z between merged runs.
pub const LN_Z_AGREEMENT_OF_SEEDS: &str = "ln-z-agreement-of-seeds";

/// Differences of means between merged runs.
pub const MEAN_AGREEMENT_OF_SEEDS: &str = "mean-agreement-of-seeds";
