//! Counter-based random streams: a draw is a function of (seed, domain, task, index), never of the order of work.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The generator behind every stream.
pub type RandomStream = ChaCha8Rng;

/// Version of the mapping from (seed, domain, task, index) to numbers. A change of it changes every result and is
/// listed in the changelog.
pub const STREAM_VERSION: u32 = 1;

/// Purpose of a random stream. The numbers are part of [`STREAM_VERSION`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Domain {
    /// One new point of a nested run; task = 0, index = number of the point, counted on from batch to batch.
    NestedPoint = 1,
    /// The choice of start points of one nested iteration.
    NestedSeeds = 2,
    /// Fits of the bounding ellipsoids.
    NestedBound = 3,
    /// Surrogates and mixtures of a nested run; task = half of the lineages and number of components, index = iteration.
    NestedSurrogate = 4,
    /// The local moves of one chain of a tempered run; task = chain set * 2^20 + temperature, index = scan.
    PtExplore = 16,
    /// One swap of a tempered run; task = chain set * 2^20 + pair of temperatures, index = scan.
    PtSwap = 17,
    /// One SMC particle of a tempered run; task = SMC sampler * 2^20 + SMC particle, index = MCMC step.
    PtSmc = 18,
    /// The references of a tempered run; task = scan, index = 2 x part + half of the clusters, where part is the number of components of
    /// the mixture, 0 for the autoregressive density, or the number of a task of the screen or of a moved copy, beyond all of these.
    PtReference = 19,
    /// The surrogate of a tempered run; task = scan.
    PtSurrogate = 20,
    /// SMC bridge to a finer model; task = step, index = particle.
    Bridge = 25,
    /// Post-processing: simulated weights, bootstraps, resampling; `task` distinguishes them.
    Post = 32,
    /// Draws of the prior outside any sampler (mocks, checks).
    Prior = 48,
    /// Tables of releases and other fixed random numbers.
    Releases = 64,
    /// Tests.
    Test = 255,
}

/// The stream of one task: `task` and `index` count without bound and never collide.
#[must_use]
pub fn stream(seed: u64, domain: Domain, task: u64, index: u64) -> RandomStream {
    let mut key = [0_u8; 32];
    for (slot, word) in
        key.chunks_exact_mut(8)
            .zip([seed, domain as u64, task, u64::from(STREAM_VERSION)])
    {
        slot.copy_from_slice(&word.to_le_bytes());
    }
    let mut stream = ChaCha8Rng::from_seed(key);
    stream.set_stream(index);
    stream
}

/// A uniform draw in the open interval (0, 1): the centres of 2^53 equal cells, those above 1/2 rounded.
pub fn unit_open<R: Rng + ?Sized>(rng: &mut R) -> f64 {
    const CELL: f64 = 1.0 / (1_u64 << 53) as f64;
    // The centre of the last cell would be rounded to 1.
    (((rng.next_u64() >> 11) as f64 + 0.5) * CELL).min(1.0 - 0.5 * f64::EPSILON)
}

/// A uniform draw from `0..count`, or 0 if there is none: the high half of a 128-bit product, whose bias is below
/// count / 2^64.
pub fn below<R: Rng + ?Sized>(rng: &mut R, count: usize) -> usize {
    let wide = u128::from(rng.next_u64()) * (count as u128);
    usize::try_from(wide >> 64).unwrap_or(0)
}

/// A standard normal draw by inversion: one uniform each, the same on every version of every library.
pub fn standard_normal<R: Rng + ?Sized>(rng: &mut R) -> f64 {
    crate::normal::quantile(unit_open(rng))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_differ_in_every_part_of_their_key() {
        let first = |s, d, t, i| stream(s, d, t, i).next_u64();
        let all = [
            first(1, Domain::Test, 0, 0),
            first(2, Domain::Test, 0, 0),
            first(1, Domain::Post, 0, 0),
            first(1, Domain::Test, 1, 0),
            first(1, Domain::Test, 0, 1),
        ];
        for i in 0..all.len() {
            for j in 0..i {
                assert_ne!(all[i], all[j]);
            }
        }
    }

    #[test]
    fn uniform_draws_are_inside_the_open_interval() {
        struct Constant(u64);
        impl rand::TryRng for Constant {
            type Error = std::convert::Infallible;

            fn try_next_u32(&mut self) -> Result<u32, Self::Error> {
                unreachable!("only whole words are drawn")
            }

            fn try_next_u64(&mut self) -> Result<u64, Self::Error> {
                Ok(self.0)
            }

            fn try_fill_bytes(&mut self, _: &mut [u8]) -> Result<(), Self::Error> {
                unreachable!("only whole words are drawn")
            }
        }
        let [least, most] = [0, u64::MAX].map(|word| unit_open(&mut Constant(word)));
        assert!(least > 0.0 && most < 1.0, "{least} {most}");
        assert!(standard_normal(&mut Constant(u64::MAX)).is_finite());
    }

    #[test]
    fn the_stream_is_the_one_of_its_version() {
        // Written down from this code: a change here is a change of STREAM_VERSION.
        let mut s = stream(42, Domain::Test, 7, 9);
        let words = [s.next_u64(), s.next_u64()];
        assert_eq!(STREAM_VERSION, 1);
        assert_eq!(
            words,
            [1_520_945_062_048_712_991, 14_730_397_256_801_625_614]
        );
    }
}
