//! The header of ECSV (astropy's enhanced CSV): YAML in comment lines, read with `saphyr` and written by hand in the
//! small subset that both YAML 1.1 (astropy) and 1.2 read the same way.

use super::header_keys::{Comment, KEYS};
use super::measured::Measured;
use super::observed::ObservedTrack;
use crate::error::{Error, Result, TrackFault};
use crate::track::BinQuantity;
use saphyr::{LoadableYamlNode, Scalar, Yaml};
use saphyr_parser::{Event, Parser};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Largest size of a header in bytes, and its deepest nesting: loaded YAML is cloned and dropped recursively.
const MAX_BYTES: usize = 256 << 10;
const MAX_DEPTH: usize = 32;

/// Longest key, quoted: YAML has no longer ones in one line than 1,024 characters.
const MAX_KEY: usize = 1_000;

/// Bytes of a header beside its `meta`.
const RESERVED: usize = 4 << 10;

/// Maximum number of nodes that a header may have under anchors, counted once for each anchor above them: the loader
/// keeps a copy of each.
const MAX_ANCHORED: usize = 100_000;

/// The contents of a header.
#[derive(Default)]
pub struct Header {
    /// Unit of each column that has one.
    pub units: BTreeMap<String, String>,
    /// The table's `meta`.
    pub meta: BTreeMap<String, Value>,
    /// Delimiter of the body.
    pub delimiter: Option<u8>,
}

/// Parses the comments above the table of an ECSV file, of which the first is `# %ECSV`.
pub fn header(path: &Path, comments: &[Comment]) -> Result<Header> {
    let header: String = comments
        .iter()
        .skip(1)
        .map(|(_, l)| {
            l.strip_prefix("# ")
                .or_else(|| l.strip_prefix('#'))
                .unwrap_or("")
        })
        .flat_map(|l| [l, "\n"])
        .collect();
    // Lines of the YAML, from 1, are comments after the first.
    let fail = |line: usize, message: String| Error::TrackFile {
        path: path.to_path_buf(),
        line: comments.get(line).or(comments.last()).map(|l| l.0),
        fault: TrackFault::Header { message },
    };
    if header.len() > MAX_BYTES {
        let message = format!("longer than {} KiB", MAX_BYTES >> 10);
        return Err(fail(1, message));
    }
    if let Err((line, message)) = bounded(&header) {
        return Err(fail(line, message));
    }
    let documents = Yaml::load_from_str(&header)
        .map_err(|e| fail(e.marker().line(), format!("not YAML: {}", e.info())))?;
    if documents.iter().any(has_compound_key) {
        let message = "a key is a list or a map".to_owned();
        return Err(fail(1, message));
    }
    let Some(Value::Object(top)) = documents.first().map(json) else {
        return Err(fail(1, "it names no columns".to_owned()));
    };
    // Units of ECSV are those of its columns.
    let is_read = |key: &&String| *key != "units" && KEYS.contains(&key.as_str());
    if let Some(key) = top.keys().find(is_read) {
        let line = comments.iter().find(|(_, text)| text.contains(key));
        return Err(Error::TrackFile {
            path: path.to_path_buf(),
            line: line.map(|l| l.0),
            fault: TrackFault::HeaderPlace { key: key.clone() },
        });
    }
    let mut header = Header::default();
    let Some(Value::Array(columns)) = top.get("datatype") else {
        return Err(fail(1, "it has no `datatype` list".to_owned()));
    };
    for column in columns {
        if let (Some(name), Some(unit)) = (
            column.get("name").and_then(Value::as_str),
            column.get("unit").and_then(Value::as_str),
        ) {
            header.units.insert(name.to_owned(), unit.to_owned());
        }
    }
    match top.get("delimiter").and_then(Value::as_str) {
        None => {}
        Some(d) if d == "," || d == " " => header.delimiter = d.bytes().next(),
        Some(d) => return Err(fail(1, format!("its delimiter is {d:?}"))),
    }
    match top.get("meta") {
        Some(Value::Object(map)) => header.meta.extend(map.clone()),
        // `!!omap`: a list of one-entry maps.
        Some(Value::Array(list)) => {
            for entry in list {
                if let Value::Object(map) = entry {
                    header.meta.extend(map.clone());
                }
            }
        }
        _ => {}
    }
    // What is read can be written and read again.
    if header
        .meta
        .iter()
        .any(|(key, value)| is_long(key) || has_long_key(value))
    {
        let message = format!("a key is longer than {MAX_KEY} characters");
        return Err(fail(1, message));
    }
    let written = |(key, value): (&String, &Value)| key_text(key).len() + yaml(value).len() + 8;
    if header.meta.iter().map(written).sum::<usize>() > MAX_BYTES - RESERVED {
        let message = format!("longer than {} KiB", MAX_BYTES >> 10);
        return Err(fail(1, message));
    }
    Ok(header)
}

/// A key as YAML.
fn key_text(key: &str) -> String {
    yaml(&Value::from(key))
}

