//! Checkpoints with a right checksum and a wrong state: resumed for one step.

use crate::harness::Verdict;
use crate::mutate;
use oblate_samplers::control::CheckpointPlan;
use oblate_samplers::rng::{RandomStream, below};
use oblate_samplers::target::Involution;
use oblate_samplers::{
    Control, Error, Event, Marginal, Observer, Outcome, Prior, Run, Symmetry, Target, bridge,
    checkpoint, nested, pt,
};
use rand::Rng;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Bytes before the payload, and where the payload's checksum and length are.
const HEADER: usize = 44;
const CHECKSUM: usize = 28;

/// Two normal modes in a box, with the symmetries that a target can have.
struct Modes {
    prior: Prior,
    symmetries: Vec<Symmetry>,
    width: f64,
}

struct Mirror;

impl Involution for Mirror {
    fn name(&self) -> &str {
        "mirror"
    }
    fn apply(&self, z: &mut [f64]) -> Option<f64> {
        z[0] = -z[0];
        Some(0.0)
    }
}

impl Modes {
    fn new(dim: usize, width: f64) -> Self {
        let marginal = Marginal::Uniform { lo: -4.0, hi: 4.0 };
        Self {
            prior: Prior::new((0..dim).map(|k| (format!("x{k}"), "", marginal))).unwrap(),
            symmetries: vec![Symmetry::Involution(Box::new(Mirror))],
            width,
        }
    }
}

impl Target for Modes {
    fn prior(&self) -> &Prior {
        &self.prior
    }
    fn ln_likelihood(&self, theta: &[f64]) -> Outcome {
        // Nothing has a likelihood in one corner.
        if theta[0] > 3.5 && theta[1] > 3.5 {
            return Outcome::Reject("corner");
        }
        let square = |x: f64| (x / self.width).powi(2);
        let rest: f64 = theta[1..].iter().map(|x| square(*x)).sum();
        Outcome::Value(-0.5 * (square(theta[0].abs() - 2.0) + rest))
    }
    fn ln_likelihood_and_gradient(&self, theta: &[f64], gradient: &mut [f64]) -> Outcome {
        let scale = self.width.powi(-2);
        for (g, x) in gradient.iter_mut().zip(theta) {
            *g = -x * scale;
        }
        gradient[0] = -(theta[0].abs() - 2.0) * theta[0].signum() * scale;
        self.ln_likelihood(theta)
    }
    fn gradient_cost(&self) -> Option<f64> {
        Some(1.0)
    }
    fn symmetries(&self) -> &[Symmetry] {
        &self.symmetries
    }
}

/// Breaks at the n-th event that is a step of the work.
struct Steps(u64);

impl Observer for Steps {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        let step = matches!(
            event,
            Event::Nested { .. }
                | Event::Batch { .. }
                | Event::Smc { .. }
                | Event::Tempered { .. }
                | Event::Bridge { .. }
        );
        self.0 = self.0.saturating_sub(u64::from(step));
        if self.0 == 0 {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }
}

/// A sampler on a target, with the settings of one seed.
pub enum Work {
    Nested(nested::Settings),
    Tempered(pt::Settings),
    Bridge(bridge::Settings, Box<Run>),
}

impl Work {
    /// Continues from the checkpoint for so many steps.
    fn go_on(&self, path: &Path, steps: u64) -> oblate_samplers::Result<Run> {
        let mut observer = Steps(steps);
        let mut control = Control::new(&mut observer);
        control.checkpoint = Some(CheckpointPlan {
            path: path.to_path_buf(),
            every: Duration::MAX,
            resume: true,
            config_hash: 1,
        });
        let (coarse, fine) = (Modes::new(3, 0.5), Modes::new(3, 0.1));
        match self {
            Self::Nested(settings) => nested::run(&coarse, settings, 1, &mut control),
            Self::Tempered(settings) => pt::run(&coarse, settings, 1, &mut control),
            Self::Bridge(settings, parent) => {
                bridge::run(&fine, &coarse, parent, settings, 1, &mut control)
            }
        }
    }
}

/// A valid checkpoint.
pub struct Seed {
    work: Work,
    bytes: Vec<u8>,
}

fn seed(work: Work, steps: u64) -> Seed {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("checkpoint");
    // An interrupt is an error where there is no result yet.
    let _ = work.go_on(&path, steps);
    Seed {
        bytes: std::fs::read(&path).unwrap(),
        work,
    }
}

pub fn nested_seeds() -> Vec<Seed> {
    let settings = |kernel, target_ess| nested::Settings {
        n_live: 40,
        kernel,
        target_ess,
        steps: None,
        simulations: 20,
        bootstraps: 20,
        ..nested::Settings::default()
    };
    use nested::Kernel::*;
    let all = [
        (settings(Uniform, None), 1),
        (settings(Uniform, None), 60),
        (settings(Differential, None), 40),
        (settings(Galilean, None), 50),
        (settings(RandomWalk, Some(5_000.0)), 260),
        (settings(Uniform, Some(5_000.0)), 260),
    ];
    all.map(|(settings, steps)| seed(Work::Nested(settings), steps))
        .into()
}

