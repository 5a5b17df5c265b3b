//! The only file that asks the CPU: compiles a kernel for each instruction set and picks one at run time.

#[cfg(target_arch = "x86_64")]
use crate::scalar::{Avx2, Avx512};
use crate::scalar::{Isa, Portable};
use std::sync::OnceLock;

/// An instruction set that kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// AVX-512 with fused multiply-add.
    Avx512,
    /// AVX2 with fused multiply-add.
    Avx2,
    /// What the target promises (SSE2 on x86-64, NEON on aarch64).
    Baseline,
}

impl Level {
    /// The best level of this CPU.
    #[must_use]
    pub fn best() -> Self {
        Self::available().first().copied().unwrap_or(Self::Baseline)
    }

    /// All levels of this CPU, best first.
    #[must_use]
    pub fn available() -> &'static [Self] {
        static AVAILABLE: OnceLock<Vec<Level>> = OnceLock::new();
        AVAILABLE.get_or_init(Self::detect)
    }

    fn detect() -> Vec<Self> {
        let mut levels = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("fma")
            {
                levels.push(Self::Avx512);
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                levels.push(Self::Avx2);
            }
        }
        levels.push(Self::Baseline);
        levels
    }
}

/// A piece of work whose `run` is inlined into a function compiled for one instruction set.
pub trait Kernel {
    /// What it returns.
    type Output;
    /// The work, in lanes of `I`; implement it with `#[inline(always)]`, and everything hot below it too.
    fn run<I: Isa>(self) -> Self::Output;
}

/// Runs a kernel at a level.
///
/// A level that this CPU lacks runs at the baseline: see [`Level::available`].
pub fn dispatch<K: Kernel>(level: Level, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if level != Level::Baseline && Level::available().contains(&level) {
            return match level {
                // SAFETY: the features of this level were found on this CPU just above.
                Level::Avx512 => unsafe { avx512(kernel) },
                // SAFETY: as above.
                _ => unsafe { avx2(kernel) },
            };
        }
    }
    let _ = level;
    kernel.run::<Portable>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,fma")]
fn avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx512>()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx2>()
}