fn is_long(key: &str) -> bool {
    key_text(key).chars().count() > MAX_KEY
}

fn has_long_key(value: &Value) -> bool {
    match value {
        Value::Array(items) => items.iter().any(has_long_key),
        Value::Object(map) => map
            .iter()
            .any(|(key, value)| is_long(key) || has_long_key(value)),
        _ => false,
    }
}

/// Refuses YAML that is nested too deeply or has too much under anchors, with the line; the loader reports all other
/// faults.
fn bounded(yaml: &str) -> std::result::Result<(), (usize, String)> {
    // Of each collection that is open: its nodes so far, and whether it has an anchor.
    let mut open: Vec<(usize, bool)> = Vec::new();
    let mut anchored = 0;
    for (event, span) in Parser::new_from_str(yaml).map_while(|event| event.ok()) {
        let nodes = match event {
            Event::SequenceStart(anchor, _) | Event::MappingStart(anchor, _) => {
                open.push((1, anchor > 0));
                0
            }
            Event::SequenceEnd | Event::MappingEnd => {
                let (nodes, anchor) = open.pop().unwrap_or_default();
                anchored += if anchor { nodes } else { 0 };
                nodes
            }
            Event::Scalar(..) | Event::Alias(_) => 1,
            _ => 0,
        };
        if let Some((parent, _)) = open.last_mut() {
            *parent += nodes;
        }
        if open.len() > MAX_DEPTH {
            let message = format!("nested more than {MAX_DEPTH} levels deep");
            return Err((span.start.line(), message));
        }
        if anchored > MAX_ANCHORED {
            return Err((span.start.line(), "too much under anchors".to_owned()));
        }
    }
    Ok(())
}

/// Whether a key is a list or a map: written as text inside other such keys, it would double with every level.
fn has_compound_key(node: &Yaml) -> bool {
    let is_compound = |key: &Yaml| match key {
        Yaml::Tagged(_, inner) => matches!(
            **inner,
            Yaml::Sequence(_) | Yaml::Mapping(_) | Yaml::Tagged(..)
        ),
        key => matches!(key, Yaml::Sequence(_) | Yaml::Mapping(_)),
    };
    match node {
        Yaml::Sequence(items) => items.iter().any(has_compound_key),
        Yaml::Mapping(map) => map
            .iter()
            .any(|(k, v)| is_compound(k) || has_compound_key(v)),
        Yaml::Tagged(_, inner) => has_compound_key(inner),
        _ => false,
    }
}

/// A YAML node as JSON; tags are dropped (astropy's quantities become maps with `value` and `unit`).
fn json(node: &Yaml) -> Value {
    match node {
        Yaml::Value(Scalar::Boolean(b)) => Value::from(*b),
        Yaml::Value(Scalar::Integer(i)) => Value::from(*i),
        Yaml::Value(Scalar::FloatingPoint(x)) => Value::from(x.into_inner()),
        Yaml::Value(Scalar::String(s)) => Value::from(s.as_ref()),
        Yaml::Representation(s, ..) => Value::from(s.as_ref()),
        Yaml::Sequence(items) => items.iter().map(json).collect(),
        Yaml::Mapping(map) => Value::Object(
            map.iter()
                .map(|(k, v)| {
                    let key = match json(k) {
                        Value::String(s) => s,
                        other => other.to_string(),
                    };
                    (key, json(v))
                })
                .collect(),
        ),
        Yaml::Tagged(_, inner) => json(inner),
        Yaml::Value(Scalar::Null) | Yaml::Alias(_) | Yaml::BadValue => Value::Null,
    }
}

/// A number of a header with its unit as astropy writes it: a plain number, or a quantity.
pub fn quantity(value: &Value) -> Option<(f64, Option<String>)> {
    let number = value.get("value").unwrap_or(value).as_f64()?;
    let unit = value.get("unit").map(|unit| {
        let text = unit.get("unit").unwrap_or(unit).as_str();
        text.unwrap_or("unknown").to_owned()
    });
    number.is_finite().then_some((number, unit))
}

