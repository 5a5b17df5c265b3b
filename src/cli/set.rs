//! The flag that changes any setting.

use crate::config::with_value;
use crate::error::Result;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// A flag for settings that have none of their own.
#[derive(clap::Args, Debug, Default)]
pub struct SetFlags {
    /// Change one setting, such as `sampling.nested.steps=32`; it overrides the settings file and the other flags, and may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = assignment)]
    changes: Vec<(String, String)>,
}

fn assignment(text: &str) -> std::result::Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => {
            Ok((key.trim().to_owned(), value.trim().to_owned()))
        }
        _ => Err("give a key and a value, such as sampling.nested.steps=32".to_owned()),
    }
}

impl SetFlags {
    /// Applies the changes in their order.
    ///
    /// # Errors
    /// As of [`with_value`].
    pub fn apply<T: Serialize + DeserializeOwned>(&self, settings: &mut T) -> Result<()> {
        for (key, value) in &self.changes {
            *settings = with_value(settings, key, value)?;
        }
        Ok(())
    }
}
