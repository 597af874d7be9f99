//! The command line as clap sees it.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use formats::asset::MAX_LEVELS;

use crate::report::tradeoff::TARGETS;

/// The version; whoever packages a certain commit names it in `FARFIELD_VERSION` at compile time.
const VERSION: &str = match option_env!("FARFIELD_VERSION") {
    Some(version) => version,
    None => env!("CARGO_PKG_VERSION"),
};

/// Bytes that the build cache is kept within: some thousand levels of 1024² maps with all that they were made from.
const DEFAULT_CACHE: &str = "20G";

/// What the number of a level may be, for messages.
const LEVEL: &str = "the number of a level, 1 to 32";

/// The most CPU seconds for one image: 11 days.
const MAX_SECONDS: f64 = 1e6;

/// The farthest exposure of a preview: beyond, single precision has no room left for the radiances themselves.
const MAX_STOPS: f32 = 64.0;

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
    /// Compile, and again whenever the manifest, a map or a grid changes
    Watch(BuildArgs),
    /// Look after the build cache
    #[command(subcommand)]
    Cache(CacheCommand),
    /// Draw a scene
    Render(RenderArgs),
    /// Compare assets with their originals, and report the difference
    Verify(VerifyArgs),
    /// Sweep the error target of a surface: speed and size against error
    Tradeoff(TradeoffArgs),
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
    /// Bytes that the build cache is kept within, as in 20G
    #[arg(long, value_name = "SIZE", default_value = DEFAULT_CACHE, value_parser = parse_size)]
    pub(super) cache_limit: u64,
    /// A cache that machines share: s3://BUCKET/FOLDER or http[s]://HOST/BUCKET/FOLDER; credentials as in AWS_ACCESS_KEY_ID
    #[arg(long, value_name = "URL")]
    pub(super) remote: Option<String>,
    /// Threads [default: one a processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) jobs: Option<u16>,
    /// Memory to stay within, as in 1500M [default: three quarters of the machine's]
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    pub(super) memory: Option<u64>,
    /// Show what would be built, and write nothing
    #[arg(long)]
    pub(super) dry_run: bool,
    /// Tell of every action that runs which input, setting or version made it run
    #[arg(long)]
    pub(super) explain: bool,
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

/// `farfield cache`.
#[derive(Debug, Subcommand)]
pub(super) enum CacheCommand {
    /// What is in the cache
    Stats(CacheArgs),
    /// Remove orphans and, beyond the limit, what was used longest ago
    Gc(CacheArgs),
    /// Read everything in the cache and hold it against its digests; what is damaged is removed, and made again when wanted
    Verify(VerifyCacheArgs),
}

/// The arguments of `farfield cache verify`.
#[derive(Args, Debug)]
pub(super) struct VerifyCacheArgs {
    /// The cache.
    #[command(flatten)]
    pub(super) cache: CacheArgs,
    /// Then run every action of the manifest anew, and compare what it gives with what is in the cache
    #[arg(long)]
    pub(super) rerun: bool,
}

/// The arguments of `farfield cache`.
#[derive(Args, Debug)]
pub(super) struct CacheArgs {
    /// The manifest
    #[arg(short, long, value_name = "FILE", default_value = "farfield.toml")]
    pub(super) manifest: PathBuf,
    /// Folder of the build cache [default: .farfield beside the manifest]
    #[arg(long, value_name = "DIR")]
    pub(super) cache: Option<PathBuf>,
    /// Bytes that `gc` leaves at most, as in 20G
    #[arg(long, value_name = "SIZE", default_value = DEFAULT_CACHE, value_parser = parse_size)]
    pub(super) limit: u64,
    /// One JSON object on stdout
    #[arg(long)]
    pub(super) json: bool,
}

