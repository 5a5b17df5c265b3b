//! The looks of a run that goes on: which checks are open, and how many scans they need.

use super::rounds;
use crate::targets::smooth;
use oblate_samplers::pt::{self, Settings};
use oblate_samplers::{Control, Event, Observer};
use std::ops::ControlFlow;

#[derive(Default)]
struct Looks(Vec<(usize, Vec<String>, f64)>);

impl Observer for Looks {
    fn event(&mut self, event: &Event) -> ControlFlow<()> {
        if let Event::Look {
            scans,
            open,
            needed,
        } = event
        {
            self.0.push((*scans, open.clone(), *needed));
        }
        ControlFlow::Continue(())
    }
}

#[test]
fn a_look_says_which_checks_are_open_and_about_how_many_scans_they_need() {
    let settings = Settings {
        extensions: 9,
        ..rounds(6)
    };
    let mut looks = Looks::default();
    let run = pt::run(
        &smooth::gauss3(),
        &settings,
        1,
        &mut Control::new(&mut looks),
    )
    .unwrap();
    assert!(run.converged());
    let all = run.draws.len() / settings.chain_sets;
    let looks = looks.0;
    assert!(looks.len() > 1);
    for (scans, open, needed) in &looks {
        assert!(!open.is_empty(), "the run goes on without an open check");
        assert!(*scans < all && *needed >= 1.0);
    }
    assert!(looks.windows(2).all(|pair| pair[0].0 < pair[1].0));
    assert!(
        looks[0].1.iter().any(|name| name == "round-trips"),
        "a short run"
    );
    // What numbers that grow still need is not far from what the run took in the end.
    let growing = looks
        .iter()
        .filter(|look| look.2.is_finite() && look.2 > 1.0);
    let expected: Vec<f64> = growing
        .map(|(scans, _, needed)| *scans as f64 * needed)
        .collect();
    let last = *expected.last().expect("a look at growing numbers");
    assert!(
        last > 0.2 * all as f64 && last < 3.0 * all as f64,
        "{expected:?} {all}"
    );
}
