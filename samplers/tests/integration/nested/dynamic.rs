//! Runs that add live points until they meet a target.

use super::{agrees, sample, settings};
use crate::targets::{hard, smooth};
use oblate_samplers::control::{CheckpointPlan, Control, Event, Observer, Silent};
use oblate_samplers::nested::{Kernel, Settings, run};
use oblate_samplers::output::{History, Status};
use oblate_samplers::{Run, Target};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

fn dynamic(n_live: usize, kernel: Kernel, target_ess: f64) -> Settings {
    Settings {
        target_ess: Some(target_ess),
        ..settings(n_live, kernel)
    }
}

#[test]
fn evidences_are_right_with_live_points_added_for_the_posterior() {
    let power = hard::power();
    agrees(
        "power",
        &power,
        power.ln_z,
        &dynamic(100, Kernel::Uniform, 2_000.0),
    );
    let cake = hard::cake(2);
    agrees(
        "cake",
        &cake,
        cake.ln_z,
        &dynamic(100, Kernel::Uniform, 2_000.0),
    );
    let shells = smooth::shells(5);
    agrees(
        "shells",
        &shells,
        shells.ln_z,
        &dynamic(200, Kernel::RandomSlice, 2_000.0),
    );
    let mvn = smooth::mvn13();
    agrees(
        "mvn13",
        &mvn,
        mvn.ln_z,
        &dynamic(200, Kernel::Differential, 3_000.0),
    );
    // Rejected draws of the prior are part of every batch that begins with it.
    let cut = smooth::half_plane();
    agrees(
        "half plane",
        &cut,
        cut.ln_z,
        &dynamic(100, Kernel::Uniform, 1_000.0),
    );
}

#[test]
fn evidences_are_right_with_live_points_added_for_the_evidence() {
    let target = smooth::gauss3();
    let aimed = Settings {
        target_ln_z_error: Some(0.08),
        ..settings(100, Kernel::Uniform)
    };
    agrees("gauss3", &target, target.ln_z, &aimed);
    let done = sample(&target, &aimed, 1);
    assert!(done.evidence.error_parts["simulated"] <= 0.08);
    let check = done.checks.iter().find(|g| g.name == "target-ln-z-error");
    assert!(check.is_some_and(|g| g.pass));
}

/// Counts batches.
#[derive(Default)]
struct Batches(usize);

impl Observer for Batches {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        self.0 += usize::from(matches!(event, Event::Batch { .. }));
        ControlFlow::Continue(())
    }
}

#[test]
fn batches_from_the_prior_reach_the_posterior() {
    let target = smooth::mvn13();
    let aimed = Settings {
        target_ln_z_error: Some(0.22),
        ..settings(200, Kernel::RandomSlice)
    };
    let mut batches = Batches::default();
    let run = run(&target, &aimed, 1, &mut Control::new(&mut batches)).unwrap();
    assert!((run.evidence.ln_z - target.ln_z).abs() < 4.0 * run.evidence.error);
    // 200 live points have an error of sqrt(18.8 / 200) = 0.31: two more batches of as many reduce it to 0.18. Batches
    // that ended far below the posterior took hundreds.
    assert!(batches.0 <= 6, "{}", batches.0);
}

#[test]
fn added_live_points_are_effective_draws_for_fewer_calls() {
    // Draws are independent, so that batches need not begin with the prior.
    let target = smooth::gauss3();
    let aimed = sample(&target, &dynamic(200, Kernel::Uniform, 4_000.0), 1);
    assert_eq!(aimed.status, Status::Complete);
    assert!(aimed.ess.quoted >= 4_000.0, "{}", aimed.ess.quoted);
    let even = sample(&target, &settings(1_000, Kernel::Uniform), 1);
    let cost = |run: &oblate_samplers::Run| run.cost.calls as f64 / run.ess.kish;
    let (aimed, even) = (cost(&aimed), cost(&even));
    println!("calls per effective draw: {aimed:.1} dynamic, {even:.1} static");
    assert!(aimed < 0.8 * even, "{aimed} {even}");
}

#[test]
fn batches_begin_with_the_prior_where_draws_resemble_each_other() {
    let target = smooth::shells(5);
    let few = Settings {
        max_batches: 3,
        ..dynamic(200, Kernel::RandomSlice, 4_000.0)
    };
    let run = sample(&target, &few, 1);
    // Its draws are a hundred, so that every batch is another run, with lineages of its own.
    assert_eq!(run.status, Status::Complete);
    assert!(run.ess.quoted < 0.5 * run.ess.kish, "{}", run.ess.quoted);
    let History::Nested { live, .. } = &run.history else {
        panic!("a nested run has live points")
    };
    assert_eq!(live[0], 600);
    let lineages = run.draws.cluster.iter().max().map(|last| last + 1);
    assert_eq!(lineages, Some(3 * 40));
    assert!((run.evidence.ln_z - target.ln_z).abs() < 4.0 * run.evidence.error);
    let target_ess = run.checks.iter().find(|check| check.name == "target-ess");
    assert!(target_ess.is_some_and(|check| !check.pass));
}