/// The whole file of a track.
pub fn text(track: &ObservedTrack) -> String {
    let cells = |values: &[f64]| values.iter().map(|x| number(*x)).collect::<Vec<_>>();
    let mut columns = vec![
        ("phi", "deg", cells(&track.phi_deg), "bin centre"),
        ("r", "kpc", cells(&track.r_kpc), "mean projected radius"),
    ];
    if track.assumed_error.is_some() {
        // The header says how the errors follow from r.
    } else if track.has_symmetric_errors() {
        let error = cells(&track.r_err_lo_kpc);
        columns.push(("r_err", "kpc", error, "standard error of r"));
    } else {
        let (lo, hi) = (cells(&track.r_err_lo_kpc), cells(&track.r_err_hi_kpc));
        columns.push(("r_err_lo", "kpc", lo, "standard error towards smaller r"));
        columns.push(("r_err_hi", "kpc", hi, "standard error towards larger r"));
    }
    if let Some(n) = &track.n {
        columns.push(("n", "", cells(n), "stars in the bin"));
    }
    let mut measured = track.measured.clone();
    if !track.stars.is_empty() {
        // Stars have these columns too.
        let none = || vec![None; track.len()];
        measured.entry(BinQuantity::Velocity).or_insert_with(none);
    }
    for (quantity, rows) in &measured {
        let column = quantity.column();
        let [description, of_error] = match quantity {
            BinQuantity::Velocity => [
                "mean line-of-sight velocity relative to the host",
                "standard error of v",
            ],
            BinQuantity::Width => [
                "standard deviation of the projected radii",
                "standard error of width",
            ],
            BinQuantity::Density => ["stars per degree", "standard error of density"],
        };
        let cells = |of: fn(&Measured) -> f64| {
            let cell = |m: &Option<Measured>| m.as_ref().map_or_else(masked, |m| number(of(m)));
            rows.iter().map(cell).collect::<Vec<_>>()
        };
        let (values, errors) = (cells(|m| m.value), cells(|m| m.error));
        columns.push((column.value, column.unit, values, description));
        columns.push((column.error, column.unit, errors, of_error));
    }
    let mut out = String::from("# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n");
    // Writing to a string cannot fail.
    for (name, unit, _, description) in &columns {
        let unit = if unit.is_empty() {
            String::new()
        } else {
            format!("unit: {unit}, ")
        };
        let _ = writeln!(
            out,
            "# - {{name: {name}, {unit}datatype: float64, description: {description}}}"
        );
    }
    let _ = writeln!(out, "# meta:");
    let _ = writeln!(out, "#   name: {}", yaml(&Value::from(track.name.as_str())));
    let _ = writeln!(
        out,
        "#   bin_width: {}",
        yaml(&Value::from(track.bin_width_deg))
    );
    if let Some(assumed) = track.assumed_error {
        let text = Value::from(assumed.to_string());
        let _ = writeln!(out, "#   assume_error: {}", yaml(&text));
    }
    for (key, value) in &track.meta {
        if !["name", "bin_width", "assume_error"].contains(&key.as_str()) {
            let _ = writeln!(out, "#   {}: {}", key_text(key), yaml(value));
        }
    }
    let _ = writeln!(out, "# schema: astropy-2.0");
    let names: Vec<&str> = columns.iter().map(|c| c.0).collect();
    let _ = writeln!(out, "{}", names.join(","));
    for row in 0..track.len() {
        let values: Vec<&str> = columns.iter().map(|c| c.2[row].as_str()).collect();
        let _ = writeln!(out, "{}", values.join(","));
    }
    for star in &track.stars {
        let values: Vec<String> = (names.iter())
            .map(|name| match *name {
                "phi" => number(star.phi_deg),
                "v" => number(star.v_km_s.value),
                "v_err" => number(star.v_km_s.error),
                _ => masked(),
            })
            .collect();
        let _ = writeln!(out, "{}", values.join(","));
    }
    out
}

/// What astropy writes for a masked value: a quoted empty text.
fn masked() -> String {
    "\"\"".to_owned()
}

/// A number, exact to the bit and short: no zeros before or after hundreds of others.
fn number(x: f64) -> String {
    if x == 0.0 || (1e-5..1e15).contains(&x.abs()) {
        x.to_string()
    } else {
        format!("{x:e}")
    }
}

/// A value in YAML's flow style.
fn yaml(value: &Value) -> String {
    match value {
        // YAML 1.1 takes a float only with a point, and an exponent only with its sign.
        Value::Number(n) if n.is_f64() => {
            let text = n.to_string();
            let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, ""));
            let point = if mantissa.contains('.') { "" } else { ".0" };
            let sign = if exponent.is_empty() || exponent.starts_with(['-', '+']) {
                ""
            } else {
                "+"
            };
            let e = if exponent.is_empty() { "" } else { "e" };
            format!("{mantissa}{point}{e}{sign}{exponent}")
        }
        Value::Array(items) => {
            format!(
                "[{}]",
                items.iter().map(yaml).collect::<Vec<_>>().join(", ")
            )
        }
        Value::Object(map) => {
            let entries: Vec<String> = map
                .iter()
                .map(|(k, v)| format!("{}: {}", key_text(k), yaml(v)))
                .collect();
            format!("{{{}}}", entries.join(", "))
        }
        plain => plain.to_string(),
    }
}

impl ObservedTrack {
    /// The text of the file that [`write`](Self::write) writes.
    #[must_use]
    pub fn to_ecsv(&self) -> String {
        text(self)
    }

    /// Writes ECSV that astropy and [`ObservedTrack::read`] read back, floats exact to the bit. The file is written
    /// completely or not at all, and replaces an old one.
    ///
    /// # Errors
    /// [`Error::Sampler`] with the file's name if it cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        oblate_samplers::files::write_atomically(path, text(self).as_bytes())?;
        Ok(())
    }
}
