//! Damage to valid inputs: of bytes, of numbers in a text, and of values in a tree.

use oblate_samplers::rng::{RandomStream, below};
use rand::Rng;
use serde_json::{Value, json};

/// Numbers and texts that readers do not expect.
const NASTY: [&str; 28] = [
    "nan",
    "inf",
    "-inf",
    "1e999",
    "-1e308",
    "1e308",
    "1e-320",
    "-0.0",
    "0",
    "-1",
    "1e10",
    "1e300",
    "18446744073709551615",
    "18446744073709551616",
    "9223372036854775807",
    "-9223372036854775808",
    "4294967296",
    "0x1p3",
    "",
    "null",
    "true",
    "\"",
    "\u{0}",
    "\u{feff}",
    "../../x",
    "*a",
    "&a [x]",
    "\u{1f30c}",
];

/// Bytes with a meaning in some format.
const BYTES: &[u8] = b"\x00\x01\x7f\x80\xff\n\r\t ,:;\"'[]{}#-&*!|>%@`.eE+0123456789aZ";

/// One of a list.
pub fn one<'a, T: ?Sized>(rng: &mut RandomStream, list: &[&'a T]) -> &'a T {
    list[below(rng, list.len())]
}

/// A number that is not an ordinary one.
pub fn nasty_float(rng: &mut RandomStream) -> f64 {
    const ALL: [f64; 16] = [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        f64::MIN,
        f64::MIN_POSITIVE,
        5e-324,
        0.0,
        -0.0,
        1.0,
        -1.0,
        1e17,
        -1e17,
        1e300,
        0.5,
        1e-300,
    ];
    match below(rng, 4) {
        0 => f64::from_bits(rng.next_u64()),
        _ => ALL[below(rng, ALL.len())],
    }
}

/// How many places are damaged: mostly one, at most four.
pub fn places(rng: &mut RandomStream) -> usize {
    let most = [1, 1, 4][below(rng, 3)];
    1 + below(rng, most)
}

/// Damages bytes in one to four places; `other` is another valid input, from which parts are taken.
pub fn bytes(rng: &mut RandomStream, seed: &[u8], other: &[u8]) -> Vec<u8> {
    let mut out = seed.to_vec();
    for _ in 0..places(rng) {
        damage(rng, &mut out, other);
    }
    out
}

fn damage(rng: &mut RandomStream, out: &mut Vec<u8>, other: &[u8]) {
    let at = below(rng, out.len() + 1);
    let end = (at + 1 + below(rng, 64)).min(out.len());
    match below(rng, 12) {
        0 | 1 => {
            if let Some(byte) = out.get_mut(at) {
                *byte ^= 1 << below(rng, 8);
            }
        }
        2 => {
            if let Some(byte) = out.get_mut(at) {
                *byte = BYTES[below(rng, BYTES.len())];
            }
        }
        3 => out.truncate(at),
        4 => drop(out.drain(at.min(end)..end)),
        5 => {
            // Up to thousands of copies: deep nesting and long lines.
            let part = out[at.min(end)..end].to_vec();
            let most = [2, 10, 3_000][below(rng, 3)];
            let count = 1 + below(rng, most);
            out.splice(at..at, part.repeat(count));
        }
        6 => {
            let from = below(rng, other.len() + 1);
            out.truncate(at);
            out.extend_from_slice(&other[from..]);
        }
        7 => {
            let most = [2, 40, 30_000][below(rng, 3)];
            let count = 1 + below(rng, most);
            let part = one(
                rng,
                &[
                    "[", "{", "- ", "{a: ", "[[a]]\n", "a.", "? ", "#", " ", "\n", "x",
                ],
            );
            out.splice(at..at, part.repeat(count).into_bytes());
        }
        8 => {
            let word = one(rng, &NASTY).as_bytes().to_vec();
            out.splice(at..at, word);
        }
        9 | 10 => replace_number(rng, out, at),
        _ => {
            // A line twice, or in another place.
            let lines: Vec<Vec<u8>> = out
                .split_inclusive(|b| *b == b'\n')
                .map(<[u8]>::to_vec)
                .collect();
            if !lines.is_empty() {
                let line = lines[below(rng, lines.len())].clone();
                let to = below(rng, lines.len());
                let mut lines = lines;
                if below(rng, 2) == 0 {
                    lines[to] = line;
                } else {
                    lines.insert(to, line);
                }
                *out = lines.concat();
            }
        }
    }
}

