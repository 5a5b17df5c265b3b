//! The manual pages.

use super::{oblate, refused};

#[test]
fn there_is_a_manual_page_of_every_subcommand() {
    let folder = tempfile::tempdir().expect("a folder");
    let pages = folder.path().join("man1");
    let out = pages.display().to_string();
    let output = oblate(&["man", "--out", &out], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let read = |name: &str| {
        let path = pages.join(format!("{name}.1"));
        std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{name}: {e}"))
    };
    let first = read("oblate");
    for verb in oblate::cli::command().get_subcommands() {
        let name = verb.get_name();
        // A page names the pages that there are.
        assert!(first.contains(&format!("oblate\\-{name}(1)")), "{name}");
        let page = read(&format!("oblate-{name}"));
        for flag in verb.get_arguments().filter_map(|a| a.get_long()) {
            let flag = flag.replace('-', "\\-");
            assert!(page.contains(&format!("\\-\\-{flag}")), "{name}: {flag}");
        }
    }
    refused(
        &oblate(&["man", "--out", &out], ""),
        &["oblate.1", "--force"],
    );
    let again = oblate(&["man", "--out", &out, "--force"], "");
    assert_eq!(again.status.code(), Some(0), "{again:?}");
    let printed = oblate(&["man"], "");
    assert_eq!(String::from_utf8_lossy(&printed.stdout), first);
}
