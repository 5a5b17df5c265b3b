//! The prior of the parameters: the table of defaults, settings that change or fix any of them, and the map from the free
//! parameters, which a sampler varies, to all, which the model needs.

use super::layout::{DIM, PARAMETERS, Parameter, REQUIRED, StreamParams, index_of};
use super::shape::{AXIS_RATIOS, QPrior, QRange, Shape};
use crate::error::{Error, Rejection, Result};
use crate::scalar::{Real, Scalar};
use oblate_samplers::limits::in_range;
use oblate_samplers::rng::{RandomStream, unit_open};
use oblate_samplers::{Marginal, Prior};
use serde::{Deserialize, Deserializer, Serialize};

/// Standard deviation of the progenitor's position per component, kpc.
const POSITION_SD_KPC: f64 = 150.0;
/// Standard deviation of the progenitor's velocity per component, km/s.
const VELOCITY_SD_KM_S: f64 = 250.0;

/// The components of the shape vector.
const SHAPE_VECTOR: [&str; 3] = ["dir_x", "dir_y", "dir_z"];

const fn uniform(lo: f64, hi: f64) -> Marginal {
    Marginal::Uniform { lo, hi }
}

const fn normal(sd: f64) -> Marginal {
    Marginal::Normal { mean: 0.0, sd }
}

const fn half_normal(sd: f64) -> Marginal {
    Marginal::HalfNormal { sd }
}

/// The prior of Chemaly et al. (2026), table 1. The half-normals select one of several equivalent configurations: the sign
/// of the halo's axis (`dir_z`), the direction of the sky's x axis (`x0_kpc`), the near or the far side of the halo
/// (`z0_kpc`), and the sense of the orbit (`vy0_km_s`). Optional parameters are absent.
fn default_marginals() -> StreamParams<Option<Marginal>> {
    StreamParams {
        log10_m_halo: Some(uniform(11.0, 14.0)),
        r_s_halo_kpc: Some(uniform(10.0, 25.0)),
        dir_x: Some(normal(1.0)),
        dir_y: Some(normal(1.0)),
        dir_z: Some(half_normal(1.0)),
        log10_m_prog: Some(uniform(7.0, 9.0)),
        r_s_prog_kpc: Some(uniform(1.0, 5.0)),
        x0_kpc: Some(half_normal(POSITION_SD_KPC)),
        z0_kpc: Some(half_normal(POSITION_SD_KPC)),
        vx0_km_s: Some(normal(VELOCITY_SD_KM_S)),
        vy0_km_s: Some(half_normal(VELOCITY_SD_KM_S)),
        vz0_km_s: Some(normal(VELOCITY_SD_KM_S)),
        age_gyr: Some(uniform(1.0, 4.0)),
        ..StreamParams::default()
    }
}

/// Parameters that change their sign if the sky is mirrored at its x axis and the orbit still turns counter-clockwise.
const MIRRORED: [&str; 5] = [
    "dir_y",
    "phi0_deg",
    "inclination_disc_deg",
    "phi_disc_deg",
    "psi_halo_deg",
];

/// Parameters that must not be negative.
const NOT_NEGATIVE: [&str; 11] = [
    "r_s_halo_kpc",
    "r_s_prog_kpc",
    "age_gyr",
    "jitter",
    "r_disc_kpc",
    "r_bulge_kpc",
    "p_halo",
    "m_prog_left",
    "dissolved_at",
    "release_peaking",
    "coulomb_logarithm",
];

/// The prior as the user writes it. Every key may be left out.
///
/// ```toml
/// q_min = 0.6
/// marginals.age_gyr = { kind = "uniform", lo = 2.0, hi = 3.0 }
/// fixed.r_s_halo_kpc = 15.0
/// ```
///
/// An optional parameter is present if it has a distribution or a fixed value here, and absent otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PriorSettings {
    /// q of a shape vector of length zero; 0.5.
    pub q_min: f64,
    /// q of an infinitely long shape vector; 1.5.
    pub q_max: f64,
    /// The distribution of each parameter while it is free; one that is left out keeps its default, which an optional parameter has not.
    #[serde(deserialize_with = "over_the_defaults")]
    pub marginals: StreamParams<Option<Marginal>>,
    /// Values of the parameters that are fixed.
    pub fixed: StreamParams<Option<f64>>,
}

