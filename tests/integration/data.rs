//! Reading and writing of tracks, and the messages about faulty ones.

mod angles;
mod criteria;
mod header;
mod measured;
mod mock;
mod selection;

use oblate::Error;
use oblate::data::{Handedness, Measured, ObservedTrack, ReadOptions, StarVelocity};
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

const HEADER: &str = "# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n# - {name: phi, unit: PHI, datatype: float64}\n# - {name: r, unit: R, datatype: float64}\n# meta:\n#   assume_error: 2%\n# schema: astropy-2.0\nphi,r\n5,60\n15,61\n25,62\n";

/// Reads `text` as a CSV file.
fn csv(text: &str) -> ObservedTrack {
    read_csv(text, &ReadOptions::default()).unwrap()
}

fn read_csv(text: &str, options: &ReadOptions) -> oblate::Result<ObservedTrack> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("arc.csv");
    std::fs::write(&path, text).unwrap();
    ObservedTrack::read_with(&path, options)
}

#[test]
fn errors_are_assumed_only_where_the_user_says_so() {
    let bare = "phi,r\n-5,60\n5,61\n25,63\n";
    assert_refused("csv", bare, &["no errors", "r_err_lo", "assume_error: 2%"]);
    let stated = csv(&format!("# by hand\n# assume_error: 2%\n{bare}"));
    let options = ReadOptions {
        assumed_error: Some("2 %".parse().unwrap()),
        ..ReadOptions::default()
    };
    for track in [stated, read_csv(bare, &options).unwrap()] {
        assert_eq!(track.name, "arc");
        assert_eq!(track.r_err_lo_kpc, [1.2, 1.22, 1.26]);
        assert_eq!(track.r_err_hi_kpc, track.r_err_lo_kpc);
        assert!(track.assumptions()[0].contains("2% of r"));
        assert_eq!(track.bins(), [-1, 0, 2]);
        assert_eq!(track.bin_width_deg.to_bits(), 10.0_f64.to_bits());
        // It is said again where the track is read back.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("track.ecsv");
        track.write(&path).unwrap();
        assert_eq!(ObservedTrack::read(&path).unwrap(), track);
    }
    let whole = "phi,r,r_err\n-5,60,1\n5,61,1\n25,63,1\n";
    assert!(csv(whole).assumptions().is_empty());
    let words = read_csv(whole, &options).unwrap_err().to_string();
    assert!(words.contains("remove one of the two"), "{words}");
    for wrong in ["0.02", "0%", "200%", "nan%", "%"] {
        let text = format!("# assume_error: {wrong}\n{bare}");
        assert_refused("csv", &text, &["line 1", "`assume_error`", "2%"]);
    }
}

#[test]
fn unknown_columns_are_refused_with_the_nearest_name() {
    let of = |column: &str| format!("phi,r,{column}\n5,60,1\n15,61,1\n25,62,1\n");
    for (column, nearest) in [
        ("r_eror", "r_err"),
        ("r_err_low", "r_err_lo"),
        ("pa", "PA"),
        ("N", "n"),
    ] {
        let near = format!("the nearest name is `{nearest}`");
        assert_refused("csv", &of(column), &["line 1", column, &near, "rename"]);
    }
    assert_refused(
        "csv",
        "phi;r;r_err\n5;60;1\n15;61;1\n25;62;1\n",
        &["line 1", "phi;r;r_err", "by commas"],
    );
    let words = refusal("csv", &of("velocity"));
    assert!(
        words.contains("`velocity` is not known; remove it"),
        "{words}"
    );
    assert_refused("csv", &of("r"), &["`r` is there twice"]);
}

#[test]
fn errors_may_differ_to_both_sides() {
    let track = csv("phi,r,r_err_lo,r_err_hi\n5,60,1,2\n15,61,1,1\n25,62,3,2\n");
    assert_eq!(track.r_err_lo_kpc, [1.0, 1.0, 3.0]);
    assert_eq!(track.r_err_hi_kpc, [2.0, 1.0, 2.0]);
    assert!(!track.has_symmetric_errors());
    let half = "phi,r,r_err_lo\n5,60,1\n15,61,1\n25,62,3\n";
    assert_refused("csv", half, &["both `r_err_lo` and `r_err_hi`"]);
    let three = "phi,r,r_err,r_err_lo,r_err_hi\n5,60,1,1,1\n15,61,1,1,1\n25,62,1,3,1\n";
    assert_refused("csv", three, &["either `r_err`"]);
    let negative = "phi,r,r_err_lo,r_err_hi\n5,60,1,2\n15,61,1,-1\n25,62,3,2\n";
    assert_refused("csv", negative, &["line 3", "`r_err_hi` is -1"]);
}

