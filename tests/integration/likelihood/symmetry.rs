//! Mirrored and turned streams.

use super::*;

#[test]
fn mirrored_streams_have_the_same_track() {
    // z -> -z of everything leaves the projection as it is. Out-of-plane offsets follow the angular momentum, a pseudovector, and are not
    // mirrored with it: the track is the same but for noise, because the distribution of Fardal's offsets along the pole is symmetric.
    let model = model(ModelSettings {
        releases: TableSettings {
            particles: 8_000,
            sampling_scheme: SamplingScheme::Random,
            ..TableSettings::default()
        },
        ..small()
    });
    let theta = BASE;
    let track = |theta: &Theta| {
        let stream = model.stream(&StreamParams::from_array(*theta));
        let stream = stream.expect("a stream");
        Track::new(&stream, 10.0, BinEdges::Hard, 100.0).expect("a track")
    };
    let changed = |names: &[&str]| {
        let mut changed = theta;
        for name in names {
            let i = index_of(name).expect("a parameter");
            changed[i] = -changed[i];
        }
        track(&changed)
    };
    let ours = track(&theta);
    // Differences of the radii of common bins in their errors.
    let apart = |other: &Track| -> Vec<f64> {
        let bins = ours.bins.iter().filter_map(|a| {
            let b = other.bins.iter().find(|b| b.bin == a.bin)?;
            Some((a.r_kpc - b.r_kpc) / a.r_err_kpc.hypot(b.r_err_kpc))
        });
        bins.collect()
    };
    let worst = |z: &[f64]| z.iter().fold(0.0_f64, |m, z| m.max(z.abs()));
    let same = apart(&changed(&["dir_z", "z0_kpc", "vz0_km_s"]));
    let other = apart(&changed(&["dir_z", "z0_kpc"]));
    assert!(
        same.len() >= 8 && same.len() + 2 >= ours.bins.len(),
        "{same:?}"
    );
    assert!(worst(&same) < 4.0, "{same:?}");
    assert!(worst(&other) > 6.0, "{other:?}");
}

/// Turned about the line of sight a track has other angles and the same radii; turned by half a turn about the sky's x axis it has angles of
/// the other sign. Offsets turn with the orbit, so that the particles are the same but for rounding.
#[test]
fn turned_streams_have_turned_tracks() {
    let model = model(small());
    let system = System::<f64, Nfw>::from_params(&StreamParams::from_array(BASE), Q);
    let track = |turn: &dyn Fn([f64; 3]) -> [f64; 3]| {
        let mut vector = system.to_vector();
        // Axis, position and velocity.
        for first in [3, 8, 11] {
            let [x, y, z] = [0, 1, 2].map(|i| vector[first + i]);
            vector[first..first + 3].copy_from_slice(&turn([x, y, z]));
        }
        let stream = model.stream_of(&system.with_vector(vector));
        stream.and_then(|s| s.track(10.0)).expect("a track").bins
    };
    let ours = track(&|v| v);
    assert!(ours.len() >= 8, "{}", ours.len());
    let (sin, cos) = 40.0_f64.to_radians().sin_cos();
    let turned = track(&|[x, y, z]| [cos * x - sin * y, sin * x + cos * y, z]);
    let mut over = track(&|[x, y, z]| [x, -y, -z]);
    over.reverse();
    for (there, bin_of) in [
        (&turned, &(|bin: i64| bin + 4) as &dyn Fn(i64) -> i64),
        (&over, &|bin| -1 - bin),
    ] {
        assert_eq!(there.len(), ours.len());
        for (a, b) in ours.iter().zip(there) {
            assert_eq!(bin_of(a.bin), b.bin);
            assert!((b.r_kpc / a.r_kpc - 1.0).abs() < 1e-10, "{a:?} {b:?}");
            assert!((b.n / a.n - 1.0).abs() < 1e-10, "{a:?} {b:?}");
        }
    }
}
