//! The import order of `src`: a module may use those before it in the list, never those after it.

use crate::files::circles;
use crate::modules::wrong_arrows;
use std::path::Path;

/// The modules in their order, from the lowest layer up.
const ORDER: [&str; 19] = [
    "error",
    "units",
    "scalar",
    "params",
    "potential",
    "orbit",
    "spray",
    "stream",
    "track",
    "data",
    "likelihood",
    "posterior",
    "inference",
    "population",
    "report",
    "config",
    "run",
    "cli",
    "main",
];

#[test]
fn every_module_imports_only_modules_to_its_left() {
    let src = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src"));
    let (wrong, seen) = wrong_arrows(src, &ORDER);
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(seen > 40, "only {seen} arrows were seen");
}

#[test]
fn no_two_files_import_each_other() {
    let src = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src"));
    let found = circles(src);
    assert!(found.is_empty(), "{found:#?}");
}
