//! Names of any characters in figures and on the page.

use super::fit::overlay;
use super::{corner_columns, one_group, sound, track};
use crate::runs;
use oblate::posterior::{Summary, SummaryContext};
use oblate::report::{Figure, PageRun, QCurve, corner, q_posterior};

/// Names come from track headers and folders, and may have any characters.
#[test]
fn a_name_of_any_characters_makes_sound_figures_and_a_sound_page() {
    let name: String = (0..0xa0)
        .chain([0xad, 0xfffd, 0xfffe, 0xffff, 0x1_f30c])
        .filter_map(char::from_u32)
        .collect();
    let run = runs::nested(500, 3);
    let mut data = track().0;
    data.name.clone_from(&name);
    let curve = || QCurve {
        name: name.clone(),
        q: run.draws.derived_column(0),
        weights: run.draws.weights(),
        ess: 500.0,
    };
    let mut columns = corner_columns(&run, 2);
    columns[0].column.name.clone_from(&name);
    columns[0].column.unit.clone_from(&name);
    let figures = [
        sound("fit_named", overlay(&data, &[(1.0, 2.0)], 360.0)),
        sound("q_named", q_posterior(&[curve(), curve()], None, None)),
        sound(
            "corner_named",
            corner(&columns, &run.draws.weights(), &name),
        ),
    ];
    let context = SummaryContext {
        command: name.clone(),
        warnings: vec![name.clone()],
        ..SummaryContext::default()
    };
    let mut summary = Summary::new(&run, &context);
    summary.parameters[0].0.clone_from(&name);
    let html = one_group(
        &name,
        &[PageRun {
            name: &name,
            summary: &summary,
            comparison: None,
            config: &name,
            figures: &figures.map(|svg| Figure {
                caption: name.clone(),
                svg,
            }),
        }],
    );
    let foreign = html
        .chars()
        .find(|c| c.is_control() && !['\t', '\n', '\r'].contains(c));
    assert_eq!(foreign, None);
    // All characters of a name that text can have are still there.
    assert!(html.contains("xyz") && html.contains("&lt;=&gt;") && html.contains('\u{1f30c}'));
}
