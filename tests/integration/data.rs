//! Reading and writing of tracks, and the messages about faulty ones.

use oblate::Error;
use oblate::data::ObservedTrack;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden")
        .join(name)
}

/// Reads `text` as a file and returns the error's text after the file's name.
fn refusal(extension: &str, text: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("track.{extension}"));
    std::fs::write(&path, text).unwrap();
    let error = ObservedTrack::read(&path).unwrap_err();
    assert!(matches!(error, Error::TrackFile { .. }), "{error:?}");
    let words = error.to_string();
    let name = path.display().to_string();
    assert!(words.starts_with(&name), "{words} does not name the file");
    words[name.len()..].to_owned()
}

fn assert_refused(extension: &str, text: &str, parts: &[&str]) {
    let words = refusal(extension, text);
    for part in parts {
        assert!(words.contains(part), "{words:?} does not say {part:?}");
    }
    assert!(words.contains("; "), "{words:?} has no remedy");
}

const HEADER: &str = "# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n# - {name: phi, unit: PHI, datatype: float64}\n# - {name: r, unit: R, datatype: float64}\n# schema: astropy-2.0\nphi,r\n5,60\n15,61\n25,62\n";

#[test]
fn csv_without_errors_gets_two_percent_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arc.csv");
    std::fs::write(&path, "# by hand\nphi,r\n-5,60\n5,61\n25,63\n").unwrap();
    let track = ObservedTrack::read(&path).unwrap();
    assert_eq!(track.name, "arc");
    assert!(track.r_err_assumed);
    assert_eq!(track.r_err_kpc, [1.2, 1.22, 1.26]);
    assert_eq!(track.bins(), [-1, 0, 2]);
    assert_eq!(track.bin_width_deg.to_bits(), 10.0_f64.to_bits());
}

#[test]
fn astropy_quantities_in_arcsec_become_kpc() {
    let card: toml::Table = std::fs::read_to_string(golden("astropy_track.toml"))
        .unwrap()
        .parse()
        .unwrap();
    let tolerance = card["tolerance"].as_float().unwrap();
    let track = ObservedTrack::read(&golden("astropy_track.ecsv")).unwrap();
    assert_eq!(track.name, "NGC 0000 south");
    assert_eq!(track.bins(), [-4, -3, -2, 0, 1, 2]);
    assert!(!track.r_err_assumed);
    for (i, phi) in track.phi_deg.iter().enumerate() {
        let r = 60.0 + 0.2 * phi + 0.004 * phi * phi;
        assert!((track.r_kpc[i] / r - 1.0).abs() < tolerance);
        assert!((track.r_err_kpc[i] / (0.03 * r) - 1.0).abs() < tolerance);
    }
    assert_eq!(track.n.unwrap()[2].to_bits(), 320.0_f64.to_bits());
    assert_eq!(track.meta["origin"], "made by astropy_track.py");
}

#[test]
fn angles_in_radians_become_degrees() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.ecsv");
    let text = HEADER
        .replace("PHI", "rad")
        .replace("unit: R", "unit: kpc")
        .replace("\n5,60\n15,61\n25,62\n", "\n0.25,60\n0.75,61\n1.25,62\n");
    std::fs::write(&path, text).unwrap();
    let track = ObservedTrack::read(&path).unwrap();
    assert!((track.phi_deg[1] - 0.75_f64.to_degrees()).abs() < 1e-12);
    assert_eq!(track.bins(), [0, 1, 2]);
}

#[test]
fn a_missing_column_is_refused() {
    assert_refused(
        "csv",
        "phi,radius\n5,60\n15,61\n25,62\n",
        &[
            "line 1",
            "column `r` is missing",
            "phi, radius",
            "name the columns",
        ],
    );
}

#[test]
fn nan_and_infinity_are_refused_with_their_line() {
    for bad in ["nan", "inf"] {
        assert_refused(
            "csv",
            &format!("phi,r\n5,60\n\n15,{bad}\n25,62\n"),
            &["line 4", "column `r`", "finite"],
        );
    }
}

