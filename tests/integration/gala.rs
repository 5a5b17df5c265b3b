//! The five streams of `tests/golden/streams_gala`: made by gala, followed a second time by independent code.

use crate::golden::{json, number, numbers, path};
use oblate::orbit::State;
use oblate::potential::{FlattenedNfw, Plummer};
use oblate::scalar::Vec3;
use oblate::stream::System;
use std::io::Read;

/// Names of the streams.
pub const NAMES: [&str; 5] = [
    "s0_oblate_tilted",
    "s1_prolate_tilted",
    "s2_spherical",
    "s3_oblate_edge_on",
    "s4_prolate_wrapped",
];

/// The stream's host, progenitor and present state.
pub fn system(name: &str) -> System<f64> {
    let file = json(&format!("streams_gala/{name}.json"));
    let p = &file["host_and_progenitor"];
    let get = |key: &str| number(&p[key]);
    let axis = Vec3::from(numbers::<3>(&file["n_unit"]));
    System {
        host: FlattenedNfw::new(10.0_f64.powf(get("log10M")), get("Rs"), get("q"), axis),
        progenitor: Plummer {
            mass: get("m"),
            r_s: get("a"),
        },
        mass_loss: 1.0,
        release_peaking: 0.0,
        coulomb_logarithm: 0.0,
        today: State {
            x: Vec3::from(numbers::<3>(&file["progenitor_final_x_kpc"])),
            v: Vec3::from(numbers::<3>(&file["progenitor_final_v_kpc_per_Gyr"])),
        },
        age_gyr: get("T"),
    }
}

/// One particle of a subset file.
pub struct Followed {
    pub trailing: bool,
    pub t_release: f64,
    pub k: [f64; 4],
    pub start: [f64; 6],
    pub end: [f64; 6],
    pub dphi_deg: f64,
}

/// The 2000 particles of a subset file.
pub fn subset(name: &str) -> Vec<Followed> {
    let file =
        std::fs::File::open(path(&format!("streams_gala/{name}_subset.csv.gz"))).expect("subset");
    let mut text = String::new();
    flate2::read::GzDecoder::new(file)
        .read_to_string(&mut text)
        .expect("gzip");
    text.lines()
        .skip(1)
        .map(|line| {
            let cells: Vec<&str> = line.split(',').collect();
            let f = |i: usize| cells[i].parse::<f64>().expect("a number");
            Followed {
                trailing: cells[1] == "t",
                t_release: f(2),
                k: std::array::from_fn(|i| f(3 + i)),
                start: std::array::from_fn(|i| f(7 + i)),
                end: std::array::from_fn(|i| f(13 + i)),
                dphi_deg: f(19),
            }
        })
        .collect()
}

/// One bin of a track file.
pub struct GoldenBin {
    pub lo_deg: f64,
    pub count: f64,
    pub mean_r_kpc: f64,
    pub se_r_kpc: f64,
}

/// The track of a stream, 10 degree bins.
pub fn track(name: &str) -> Vec<GoldenBin> {
    let text =
        std::fs::read_to_string(path(&format!("streams_gala/{name}_track.csv"))).expect("track");
    text.lines()
        .skip(1)
        .map(|line| {
            let f = |i: usize| {
                line.split(',')
                    .nth(i)
                    .and_then(|c| c.parse().ok())
                    .unwrap_or(f64::NAN)
            };
            GoldenBin {
                lo_deg: f(0),
                count: f(2),
                mean_r_kpc: f(5),
                se_r_kpc: f(6),
            }
        })
        .collect()
}

/// Mean line-of-sight velocity and scatter of velocities and radii of a bin.
pub struct GoldenMeasured {
    pub phi_deg: f64,
    pub n: f64,
    pub v_km_s: f64,
    pub sd_of_v_km_s: f64,
    pub sd_of_r_kpc: f64,
}

/// The bins of `velocities.json`.
pub fn measured(name: &str) -> Vec<GoldenMeasured> {
    let rows = json("streams_gala/velocities.json")[name].clone();
    let row = |row: &serde_json::Value| {
        let [phi_deg, n, v_km_s, sd_of_v_km_s, _, sd_of_r_kpc] = numbers::<6>(row);
        GoldenMeasured {
            phi_deg,
            n,
            v_km_s,
            sd_of_v_km_s,
            sd_of_r_kpc,
        }
    };
    rows.as_array().expect("bins").iter().map(row).collect()
}
