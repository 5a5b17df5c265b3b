//! Reads which modules of a crate import which, for the tests of import order of both crates.

use crate::files::rust_files;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// The imports against the order, and modules missing from it, as sentences; and the number of imports seen.
pub fn wrong_arrows(src: &Path, order: &[&str]) -> (Vec<String>, usize) {
    let front = fs::read_to_string(src.join("lib.rs")).unwrap();
    let exports = exports(&front);
    let (mut wrong, mut seen) = (Vec::new(), 0);
    for file in rust_files(src) {
        let below = file.strip_prefix(src).unwrap();
        let first = below.components().next().unwrap().as_os_str();
        let module = Path::new(first).file_stem().unwrap().to_str().unwrap();
        if module == "lib" {
            continue;
        }
        for used in modules_used(&fs::read_to_string(&file).unwrap(), &exports) {
            let place = |name: &str| order.iter().position(|r| *r == name);
            match (place(module), place(&used)) {
                (Some(own), Some(other)) if other > own => {
                    wrong.push(format!("{}: {module} imports {used}", below.display()));
                }
                (Some(own), Some(other)) => seen += usize::from(other < own),
                _ => wrong.push(format!("{module} or {used} has no place in the order")),
            }
        }
    }
    (wrong, seen)
}

/// Names that `lib.rs` re-exports, with their modules.
fn exports(front: &str) -> BTreeMap<String, String> {
    front
        .split(';')
        .filter_map(|item| item.trim().strip_prefix("pub use "))
        .filter_map(|path| path.split_once("::"))
        .flat_map(|(module, names)| heads(names).into_iter().map(|n| (n, module.to_owned())))
        .collect()
}

/// Modules named after `crate::` (in a command: after `oblate::`), outside comments and test modules.
pub fn modules_used(text: &str, exports: &BTreeMap<String, String>) -> BTreeSet<String> {
    let code: String = text
        .split("#[cfg(test)]\nmod tests {")
        .next()
        .unwrap()
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .map(|line| line.replace("oblate::", "crate::") + "\n")
        .collect();
    code.split("crate::")
        .skip(1)
        .flat_map(heads)
        .map(|name| exports.get(&name).cloned().unwrap_or(name))
        .collect()
}

/// The first name of a path, or of every path in a group `{a::b, c::{d, e}}`.
fn heads(path: &str) -> Vec<String> {
    let name = |text: &str| -> String {
        let letters = text.trim_start().chars();
        letters
            .take_while(|c| c.is_alphanumeric() || *c == '_')
            .collect()
    };
    let Some(group) = path.strip_prefix('{') else {
        return vec![name(path)];
    };
    let (mut depth, mut start, mut names) = (0, 0, Vec::new());
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            ',' | '}' if depth == 0 => {
                names.push(name(&group[start..at]));
                start = at + 1;
            }
            '}' => depth -= 1,
            _ => {}
        }
        if c == '}' && start == at + 1 {
            break;
        }
    }
    names.retain(|n| !n.is_empty());
    names
}