#[test]
fn bins_may_lie_anywhere_on_an_even_grid() {
    let of = |phi: [f64; 3]| {
        let rows = phi.map(|phi| format!("{phi},60,1\n")).concat();
        csv(&format!("phi,r,r_err\n{rows}"))
    };
    let on = of([-5.0, 5.0, 25.0]);
    assert_eq!((on.offset_deg(), on.bins()), (0.0, vec![-1, 0, 2]));
    // Angles that a file rounds are those of a grid without an offset.
    let rounded = of([-5.001, 4.999, 25.003]);
    assert_eq!(rounded.offset_deg().to_bits(), 0.0_f64.to_bits());
    for phi in [[-3.0, 7.0, 27.0], [0.0, 10.0, 20.0], [-41.5, -31.5, -11.5]] {
        let track = of(phi);
        for (k, phi) in track.bins().into_iter().zip(phi) {
            let centre = track.offset_deg() + (k as f64 + 0.5) * track.bin_width_deg;
            assert!((centre - phi).abs() < 1e-12, "{phi}: {centre}");
        }
        assert!(track.offset_deg().abs() <= 5.0);
    }
}

#[test]
fn position_angles_count_from_the_progenitor() {
    let of = |header: &str, angles: [f64; 3]| {
        let rows = angles.map(|angle| format!("{angle},60,1\n")).concat();
        format!("{header}PA,r,r_err\n{rows}")
    };
    let from =
        |progenitor: f64, angles| csv(&of(&format!("# progenitor_pa: {progenitor}\n"), angles));
    assert_eq!(from(20.0, [15.0, 25.0, 35.0]).phi_deg, [-5.0, 5.0, 15.0]);
    // Over north, to both sides.
    assert_eq!(from(0.0, [355.0, 5.0, 15.0]).phi_deg, [-5.0, 5.0, 15.0]);
    assert_eq!(from(350.0, [345.0, 355.0, 5.0]).phi_deg, [-5.0, 5.0, 15.0]);
    assert_eq!(
        from(10.0, [340.0, 350.0, 0.0]).phi_deg,
        [-30.0, -20.0, -10.0]
    );
    assert_refused("csv", &of("", [5.0, 15.0, 25.0]), &["`progenitor_pa`"]);
    let both = "phi,PA,r,r_err\n5,5,60,1\n15,15,60,1\n25,25,60,1\n";
    assert_refused("csv", both, &["`phi` and `PA`"]);
    let turn: String = (0..36)
        .map(|k| format!("{},60,1\n", (10 * k + 40) % 360))
        .collect();
    let turn = format!("# progenitor_pa: 0\nPA,r,r_err\n{turn}40,60,1\n");
    assert_refused("csv", &turn, &["a whole turn", "give `phi`"]);
}

#[test]
fn rows_without_a_radius_are_single_stars() {
    let text = "phi,r,r_err,v,v_err,n\n-15,60,1,,,5\n-5,61,1,20,4,6\n5,62,1,,,7\n-3.5,,,31,6,\n9.5,,,-12.25,7,\n";
    let track = csv(text);
    assert_eq!((track.len(), track.stars.len()), (3, 2));
    let star = StarVelocity {
        phi_deg: -3.5,
        v_km_s: Measured {
            value: 31.0,
            error: 6.0,
        },
    };
    assert_eq!(track.stars[0], star);
    assert_eq!(track.bin_at(-3.5), -1);
    assert!(track.has_velocities());
    // Velocities of stars alone.
    let alone = csv(&text.replace("20,4", ","));
    assert!(alone.measured.is_empty() && alone.has_velocities());
    for track in [&track, &alone] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stars.ecsv");
        track.write(&path).unwrap();
        assert_eq!(&ObservedTrack::read(&path).unwrap(), track);
    }
    let options = ReadOptions {
        handedness: Some(Handedness::Mirrored),
        ..ReadOptions::default()
    };
    let mirrored = read_csv(text, &options).unwrap();
    assert_eq!(mirrored.stars[0].phi_deg.to_bits(), 3.5_f64.to_bits());
    assert!(!mirrored.has_data_of(&track));
    // Position angles over north: a star at 2 degrees is 12 degrees from a progenitor at 350.
    let north = csv(
        "# progenitor_pa: 350\nPA,r,r_err,v,v_err\n345,60,1,,\n355,61,1,,\n5,62,1,,\n2,,,31,6\n352,,,30,6\n",
    );
    let angles: Vec<f64> = north.stars.iter().map(|star| star.phi_deg).collect();
    assert_eq!(angles, [12.0, 2.0]);
    for (row, parts) in [
        ("-3,,,31,,", ["single star", "error"]),
        ("-3,,,,,", ["single star", "error"]),
        ("-3,,,31,6,8", ["single star", "`n`"]),
        ("-3,,1,31,6,", ["single star", "`r_err`"]),
        ("33,,,31,6,", ["no bin", "33"]),
        ("-3,,,31,-6,", ["line 7", "v_err"]),
        ("-3,,,abc,6,", ["line 7", "abc"]),
    ] {
        assert_refused("csv", &format!("{text}{row}\n"), &parts);
    }
    // A column of another quantity must still have a value somewhere.
    let empty = "phi,r,r_err,v,v_err,width,width_err\n-15,60,1,,,,\n-5,61,1,,,,\n5,62,1,,,,\n-3.5,,,31,6,,\n";
    assert_refused("csv", empty, &["`width` is empty"]);
    assert!(track.clone().with_stars(vec![star; 3]).is_ok());
    let far = StarVelocity {
        phi_deg: 40.0,
        ..star
    };
    assert!(track.with_stars(vec![far]).is_err());
}