/// `farfield render`.
#[derive(Args, Debug)]
pub(super) struct RenderArgs {
    /// The scene, as in `[scene.NAME]`
    pub(super) scene: String,
    /// The manifest
    #[arg(short, long, value_name = "FILE", default_value = "farfield.toml")]
    pub(super) manifest: PathBuf,
    /// What stands for the surfaces
    #[arg(long, value_enum, default_value = "farfield")]
    pub(super) model: Model,
    /// Level of the assets: `auto` chooses by the size of a pixel's footprint, 1 is the finest
    #[arg(long, value_name = "auto|INDEX", default_value = "auto", value_parser = parse_lod)]
    pub(super) lod: Lod,
    /// The image: OpenEXR with its variance; must end in .exr
    #[arg(short, long, value_name = "FILE", value_parser = parse_image)]
    pub(super) output: PathBuf,
    /// Samples a pixel
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub(super) spp: u32,
    /// CPU seconds to spend, in place of a number of samples
    #[arg(long, value_name = "SECONDS", conflicts_with = "spp", value_parser = parse_seconds)]
    pub(super) time: Option<f64>,
    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
    /// Light that is followed [default: that of the asset]
    #[arg(long, value_enum)]
    pub(super) integrator: Option<Integrator>,
    /// Folder of the assets: OUT/NAME/asset.json
    #[arg(long, value_name = "DIR", default_value = "lod")]
    pub(super) out: PathBuf,
    /// Threads [default: one a processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) jobs: Option<u16>,
    /// Write a preview beside the image: 8-bit PNG, sRGB
    #[arg(long)]
    pub(super) png: bool,
    /// Stops by which the preview is brighter
    #[arg(long, value_name = "E", default_value_t = 0.0, allow_negative_numbers = true)]
    #[arg(requires = "png", value_parser = parse_stops)]
    pub(super) exposure: f32,
    /// Report warnings and errors alone
    #[arg(short, long)]
    pub(super) quiet: bool,
}

/// What stands for a surface in an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Model {
    /// The compiled asset
    Farfield,
    /// The original at full resolution
    Full,
    /// Averaged heights with the base BRDF
    Naive,
    /// The asset's normal distribution without its scaling
    Lobes,
    /// One Beckmann lobe from the moments of the slopes
    Leadr,
}

/// A level of an asset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lod {
    /// By the size of a pixel's footprint.
    Auto,
    /// This one, from 1.
    Level(usize),
}

/// The light that paths follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Integrator {
    /// From the lights to a surface to the camera
    Direct,
    /// From surface to surface, too
    Path,
}

/// `farfield verify`.
#[derive(Args, Debug)]
pub(super) struct VerifyArgs {
    /// Surfaces to verify; all of the manifest, if none is named
    pub(super) names: Vec<String>,
    /// The manifest
    #[arg(short, long, value_name = "FILE", default_value = "farfield.toml")]
    pub(super) manifest: PathBuf,
    /// Folder of the assets: OUT/NAME/asset.json
    #[arg(long, value_name = "DIR", default_value = "lod")]
    pub(super) out: PathBuf,
    /// Folder of the report: DIR/report.html, DIR/report.json
    #[arg(long, value_name = "DIR", default_value = "report")]
    pub(super) report: PathBuf,
    /// Pixels a side of the images
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(16..=512))]
    pub(super) size: u32,
    /// Samples a pixel of each of the two halves of an image
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(4..=65536))]
    pub(super) spp: u32,
    /// Seed of the random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
    /// Verify this level alone, from 1
    #[arg(long, value_name = "INDEX", value_parser = parse_level)]
    pub(super) level: Option<usize>,
    /// Threads [default: one a processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) jobs: Option<u16>,
    /// One JSON object a line on stdout
    #[arg(long)]
    pub(super) json: bool,
    /// Report every image
    #[arg(short, long, conflicts_with = "quiet")]
    pub(super) verbose: bool,
    /// Report warnings and errors alone
    #[arg(short, long)]
    pub(super) quiet: bool,
}

