//! The ranges of a track: its columns, and the bins of data and of models.

use super::{Row, ranges, rows};
use crate::haloes::THETA;
use oblate::Error;
use oblate::data::{AssumedError, ObservedTrack};
use oblate::likelihood::{DataBin, LikelihoodSettings, TrackLikelihood};
use oblate::params::StreamParams;
use oblate::spray::TableSettings;
use oblate::stream::{Model, ModelSettings};
use oblate::track::{BinEdges, Track};

/// Reads columns as a track.
fn track(text: &str) -> Result<ObservedTrack, String> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("track.csv");
    std::fs::write(&path, text).expect("a file");
    ObservedTrack::read(&path).map_err(|e| e.to_string())
}

#[test]
fn the_ranges_of_a_track_are_those_of_the_page() {
    let good = |column: &str, value: f64| {
        let cell = |name: &str, usual: f64| if name == column { value } else { usual };
        let (r, r_err, n) = (cell("r", 60.0), cell("r_err", 1.0), cell("n", 9.0));
        track(&format!(
            "phi,r,r_err,n\n-15,60,1,9\n-5,60,1,9\n5,{r:?},{r_err:?},{n:?}\n"
        ))
    };
    for Row { key, lo, hi } in rows("6. A track") {
        match key.as_str() {
            "r" | "r_err" | "n" => {
                assert!(good(&key, lo).is_ok() && good(&key, hi).is_ok(), "{key}");
                for wrong in [lo.next_down(), hi.next_up(), f64::NAN, f64::INFINITY] {
                    let words = good(&key, wrong).unwrap_err();
                    assert!(words.contains("line 4") && words.contains(&format!("`{key}`")));
                    assert!(words.contains("; give"), "{words}");
                }
            }
            "v" | "v_err" | "width" | "width_err" | "density" | "density_err" => {
                let name = key.trim_end_matches("_err");
                let of = |number: f64| {
                    let pair = if key == name {
                        format!("{number:?},1")
                    } else {
                        format!("1,{number:?}")
                    };
                    track(&format!(
                        "phi,r,r_err,{name},{name}_err\n-15,60,1,,\n-5,60,1,,\n5,60,1,{pair}\n"
                    ))
                };
                assert!(of(lo).is_ok() && of(hi).is_ok(), "{key}");
                for wrong in [lo.next_down(), hi.next_up(), f64::NAN, f64::INFINITY] {
                    let words = of(wrong).unwrap_err();
                    assert!(words.contains("line 4") && words.contains(&format!("`{key}`")));
                    assert!(words.contains("; give"), "{words}");
                }
            }
            "phi" => {
                // 7,200 is the centre of the bin number 112 of 64 degrees.
                let at = |end: f64| {
                    let sign = end.signum();
                    let mut phi = [end - 128.0 * sign, end - 64.0 * sign, end];
                    phi.sort_by(f64::total_cmp);
                    ObservedTrack::new("far", &phi, 64.0, &[60.0; 3], &[1.2; 3])
                };
                for end in [lo, hi] {
                    assert!(at(end).is_ok());
                    let words = at(end + 64.0 * end.signum()).unwrap_err().to_string();
                    assert!(words.contains("7264") && words.contains("7200"), "{words}");
                }
            }
            "bin_width" => {
                let of = |width: f64| {
                    let phi = [0.5 * width, 1.5 * width, 2.5 * width];
                    ObservedTrack::new("wide", &phi, width, &[60.0; 3], &[1.2; 3])
                };
                assert!(of(lo).is_ok() && of(hi).is_ok());
                for wrong in [lo.next_down(), hi.next_up(), 0.0, f64::NAN] {
                    let words = of(wrong).unwrap_err().to_string();
                    assert!(
                        words.contains("bin_width") || words.contains("phi"),
                        "{words}"
                    );
                }
            }
            _ => {
                let of = |rows: usize| {
                    let row = |i: usize| format!("{},60,1\n", (i as f64 + 0.5) * 0.25);
                    track(&format!(
                        "phi,r,r_err\n{}",
                        (0..rows).map(row).collect::<String>()
                    ))
                };
                let (lo, hi) = (lo as usize, hi as usize);
                assert!(of(lo).is_ok() && of(hi).is_ok());
                assert!(of(lo - 1).unwrap_err().contains("at least 3 bins"));
                let words = of(hi + 1).unwrap_err();
                assert!(words.contains("line 10002") && words.contains("at most 10000 bins"));
            }
        }
    }
}

#[test]
fn a_bin_at_any_distance_is_refused_with_its_line() {
    for far in ["1e10", "1e300", "-1e300"] {
        let words = track(&format!("phi,r,r_err\n5,60,1\n15,60,1\n{far},60,1\n")).unwrap_err();
        assert!(words.contains("line 4"), "{words}");
    }
    // The same through the library, where bins are numbered.
    for bin in [i64::MAX, i64::MIN, 1_000_000_000] {
        let data = [0, 1, bin].map(|bin| DataBin::symmetric(bin, 60.0, 1.0));
        let likelihood = TrackLikelihood::new(
            &LikelihoodSettings::default(),
            10.0,
            &data,
            &TableSettings::default(),
        );
        assert!(matches!(likelihood, Err(Error::OutOfRange(_))));
    }
}

#[test]
fn particles_far_around_the_centre_make_no_bins_there() {
    let mut settings = ModelSettings::default();
    settings.releases.particles = 64;
    let params = StreamParams::from_array(THETA);
    let model = Model::new(&settings).expect("a model");
    let mut particles = model.stream(&params).expect("a stream");
    let narrow = Track::new(&particles, 0.1, BinEdges::Hard, 1.0).expect("a track");
    particles.winding_numbers[0] = 1e12;
    particles.winding_numbers[1] = -1e12;
    let track = Track::new(&particles, 0.1, BinEdges::Hard, 1.0).expect("a track");
    assert!(track.bins.len() <= narrow.bins.len());
    for width in [0.0, 1e-5, f64::NAN, 1e300] {
        assert!(Track::new(&particles, width, BinEdges::Hard, 1.0).is_err());
        assert!(particles.track(width).is_err());
    }
}

#[test]
fn an_assumed_error_is_as_small_and_as_large_as_the_page_says() {
    let found = ranges("An assumed error is");
    let [(lo, hi)] = found[..] else {
        panic!("{found:?}");
    };
    let assumed = |percent: f64| format!("{percent}%").parse::<AssumedError>();
    for end in [lo, hi] {
        assert!(assumed(end).is_ok(), "{end}");
    }
    for beyond in [lo.next_down(), hi.next_up()] {
        assert!(assumed(beyond).is_err(), "{beyond}");
    }
}
