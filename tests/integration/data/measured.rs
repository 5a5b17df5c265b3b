//! Velocities, widths and densities in files of tracks.

use super::{assert_refused, csv};
use oblate::data::{Measured, ObservedTrack};
use oblate::track::BinQuantity;

const ARC: &str = "phi,r,r_err,v,v_err,width,width_err\n\
    -15,60,1,-120.5,4,2.5,0.3\n-5,61,1,,,2.6,0.4\n5,62,1,-98,5,,\n";

const ARC_OF_STARS: &str = "phi,r,r_err,v,v_err\n-15,60,1,,\n-5,61,1,,\n5,62,1,,\n";

fn measured(value: f64, error: f64) -> Option<Measured> {
    Some(Measured { value, error })
}

#[test]
fn velocities_and_widths_are_read_with_gaps() {
    let track = csv(ARC);
    assert_eq!(
        track.measured[&BinQuantity::Velocity],
        [measured(-120.5, 4.0), None, measured(-98.0, 5.0)]
    );
    assert_eq!(
        track.measured[&BinQuantity::Width],
        [measured(2.5, 0.3), measured(2.6, 0.4), None]
    );
    // A track without them has none, and is another track.
    let plain = csv("phi,r,r_err\n-15,60,1\n-5,61,1\n5,62,1\n");
    assert!(plain.measured.is_empty());
    assert!(!plain.has_data_of(&track) && track.has_data_of(&track.clone()));
}

#[test]
fn the_lower_edge_of_a_bin_belongs_to_it() {
    let star = |phi: f64| format!("{phi},,,10,5\n");
    for (first, edge) in [(5.0, 0.0), (-25.0, -30.0)] {
        let bins: String = (0..3)
            .map(|k| format!("{},60,1,,\n", first + 10.0 * f64::from(k)))
            .collect();
        let track = csv(&format!("phi,r,r_err,v,v_err\n{bins}{}", star(edge)));
        assert_eq!(track.bin_at(edge), track.bins()[0], "{edge}");
    }
}

#[test]
fn single_stars_do_not_count_as_bins() {
    let stars = |count: usize| {
        let star = |i: usize| format!("{},,,{},5\n", -19.0 + 1e-4 * i as f64, i % 100);
        ARC_OF_STARS.to_owned() + &(0..count).map(star).collect::<String>()
    };
    assert_eq!(csv(&stars(10_500)).stars.len(), 10_500);
    assert_refused(
        "csv",
        &stars(110_000),
        &["line 110002", "110000 rows", "single stars"],
    );
    let bin = |i: usize| format!("{},60,1\n", 0.1 * i as f64);
    let bins: String = (0..10_001).map(bin).collect();
    assert_refused(
        "csv",
        &format!("phi,r,r_err\n{bins}"),
        &["line 10002", "10001 bins", "at most 10000"],
    );
}

#[test]
fn densities_may_be_below_zero_where_the_background_is_subtracted() {
    let rows = "-15,60,1,31.5,6\n-5,61,1,,\n5,62,1,-2.5,5\n";
    for unit in ["", "# units: density 1/deg\n"] {
        let track = csv(&format!("{unit}phi,r,r_err,density,density_err\n{rows}"));
        assert_eq!(
            track.measured[&BinQuantity::Density],
            [measured(31.5, 6.0), None, measured(-2.5, 5.0)]
        );
    }
    let areas = format!("# units: density arcmin-2\nphi,r,r_err,density,density_err\n{rows}");
    assert_refused("csv", &areas, &["`density`", "arcmin-2", "1/deg"]);
}

#[test]
fn widths_are_angles_where_radii_are_and_velocities_stay() {
    let header = "# units: phi deg, r arcsec, v km/s\n# distance: 20 Mpc\n";
    let track = csv(&format!("{header}{ARC}"));
    // 20 Mpc are 0.09696 kpc per arcsec.
    let width = track.measured[&BinQuantity::Width][0].expect("a width");
    assert!(
        (width.value - 2.5 * 0.096_962_736).abs() < 1e-8,
        "{width:?}"
    );
    assert!(
        (width.error - 0.3 * 0.096_962_736).abs() < 1e-8,
        "{width:?}"
    );
    let velocity = track.measured[&BinQuantity::Velocity][0];
    assert_eq!(velocity, measured(-120.5, 4.0));
}

#[test]
fn a_mirrored_track_has_the_same_velocities_in_the_other_order() {
    let plain = csv(ARC);
    let mirrored = csv(&format!("# handedness: mirrored\n{ARC}"));
    for (quantity, rows) in &plain.measured {
        let reversed: Vec<_> = rows.iter().rev().copied().collect();
        assert_eq!(mirrored.measured[quantity], reversed);
    }
}

#[test]
fn what_is_measured_by_half_is_refused() {
    for (from, to, parts) in [
        // An error that is missing in a row, and a value.
        ("-98,5", "-98,", ["line 4", "`v`", "`v_err`"]),
        ("2.6,0.4", ",0.4", ["line 3", "`width_err`", "`width`"]),
        // Numbers that cannot be.
        ("-98,5", "nan,5", ["line 4", "`v`", "finite"]),
        ("-98,5", "-98,0", ["line 4", "`v_err`", "0.001"]),
        ("-98,5", "-98000,5", ["line 4", "`v`", "10000"]),
        ("-98,5", "fast,5", ["line 4", "`v`", "not a number"]),
        ("2.6,0.4", "-2.6,0.4", ["line 3", "`width`", "0.001"]),
    ] {
        assert_refused("csv", &ARC.replace(from, to), &parts);
    }
    let column = "phi,r,r_err,v\n-15,60,1,3\n-5,61,1,4\n5,62,1,5\n";
    assert_refused("csv", column, &["line 1", "`v`", "`v_err`"]);
    let empty = ARC.replace("-120.5,4", ",").replace("-98,5", ",");
    assert_refused("csv", &empty, &["`v`", "empty"]);
    let miles = format!("# units: v pc/Myr\n{ARC}");
    assert_refused("csv", &miles, &["`v`", "pc/Myr", "km/s"]);
}

#[test]
fn what_is_written_is_read_back() {
    let track = csv(ARC);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("track.ecsv");
    track.write(&path).expect("written");
    assert_eq!(ObservedTrack::read(&path).expect("a track"), track);
    let text = std::fs::read_to_string(&path).expect("a file");
    assert!(text.contains("{name: v, unit: km / s,"), "{text}");
    assert!(text.contains("\"\",\"\""), "{text}");
    // As JSON too, where a track without them has no key.
    let json = serde_json::to_string(&track).expect("JSON");
    let back: ObservedTrack = serde_json::from_str(&json).expect("a track");
    assert_eq!(back, track);
    let plain = csv("phi,r,r_err\n-15,60,1\n-5,61,1\n5,62,1\n");
    let json = serde_json::to_string(&plain).expect("JSON");
    assert!(!json.contains("measured"), "{json}");
}
