//! `farfield init`: a project that builds at once.

use std::f32::consts::{PI, TAU};
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::Path;

use super::args::InitArgs;
use super::{DONE, FAILED, complain, print};
use crate::io::heights::encode_png16;

/// The manifest of a new project.
const MANIFEST: &str = r#"# What farfield builds. Lengths are metres, colours linear RGB, paths relative to this file.

[build]
error = 0.03                    # error below 75° to aim at

[surface.twill]
height    = "twill.png"         # EXR, PNG, TIFF or JPEG
size      = [0.010, 0.010]      # metres covered by the map
amplitude = 0.0004              # metres per unit of the stored value, which is 0 to 1
boundary  = "repeat"            # or "clamp"
bsdf      = { type = "diffuse", albedo = [0.55, 0.42, 0.30] }
levels    = [8]                 # downsampling factors
"#;

/// Texels of the generated map along one axis.
const TEXELS: u32 = 256;

/// Texels of a yarn: 8 yarns, two periods of a 2/2 twill.
const YARN: f32 = 32.0;

/// Makes the project; the exit code.
pub(super) fn run(args: &InitArgs) -> u8 {
    let map = encode_png16(&twill(), TEXELS, TEXELS);
    let files = [("farfield.toml", MANIFEST.as_bytes()), ("twill.png", &map)];
    if let Some((taken, _)) = files.iter().find(|(name, _)| args.dir.join(name).symlink_metadata().is_ok()) {
        let path = args.dir.join(taken);
        complain("error", &format!("`{}`: is already there; wanted a folder without it", path.display()));
        return FAILED;
    }
    for (name, bytes) in files {
        if let Err(error) = create(&args.dir, name, bytes) {
            complain("error", &format!("`{}`: cannot be created: {error}", args.dir.join(name).display()));
            return FAILED;
        }
    }
    let manifest = args.dir.join("farfield.toml");
    print(&format!("made {0}; build it with `farfield build -m {0}`\n", manifest.display()));
    DONE
}

/// Writes a new file.
fn create(dir: &Path, name: &str, bytes: &[u8]) -> std::io::Result<()> {
    fs::create_dir_all(dir)?;
    OpenOptions::new().write(true).create_new(true).open(dir.join(name))?.write_all(bytes)
}

/// Codes of a 2/2 twill: each yarn passes over two and under two, shifted by one from yarn to yarn.
fn twill() -> Vec<u16> {
    let n = TEXELS as usize;
    (0..n * n).map(|i| (twill_height((i % n) as f32, (i / n) as f32) * 65535.0).round() as u16).collect()
}

/// Height of the twill at (u, v) in texels, in [0, 1]: the upper one of a warp and a weft yarn.
fn twill_height(u: f32, v: f32) -> f32 {
    let (s, t) = ((u + 0.5) / YARN, (v + 0.5) / YARN);
    let warp = yarn(s, 0.75 * t) + 0.25 * (TAU * (t + s.floor()) / 4.0).sin();
    let weft = yarn(t, 0.75 * s) - 0.25 * (TAU * (s + t.floor()) / 4.0).sin();
    warp.max(weft).clamp(0.0, 1.0)
}

/// Height of a yarn at `across` (whole numbers between yarns), its fibres winding with `along`.
fn yarn(across: f32, along: f32) -> f32 {
    let round = (PI * across.fract()).sin();
    let fibres = (TAU * (4.0 * across + 8.0 * along)).sin();
    0.25 + 0.4 * round + 0.03 * fibres * round
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_generated_twill_tiles() {
        let n = TEXELS as f32;
        for i in 0..TEXELS {
            let i = i as f32;
            assert!((twill_height(i, 0.0) - twill_height(i, n)).abs() < 1e-4);
            assert!((twill_height(0.0, i) - twill_height(n, i)).abs() < 1e-4);
        }
    }
}
