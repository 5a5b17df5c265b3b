//! A halo of one's own: the halo of the paper plus the disc of the host galaxy, with exact gradients.
//!
//! `cargo run --release --example own_halo`
//!
//! The halo is put together from two potentials of the library; one of your own is a struct with the trait `Potential`, written once for
//! all number types. The derivatives of a stream with respect to positions and parameters follow from the acceleration.

use oblate::Result;
use oblate::params::{QRange, StreamParams};
use oblate::potential::{
    Disc, DiscProfile, DiscShape, FlattenedNfw, Halo, HaloParameters, Nfw, Sum,
};
use oblate::scalar::{Scalar, Vec3};
use oblate::stream::{CompiledHost, Kernels, Model, ModelSettings, System};

/// The kind of halo: a flattened NFW halo with a disc of 7e10 Msun that is seen edge-on, its normal along the sky's y axis.
#[derive(Clone, Copy, Debug, Default)]
pub struct NfwWithDisc;

impl Halo for NfwWithDisc {
    type In<S: Scalar> = Sum<FlattenedNfw<S>, Disc<S>>;

    #[inline(always)]
    fn new<S: Scalar>(p: HaloParameters<S>) -> Self::In<S> {
        let halo = FlattenedNfw::from_flattening(p.mass, p.r_s, p.flattening, p.axis);
        let disc = Disc::new(
            S::from_f64(7e10),
            S::from_f64(3.0),
            Vec3::from_f64(Vec3::new(0.0, 1.0, 0.0)),
            DiscShape::new(DiscProfile::MiyamotoNagai, 0.1),
        );
        Sum(halo, disc)
    }

    #[inline(always)]
    fn parameters<S: Scalar>(Sum(halo, _): &Self::In<S>) -> HaloParameters<S> {
        Nfw::parameters(halo)
    }
}

impl CompiledHost for NfwWithDisc {
    fn kernels() -> &'static Kernels<Self> {
        static KERNELS: Kernels<NfwWithDisc> = Kernels::new();
        &KERNELS
    }
}

#[allow(dead_code, reason = "a test includes this file for the halo above")]
fn main() -> Result<()> {
    let params = StreamParams::from([
        12.0, 15.0, 0.3, 0.0, 1.2, 8.0, 1.0, 60.0, 30.0, 30.0, 140.0, 45.0, 3.0,
    ]);
    let model = Model::new(&ModelSettings::default())?;
    let without = model.stream(&params)?.track(10.0)?;
    let system =
        System::<f64, NfwWithDisc>::with_host(&params, QRange::default(), model.settings());
    let with = model.stream_of(&system)?.track(10.0)?;
    println!(
        "{:>8} {:>12} {:>12}",
        "phi/deg", "without disc", "with disc"
    );
    for bin in &with.bins {
        let other = without.bins.iter().find(|other| other.bin == bin.bin);
        let r = other.map_or("-".to_owned(), |other| format!("{:.2}", other.r_kpc));
        println!("{:>8} {:>12} {:>12.2}", bin.phi_deg, r, bin.r_kpc);
    }
    Ok(())
}
