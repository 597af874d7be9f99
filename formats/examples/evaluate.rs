//! Evaluates f_low and the additive term: `evaluate ASSET_DIR`, one point a line on stdin, twice RGB a line on stdout.
//!
//! A point is 11 numbers: x (2), n_c (3), ωi (3), ωo (3). n_c = 0 0 0 asks for the normal of the coarse heights.

use farfield_formats::SurfaceAsset;
use std::error::Error;
use std::io::{self, BufWriter, Write};
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let dir = std::env::args().nth(1).ok_or("usage: evaluate ASSET_DIR < points")?;
    let asset = SurfaceAsset::read(Path::new(&dir))?;
    let level = asset.levels.first().ok_or("the asset has no level")?;
    let mut out = BufWriter::new(io::stdout().lock());
    for line in io::stdin().lines() {
        let numbers: Vec<f32> = line?.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
        let [x0, x1, nx, ny, nz, ix, iy, iz, ox, oy, oz] = numbers[..] else { return Err("11 numbers a line".into()) };
        let x = [x0, x1];
        let n_c = if [nx, ny, nz] == [0.0; 3] { level.normal_at(&asset, x) } else { [nx, ny, nz] };
        let [wi, wo] = [[ix, iy, iz], [ox, oy, oz]];
        let [r, g, b] = level.f_low(&asset, x, n_c, wi, wo);
        let [ar, ag, ab] = level.additive_at(x, asset.boundary, wi, wo);
        writeln!(out, "{r:e} {g:e} {b:e} {ar:e} {ag:e} {ab:e}")?;
    }
    Ok(())
}
