//! Writes the random assets that the Python reader is compared on: `sample_assets DIR` makes one folder each.

#[path = "../tests/sample/mod.rs"]
mod sample;

use farfield_formats::Boundary;
use sample::Sample;
use std::error::Error;
use std::fs;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(std::env::args().nth(1).ok_or("usage: sample_assets DIR")?);
    for (name, sample) in [
        ("color_rank2_repeat", Sample::ROOMY),
        ("plain_rank1_clamp", Sample { boundary: Boundary::Clamp, has_color: false, rank: 1, ..Sample::ROOMY }),
        ("diffuse_rank2_clamp", Sample { boundary: Boundary::Clamp, is_specular: false, ..Sample::ROOMY }),
        ("additive_repeat", Sample { additive: Some(5), lobes: 2, directions: 3, ..Sample::ROOMY }),
        ("one_cell", Sample { cells: [1, 1], patches: [1, 1], directions: 1, lobes: 8, rank: 1, ..Sample::SMALL }),
    ] {
        let dir = out.join(name);
        fs::create_dir_all(&dir)?;
        for (file, bytes) in sample.asset().encode()? {
            fs::write(dir.join(file), bytes)?;
        }
    }
    Ok(())
}
