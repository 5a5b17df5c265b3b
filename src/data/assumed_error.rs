//! A standard error that the user states for all radii of a track without errors, in per cent of the radius: `2%`.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Errors that may be assumed, per cent of the radius.
const PERCENT: RangeInclusive<f64> = 1e-3..=100.0;

/// A standard error in per cent of each radius. Its text is a number with a sign, `2%`, so that it is not taken for a fraction.
///
/// ```
/// use oblate::data::AssumedError;
/// let assumed: AssumedError = "2%".parse()?;
/// assert_eq!(assumed.of(60.0), 1.2);
/// assert_eq!(assumed.to_string(), "2%");
/// assert!("0.02".parse::<AssumedError>().is_err());
/// # Ok::<(), oblate::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct AssumedError {
    percent: f64,
}

impl AssumedError {
    /// The error of a radius, in its unit.
    #[must_use]
    pub fn of(self, r: f64) -> f64 {
        self.percent / 100.0 * r
    }
}

impl FromStr for AssumedError {
    type Err = Error;

    /// # Errors
    /// [`Error::Setting`] for anything but a number from 0.001 to 100 with a per cent sign.
    fn from_str(text: &str) -> Result<Self> {
        let number = text.trim().strip_suffix('%').map(str::trim_end);
        match number.map(str::parse::<f64>) {
            Some(Ok(percent)) if PERCENT.contains(&percent) => Ok(Self { percent }),
            _ => Err(Error::Setting {
                key: "assume_error".to_owned(),
                value: text.to_owned(),
                remedy: format!(
                    "give per cent of the radius with the sign, from {}% to {}%, such as 2%",
                    PERCENT.start(),
                    PERCENT.end()
                ),
            }),
        }
    }
}

impl fmt::Display for AssumedError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}%", self.percent)
    }
}

impl TryFrom<String> for AssumedError {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

impl From<AssumedError> for String {
    fn from(assumed: AssumedError) -> Self {
        assumed.to_string()
    }
}