impl Default for PriorSettings {
    fn default() -> Self {
        let QRange { q_min, q_max } = QRange::default();
        Self {
            q_min,
            q_max,
            marginals: default_marginals(),
            fixed: StreamParams::default(),
        }
    }
}

/// Reads the marginals that are given and takes the others from the table.
fn over_the_defaults<'de, D: Deserializer<'de>>(
    source: D,
) -> std::result::Result<StreamParams<Option<Marginal>>, D::Error> {
    let given = StreamParams::<Option<Marginal>>::deserialize(source)?.to_array();
    let table = default_marginals().to_array();
    Ok(StreamParams::from_array(std::array::from_fn(|i| {
        given[i].or(table[i])
    })))
}

impl PriorSettings {
    /// Checks every number by itself, those of marginals of fixed parameters too: the ranges of docs/limits.md. Checks then that marginals
    /// are distributions, not negative where the model needs it, and that `q_min` is below `q_max`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] or [`Error::Setting`] with the first key that is at fault.
    pub fn check(&self) -> Result<()> {
        in_range("prior.q_min", self.q_min, AXIS_RATIOS)?;
        in_range("prior.q_max", self.q_max, AXIS_RATIOS)?;
        if self.q_min >= self.q_max {
            return Err(Error::Setting {
                key: "prior.q_max".to_owned(),
                value: self.q_max.to_string(),
                remedy: "give a number above q_min".to_owned(),
            });
        }
        let (marginals, fixed) = (self.marginals.to_array(), self.fixed.to_array());
        for (i, parameter) in PARAMETERS.iter().enumerate() {
            let Parameter { name, range, .. } = parameter;
            match &marginals[i] {
                Some(marginal) => {
                    marginal.check_range(&format!("prior.marginals.{name}"), range)?;
                    check_marginal(name, marginal)?;
                }
                None if parameter.absent.is_none() => {
                    return Err(Error::Setting {
                        key: format!("prior.marginals.{name}"),
                        value: "none".to_owned(),
                        remedy: "give a distribution: every stream has this parameter".to_owned(),
                    });
                }
                None => {}
            }
            let Some(value) = fixed[i] else {
                continue;
            };
            let key = format!("prior.fixed.{name}");
            in_range(&key, value, range.clone())?;
            let (lo, hi) = marginals[i].map_or((value, value), |marginal| marginal.support());
            if value < lo || value > hi {
                return Err(Error::Setting {
                    key,
                    value: value.to_string(),
                    remedy: format!(
                        "its prior has values from {lo} to {hi}: give one of these, or widen prior.marginals.{name}"
                    ),
                });
            }
        }
        Ok(())
    }

    /// The same prior for the track of the other sense, whose phi has the opposite sign: the parameters that a mirrored sky changes,
    /// `dir_y`, `phi0_deg`, the angles of a disc and that of a second axis, have the opposite sign in their distributions and fixed values.
    ///
    /// # Errors
    /// [`Error::Setting`] if `vy0_km_s` may be negative, so that orbits of both senses are in the prior already, and for a half-normal
    /// distribution of a parameter that changes its sign.
    pub fn mirrored(&self) -> Result<Self> {
        if let Some(vy) = self.marginals.vy0_km_s.filter(|vy| vy.support().0 < 0.0) {
            return Err(Error::Setting {
                key: "prior.marginals.vy0_km_s".to_owned(),
                value: format!("values from {}", vy.support().0),
                remedy: "give a distribution without negative values: with them the orbit turns in both senses already".to_owned(),
            });
        }
        let mut mirrored = *self;
        for name in MIRRORED {
            let Some(i) = index_of(name) else { continue };
            if let Some(marginal) = mirrored.marginals.get_mut(i) {
                *marginal = marginal.map(|m| opposite(name, m)).transpose()?;
            }
            if let Some(fixed) = mirrored.fixed.get_mut(i) {
                *fixed = fixed.map(|value| 0.0 - value);
            }
        }
        Ok(mirrored)
    }

