//! The `oblate` command.
fn main() {}