/// Puts something else in the place of the next number at or after a position.
fn replace_number(rng: &mut RandomStream, out: &mut Vec<u8>, at: usize) {
    let part_of_number = |b: &u8| b.is_ascii_digit() || b".eE+-".contains(b);
    let Some(begin) = out[at..]
        .iter()
        .position(u8::is_ascii_digit)
        .map(|i| at + i)
    else {
        return;
    };
    let end = out[begin..]
        .iter()
        .position(|b| !part_of_number(b))
        .map_or(out.len(), |i| begin + i);
    let word = one(rng, &NASTY).as_bytes().to_vec();
    out.splice(begin..end, word);
}

/// Damages one to four values of a tree.
pub fn tree(rng: &mut RandomStream, seed: &Value) -> Value {
    let mut out = seed.clone();
    for _ in 0..places(rng) {
        let mut left = 1 + below(rng, count(&out));
        damage_node(rng, &mut out, &mut left);
    }
    out
}

fn count(value: &Value) -> usize {
    1 + match value {
        Value::Array(items) => items.iter().map(count).sum(),
        Value::Object(map) => map.values().map(count).sum(),
        _ => 0,
    }
}

/// Damages the node that is `left` nodes away, in depth-first order.
fn damage_node(rng: &mut RandomStream, value: &mut Value, left: &mut usize) {
    *left -= 1;
    if *left == 0 {
        *value = other_value(rng, value);
        return;
    }
    let children: Vec<&mut Value> = match value {
        Value::Array(items) => items.iter_mut().collect(),
        Value::Object(map) => map.values_mut().collect(),
        _ => Vec::new(),
    };
    for child in children {
        damage_node(rng, child, left);
        if *left == 0 {
            return;
        }
    }
}

fn other_value(rng: &mut RandomStream, old: &Value) -> Value {
    match (old, below(rng, 4)) {
        (Value::Object(map), 0) if !map.is_empty() => {
            let mut map = map.clone();
            let key = map
                .keys()
                .nth(below(rng, map.len()))
                .cloned()
                .unwrap_or_default();
            let gone = map.remove(&key);
            if below(rng, 2) == 0 {
                map.insert(format!("{key}x"), gone.unwrap_or_default());
            }
            return Value::Object(map);
        }
        (Value::Array(items), 0) if !items.is_empty() => {
            let mut items = items.clone();
            let at = below(rng, items.len());
            match below(rng, 3) {
                0 => drop(items.remove(at)),
                1 => items.insert(at, items[at].clone()),
                _ => items.swap(at, 0),
            }
            return Value::Array(items);
        }
        (Value::Number(n), 0 | 1) => {
            let x = n.as_f64().unwrap_or(0.0);
            let factor = [0.0, -1.0, 0.5, 2.0, 1.001, 1e3, 1e10][below(rng, 7)];
            return if n.is_f64() {
                json!(x * factor)
            } else {
                integer(rng, n.as_u64().unwrap_or(0))
            };
        }
        _ => {}
    }
    match below(rng, 14) {
        0 => Value::Null,
        1 => json!(below(rng, 2) == 0),
        2 => json!(0),
        3 => json!(-1),
        4 => json!(u64::MAX),
        5 => json!(1e308),
        6 => json!(-1e308),
        7 => json!(5e-324),
        8 => json!(one(rng, &NASTY)),
        9 => json!([]),
        10 => json!({}),
        11 => json!("x".repeat(1 + below(rng, 10_000))),
        12 => json!([old]),
        _ => (0..120).fold(old.clone(), |inner, _| json!([inner])),
    }
}

fn integer(rng: &mut RandomStream, n: u64) -> Value {
    json!(
        [
            n.wrapping_add(1),
            n.wrapping_sub(1),
            0,
            1,
            1 << 20,
            1 << 31,
            1 << 40,
            u64::MAX >> 1
        ][below(rng, 8)]
    )
}