#[test]
fn posterior_means_are_right_within_their_effective_sizes() {
    let target = smooth::mvn13();
    let run = sample(&target, &dynamic(200, Kernel::Differential, 3_000.0), 2);
    // The prior is N(mean, 1) and the likelihood Gaussian: a long static run has the same means.
    let even = sample(&target, &settings(1_000, Kernel::Differential), 3);
    let moments = |run: &oblate_samplers::Run, k: usize| {
        let (x, w) = (run.draws.column(k), run.draws.weights());
        let mean: f64 = x.iter().zip(&w).map(|(x, w)| x * w).sum();
        let variance: f64 = x.iter().zip(&w).map(|(x, w)| w * (x - mean).powi(2)).sum();
        (mean, variance / run.ess.bulk[k])
    };
    for k in 0..target.dim() {
        let ((a, va), (b, vb)) = (moments(&run, k), moments(&even, k));
        let z = (a - b) / (va + vb).sqrt();
        // One in 1,200 for thirteen numbers.
        assert!(z.abs() < 4.0, "{k}: {z}");
    }
}

/// Breaks at event `at`.
struct StopAt(u64);

impl Observer for StopAt {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        if let Event::Nested { .. } | Event::Batch { .. } = event {
            self.0 = self.0.saturating_sub(1);
        }
        if self.0 == 0 {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }
}

/// A part of a run: it goes on from the checkpoint in the folder, if there is one.
fn part(
    target: &dyn Target,
    settings: &Settings,
    folder: &Path,
    observer: &mut dyn Observer,
) -> Run {
    let mut control = Control::new(observer);
    control.checkpoint = Some(CheckpointPlan {
        path: folder.join("run"),
        every: Duration::MAX,
        resume: true,
        config_hash: 5,
    });
    run(target, settings, 1, &mut control).unwrap()
}

#[test]
fn a_dynamic_run_has_the_same_bits_on_any_threads_and_after_any_stop() {
    for (n_live, kernel) in [(60, Kernel::Differential), (160, Kernel::Surrogate)] {
        has_the_same_bits(&dynamic(n_live, kernel, 500.0));
    }
}

fn has_the_same_bits(aimed: &Settings) {
    let folder = tempfile::tempdir().unwrap();
    let target = smooth::shells(5);
    let whole = sample(&target, aimed, 1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build();
    let threaded = pool.unwrap().install(|| sample(&target, aimed, 1));
    assert_eq!(threaded.bits(), whole.bits());
    let mut stops = 0;
    let resumed = loop {
        let run = part(&target, aimed, folder.path(), &mut StopAt(17));
        if run.status == Status::Complete {
            break run;
        }
        assert_eq!(run.status, Status::Interrupted);
        assert!(run.evidence.ln_z.is_finite() && !run.converged());
        stops += 1;
    };
    assert!(stops > 5, "{stops}");
    assert_eq!(resumed.bits(), whole.bits());
}

#[test]
fn a_run_goes_on_with_more_batches_as_if_it_had_been_allowed_them() {
    let folder = tempfile::tempdir().unwrap();
    let target = smooth::shells(5);
    let aimed = |max_batches| Settings {
        max_batches,
        ..dynamic(60, Kernel::Differential, 5_000.0)
    };
    let up_to = |batches| part(&target, &aimed(batches), folder.path(), &mut Silent);
    let [one, three] = [1, 3].map(up_to);
    assert_eq!(one.status, Status::Complete);
    assert!(one.draws.len() < three.draws.len());
    assert_eq!(three.bits(), sample(&target, &aimed(3), 1).bits());
}

/// The events of a run that say how far its batches are.
#[derive(Default)]
struct Marks(Vec<Event>);

impl Observer for Marks {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        if let Event::Nested { .. } | Event::Batch { .. } = event {
            self.0.push(event.clone());
        }
        ControlFlow::Continue(())
    }
}

#[test]
fn a_run_says_how_far_its_batches_are_and_about_how_many_it_needs() {
    let target = smooth::shells(5);
    let aimed = dynamic(60, Kernel::Differential, 500.0);
    let mut marks = Marks::default();
    let run = run(&target, &aimed, 1, &mut Control::new(&mut marks)).unwrap();
    assert_eq!(run.status, Status::Complete);
    let (mut done, mut needs) = (0.0, Vec::new());
    for event in &marks.0 {
        match event {
            Event::Nested { batches, .. } => {
                assert!(*batches >= done, "{batches} after {done}");
                done = *batches;
            }
            Event::Batch {
                number,
                of,
                open,
                needed,
                ..
            } => {
                let (first, number) = (*number == 1, *number as f64);
                // An end that is expected from earlier batches is near the end that comes.
                assert!(first || done > number - 0.3, "{done} of {number}");
                assert!(*of == aimed.max_batches && !open.is_empty() && *needed > 1.0);
                needs.push(number * needed);
            }
            _ => {}
        }
    }
    let (all, last) = (done.floor() + 1.0, needs.pop().expect("a second batch"));
    assert!(last > 0.5 * all && last < 2.0 * all, "{last} of {all}");
}