/// `farfield tradeoff`.
#[derive(Args, Debug)]
pub(super) struct TradeoffArgs {
    /// The surface
    pub(super) name: String,
    /// The manifest
    #[arg(short, long, value_name = "FILE", default_value = "farfield.toml")]
    pub(super) manifest: PathBuf,
    /// Error targets, ε below 75° as fractions, separated by commas
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = parse_error, default_values_t = TARGETS)]
    pub(super) errors: Vec<f64>,
    /// Take the factorisation apart instead: singular values, every size, other ways to T and S
    #[arg(long, conflicts_with_all = ["errors", "size", "spp"])]
    pub(super) study: bool,
    /// Folder of the table and the plot: DIR/tradeoff-NAME.txt, .json, .svg; DIR/study-NAME.txt, .json
    #[arg(long, value_name = "DIR", default_value = "report")]
    pub(super) report: PathBuf,
    /// This level alone, from 1
    #[arg(long, value_name = "INDEX", value_parser = parse_level)]
    pub(super) level: Option<usize>,
    /// Pixels a side of the images
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(8..=512))]
    pub(super) size: u32,
    /// Samples a pixel of each of the two halves of an image
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(4..=65536))]
    pub(super) spp: u32,
    /// Seed of the images
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
    /// Threads [default: one a processor]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub(super) jobs: Option<u16>,
    /// One JSON object a line on stdout
    #[arg(long)]
    pub(super) json: bool,
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

/// Bytes, with a unit if wanted: K, M, G, T are powers of 1024.
fn parse_size(text: &str) -> Result<u64, String> {
    let (number, shift) = match text.find(|c: char| !c.is_ascii_digit()).map(|at| text.split_at(at)) {
        None => (text, 0),
        Some((number, "K")) => (number, 10),
        Some((number, "M")) => (number, 20),
        Some((number, "G")) => (number, 30),
        Some((number, "T")) => (number, 40),
        Some(_) => ("", 0),
    };
    let bytes = number.parse::<u64>().ok().and_then(|number| number.checked_mul(1 << shift));
    bytes.ok_or_else(|| "wanted bytes, as in 1500M or 20G".into())
}

/// A number that may be an error.
fn parse_error(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(error) if error > 0.0 && error <= 1.0 => Ok(error),
        _ => Err("wanted a number greater than 0 and at most 1".into()),
    }
}

/// `auto` or the number of a level.
fn parse_lod(text: &str) -> Result<Lod, String> {
    match text {
        "auto" => Ok(Lod::Auto),
        _ => parse_level(text).map(Lod::Level).map_err(|_| format!("wanted `auto` or {LEVEL}")),
    }
}

/// The number of a level.
fn parse_level(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(index) if (1..=MAX_LEVELS).contains(&index) => Ok(index),
        _ => Err(format!("wanted {LEVEL}")),
    }
}

/// The path of an OpenEXR image.
fn parse_image(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension() {
        Some(extension) if extension.eq_ignore_ascii_case("exr") => Ok(path),
        _ => Err("wanted a path that ends in .exr".into()),
    }
}

/// A time to spend.
fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if seconds > 0.0 && seconds <= MAX_SECONDS => Ok(seconds),
        _ => Err("wanted seconds, greater than 0 and at most 1000000".into()),
    }
}