#[test]
fn text_in_a_number_is_refused() {
    assert_refused(
        "csv",
        "phi,r\n5,60\n15,x\n25,62\n",
        &["line 3", "column `r`", "\"x\"", "not a number"],
    );
}

#[test]
fn radii_and_errors_at_or_below_zero_are_refused() {
    assert_refused(
        "csv",
        "phi,r\n5,60\n15,0\n25,62\n",
        &["line 3", "column `r` is 0", "above zero"],
    );
    assert_refused(
        "csv",
        "phi,r,r_err\n5,60,1\n15,61,1\n25,62,-1\n",
        &["line 4", "column `r_err` is -1", "above zero"],
    );
}

#[test]
fn unsorted_and_repeated_bins_are_refused() {
    assert_refused(
        "csv",
        "phi,r\n15,60\n5,61\n25,62\n",
        &[
            "line 3",
            "column `phi` is 5 deg after 15 deg",
            "sort the rows",
        ],
    );
    assert_refused(
        "csv",
        "phi,r\n5,60\n5,61\n15,62\n",
        &["line 3", "`phi`", "each bin once"],
    );
}

#[test]
fn unequal_bins_are_refused() {
    assert_refused(
        "csv",
        "phi,r\n5,60\n15,61\n27,62\n",
        &[
            "line 4",
            "`phi` steps by 12 deg",
            "10 deg wide",
            "equally wide",
        ],
    );
}

#[test]
fn bins_off_the_progenitors_grid_are_refused() {
    assert_refused(
        "csv",
        "phi,r\n0,60\n10,61\n20,62\n",
        &[
            "line 2",
            "`phi` is 0 deg",
            "multiples of 10 deg",
            "on an edge",
        ],
    );
}

#[test]
fn two_bins_are_refused() {
    assert_refused(
        "csv",
        "phi,r\n5,60\n15,61\n",
        &["line 1", "2 bins", "at least 3"],
    );
}

#[test]
fn unknown_units_are_refused() {
    let swap = |phi: &str, r: &str| {
        HEADER
            .replace("PHI", phi)
            .replace("unit: R", &format!("unit: {r}"))
    };
    assert_refused(
        "ecsv",
        &swap("hourangle", "kpc"),
        &["line 8", "column `phi` is in `hourangle`", "deg or rad"],
    );
    assert_refused(
        "ecsv",
        &swap("deg", "pc"),
        &["line 8", "column `r` is in `pc`", "kpc"],
    );
    assert_refused(
        "ecsv",
        &swap("deg", "arcsec"),
        &["line 8", "no `distance`", "Mpc"],
    );
}

#[test]
fn a_broken_header_is_refused() {
    assert_refused(
        "ecsv",
        "# %ECSV 1.0\n# ---\n# datatype: [\nphi,r\n5,60\n",
        &["line ", "not YAML", "astropy"],
    );
}

