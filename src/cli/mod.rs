//! Arguments, progress, exit codes.
//!
//! Results go to stdout, progress and diagnostics to stderr. Exit codes: 0 everything asked for is done, 1 an asset
//! failed or its input is unreadable, 2 the request made no sense, 130 interrupted.

mod args;
mod build;
mod cache;
mod init;
mod inspect;
mod progress;
mod render;
mod tradeoff;
mod verify;
mod watch;

use std::io::Write;
use std::process::ExitCode;

use args::{Cli, Command};
use clap::Parser;

/// Everything asked for is done.
const DONE: u8 = 0;
/// An asset failed.
const FAILED: u8 = 1;
/// The request made no sense.
const SENSELESS: u8 = 2;
/// The user interrupted.
const INTERRUPTED: i32 = 130;

/// Runs the command line.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are no mistakes and go to stdout with code 0.
            let _ = error.print();
            return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(SENSELESS));
        }
    };
    ExitCode::from(match cli.command {
        Command::Init(args) => init::run(&args),
        Command::Build(args) => build::run(&args),
        Command::Watch(args) => watch::run(&args),
        Command::Cache(command) => cache::run(&command),
        Command::Render(args) => render::run(&args),
        Command::Verify(args) => verify::run(&args),
        Command::Tradeoff(args) => tradeoff::run(&args),
        Command::Inspect(args) => inspect::run(&args),
    })
}

/// Writes a result to stdout. A reader that has closed the pipe wants no more of it, which is no failure.
fn print(text: &str) {
    let _ = std::io::stdout().lock().write_all(text.as_bytes());
}

/// Writes a diagnostic line to stderr.
fn complain(kind: &str, text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{kind}: {text}");
}
