//! Compiles kernels for each instruction set, and chooses one at run time by the features that the CPU reports.

use std::sync::OnceLock;

/// An instruction set that kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// AVX-512 with fused multiply-add.
    Avx512,
    /// AVX2 with fused multiply-add.
    Avx2,
    /// The instructions that every CPU of the target has (SSE2 on x86-64, NEON on aarch64).
    Baseline,
}

impl Level {
    /// The best instruction set of this CPU.
    #[must_use]
    pub fn best() -> Self {
        Self::available().first().copied().unwrap_or(Self::Baseline)
    }

    /// All instruction sets of this CPU, the best first.
    #[must_use]
    pub fn available() -> &'static [Self] {
        static AVAILABLE: OnceLock<Vec<Level>> = OnceLock::new();
        AVAILABLE.get_or_init(Self::detect)
    }

    /// This instruction set if the CPU has it, the baseline if not.
    #[must_use]
    pub fn or_baseline(self) -> Self {
        if Self::available().contains(&self) {
            self
        } else {
            Self::Baseline
        }
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

/// Compiles a [`Kernel`] with one lifetime parameter, and perhaps one type parameter, for each instruction set, and gives it
/// `dispatch(self, level)`. If this CPU lacks the instruction set, the baseline is used.
///
/// Each compiled function is in a module of its own and therefore in a codegen unit of its own: they are compiled in parallel, and only
/// when they change. The macro can be used once per file.
macro_rules! compile_kernel {
    ($kernel:ident $(<$parameter:ident: $bound:path>)?) => {
        impl$(<$parameter: $bound>)? $kernel<'_ $(, $parameter)?> {
            fn dispatch(
                self,
                level: $crate::scalar::Level,
            ) -> <Self as $crate::scalar::Kernel>::Output {
                match level.or_baseline() {
                    #[cfg(target_arch = "x86_64")]
                    // SAFETY: `or_baseline` returns a level only if its features were found on this CPU.
                    $crate::scalar::Level::Avx512 => unsafe { compiled::avx512::run(self) },
                    #[cfg(target_arch = "x86_64")]
                    // SAFETY: as above.
                    $crate::scalar::Level::Avx2 => unsafe { compiled::avx2::run(self) },
                    _ => compiled::portable::run(self),
                }
            }
        }

        mod compiled {
            #[cfg(target_arch = "x86_64")]
            pub(super) mod avx512 {
                use super::super::$kernel;
                use $crate::scalar::{Avx512, Kernel};
                #[target_feature(enable = "avx512f,avx512dq,avx512vl,fma")]
                pub(in super::super) fn run$(<$parameter: $bound>)?(
                    kernel: $kernel<'_ $(, $parameter)?>,
                ) -> <$kernel<'_ $(, $parameter)?> as Kernel>::Output {
                    kernel.run::<Avx512>()
                }
            }

            #[cfg(target_arch = "x86_64")]
            pub(super) mod avx2 {
                use super::super::$kernel;
                use $crate::scalar::{Avx2, Kernel};
                #[target_feature(enable = "avx2,fma")]
                pub(in super::super) fn run$(<$parameter: $bound>)?(
                    kernel: $kernel<'_ $(, $parameter)?>,
                ) -> <$kernel<'_ $(, $parameter)?> as Kernel>::Output {
                    kernel.run::<Avx2>()
                }
            }

            pub(super) mod portable {
                use super::super::$kernel;
                use $crate::scalar::{Kernel, Portable};
                #[inline(never)]
                pub(in super::super) fn run$(<$parameter: $bound>)?(
                    kernel: $kernel<'_ $(, $parameter)?>,
                ) -> <$kernel<'_ $(, $parameter)?> as Kernel>::Output {
                    kernel.run::<Portable>()
                }
            }
        }
    };
}

pub(crate) use compile_kernel;