#[test]
fn a_header_that_is_nested_too_deeply_or_too_long_is_refused() {
    let header = |meta: &str| {
        HEADER
            .replace("PHI", "deg")
            .replace("unit: R", "unit: kpc")
            .replace("# schema", &format!("# meta:\n#   {meta}\n# schema"))
    };
    let deep = |n: usize| "- ".repeat(n);
    let flow = |n: usize| format!("a: {}1{}", "[".repeat(n), "]".repeat(n));
    assert_refused(
        "ecsv",
        &header(&deep(20_000)),
        &["nested more than 32 levels"],
    );
    assert_refused(
        "ecsv",
        &header(&flow(100)),
        &["line 8", "nested more than 32 levels"],
    );
    assert_refused(
        "ecsv",
        &header(&format!("a: {}", "x".repeat(300_000))),
        &["256 KiB"],
    );
    // Every anchor keeps a copy of all that is below it.
    let anchors: String = (0..25).map(|k| format!("&a{k} [")).collect();
    let list = format!("a: {anchors}{}{}", "1,".repeat(20_000), "]".repeat(25));
    assert_refused("ecsv", &header(&list), &["too much under anchors"]);
    // A key of a kilobyte that would be gigabytes as text.
    assert_refused(
        "ecsv",
        &header(&format!("{}a: 1", "? ".repeat(28))),
        &["a key is a list or a map"],
    );
    // What could not be read again: a key too long for one line of YAML, and a text that quotes would make too long.
    assert_refused(
        "ecsv",
        &header(&format!("? {}\n#   : 1", "k".repeat(1_100))),
        &["a key is longer than 1000"],
    );
    assert_refused(
        "ecsv",
        &header(&format!("a: {}", "\\".repeat(200_000))),
        &["256 KiB"],
    );
    // Values that are nested less deeply are kept.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.ecsv");
    std::fs::write(&path, header(&flow(20))).unwrap();
    let track = ObservedTrack::read(&path).unwrap();
    assert_eq!(
        track.meta["a"].to_string(),
        format!("{}1{}", "[".repeat(20), "]".repeat(20))
    );
}

#[test]
fn a_file_longer_than_any_track_is_refused_unread() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.csv");
    let file = std::fs::File::create(&path).unwrap();
    file.set_len(1 << 40).unwrap();
    let words = ObservedTrack::read(&path).unwrap_err().to_string();
    assert!(
        words.contains("t.csv") && words.contains("longer than 4 MiB"),
        "{words}"
    );
    // A device has no length.
    #[cfg(unix)]
    {
        let words = ObservedTrack::read(Path::new("/dev/zero"))
            .unwrap_err()
            .to_string();
        assert!(words.contains("longer than 4 MiB"), "{words}");
    }
}

#[test]
fn short_rows_and_empty_files_are_refused() {
    assert_refused(
        "csv",
        "phi,r\n5,60\n15\n",
        &["line 3", "1 values", "2 columns"],
    );
    assert_refused("csv", "\n", &["no table", "phi and r"]);
}

#[test]
fn an_unreadable_file_is_named_with_a_remedy() {
    let error = ObservedTrack::read(Path::new("/nowhere/track.ecsv")).unwrap_err();
    assert!(matches!(error, Error::Io { .. }));
    let words = error.to_string();
    assert!(
        words.contains("/nowhere/track.ecsv") && words.contains("readable"),
        "{words}"
    );
}

proptest! {
    #[test]
    fn what_is_written_is_read_back_to_the_bit(
        first in -30_i64..30,
        width in prop::sample::select(vec![5.0, 10.0, 12.5]),
        bins in prop::collection::vec((1.0_f64..200.0, prop_oneof![1e-6_f64..5.0, Just(1e-6 / 3.0)], 0.0_f64..1e5), 3..20),
        with in prop::collection::vec(any::<bool>(), 2),
        number in -1e9_f64..1e9,
        word in "[a-zA-Z:'\"#{}, \\-]{0,12}",
    ) {
        let phi: Vec<f64> = (0..bins.len()).map(|i| ((first + i as i64) as f64 + 0.5) * width).collect();
        let r: Vec<f64> = bins.iter().map(|b| b.0).collect();
        let err: Vec<f64> = bins.iter().map(|b| b.1).collect();
        let mut track = ObservedTrack::new("a: \"name\"", &phi, width, &r, with[0].then_some(&err[..])).unwrap();
        track.n = with[1].then(|| bins.iter().map(|b| b.2).collect());
        track.meta.insert("small".to_owned(), serde_json::json!(number * 1e-30));
        track.meta.insert("origin".to_owned(), serde_json::json!({"by": word, "at": [1, 2.5, true]}));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("track.ecsv");
        track.write(&path).unwrap();
        prop_assert_eq!(ObservedTrack::read(&path).unwrap(), track);
    }
}
