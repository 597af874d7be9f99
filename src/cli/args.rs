//! The command line as clap sees it.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

/// The version; whoever packages a certain commit names it in `FARFIELD_VERSION` at compile time.
const VERSION: &str = match option_env!("FARFIELD_VERSION") {
    Some(version) => version,
    None => env!("CARGO_PKG_VERSION"),
};

/// Prefiltering asset compiler for level-of-detail materials.
#[derive(Debug, Parser)]
#[command(name = "farfield", version = VERSION, arg_required_else_help = true)]
pub(super) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub(super) command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Make a small project that builds at once
    Init(InitArgs),
    /// Compile surfaces into assets
    Build(BuildArgs),
    /// Show what is in an asset, and check its hashes
    Inspect(InspectArgs),
}

/// `farfield init`.
#[derive(Args, Debug)]
pub(super) struct InitArgs {
    /// Folder of the project, made if it is not there; nothing in it is overwritten
    #[arg(default_value = ".")]
    pub(super) dir: PathBuf,
}

/// `farfield build`.
#[derive(Args, Debug)]
pub(super) struct BuildArgs {
    /// Surfaces to build; all of the manifest, if none is named
    pub(super) names: Vec<String>,
    /// The manifest
    #[arg(short, long, value_name = "FILE", default_value = "farfield.toml")]
    pub(super) manifest: PathBuf,
    /// Folder of the assets: OUT/NAME/asset.json
    #[arg(long, value_name = "DIR", default_value = "lod")]
    pub(super) out: PathBuf,
    /// Folder of the build cache [default: .farfield beside the manifest]
    #[arg(long, value_name = "DIR")]
    pub(super) cache: Option<PathBuf>,
    /// Threads [default: one a processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) jobs: Option<u16>,
    /// Show what would be built, and write nothing
    #[arg(long)]
    pub(super) dry_run: bool,
    /// One JSON object a line on stdout
    #[arg(long)]
    pub(super) json: bool,
    /// Error below 75° to aim at, as a fraction, instead of the manifest's
    #[arg(long, value_name = "E", value_parser = parse_error)]
    pub(super) error: Option<f64>,
    /// Build what is up to date, too
    #[arg(long)]
    pub(super) force: bool,
    /// Fail where a level misses its error
    #[arg(long)]
    pub(super) strict: bool,
    /// Report every stage
    #[arg(short, long, conflicts_with = "quiet")]
    pub(super) verbose: bool,
    /// Report warnings and errors alone
    #[arg(short, long)]
    pub(super) quiet: bool,
}

/// `farfield inspect`.
#[derive(Args, Debug)]
pub(super) struct InspectArgs {
    /// Folder of an asset, or its asset.json
    pub(super) asset: PathBuf,
    /// One JSON object
    #[arg(long)]
    pub(super) json: bool,
}

/// A number that may be an error.
fn parse_error(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(error) if error > 0.0 && error <= 1.0 => Ok(error),
        _ => Err("wanted a number greater than 0 and at most 1".into()),
    }
}
