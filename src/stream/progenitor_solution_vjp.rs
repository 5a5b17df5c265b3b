//! Reverse mode of the progenitor solution: it is computed once more on dual numbers, whose derivatives are multiplied by those of the
//! result with respect to the solution.

use super::cotangents::{Cotangents, SharedCotangent};
use super::model::Model;
use super::progenitor_solution::release_frame;
use super::system::{SYSTEM_LEN, System};
use crate::orbit::DenseOrbit;
use crate::potential::{Halo, Potential};
use crate::scalar::{Isa, Kernel, LANES, LaneDual, Lanes, Level, Scalar, Vec3, compile_kernel};
use std::marker::PhantomData;

/// The reverse mode of a progenitor solution.
pub struct SolutionVjpKernel<'a, H: Halo> {
    pub(super) model: &'a Model,
    pub(super) system: &'a System<f64, H>,
    /// Derivatives of the result with respect to the solution.
    pub(super) total: &'a Cotangents,
}

/// Lane vectors that hold the derivatives with respect to the vector of a system.
const VECTORS: usize = SYSTEM_LEN.div_ceil(LANES);

impl<H: Halo> Kernel for SolutionVjpKernel<'_, H> {
    type Output = [f64; SYSTEM_LEN];

    #[inline(always)]
    fn run<I: Isa>(self) -> Self::Output {
        let Self {
            model,
            system,
            total,
        } = self;
        let mut numbers = [LaneDual::<I, VECTORS>::zero(); SYSTEM_LEN];
        for (i, number) in system.to_vector().into_iter().enumerate() {
            numbers[i] = LaneDual::variable(number, i);
        }
        let system = System::<_, H>::from_vector(numbers);
        let orbit = DenseOrbit::integrate(
            &OutOfLine::<I, _>::new(&system.host),
            system.today,
            system.age_gyr,
            total.nodes.len() - 1,
            model.settings.orbit,
        );
        let mut sum = Contraction::<I>(Lanes::zero());
        for (node, by) in orbit.nodes.iter().zip(&total.nodes) {
            for row in 0..3 {
                sum.add_vec(&node.vector(row), by.vector(row));
            }
        }
        for (tau, by) in model.table.taus.iter().zip(&total.release_frames) {
            let (release_frame, _) = release_frame(
                &system.host,
                &system.progenitor,
                &orbit,
                *tau,
                model.table.recipe,
            );
            sum.add_vec(&release_frame.state.x, by.state.x);
            sum.add_vec(&release_frame.state.v, by.state.v);
            for c in 0..3 {
                sum.add_vec(&release_frame.position[c], by.position[c]);
                sum.add_vec(&release_frame.velocity[c], by.velocity[c]);
            }
        }
        // Derivatives with respect to what the particles depend on directly.
        let SharedCotangent {
            host,
            progenitor,
            age_gyr,
        } = total.shared;
        let halo = H::parameters(&system.host);
        sum.add(&halo.mass, host.ln_mass / halo.mass.re);
        sum.add(&halo.r_s, host.ln_r_s / halo.r_s.re);
        sum.add(&halo.flattening, host.flattening);
        sum.add_vec(&halo.axis, host.axis);
        sum.add(
            &system.progenitor.mass,
            progenitor.ln_mass / system.progenitor.mass.re,
        );
        sum.add(&system.progenitor.r_s, progenitor.r_s);
        sum.add(&system.age_gyr, age_gyr);
        let mut gradient = [0.0; SYSTEM_LEN];
        let lanes = sum.0.store();
        gradient.copy_from_slice(&lanes.0.as_flattened()[..SYSTEM_LEN]);
        gradient
    }
}

compile_kernel!(SolutionVjpKernel<H: crate::potential::Halo>);

/// Runs the kernel at a level.
pub(super) fn progenitor_solution_vjp<H: Halo>(
    kernel: SolutionVjpKernel<'_, H>,
    level: Level,
) -> [f64; SYSTEM_LEN] {
    kernel.dispatch(level)
}

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

/// Sum of derivatives of the result times dual parts: the chain rule.
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
