//! The header of a track: where it is read, and what of it would be ignored and is refused.

use super::{HEADER, assert_refused, csv, read_csv};
use oblate::data::{Handedness, ObservedTrack, ReadOptions};

const BODY: &str = "phi,r,r_err\n-5,597,20\n5,610,20\n15,620,20\n";

/// Radii of `BODY` at 20 Mpc.
const R_KPC: f64 = 597.0 * 20e3 / 206_264.806_247;

fn ecsv(text: &str) -> ObservedTrack {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("track.ecsv");
    std::fs::write(&path, text).unwrap();
    ObservedTrack::read(&path).unwrap()
}

/// An ECSV file in degrees and kpc, with further entries of its `meta`.
fn with_meta(entries: &[&str]) -> String {
    let lines: String = (entries.iter())
        .map(|entry| format!("#   {entry}\n"))
        .collect();
    let text = HEADER.replace("PHI", "deg").replace("unit: R", "unit: kpc");
    text.replace("# schema", &format!("{lines}# schema"))
}

#[test]
fn blank_lines_do_not_end_a_header() {
    for text in [
        "# name: B\n\n# units: phi deg, r arcsec\n \n# distance: 20 Mpc\n\n",
        "\n# name: B\n# units: phi deg, r arcsec\n# distance: 20 Mpc\n",
    ] {
        let track = csv(&format!("{text}{BODY}"));
        assert_eq!(track.name, "B");
        assert!((track.r_kpc[0] / R_KPC - 1.0).abs() < 1e-11, "{text}");
    }
    // A fault has its line in the file.
    let late = format!("\n# name: B\n\n# distance 20 Mpc\n{BODY}");
    assert_refused("csv", &late, &["line 4", "`distance: value`"]);
    let text = with_meta(&["handedness: mirrored"]).replace("unit: deg", "unit: rad");
    let text = text.replace("\n5,60\n15,61\n25,62\n", "\n0.25,60\n0.75,61\n1.25,62\n");
    let inside = text.replace("# meta", "\n# meta");
    for text in [format!("\n{text}"), inside] {
        let track = ecsv(&text);
        assert!((track.phi_deg[0] + 1.25_f64.to_degrees()).abs() < 1e-12);
        assert!(track.is_mirrored());
    }
    let broken = "\n# %ECSV 1.0\n\n# ---\n# datatype: [\nphi,r\n5,60\n";
    assert_refused("ecsv", broken, &["line 5", "not YAML"]);
}

#[test]
fn keys_where_no_header_is_read_are_refused() {
    let below = BODY.replace("5,610", "# distance: 20 Mpc\n5,610");
    let parts = ["line 3", "`distance`", "above the names"];
    assert_refused("csv", &below, &parts);
    let at_end = format!("# by hand\n{BODY}# handednes = mirrored\n");
    assert_refused("csv", &at_end, &["line 6", "`handednes`"]);
    let text = with_meta(&[]);
    let below = format!("{text}# bin_width: 5\n");
    assert_refused("ecsv", &below, &["line 14", "`bin_width`", "`meta`"]);
    let above = format!("# distance: 20 Mpc\n{text}");
    assert_refused("ecsv", &above, &["line 1", "`distance`"]);
    let beside = text.replace("# schema", "# handedness: mirrored\n# schema");
    assert_refused("ecsv", &beside, &["line 9", "`handedness`", "`meta`"]);
    // Free text may stand anywhere.
    let noted = BODY.replace("5,610", "# 0,600,20: not used\n5,610");
    assert_eq!(csv(&noted), csv(BODY));
    assert_eq!(ecsv(&format!("# by hand\n{text}# the end\n")), ecsv(&text));
}

