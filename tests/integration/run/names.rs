//! Names of tracks as names of files.

use oblate::Error;
use oblate::error::NameFault;
use oblate::run::file_name;
use proptest::prelude::*;
use std::path::{Component, Path};

#[test]
fn usual_names_stay_and_all_else_is_encoded() {
    for (name, file) in [
        ("s2_spherical", "s2_spherical_x"),
        ("NGC 5907 (south), v1.2+", "NGC 5907 (south), v1.2+_x"),
        ("α Per", "α Per_x"),
        ("M31/NW", "M31%2FNW_x"),
        ("../../../escaped", "%2E.%2F..%2F..%2Fescaped_x"),
        ("/etc", "%2Fetc_x"),
        ("..", "%2E%2E_x"),
        (" a ", "%20a%20_x"),
        ("100%", "100%25_x"),
        ("a\nb\u{202e}", "a%0Ab%E2%80%AE_x"),
        ("C:\\x", "C%3A%5Cx_x"),
        ("Con.5", "%43on.5_x"),
        ("com7.", "%63om7%2E_x"),
    ] {
        assert_eq!(file_name(name, "_x").unwrap(), file, "{name:?}");
    }
    assert_eq!(file_name("lpt9", "").unwrap(), "%6Cpt9");
    assert_eq!(file_name("com7.5", "").unwrap(), "%63om7.5");
}

#[test]
fn empty_and_long_names_are_refused() {
    let fault = |name: &str| match file_name(name, "_nested") {
        Err(Error::Name { fault, .. }) => fault,
        other => panic!("{other:?}"),
    };
    assert_eq!(fault(""), NameFault::Empty);
    assert_eq!(file_name(&"a".repeat(248), "_nested").unwrap().len(), 255);
    let (bytes, max) = (256, 255);
    assert_eq!(fault(&"a".repeat(249)), NameFault::TooLong { bytes, max });
    let words = file_name(&"/".repeat(99), "").unwrap_err().to_string();
    assert!(
        words.contains("297 bytes of at most 255; shorten it"),
        "{words}"
    );
}

/// The name of a file, back.
fn decoded(file: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = file.bytes();
    while let Some(byte) = rest.next() {
        bytes.push(match byte {
            b'%' => {
                let hex = [rest.next().unwrap(), rest.next().unwrap()];
                u8::from_str_radix(std::str::from_utf8(&hex).unwrap(), 16).unwrap()
            }
            plain => plain,
        });
    }
    String::from_utf8(bytes).unwrap()
}

proptest! {
    #[test]
    fn every_name_is_one_component_of_a_path_and_can_be_told_from_all_others(name in "\\PC{1,30}|[./\\\\%a ]{1,30}|.{1,30}") {
        let file = file_name(&name, "_nested").unwrap();
        let components: Vec<Component> = Path::new(&file).components().collect();
        prop_assert_eq!(components, vec![Component::Normal(file.as_ref())]);
        prop_assert!(!file.starts_with('.') && !file.chars().any(char::is_control));
        // What can be decoded is of one name only.
        prop_assert_eq!(decoded(file.strip_suffix("_nested").unwrap()), name);
    }
}
