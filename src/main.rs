//! The `oblate` command: runs the command line, prints an error, chooses the exit code.

use oblate::cli::{self, Exit};
use std::process::ExitCode;

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().collect();
    let exit = cli::run(&args, &mut std::io::stdout()).unwrap_or_else(|error| {
        eprintln!("error: {}", cli::message(&error));
        Exit::of(&error)
    });
    ExitCode::from(exit.code())
}
