//! The import order of `src`: a module may use those before it in the list, never those after it.

use crate::files::{circles, imports};
use crate::modules::{modules_used, wrong_arrows};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// From the lowest layer up. `checkpoint` stands before `output`, whose hash of a run is that of checkpoints; `nested` and `hmc`
/// do not import each other, which the order alone cannot say (see the second test).
const ORDER: [&str; 25] = [
    "limits",
    "error",
    "normal",
    "diagnostics",
    "rng",
    "single",
    "target",
    "files",
    "read",
    "valid",
    "checkpoint",
    "surrogate",
    "output",
    "control",
    "cpu_clock",
    "checkpointer",
    "difference_pool",
    "smc_weights",
    "mixture",
    "autoregressive",
    "bent",
    "hmc",
    "nested",
    "pt",
    "bridge",
];

fn src() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/src"))
}

#[test]
fn every_module_imports_only_modules_to_its_left() {
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
    let used: Vec<_> = modules_used(text, &exports).into_iter().collect();
    assert_eq!(used, ["error", "hmc", "normal", "output", "rng"]);
}

#[test]
fn no_two_files_import_each_other() {
    let found = circles(src());
    assert!(found.is_empty(), "{found:#?}");
    let arrows: usize = imports(src()).values().map(|used| used.len()).sum();
    assert!(arrows > 150, "only {arrows} imports were seen");
}

#[test]
fn a_circle_between_files_is_found_through_re_exports_and_a_re_export_is_no_import() {
    let folder = tempfile::tempdir().unwrap();
    let write = |file: &str, text: &str| {
        let path = folder.path().join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    };
    write("lib.rs", "mod a;\nmod b;\nmod c;\n");
    // `a` only passes on what its children define; `a/one` and `b` import each other.
    write(
        "a/mod.rs",
        "mod one;\nmod two;\npub use one::One;\npub use two::two;\n",
    );
    write("a/one.rs", "use crate::b;\npub struct One(b::B);\n");
    write("a/two.rs", "pub fn two() -> super::One { loop {} }\n");
    write(
        "b.rs",
        "pub struct B;\nimpl B { fn f() -> crate::a::One { loop {} } }\n",
    );
    // `c` uses its child, which uses an item of `c`; its tests do not count.
    write(
        "c/mod.rs",
        "mod child;\npub struct Item;\nfn f() { child::g(Item) }\n",
    );
    write(
        "c/child.rs",
        "use super::Item;\npub fn g(_: Item) {}\n#[cfg(test)]\nmod tests { use crate::a::two; }\n",
    );
    assert_eq!(
        circles(folder.path()),
        [vec!["a/one.rs", "b.rs"], vec!["c/child.rs", "c/mod.rs"]]
    );
    assert_eq!(
        imports(folder.path())["a/two.rs"]
            .iter()
            .collect::<Vec<_>>(),
        ["a/one.rs"]
    );
    assert!(imports(folder.path())["a/mod.rs"].is_empty());
}

#[test]
fn a_circle_between_files_is_found_through_methods_of_one_type() {
    let folder = tempfile::tempdir().unwrap();
    let write = |file: &str, text: &str| fs::write(folder.path().join(file), text).unwrap();
    write("lib.rs", "mod data;\nmod more;\n");
    // `data` calls a method that `more` defines for its type; what `more` calls of `data` is an import by name already.
    let data = |body: &str| {
        format!(
            "pub struct Data<'a>(&'a u8);\nimpl<'a> Data<'a> {{\n    fn f(&self) {{\n        {body}\n    }}\n    fn g(&self) {{}}\n}}\n"
        )
    };
    write(
        "more.rs",
        "use crate::data::Data;\nimpl Data<'_> {\n    pub fn more(&self) {\n        self.g()\n    }\n}\n",
    );
    write("data.rs", &data("self.more()"));
    assert_eq!(circles(folder.path()), [vec!["data.rs", "more.rs"]]);
    write("data.rs", &data("self.g()"));
    assert!(circles(folder.path()).is_empty());
}
