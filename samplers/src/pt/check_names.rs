//! Names of the checks of tempered runs.

/// Round trips of the chain set that has fewest.
pub const ROUND_TRIPS_WORST_CHAIN_SET: &str = "round-trips-worst-chain-set";

/// Round trips of all chain sets.
pub const ROUND_TRIPS: &str = "round-trips";

/// Arrivals at the posterior from a new draw of the reference.
pub const RESTARTS_PER_REPLICA: &str = "restarts-per-replica";

/// Round-trip rate over that with independent local samples.
pub const ROUND_TRIP_RATE: &str = "round-trip-rate";

/// Largest swap rejection.
pub const SWAP_REJECTION: &str = "swap-rejection";

/// Change of the communication barrier since the round before.
pub const COMMUNICATION_BARRIER_CHANGE: &str = "communication-barrier-change";

/// Standard error of ln Z.
pub const LN_Z_ERROR: &str = "ln-z-error";

/// Difference of the one-sided estimates of ln Z.
pub const FORWARD_BACKWARD_DIFFERENCE: &str = "forward-backward-difference";

/// Differences of ln Z between chain sets.
pub const LN_Z_AGREEMENT_OF_CHAIN_SETS: &str = "ln-z-agreement-of-chain-sets";

/// Difference of ln Z between the newest extension and the earlier ones.
pub const NEWEST_LN_Z: &str = "newest-ln-z";

/// Effective sample size of the newest extension.
pub const NEWEST_ESS: &str = "newest-ess";

/// Differences of mode weights between chain sets in the newest extension.
pub const NEWEST_MODE_AGREEMENT: &str = "newest-mode-agreement";

/// Looks in succession at which all other checks passed.
pub const LOOKS_PASSED: &str = "looks-passed";

/// Largest R-hat.
pub const R_HAT: &str = "r-hat";

/// Differences of mode weights between chain sets.
pub const MODE_AGREEMENT_OF_CHAIN_SETS: &str = "mode-agreement-of-chain-sets";

/// Fraction of transitions that met a rejected point.
pub const REJECTED_TRANSITIONS: &str = "rejected-transitions";

/// Acceptance at the worst temperature.
pub const LOWEST_ACCEPTANCE: &str = "lowest-acceptance";

/// Acceptance at the best temperature.
pub const HIGHEST_ACCEPTANCE: &str = "highest-acceptance";

/// Fraction of transitions that were stopped at their longest.
pub const TRUNCATED_TRAJECTORIES: &str = "truncated-trajectories";