    /// The same prior for parameter sets that have all parameters which every stream has: none of these is fixed.
    #[must_use]
    pub fn with_required_free(&self) -> Self {
        let mut free = *self;
        for i in 0..REQUIRED {
            if let Some(fixed) = free.fixed.get_mut(i) {
                *fixed = None;
            }
        }
        free
    }

    /// The same prior with the optional parameters of a stream that it does not have, fixed at the values of the stream.
    #[must_use]
    pub fn with_optional_of(&self, stream: &StreamParams<Option<f64>>) -> Self {
        let (marginals, values) = (self.marginals.to_array(), stream.to_array());
        let mut with = *self;
        for i in REQUIRED..DIM {
            if let (None, Some(fixed @ None)) = (marginals[i], with.fixed.get_mut(i)) {
                *fixed = values[i];
            }
        }
        with
    }

    /// Fixes one parameter by its name.
    ///
    /// # Errors
    /// [`Error::Setting`] if there is no such parameter.
    pub fn fix(&mut self, name: &str, value: f64) -> Result<()> {
        let slot = index_of(name).and_then(|i| self.fixed.get_mut(i));
        match slot {
            Some(slot) => {
                *slot = Some(value);
                Ok(())
            }
            None => Err(Error::Setting {
                key: format!("prior.fixed.{name}"),
                value: value.to_string(),
                remedy: format!(
                    "there is no such parameter; the names are {}",
                    super::NAMES.join(", ")
                ),
            }),
        }
    }
}

/// The prior, checked: which parameters are present and which of them free, their distributions, and the values of the fixed ones.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamPrior {
    settings: PriorSettings,
    /// Indices of the free parameters in [`PARAMETERS`], in order.
    free: Vec<usize>,
    /// Indices of the free and the fixed parameters, in order.
    present: Vec<usize>,
    /// Values of the fixed and the absent parameters; NaN, and unused, at the indices of the free ones.
    fixed: [f64; DIM],
    prior: Prior,
}

impl StreamPrior {
    /// Checks the settings and builds the product prior of the free parameters.
    ///
    /// # Errors
    /// Those of [`PriorSettings::check`]; [`Error::Setting`] if no parameter is free.
    pub fn new(settings: &PriorSettings) -> Result<Self> {
        settings.check()?;
        let marginals = settings.marginals.to_array();
        let fixed = settings.fixed.to_array();
        let distributions: Vec<(usize, Marginal)> = (0..DIM)
            .filter(|&i| fixed[i].is_none())
            .filter_map(|i| Some((i, marginals[i]?)))
            .collect();
        let free: Vec<usize> = distributions.iter().map(|(i, _)| *i).collect();
        let present = (0..DIM)
            .filter(|&i| fixed[i].is_some() || marginals[i].is_some())
            .collect();
        let fixed = std::array::from_fn(|i| {
            let absent = PARAMETERS[i].absent.filter(|_| marginals[i].is_none());
            fixed[i].or(absent).unwrap_or(f64::NAN)
        });
        if free.is_empty() {
            return Err(Error::Setting {
                key: "prior.fixed".to_owned(),
                value: "all parameters".to_owned(),
                remedy: "leave at least one parameter free".to_owned(),
            });
        }
        let prior = Prior::new(
            distributions
                .into_iter()
                .map(|(i, marginal)| (PARAMETERS[i].name, PARAMETERS[i].unit, marginal)),
        )?;
        Ok(Self {
            settings: *settings,
            free,
            present,
            fixed,
            prior,
        })
    }

    /// The settings it was built from.
    #[must_use]
    pub fn settings(&self) -> &PriorSettings {
        &self.settings
    }

    /// Checks that the progenitor may be on either side of the host, where the data or the model tell the near one from the far one. `reason`
    /// says what does, with its verb.
    ///
    /// # Errors
    /// [`Error::Setting`] if its distance has the default prior, which is that of a galaxy and a track without sides.
    pub fn check_both_sides(&self, reason: &str) -> Result<()> {
        let remedy = format!(
            "{reason} the near side of the galaxy from the far one, so that the progenitor may be on either: give a normal \
             distribution, such as {{ kind = \"normal\", mean = 0, sd = 150 }}"
        );
        self.check_not_default("z0_kpc", "the half-normal default", &remedy)
    }

