//! The thirteen parameters: their table, their prior, the halo's shape, and the symmetries of the prior.

mod features;
mod layout;
mod lines;
mod prior;
mod shape;
mod symmetry;

use oblate::params::{PriorSettings, StreamPrior};
use oblate_samplers::rng::{Domain, RandomStream, stream};

const DRAWS: usize = 20_000;

fn default_prior() -> StreamPrior {
    StreamPrior::new(&PriorSettings::default()).unwrap()
}

fn rng(task: u64) -> RandomStream {
    stream(20_260_101, Domain::Test, task, 0)
}
