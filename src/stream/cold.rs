//! The cold stage once more, on dual numbers: where the derivatives of the particles, in reverse mode, meet those of the orbit and the
//! releases, in forward mode.

use super::backward::{ByShared, Cotangents};
use super::setup::launch;
use super::{Galaxy, Model, ModelSettings};
use crate::orbit::DenseOrbit;
use crate::potential::Potential;
use crate::scalar::{Isa, Kernel, LANES, LaneDual, Lanes, Level, Scalar, Vec3, compile_kernel};
use std::marker::PhantomData;

/// The cold stage once more, on duals, joined to the derivatives with respect to what it hands over.
struct Cold<'a> {
    model: &'a Model,
    galaxy: &'a Galaxy<f64>,
    total: &'a Cotangents,
}

impl Model {
    /// The gradient with respect to the [numbers](Galaxy::numbers) of a galaxy, from the derivatives with respect to what the cold
    /// stage hands over to the particles.
    pub(super) fn pull_back_setup(
        &self,
        galaxy: &Galaxy<f64>,
        total: &Cotangents,
    ) -> [f64; Galaxy::<f64>::NUMBERS] {
        let cold = Cold {
            model: self,
            galaxy,
            total,
        };
        cold.dispatch(Level::best())
    }
}

/// Vectors for the derivatives with respect to the numbers of a galaxy.
const VECTORS: usize = Galaxy::<f64>::NUMBERS.div_ceil(LANES);

impl Kernel for Cold<'_> {
    type Output = [f64; Galaxy::<f64>::NUMBERS];

    #[inline(always)]
    fn run<I: Isa>(self) -> Self::Output {
        let Self {
            model,
            galaxy,
            total,
        } = self;
        let mut numbers = [LaneDual::<I, VECTORS>::zero(); Galaxy::<f64>::NUMBERS];
        for (i, number) in galaxy.numbers().into_iter().enumerate() {
            numbers[i] = LaneDual::variable(number, i);
        }
        let galaxy = Galaxy::from_numbers(numbers);
        let ModelSettings {
            orbit_steps, orbit, ..
        } = model.settings;
        let orbit = DenseOrbit::integrate(
            &OutOfLine::<I, _>::new(&galaxy.host),
            galaxy.today,
            galaxy.age_gyr,
            orbit_steps,
            orbit,
        );
        let mut sum = Contraction::<I>(Lanes::zero());
        for (node, by) in orbit.nodes.iter().zip(&total.nodes) {
            for row in 0..3 {
                sum.add_vec(&node.vector(row), by.vector(row));
            }
        }
        for (tau, by) in model.table.taus.iter().zip(&total.launches) {
            let (launch, _) = launch(
                &galaxy.host,
                &galaxy.sphere,
                &orbit,
                *tau,
                model.table.recipe,
            );
            sum.add_vec(&launch.state.x, by.state.x);
            sum.add_vec(&launch.state.v, by.state.v);
            for c in 0..3 {
                sum.add_vec(&launch.position[c], by.position[c]);
                sum.add_vec(&launch.velocity[c], by.velocity[c]);
            }
        }
        // What the particles meet directly.
        let ByShared {
            host,
            sphere,
            age_gyr,
        } = total.shared;
        sum.add(&galaxy.host.mass, host.ln_mass / galaxy.host.mass.re);
        sum.add(&galaxy.host.r_s, host.ln_r_s / galaxy.host.r_s.re);
        sum.add(&galaxy.host.flattening, host.flattening);
        sum.add_vec(&galaxy.host.axis, host.axis);
        sum.add(&galaxy.sphere.mass, sphere.ln_mass / galaxy.sphere.mass.re);
        sum.add(&galaxy.sphere.r_s, sphere.r_s);
        sum.add(&galaxy.age_gyr, age_gyr);
        let mut gradient = [0.0; Galaxy::<f64>::NUMBERS];
        let lanes = sum.0.store();
        gradient.copy_from_slice(&lanes.0.as_flattened()[..Galaxy::<f64>::NUMBERS]);
        gradient
    }
}

compile_kernel!(Cold);

/// A potential whose acceleration is a function that is called and not inlined: on dual numbers it is long, and an orbit's step
/// holds it many times.
struct OutOfLine<'a, I, P>(&'a P, PhantomData<I>);

impl<'a, I, P> OutOfLine<'a, I, P> {
    fn new(potential: &'a P) -> Self {
        Self(potential, PhantomData)
    }
}

impl<I: Isa, P: Potential<LaneDual<I, VECTORS>>> Potential<LaneDual<I, VECTORS>>
    for OutOfLine<'_, I, P>
{
    #[inline(always)]
    fn value(&self, x: Vec3<LaneDual<I, VECTORS>>) -> LaneDual<I, VECTORS> {
        self.0.value(x)
    }

    #[inline(always)]
    fn acceleration(&self, x: Vec3<LaneDual<I, VECTORS>>) -> Vec3<LaneDual<I, VECTORS>> {
        I::call(Acceleration {
            potential: self.0,
            x,
        })
    }

    #[inline(always)]
    fn hessian_product(
        &self,
        x: Vec3<LaneDual<I, VECTORS>>,
        v: Vec3<LaneDual<I, VECTORS>>,
    ) -> Vec3<LaneDual<I, VECTORS>> {
        self.0.hessian_product(x, v)
    }
}

/// An acceleration as a function of its own.
struct Acceleration<'a, I: Isa, P> {
    potential: &'a P,
    x: Vec3<LaneDual<I, VECTORS>>,
}

impl<I: Isa, P: Potential<LaneDual<I, VECTORS>>> Kernel for Acceleration<'_, I, P> {
    type Output = Vec3<LaneDual<I, VECTORS>>;

    /// In lanes of its fields' instruction set, which is the one that it is called for.
    #[inline(always)]
    fn run<Same: Isa>(self) -> Self::Output {
        self.potential.acceleration(self.x)
    }
}

/// Sum of derivative times dual part: where reverse mode meets forward mode.
struct Contraction<I: Isa>(Lanes<I, VECTORS>);

impl<I: Isa> Contraction<I> {
    #[inline(always)]
    fn add(&mut self, number: &LaneDual<I, VECTORS>, by: f64) {
        self.0 = number.eps.mul_add(Lanes::from_f64(by), self.0);
    }

    #[inline(always)]
    fn add_vec(&mut self, vector: &Vec3<LaneDual<I, VECTORS>>, by: Vec3<f64>) {
        self.add(&vector.x, by.x);
        self.add(&vector.y, by.y);
        self.add(&vector.z, by.z);
    }
}
