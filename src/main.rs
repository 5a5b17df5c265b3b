//! The `oblate` command: runs the command line and returns its exit code.

#![deny(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    clippy::print_stderr
)]

use std::ffi::OsString;
use std::process::ExitCode;

fn main() -> ExitCode {
    let args: Vec<OsString> = std::env::args_os().collect();
    let exit = oblate::cli::run(&args, &mut std::io::stdout());
    ExitCode::from(exit.code())
}