pub fn pt_seeds() -> Vec<Seed> {
    let plain = pt::Settings {
        chain_sets: 2,
        rounds: 3,
        first_scans: 4,
        temperatures: 4,
        min_temperatures: 3,
        max_temperatures: 6,
        ..pt::Settings::default()
    };
    let mixed = pt::Settings {
        smc_particles: 40,
        smc_samplers: 2,
        mcmc_steps: 2,
        slice_updates: 1,
        extensions: 3,
        mixture_rounds: 3,
        max_leapfrogs: 4,
        ..plain.clone()
    };
    let along_surrogate = pt::Settings {
        surrogate: true,
        smc_particles: 200,
        hmc_transitions: 0,
        slice_updates: 1,
        ..mixed.clone()
    };
    let diagonal = pt::Settings { ..plain.clone() };
    let all = [
        (plain.clone(), 3),
        (plain, 10),
        (diagonal, 4),
        (along_surrogate, 40),
        (mixed.clone(), 3),
        (mixed.clone(), 40),
        (mixed.clone(), 47),
        (mixed, 80),
    ];
    all.map(|(settings, steps)| seed(Work::Tempered(settings), steps))
        .into()
}

pub fn bridge_seeds() -> Vec<Seed> {
    let parent = || {
        let settings = nested::Settings {
            n_live: 60,
            ..nested::Settings::default()
        };
        let mut silent = oblate_samplers::control::Silent;
        nested::run(
            &Modes::new(3, 0.5),
            &settings,
            1,
            &mut Control::new(&mut silent),
        )
        .unwrap()
    };
    // Fifty draws are too few, so that further MCMC steps and another batch follow.
    let settings = bridge::Settings {
        smc_particles: 50,
        mcmc_steps: 3,
        further_mcmc_steps: 4,
        max_batches: 2,
    };
    [0, 1, 2, 8, 14, 20, 26]
        .map(|steps| seed(Work::Bridge(settings.clone(), Box::new(parent())), steps))
        .into()
}

/// Damages the payload of one seed, corrects the checksum, and continues from it for one step.
pub fn case(rng: &mut RandomStream, seeds: &[Seed], folder: &Path) -> Verdict {
    let own = &seeds[below(rng, seeds.len())];
    let other = &seeds[below(rng, seeds.len())];
    let mut bytes = own.bytes.clone();
    let payload = damaged(rng, &own.bytes[HEADER..], &other.bytes[HEADER..]);
    bytes.truncate(HEADER);
    bytes.extend_from_slice(&payload);
    bytes[CHECKSUM..CHECKSUM + 8].copy_from_slice(&checkpoint::hash(&payload).to_le_bytes());
    bytes[CHECKSUM + 8..HEADER].copy_from_slice(&(payload.len() as u64).to_le_bytes());
    let path: PathBuf = folder.join("checkpoint");
    let _ = std::fs::remove_file(checkpoint::previous(&path));
    std::fs::write(&path, &bytes).unwrap();
    match own.work.go_on(&path, 1) {
        Err(Error::Checkpoint { .. }) => Verdict::Refused,
        // Another error is one of the work itself.
        Ok(_) | Err(_) => Verdict::Accepted,
    }
}

fn damaged(rng: &mut RandomStream, payload: &[u8], other: &[u8]) -> Vec<u8> {
    if below(rng, 3) == 0 {
        return mutate::bytes(rng, payload, other);
    }
    let mut out = payload.to_vec();
    for _ in 0..mutate::places(rng) {
        // The beginning and the end hold most of what is not a long row of numbers.
        let reach = [64, 1024, out.len()][below(rng, 3)].min(out.len());
        let place = below(rng, reach);
        let at = if below(rng, 2) == 0 {
            place
        } else {
            out.len() - 1 - place
        };
        match below(rng, 5) {
            0 => {
                let number = mutate::nasty_float(rng).to_le_bytes();
                let end = (at + 8).min(out.len());
                out[at..end].copy_from_slice(&number[..end - at]);
            }
            1 => out[at] = out[at].wrapping_add(1),
            2 => out[at] = out[at].wrapping_sub(1),
            3 => out[at] = [0, 1, 2, 3, 0x7f, 0xff][below(rng, 6)],
            // A long varint.
            _ => {
                let number = rng.next_u64() >> below(rng, 64);
                out.splice(at..=at, varint(number));
            }
        }
    }
    out
}

fn varint(mut number: u64) -> Vec<u8> {
    let mut out = Vec::new();
    while number >= 0x80 {
        out.push((number & 0x7f) as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
    out
}
