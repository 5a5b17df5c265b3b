//! Thirty seeds of every target with known evidence: whether the differences of ln Z from the truth agree with the
//! quoted errors.
//!
//! ```text
//! cargo test -p oblate-samplers --release --test campaign -- --ignored --nocapture --test-threads 1 nested
//! cargo test -p oblate-samplers --release --test campaign -- --ignored --nocapture --test-threads 1 pt
//! ```
//!
//! Rows of a table appear as they are done; a test fails after its last row. CI runs the same targets with three seeds, in
//! `integration`, where some tests have a long form too: `cargo test -p oblate-samplers --release -- --ignored`.

mod nested;
mod pt;
#[path = "../integration/pulls.rs"]
mod pulls;
mod table;
#[allow(dead_code, reason = "some targets belong to other tests")]
#[path = "../integration/targets/mod.rs"]
mod targets;