    /// Checks that the progenitor may be on either side, unless the prior stays as it is if the near side is exchanged with the far one: then
    /// one of them is enough.
    ///
    /// # Errors
    /// [`Error::Setting`] by [`check_both_sides`](Self::check_both_sides).
    pub fn check_sides(&self) -> Result<()> {
        let tells = |names: &str| {
            self.check_both_sides(&format!(
                "what is known of {names}, neither 0 nor symmetric about 0, tells"
            ))
        };
        // The mirror at the sky turns dir_z, vz0 and z0 around, and an axis is the same as its opposite. The angle of a second axis counts from
        // the first one, whose opposite has another.
        let in_depth = self.is_even("dir_z") && !self.has("psi_halo_deg");
        let on_the_sky = self.is_even("dir_x") && self.is_even("dir_y");
        if !(in_depth || on_the_sky) {
            tells("the halo's axis, `dir_x` and `dir_y`,")?;
        }
        if !self.is_even("vz0_km_s") {
            tells("`vz0_km_s`")?;
        }
        Ok(())
    }

    /// Whether a parameter is as probable as its opposite: its distribution is symmetric about 0, or it is fixed at 0 or absent.
    #[must_use]
    pub fn is_even(&self, name: &str) -> bool {
        let Some(index) = index_of(name).filter(|_| self.has(name)) else {
            return true;
        };
        let centre = match self.settings.marginals.to_array()[index] {
            Some(Marginal::Normal { mean, .. }) if self.free.contains(&index) => mean,
            Some(Marginal::Uniform { lo, hi }) if self.free.contains(&index) => lo + hi,
            Some(Marginal::HalfNormal { .. }) if self.free.contains(&index) => return false,
            _ => self.fixed[index],
        };
        centre.abs() <= 0.0
    }

    /// Checks that a parameter of every stream is fixed or has another distribution than the default, which `value` names in the message.
    ///
    /// # Errors
    /// [`Error::Setting`] with this remedy if it has the default.
    pub fn check_not_default(&self, name: &str, value: &str, remedy: &str) -> Result<()> {
        let has_default = |index: usize| {
            let own = self.settings.marginals.to_array()[index];
            self.free.contains(&index) && own == default_marginals().to_array()[index]
        };
        if !index_of(name).is_some_and(has_default) {
            return Ok(());
        }
        Err(Error::Setting {
            key: format!("prior.marginals.{name}"),
            value: value.to_owned(),
            remedy: remedy.to_owned(),
        })
    }

    /// The product prior of the free parameters, with names and units.
    #[must_use]
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// The indices of the free parameters in [`PARAMETERS`], in the order of [`prior`](Self::prior).
    #[must_use]
    pub fn free(&self) -> &[usize] {
        &self.free
    }

    /// The indices in [`PARAMETERS`] of the parameters that are present, free or fixed, in order.
    #[must_use]
    pub fn present(&self) -> &[usize] {
        &self.present
    }

    /// Checks that a parameter is present if `part`, which it belongs to, is there, and absent otherwise. `example` is a distribution of it.
    ///
    /// # Errors
    /// [`Error::Setting`] if it lacks a value or a distribution, or has one in vain.
    pub fn check_belongs(
        &self,
        name: &str,
        is_there: bool,
        part: &str,
        example: Option<&str>,
    ) -> Result<()> {
        if self.has(name) == is_there {
            return Ok(());
        }
        let such_as = example.map_or_else(String::new, |example| format!(", such as {example},"));
        let (value, remedy) = if is_there {
            let remedy = format!(
                "give a distribution{such_as} or a value by prior.fixed.{name}: {part} has this parameter"
            );
            ("none", remedy)
        } else {
            let remedy = format!("leave {name} out, or give {part}, which it belongs to");
            ("given", remedy)
        };
        Err(Error::Setting {
            key: format!("prior.marginals.{name}"),
            value: value.to_owned(),
            remedy,
        })
    }

    /// Whether a parameter is present, free or fixed.
    #[must_use]
    pub fn has(&self, name: &str) -> bool {
        index_of(name).is_some_and(|index| self.present.contains(&index))
    }

