//! Figures of the diagnostics of samplers.

use super::sound;
use crate::runs;
use oblate::report::diagnostics;

#[test]
fn diagnostics_show_every_kind_of_run() {
    let svg = sound("diagnostics_nested", diagnostics(&runs::nested(6000, 5)));
    assert!(svg.contains("ln X") && svg.contains("insertion rank"));
    let svg = sound(
        "diagnostics_tempered",
        diagnostics(&runs::tempered(4000, 6)),
    );
    assert_eq!(svg.matches("class=\"gap\"").count(), 7);
    assert_eq!(svg.matches("class=\"acceptance\"").count(), 8);
    assert!(svg.contains("31, 28, 35, 30"));
    let svg = sound("diagnostics_refined", diagnostics(&runs::bridged(2000, 6)));
    assert_eq!(svg.matches("class=\"step\"").count(), 6);
}

#[test]
fn an_axis_of_numbers_that_doubles_cannot_count_has_an_end() {
    let mut run = runs::nested(100, 1);
    if let oblate_samplers::output::History::Nested { ln_x, .. } = &mut run.history {
        // Two neighbouring doubles.
        for (k, x) in ln_x.iter_mut().enumerate() {
            *x = if k < 50 { -1e17 } else { -1e17 - 16.0 };
        }
    }
    sound("far", diagnostics(&run));
}
