//! What encoding costs: time and bytes of one level with N = 15 and 128² cells of 6 lobes.

#[path = "../tests/sample/mod.rs"]
mod sample;

use farfield_formats::SurfaceAsset;
use sample::Sample;
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let sample = Sample { cells: [128, 128], lobes: 6, patches: [4, 4], directions: 15, rank: 1, ..Sample::SMALL };
    let mut asset = sample.asset();
    asset.levels[0].factor = [8.0, 8.0];
    // Smooth tables, as real ones are: the sample's own noise would measure the worst case only.
    for (label, smooth) in [("noise", false), ("smooth", true)] {
        if smooth {
            let level = &mut asset.levels[0];
            let n2 = (level.directions * level.directions) as f32;
            for (index, rgb) in level.angular[0].iter_mut().enumerate() {
                let [o, i] = [(index as f32 / n2).floor() / n2, (index as f32 % n2) / n2];
                let wave = 1.0 + 0.2 * (6.0 * o).sin() * (6.0 * i).sin();
                *rgb = [wave, 1.1 * wave, 0.9 * wave];
            }
        }
        let start = Instant::now();
        let files = asset.encode()?;
        let encoding = start.elapsed();
        let start = Instant::now();
        SurfaceAsset::decode(&mut |path| Ok(files[path].clone()))?;
        println!("{label}: encode {encoding:?}, decode {:?}", start.elapsed());
        files.iter().for_each(|(name, bytes)| println!("  {:8} {name}", bytes.len()));
    }
    Ok(())
}