    /// The indices in [`PARAMETERS`] of the free optional parameters, in order: the last ones of [`free`](Self::free).
    #[must_use]
    pub fn free_optional(&self) -> &[usize] {
        let first = self.free.partition_point(|&i| i < REQUIRED);
        &self.free[first..]
    }

    /// The index of a parameter among the free ones; `None` if it is fixed, absent or unknown.
    #[must_use]
    pub fn free_index(&self, name: &str) -> Option<usize> {
        let index = index_of(name)?;
        self.free.iter().position(|&i| i == index)
    }

    /// All parameters from the free ones, in the order of [`free`](Self::free).
    pub fn fill<S: Scalar>(&self, theta: &[S]) -> StreamParams<S> {
        let mut all = self.fixed.map(S::from_f64);
        for (&place, &value) in self.free.iter().zip(theta) {
            all[place] = value;
        }
        StreamParams::from_array(all)
    }

    /// The range of q.
    #[must_use]
    pub fn q_range(&self) -> QRange {
        QRange {
            q_min: self.settings.q_min,
            q_max: self.settings.q_max,
        }
    }

    /// Flattening and axis of the halo at given parameters.
    pub fn shape<S: Real>(&self, params: &StreamParams<S>) -> Shape<S> {
        self.q_range().shape(params.dir())
    }

    /// The prior of q that follows from these settings: uniform as long as the shape vector is free and its three
    /// marginals are standard normals (or their positive halves).
    #[must_use]
    pub fn q_prior(&self) -> QPrior {
        let standard = SHAPE_VECTOR.iter().all(|name| {
            self.free_index(name).is_some_and(|i| {
                let m = self.prior.marginals()[i];
                m == normal(1.0) || m == half_normal(1.0)
            })
        });
        if standard {
            QPrior::Uniform {
                lo: self.settings.q_min,
                hi: self.settings.q_max,
            }
        } else {
            QPrior::Unknown
        }
    }

    /// Whether the prior of the halo's axes, without their signs, is isotropic: q is uniform, at most one component of the shape vector is known to be
    /// positive, and a second axis has any angle around the first.
    #[must_use]
    pub fn axis_is_isotropic(&self) -> bool {
        let positive = (SHAPE_VECTOR.iter())
            .filter_map(|name| self.free_index(name))
            .filter(|&i| self.prior.marginals()[i] == half_normal(1.0));
        positive.count() <= 1 && self.angle_to_line_of_sight_is_isotropic()
    }

    /// Whether the prior of the angles between the halo's axes and the line of sight is that of isotropic axes. More components of the shape vector may
    /// be known to be positive.
    #[must_use]
    pub fn angle_to_line_of_sight_is_isotropic(&self) -> bool {
        let any_angle = || match self.free_index("psi_halo_deg") {
            Some(i) => match self.prior.marginals()[i] {
                // An axis has no sign: half a turn has all of them.
                Marginal::Uniform { lo, hi } => ((hi - lo) / 180.0).fract().abs() < 1e-12,
                _ => false,
            },
            None => !self.has("psi_halo_deg"),
        };
        self.q_prior() != QPrior::Unknown && any_angle()
    }

    /// One draw of the prior, all parameters.
    pub fn draw(&self, rng: &mut RandomStream) -> StreamParams<f64> {
        let u: Vec<f64> = self.free.iter().map(|_| unit_open(rng)).collect();
        let mut theta = vec![0.0; u.len()];
        self.prior.theta_from_u(&u, &mut theta);
        self.fill(&theta)
    }

    /// Checks that parameters lie inside the prior, and that fixed and absent ones have their values.
    ///
    /// # Errors
    /// [`Error::OutsidePrior`] with the name and the bounds of the first that does not (NaN and infinities never do);
    /// [`Error::Setting`] for a fixed or absent parameter with another value.
    pub fn check_inside(&self, params: &StreamParams<f64>) -> Result<()> {
        let mut marginals = self.free.iter().zip(self.prior.marginals()).peekable();
        for (i, value) in params.to_array().into_iter().enumerate() {
            let Some((_, marginal)) = marginals.next_if(|(place, _)| **place == i) else {
                self.check_fixed(i, value)?;
                continue;
            };
            let (lo, hi) = marginal.support();
            if !(value.is_finite() && value >= lo && value <= hi) {
                return Err(Error::OutsidePrior {
                    name: PARAMETERS[i].name.to_owned(),
                    value,
                    lo,
                    hi,
                });
            }
        }
        Ok(())
    }

