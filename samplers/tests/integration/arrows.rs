//! The import order of `src`: a room may use what stands to its left, never what stands to its right.

use crate::rooms::{rooms_used, wrong_arrows};
use std::collections::BTreeMap;
use std::path::Path;

/// From the ground floor up. `checkpoint` stands before `output`, whose hash of a run is the checkpoints' hash; `nested`
/// and `hmc` do not know each other, which the order alone cannot say (see the second test).
const ORDER: [&str; 17] = [
    "error",
    "normal",
    "rng",
    "target",
    "checkpoint",
    "output",
    "control",
    "keeper",
    "diagnostics",
    "neighbours",
    "cooling",
    "mixture",
    "hmc",
    "nested",
    "pt",
    "boost",
    "refine",
];

fn src() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src"))
}

#[test]
fn every_room_imports_only_rooms_to_its_left() {
    let (wrong, seen) = wrong_arrows(src(), &ORDER);
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(seen > 40, "only {seen} arrows were seen");
}

#[test]
fn nested_knows_neither_hmc_nor_pt() {
    let without: Vec<_> = ORDER.into_iter().filter(|r| *r != "hmc").collect();
    let (wrong, _) = wrong_arrows(src(), &without);
    assert!(wrong.iter().all(|w| !w.contains("nested")), "{wrong:#?}");
}

#[test]
fn an_arrow_is_seen_in_paths_groups_and_exports_but_not_in_comments_and_tests() {
    let text = "
use crate::rng::stream;
use crate::{
    normal, hmc::{Point, leapfrog},
};
// use crate::pt::run;
fn f() -> crate::Result<()> { crate::output::f() }
#[cfg(test)]
mod tests {
    use crate::nested::run;
}";
    let exports = BTreeMap::from([("Result".to_owned(), "error".to_owned())]);
    let used: Vec<_> = rooms_used(text, &exports).into_iter().collect();
    assert_eq!(used, ["error", "hmc", "normal", "output", "rng"]);
}
