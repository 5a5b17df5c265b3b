//! Numbers in JSON, which has neither NaN nor infinities: these are written as the strings `"nan"`, `"inf"` and
//! `"-inf"`, so that a failed check keeps its value. Finite numbers are exact to the bit.

use serde::de::Error as _;
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;

/// A number that may be NaN or infinite.
#[derive(Clone, Copy, Debug)]
struct Number(f64);

impl Serialize for Number {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            x if x.is_finite() => serializer.serialize_f64(x),
            x if x.is_nan() => serializer.serialize_str("nan"),
            x if x > 0.0 => serializer.serialize_str("inf"),
            _ => serializer.serialize_str("-inf"),
        }
    }
}

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Form {
            Number(f64),
            Word(String),
        }
        match Form::deserialize(deserializer)? {
            Form::Number(x) => Ok(Self(x)),
            Form::Word(word) => match word.as_str() {
                "nan" => Ok(Self(f64::NAN)),
                "inf" => Ok(Self(f64::INFINITY)),
                "-inf" => Ok(Self(f64::NEG_INFINITY)),
                _ => Err(D::Error::custom(format!("{word:?} is not a number"))),
            },
        }
    }
}

/// For `#[serde(with)]` on an `f64`.
pub mod number {
    use super::*;

    /// Writes one number.
    ///
    /// # Errors
    /// Those of the serializer.
    #[allow(
        clippy::trivially_copy_pass_by_ref,
        reason = "the signature that serde asks for"
    )]
    pub fn serialize<S: Serializer>(x: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        Number(*x).serialize(serializer)
    }

    /// Reads one number.
    ///
    /// # Errors
    /// Those of the deserializer, and for a string that is no number.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Number::deserialize(deserializer).map(|n| n.0)
    }
}

/// For `#[serde(with)]` on a list of numbers.
pub mod list {
    use super::*;

    /// Writes a list.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer>(xs: &[f64], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(xs.iter().map(|x| Number(*x)))
    }

    /// Reads a list.
    ///
    /// # Errors
    /// As for one number.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
        Ok(Vec::<Number>::deserialize(deserializer)?
            .into_iter()
            .map(|n| n.0)
            .collect())
    }
}

/// For `#[serde(with)]` on numbers by name.
pub mod map {
    use super::*;

    /// Writes a map.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer>(
        map: &BTreeMap<String, f64>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        serializer.collect_map(map.iter().map(|(k, x)| (k, Number(*x))))
    }

    /// Reads a map.
    ///
    /// # Errors
    /// As for one number.
    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<BTreeMap<String, f64>, D::Error> {
        Ok(BTreeMap::<String, Number>::deserialize(deserializer)?
            .into_iter()
            .map(|(k, n)| (k, n.0))
            .collect())
    }
}

/// For `#[serde(with)]` on a list of (name, value) pairs that is a JSON object in that order.
pub mod ordered {
    use super::*;
    use serde::de::{MapAccess, Visitor};
    use std::marker::PhantomData;

    /// Writes the pairs as an object.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer, T: Serialize>(
        pairs: &[(String, T)],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(pairs.len()))?;
        for (name, value) in pairs {
            map.serialize_entry(name, value)?;
        }
        map.end()
    }

    /// Reads an object into pairs, in its order.
    ///
    /// # Errors
    /// Those of the deserializer.
    pub fn deserialize<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
        deserializer: D,
    ) -> Result<Vec<(String, T)>, D::Error> {
        struct Pairs<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Pairs<T> {
            type Value = Vec<(String, T)>;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut pairs = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    pairs.push(entry);
                }
                Ok(pairs)
            }
        }
        deserializer.deserialize_map(Pairs(PhantomData))
    }
}

/// For `#[serde(with)]` on a list of convergence checks, whose values may be NaN or infinite.
pub mod checks {
    use super::*;
    use oblate_samplers::output::Check;

    /// The fields of a [`Check`] as they are written.
    #[derive(Serialize, Deserialize)]
    #[serde(remote = "Check")]
    struct CheckFields {
        name: String,
        #[serde(with = "super::number")]
        value: f64,
        #[serde(with = "super::number")]
        limit: f64,
        pass: bool,
        message: String,
    }

    #[derive(Serialize, Deserialize)]
    struct Row(#[serde(with = "CheckFields")] Check);

    /// Writes the checks.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer>(checks: &[Check], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(checks.iter().cloned().map(Row))
    }

    /// Reads the checks.
    ///
    /// # Errors
    /// Those of the deserializer.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Check>, D::Error> {
        let rows = Vec::<Row>::deserialize(deserializer)?;
        Ok(rows.into_iter().map(|row| row.0).collect())
    }
}