/// An exposure.
fn parse_stops(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(stops) if stops.abs() <= MAX_STOPS => Ok(stops),
        _ => Err("wanted stops from -64 to 64".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<Command, clap::Error> {
        Cli::try_parse_from(line.split_whitespace()).map(|cli| cli.command)
    }

    fn render(line: &str) -> RenderArgs {
        match parse(line) {
            Ok(Command::Render(args)) => args,
            other => panic!("{line}: {other:?}"),
        }
    }

    fn verify(line: &str) -> VerifyArgs {
        match parse(line) {
            Ok(Command::Verify(args)) => args,
            other => panic!("{line}: {other:?}"),
        }
    }

    #[test]
    fn render_has_the_documented_defaults() {
        let args = render("farfield render shop -o shop.exr");
        assert_eq!((args.scene.as_str(), args.output), ("shop", PathBuf::from("shop.exr")));
        assert_eq!((args.manifest, args.out), (PathBuf::from("farfield.toml"), PathBuf::from("lod")));
        assert_eq!((args.model, args.lod, args.integrator), (Model::Farfield, Lod::Auto, None));
        assert_eq!((args.spp, args.time, args.seed, args.jobs), (64, None, 0, None));
        assert_eq!((args.png, args.exposure, args.quiet), (false, 0.0, false));
    }

    #[test]
    fn every_option_of_render_arrives() {
        let args = render(
            "farfield render shop -m shop.toml --model leadr --lod 2 -o a.EXR --time 1.5 --seed 7 --integrator path \
             --out assets --jobs 2 --png --exposure -1.5 -q",
        );
        assert_eq!((args.manifest, args.out), (PathBuf::from("shop.toml"), PathBuf::from("assets")));
        assert_eq!((args.model, args.lod, args.integrator), (Model::Leadr, Lod::Level(2), Some(Integrator::Path)));
        assert_eq!((args.time, args.seed, args.jobs), (Some(1.5), 7, Some(2)));
        assert_eq!((args.png, args.exposure, args.quiet), (true, -1.5, true));
        for (name, model) in [
            ("farfield", Model::Farfield),
            ("full", Model::Full),
            ("naive", Model::Naive),
            ("lobes", Model::Lobes),
            ("leadr", Model::Leadr),
        ] {
            assert_eq!(render(&format!("farfield render shop -o a.exr --model {name}")).model, model);
        }
    }

    #[test]
    fn verify_has_the_documented_defaults_and_every_option_arrives() {
        let args = verify("farfield verify");
        assert_eq!((args.names.len(), args.manifest), (0, PathBuf::from("farfield.toml")));
        assert_eq!((args.out, args.report), (PathBuf::from("lod"), PathBuf::from("report")));
        assert_eq!((args.size, args.spp, args.seed, args.level, args.jobs), (64, 128, 0, None, None));
        assert_eq!((args.json, args.verbose, args.quiet), (false, false, false));
        let args = verify(
            "farfield verify bark cloth -m a.toml --out b --report c --size 16 --spp 4 --seed 1 --level 32 --jobs 3 \
             --json -v",
        );
        assert_eq!((args.names, args.manifest), (vec!["bark".into(), "cloth".into()], PathBuf::from("a.toml")));
        assert_eq!((args.out, args.report), (PathBuf::from("b"), PathBuf::from("c")));
        assert_eq!((args.size, args.spp, args.seed, args.level, args.jobs), (16, 4, 1, Some(32), Some(3)));
        assert_eq!((args.json, args.verbose, args.quiet), (true, true, false));
    }

    #[test]
    fn values_beyond_their_limits_are_refused() {
        for line in [
            "render",
            "render shop",
            "render -o a.exr",
            "render shop -o a.png",
            "render shop -o exr",
            "render shop -o .exr",
            "render shop -o a.exr --spp 0",
            "render shop -o a.exr --spp 65537",
            "render shop -o a.exr --spp 64 --time 1",
            "render shop -o a.exr --time 0",
            "render shop -o a.exr --time nan",
            "render shop -o a.exr --time inf",
            "render shop -o a.exr --lod 0",
            "render shop -o a.exr --lod 33",
            "render shop -o a.exr --lod fine",
            "render shop -o a.exr --model plain",
            "render shop -o a.exr --integrator bdpt",
            "render shop -o a.exr --seed -1",
            "render shop -o a.exr --jobs 0",
            "render shop -o a.exr --exposure 1",
            "render shop -o a.exr --png --exposure nan",
            "render shop -o a.exr --png --exposure 65",
            "verify --size 15",
            "verify --size 513",
            "verify --spp 3",
            "verify --spp 65537",
            "verify --level 0",
            "verify --jobs 1025",
            "verify -q -v",
            "build --memory 1.5G",
            "build --memory 1500MB",
            "build --memory G",
            "build --cache-limit 99999999999T",
            "cache",
            "cache gc --limit -1",
        ] {
            let error = parse(&format!("farfield {line}")).expect_err(line);
            assert_eq!(error.exit_code(), 2, "{line}");
        }
    }
}