    /// Whether the free parameters lie inside the prior, its bounds included.
    ///
    /// # Errors
    /// [`Rejection::BadParameter`] if one of them is NaN or infinite, [`Rejection::OutsidePrior`] if one lies outside its bounds.
    pub fn check_point(&self, params: &StreamParams<f64>) -> std::result::Result<(), Rejection> {
        let free = self.free_values(&params.to_array());
        if !free.iter().all(|value| value.is_finite()) {
            return Err(Rejection::BadParameter);
        }
        let mut pairs = free.iter().zip(self.prior.marginals());
        let inside = pairs.all(|(value, marginal)| {
            let (lo, hi) = marginal.support();
            (lo..=hi).contains(value)
        });
        if inside {
            Ok(())
        } else {
            Err(Rejection::OutsidePrior)
        }
    }

    /// All parameters from those that are given: fixed and absent ones may be left out.
    ///
    /// # Errors
    /// [`Error::Setting`] for a free parameter that is left out, or a fixed or absent one with another value.
    pub fn complete(&self, given: &StreamParams<Option<f64>>) -> Result<StreamParams<f64>> {
        let mut all = self.fixed;
        for (i, value) in given.to_array().into_iter().enumerate() {
            let name = PARAMETERS[i].name;
            let is_free = self.free.contains(&i);
            match value {
                Some(value) if is_free => all[i] = value,
                Some(value) => self.check_fixed(i, value)?,
                None if is_free => {
                    return Err(Error::Setting {
                        key: name.to_owned(),
                        value: "missing".to_owned(),
                        remedy: "give a value, because it is not fixed".to_owned(),
                    });
                }
                None => {}
            }
        }
        Ok(StreamParams::from_array(all))
    }

    /// The values of the free parameters among all, in the order of [`free`](Self::free).
    #[must_use]
    pub fn free_values(&self, all: &[f64; DIM]) -> Vec<f64> {
        self.free.iter().map(|&place| all[place]).collect()
    }

    /// # Errors
    /// [`Error::Setting`] if a fixed or absent parameter has another value than its own.
    fn check_fixed(&self, index: usize, value: f64) -> Result<()> {
        let own = self.fixed[index];
        if value.total_cmp(&own).is_eq() {
            return Ok(());
        }
        let name = PARAMETERS[index].name;
        Err(Error::Setting {
            key: name.to_owned(),
            value: value.to_string(),
            remedy: if self.present.contains(&index) {
                format!("it is fixed at {own}; give this value, or free the parameter")
            } else {
                format!(
                    "it is absent; leave it out, or give it a prior by `prior.marginals.{name}`"
                )
            },
        })
    }
}

/// The distribution of a parameter with the opposite sign.
fn opposite(name: &str, marginal: Marginal) -> Result<Marginal> {
    match marginal {
        Marginal::Uniform { lo, hi } => Ok(uniform(0.0 - hi, 0.0 - lo)),
        Marginal::Normal { mean, sd } => Ok(Marginal::Normal {
            mean: 0.0 - mean,
            sd,
        }),
        Marginal::HalfNormal { .. } => Err(Error::Setting {
            key: format!("prior.marginals.{name}"),
            value: format!("{marginal:?}"),
            remedy: "the opposite sense has the opposite sign of this parameter: give a uniform or a normal".to_owned(),
        }),
    }
}

fn check_marginal(name: &str, marginal: &Marginal) -> Result<()> {
    let remedy = if !marginal.is_valid() {
        "give finite numbers with lo < hi, and standard deviations above zero"
    } else if NOT_NEGATIVE.contains(&name) && marginal.support().0 < 0.0 {
        "this parameter must not be negative: give a uniform or a half_normal"
    } else {
        return Ok(());
    };
    Err(Error::Setting {
        key: format!("prior.marginals.{name}"),
        value: format!("{marginal:?}"),
        remedy: remedy.to_owned(),
    })
}
