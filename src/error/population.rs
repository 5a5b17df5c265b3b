//! Reasons why a posterior of q cannot be part of a population.

/// A fault of a posterior of q; the message ends with what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PosteriorFault {
    /// There are no draws.
    #[error("the fit has no draws of q; finish the fit, or leave the stream out")]
    NoDraws,
    /// The numbers of draws and weights differ.
    #[error("{draws} draws of q, but {weights} weights; write the run folder again")]
    Lengths {
        /// Number of draws.
        draws: usize,
        /// Number of weights.
        weights: usize,
    },
    /// The prior of q has no closed form.
    #[error(
        "the prior of q in this fit is not known, so it cannot be divided out; fit again with dir_x, dir_y and dir_z free under \
         their default marginals"
    )]
    UnknownPrior,
    /// The prior of the halo's axes is not isotropic.
    #[error(
        "the prior of the halo's axes in this fit is not isotropic, with which axes are compared; fit again with dir_x, dir_y and dir_z \
         free under their default marginals, and psi_halo_deg of a triaxial halo uniform over 180 or 360 degrees"
    )]
    AxisPrior,
    /// The fit's prior does not cover the population's support.
    #[error(
        "the fit's prior of q, uniform on [{lo}, {hi}], does not cover the population's support [{from}, {to}]; fit again with a wider \
         range of q, or narrow the family's"
    )]
    NarrowPrior {
        /// Lower end of the fit's prior.
        lo: f64,
        /// Its upper end.
        hi: f64,
        /// Lower end of the population's support.
        from: f64,
        /// Its upper end.
        to: f64,
    },
    /// A draw lies outside the prior that made it.
    #[error(
        "q = {q} is outside the fit's own prior [{lo}, {hi}]; check that draws and prior come from the same run"
    )]
    OutsideOwnPrior {
        /// The draw.
        q: f64,
        /// Lower end of the prior.
        lo: f64,
        /// Its upper end.
        hi: f64,
    },
    /// The weights are not normalised.
    #[error("the weights add up to {sum}; normalise them so that their exponentials add up to 1")]
    WeightSum {
        /// Their sum.
        sum: f64,
    },
    /// The effective size is not a positive number.
    #[error("the effective sample size is {size}; finish the fit, or leave the stream out")]
    EffectiveSize {
        /// The size.
        size: f64,
    },
    /// Another fit has the same track.
    #[error("the track is that of {other} too, and would count twice; give one fit of each track")]
    SameTrack {
        /// Name of the other fit.
        other: String,
    },
    /// The fits do not measure q in the same way.
    #[error(
        "the fit differs from {other} in its {part}, so that the two do not measure one population; fit both with the same {part}"
    )]
    OtherFit {
        /// Name of the other fit.
        other: String,
        /// What differs, as a table of the settings.
        part: &'static str,
    },
    /// No draw lies inside the population's support.
    #[error("no draw of q lies in [{lo}, {hi}]; widen the family's support")]
    OutsideSupport {
        /// Lower end of the support.
        lo: f64,
        /// Its upper end.
        hi: f64,
    },
}