#[test]
fn a_mirrored_track_has_its_phi_reversed() {
    let body = "phi,r,r_err\n-15,60,1\n-5,61,2\n15,62,3\n";
    let options = ReadOptions {
        handedness: Some(Handedness::Mirrored),
        ..ReadOptions::default()
    };
    let header = csv(&format!("# handedness: mirrored\n{body}"));
    for track in [header, read_csv(body, &options).unwrap()] {
        assert_eq!(track.phi_deg, [-15.0, 5.0, 15.0]);
        assert_eq!(track.r_kpc, [62.0, 61.0, 60.0]);
        assert_eq!(track.r_err_lo_kpc, [3.0, 2.0, 1.0]);
        assert!(track.assumptions()[0].contains("mirrored"));
        // Once only.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("track.ecsv");
        track.write(&path).unwrap();
        assert_eq!(ObservedTrack::read(&path).unwrap(), track);
    }
    let text = format!("# handedness: left\n{body}");
    assert_refused("csv", &text, &["line 1", "`mirrored`"]);
    // A fault keeps the line of its row.
    let text = "# handedness: mirrored\nphi,r,r_err\n-15,60,1\n-5,-61,2\n15,62,3\n";
    assert_refused("csv", text, &["line 4", "`r` is -61"]);
}

#[test]
fn a_name_may_be_or_begin_with_a_number() {
    let body = "phi,r,r_err\n5,60,1\n15,61,1\n25,62,1\n";
    for name in ["5128", "47 Tuc", "1e3", "-2.50", "3 deg"] {
        assert_eq!(csv(&format!("# name: {name}\n{body}")).name, name);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("track.ecsv");
    let header = HEADER.replace("PHI", "deg").replace("unit: R", "unit: kpc");
    for (name, expected) in [("5128", "5128"), ("2.5", "2.5"), ("47 Tuc", "47 Tuc")] {
        let text = header.replace("# meta:\n", &format!("# meta:\n#   name: {name}\n"));
        std::fs::write(&path, text).unwrap();
        let track = ObservedTrack::read(&path).unwrap();
        assert_eq!(track.name, expected);
        track.write(&path).unwrap();
        assert_eq!(ObservedTrack::read(&path).unwrap().name, expected);
    }
}

#[test]
fn a_csv_header_gives_units_and_distance() {
    let body = "phi,r,r_err\n-300,600,20\n300,610,20\n900,620,20\n";
    let track = csv(&format!(
        "# NGC 1\n# name: south\n# units: phi arcmin, r arcsec\n# distance = 20 Mpc\n# bin_width: 10 deg\n{body}"
    ));
    assert_eq!(
        (track.name.as_str(), track.bins()),
        ("south", vec![-1, 0, 1])
    );
    let kpc_per_arcsec = 20e3 / 206_264.806_247;
    assert!((track.r_kpc[0] / (600.0 * kpc_per_arcsec) - 1.0).abs() < 1e-11);
    // The errors have the unit of the radii.
    assert!((track.r_err_hi_kpc[0] / (20.0 * kpc_per_arcsec) - 1.0).abs() < 1e-11);
    for (header, parts) in [
        ("# distance: 20 Mpc\n", vec!["no unit", "# units: r arcsec"]),
        ("# units: r arcsec\n", vec!["no `distance`"]),
        (
            "# units: r arcsec\n# distance: far\n",
            vec!["`distance` is"],
        ),
        (
            "# units: r arcsec\n# distance: 20 kpc\n",
            vec!["`distance` is"],
        ),
        (
            "# units: phi hourangle\n",
            vec!["`phi` is in `hourangle`", "arcmin"],
        ),
        ("# units: arcsec\n", vec!["line 1", "`phi deg, r arcsec`"]),
        (
            "# distanse: 20 Mpc\n",
            vec!["line 1", "`distanse`", "`distance: value`"],
        ),
        ("# distance 20 Mpc\n", vec!["line 1", "`distance: value`"]),
        ("# units: r_kpc arcsec\n", vec!["line 1", "`r_kpc`"]),
        ("# bin_width: 1 kpc\n", vec!["line 1", "`bin_width`"]),
    ] {
        assert_refused("csv", &format!("{header}{body}"), &parts);
    }
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
    assert!(track.assumptions().is_empty());
    for (i, phi) in track.phi_deg.iter().enumerate() {
        let r = 60.0 + 0.2 * phi + 0.004 * phi * phi;
        assert!((track.r_kpc[i] / r - 1.0).abs() < tolerance);
        assert!((track.r_err_lo_kpc[i] / (0.03 * r) - 1.0).abs() < tolerance);
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
        "phi,n\n5,60\n15,61\n25,62\n",
        &[
            "line 1",
            "column `r` is missing",
            "phi, n",
            "name the columns",
        ],
    );
}

#[test]
fn nan_and_infinity_are_refused_with_their_line() {
    for bad in ["nan", "inf"] {
        assert_refused(
            "csv",
            &format!("phi,r,r_err\n5,60,1\n\n15,{bad},1\n25,62,1\n"),
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
        "phi,r,r_err\n5,60,1\n15,0,1\n25,62,1\n",
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
        "phi,r,r_err\n15,60,1\n5,61,1\n25,62,1\n",
        &[
            "line 3",
            "column `phi` is 5 deg after 15 deg",
            "sort the rows",
        ],
    );
    assert_refused(
        "csv",
        "phi,r,r_err\n5,60,1\n5,61,1\n15,62,1\n",
        &["line 3", "`phi`", "each bin once"],
    );
}

#[test]
fn unequal_bins_are_refused() {
    assert_refused(
        "csv",
        "phi,r,r_err\n5,60,1\n15,61,1\n27,62,1\n",
        &[
            "line 4",
            "`phi` steps by 12 deg",
            "10 deg wide",
            "equally wide",
        ],
    );
}

#[test]
fn bins_of_another_width_than_the_one_given_are_refused_where_they_have_drifted() {
    // Each step is within the rounding of files.
    let track = |bins: u32| {
        let row = |i| format!("{:.4},60,1\n", 0.5 + 1.0009 * f64::from(i));
        let rows: String = (0..bins).map(row).collect();
        format!("# bin_width: 1\nphi,r,r_err\n{rows}")
    };
    assert_eq!(csv(&track(110)).len(), 110);
    // The 112th step adds up to a tenth of a bin; two lines are above the first row.
    assert_refused(
        "csv",
        &track(150),
        &["line 115", "`phi` steps by", "1 deg wide"],
    );
}

#[test]
fn two_bins_are_refused() {
    assert_refused(
        "csv",
        "phi,r,r_err\n5,60,1\n15,61,1\n",
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
        &[
            "line 10",
            "column `phi` is in `hourangle`",
            "deg, rad, arcmin or arcsec",
        ],
    );
    assert_refused(
        "ecsv",
        &swap("deg", "pc"),
        &["line 10", "column `r` is in `pc`", "kpc"],
    );
    assert_refused(
        "ecsv",
        &swap("deg", "arcsec"),
        &["line 10", "no `distance`", "Mpc"],
    );
}

#[test]
fn a_misspelt_key_of_an_ecsv_header_is_refused() {
    let text = HEADER.replace("PHI", "deg").replace("unit: R", "unit: kpc");
    for (key, meant) in [
        ("handednes", "handedness"),
        ("Distance", "distance"),
        ("assumed_error", "assume_error"),
    ] {
        let text = text.replace("# schema", &format!("#   {key}: 1\n# schema"));
        assert_refused(
            "ecsv",
            &text,
            &["line 9", key, &format!("`{meant}: value`")],
        );
    }
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
            .replace("assume_error: 2%", meta)
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
    let meta = format!("assume_error: 2%\n#   {}", flow(20));
    std::fs::write(&path, header(&meta)).unwrap();
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
        words.contains("t.csv") && words.contains("longer than 16 MiB"),
        "{words}"
    );
    // A device has no length.
    #[cfg(unix)]
    {
        let words = ObservedTrack::read(Path::new("/dev/zero"))
            .unwrap_err()
            .to_string();
        assert!(words.contains("longer than 16 MiB"), "{words}");
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
        let mut track = ObservedTrack::new("a: \"name\"", &phi, width, &r, &err).unwrap();
        if with[0] {
            track.r_err_hi_kpc = err.iter().map(|e| 1.5 * e).collect();
        }
        track.n = with[1].then(|| bins.iter().map(|b| b.2).collect());
        track.meta.insert("small".to_owned(), serde_json::json!(number * 1e-30));
        track.meta.insert("origin".to_owned(), serde_json::json!({"by": word, "at": [1, 2.5, true]}));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("track.ecsv");
        track.write(&path).unwrap();
        prop_assert_eq!(ObservedTrack::read(&path).unwrap(), track);
    }
}
