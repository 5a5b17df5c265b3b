//! First: thirteen parameters to the track of a stream.
//!
//! `cargo run --release --example one_stream`

use oblate::Result;
use oblate::params::{PriorSettings, StreamParams, StreamPrior};
use oblate::stream::{Model, ModelSettings};

fn main() -> Result<()> {
    let params = StreamParams {
        log10_m_halo: 12.1,
        r_s_halo_kpc: 16.0,
        dir_x: -0.112,
        dir_y: -0.179,
        dir_z: 0.735,
        log10_m_prog: 8.0,
        r_s_prog_kpc: 1.5,
        x0_kpc: 59.0,
        z0_kpc: 53.0,
        vx0_km_s: -41.0,
        vy0_km_s: 156.0,
        vz0_km_s: -29.0,
        age_gyr: 3.0,
        ..StreamParams::ABSENT
    };
    let prior = StreamPrior::new(&PriorSettings::default())?;
    prior.check_inside(&params)?;
    let shape = prior.shape(&params);
    println!("q = {:.2}, axis = {:.2?}", shape.q, shape.axis.to_array());

    // Made once for many streams: the releases, and everything else that does not depend on the parameters.
    let model = Model::new(&ModelSettings::default())?;
    let track = model.stream(&params)?.track(10.0)?;
    println!("{:>8} {:>8} {:>8} {:>6}", "phi/deg", "r/kpc", "+-", "n");
    for bin in &track.bins {
        println!(
            "{:>8} {:>8.2} {:>8.2} {:>6.0}",
            bin.phi_deg, bin.r_kpc, bin.r_err_kpc, bin.n
        );
    }
    Ok(())
}