#[test]
fn keys_with_a_unit_or_in_upper_case_are_refused_with_the_right_key() {
    for (comment, word, meant) in [
        ("bin_width_deg: 20", "bin_width_deg", "bin_width"),
        ("distance_Mpc = 20", "distance_Mpc", "distance"),
        ("distance_kpc 20000", "distance_kpc", "distance"),
        ("distanse_mpc: 20", "distanse_mpc", "distance"),
        ("Distance 20 Mpc, r in arcsec", "Distance", "distance"),
        ("distance [Mpc]: 20", "distance", "distance"),
        ("Units - r arcsec", "Units", "units"),
    ] {
        let text = format!("# {comment}\n{BODY}");
        let parts = ["line 1", &format!("`{word}`"), &format!("`{meant}: value`")];
        assert_refused("csv", &text, &parts);
    }
    for (key, meant) in [
        ("bin_width_deg", "bin_width"),
        ("distance_mpc", "distance"),
        ("progenitor_pa_deg", "progenitor_pa"),
    ] {
        let parts = ["line 9", key, &format!("`{meant}: value`")];
        assert_refused("ecsv", &with_meta(&[&format!("{key}: 20")]), &parts);
    }
    // Tracks of earlier fits say it twice.
    let twice = ecsv(&with_meta(&["bin_width: 10", "bin_width_deg: 10"]));
    assert_eq!(twice.bins(), [0, 1, 2]);
    assert_eq!(ecsv(&twice.to_ecsv()), twice);
    let other = ["bin_width: 10.0", "bin_width_deg: 5.0"];
    assert_refused("ecsv", &with_meta(&other), &["`bin_width: value`"]);
    let distances = ["distance: 20", "distance_mpc: 20"];
    assert_refused("ecsv", &with_meta(&distances), &["`distance: value`"]);
    // The name of a galaxy or a reference is free text.
    let free = format!("# Name of the host: NGC 1\n# Karachentsev (2013): distance\n{BODY}");
    assert_eq!(csv(&free), csv(BODY));
}

#[test]
fn what_a_header_says_twice_is_refused() {
    let units = "# units: phi deg, r arcsec\n";
    let twice = format!("{units}# distance: 20 Mpc\n# distance: 25 Mpc\n{BODY}");
    assert_refused("csv", &twice, &["line 3", "`distance` twice"]);
    let unit = format!("{units}# distance: 20 Mpc\n# units: r kpc\n{BODY}");
    assert_refused("csv", &unit, &["line 3", "unit of `r` twice"]);
    // Units of different columns may have lines of their own.
    let apart = format!("# units: phi deg\n# units: r arcsec\n# distance: 20 Mpc\n{BODY}");
    assert!((csv(&apart).r_kpc[0] / R_KPC - 1.0).abs() < 1e-11);
}

#[test]
fn units_in_names_and_of_errors_alone_are_explained() {
    let of = |names: &str| BODY.replace("phi,r,r_err", names);
    for names in ["phi [deg],r [arcsec],r_err", "phi(deg),r,r_err"] {
        let parts = ["line 1", "name it `phi`", "# units: phi deg, r arcsec"];
        assert_refused("csv", &of(names), &parts);
    }
    let spaces = BODY.replace(',', " ");
    let semicolons = of("phi [deg],r,r_err").replace(',', ";");
    for text in [spaces, semicolons, of("phi r,r_err,n")] {
        assert_refused("csv", &text, &["line 1", "not separated"]);
    }
    let errors = format!("# units: r kpc, r_err arcsec\n{BODY}");
    assert_refused("csv", &errors, &["column `r_err` is in arcsec"]);
}

#[test]
fn a_track_that_is_mirrored_twice_has_its_first_sense() {
    let options = ReadOptions {
        handedness: Some(Handedness::Mirrored),
        ..ReadOptions::default()
    };
    let once = read_csv(BODY, &options).unwrap();
    assert!(once.is_mirrored());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arc.ecsv");
    once.write(&path).unwrap();
    let twice = ObservedTrack::read_with(&path, &options).unwrap();
    assert_eq!(twice, csv(BODY));
    assert!(twice.assumptions().is_empty());
}
