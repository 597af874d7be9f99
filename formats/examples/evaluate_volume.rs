//! Evaluates a volume: `evaluate_volume ASSET_DIR`, one point a line on stdin; extinction and phase function on stdout.
//!
//! A point is 9 numbers: the fraction of the volume along x, y, z, then ω and ω′, both away from it. The answer is σ_t(ω) in 1/m
//! and p(ω, ω′) in 1/sr, RGB; zeros where the volume is empty.

use farfield_formats::VolumeAsset;
use std::error::Error;
use std::io::{self, BufWriter, Write};
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let dir = std::env::args().nth(1).ok_or("usage: evaluate_volume ASSET_DIR < points")?;
    let asset = VolumeAsset::read(Path::new(&dir))?;
    let level = asset.levels.first().ok_or("the asset has no level")?;
    let mut out = BufWriter::new(io::stdout().lock());
    for line in io::stdin().lines() {
        let numbers: Vec<f32> = line?.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        let [x, y, z, wx, wy, wz, ix, iy, iz] = numbers[..] else { return Err("9 numbers a line".into()) };
        let [w, wi] = [[wx, wy, wz], [ix, iy, iz]];
        let voxel = level.voxel_at([x, y, z]);
        let found = voxel.map(|voxel| (voxel.extinction(w), voxel.phase(w, wi)));
        let (sigma_t, [r, g, b]) = found.unwrap_or((0.0, [0.0; 3]));
        writeln!(out, "{sigma_t:e} {r:e} {g:e} {b:e}")?;
    }
    Ok(())
}
