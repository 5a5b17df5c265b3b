//! What a user may set of a boost.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// Settings of [`boost::run`](super::run).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Independent draws of the mixture, one likelihood call each.
    pub draws: usize,
    /// Most components of the mixture; powers of 2 up to it are tried.
    pub max_components: usize,
    /// Share of the draws that come from the prior: it bounds the weights where the mixture has no tails.
    pub prior_share: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            draws: 40_000,
            max_components: 64,
            prior_share: 0.05,
        }
    }
}

impl Settings {
    /// Whether a boost can work with these numbers.
    ///
    /// # Errors
    /// [`Error::Setting`] names the first one that is out of its range.
    pub fn check(&self) -> Result<()> {
        let refuse = |name, value: String, remedy| {
            Err(Error::Setting {
                name,
                value,
                remedy,
            })
        };
        if self.draws < 1_000 {
            return refuse(
                "draws",
                self.draws.to_string(),
                "give at least 1,000, better 40,000",
            );
        }
        if self.max_components == 0 {
            return refuse("max_components", "0".to_owned(), "give at least 1");
        }
        if !(self.prior_share > 0.0 && self.prior_share < 1.0) {
            return refuse(
                "prior_share",
                self.prior_share.to_string(),
                "give a small share above 0, as 0.05",
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_refused_by_name() {
        let name = |change: &dyn Fn(&mut Settings)| {
            let mut settings = Settings::default();
            change(&mut settings);
            match settings.check() {
                Err(Error::Setting { name, .. }) => name,
                other => panic!("{other:?}"),
            }
        };
        assert!(Settings::default().check().is_ok());
        assert_eq!(name(&|s| s.draws = 10), "draws");
        assert_eq!(name(&|s| s.max_components = 0), "max_components");
        assert_eq!(name(&|s| s.prior_share = f64::NAN), "prior_share");
    }
}
