//! Writes the random volumes that the Python reader is compared on: `sample_volumes DIR` makes one folder each.

#[path = "../tests/sample_volume/mod.rs"]
mod sample_volume;

use sample_volume::Sample;
use std::error::Error;
use std::fs;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(std::env::args().nth(1).ok_or("usage: sample_volumes DIR")?);
    for (name, sample) in [
        ("two_lobes", Sample::ROOMY),
        ("one_lobe_one_colour", Sample { lobes: 1, albedo: Some([0.9, 0.5, 0.1]), ..Sample::ROOMY }),
        ("three_lobes_full", Sample { lobes: 3, filled: 1.0, ..Sample::ROOMY }),
        ("one_voxel", Sample { size: [1, 1, 1], filled: 1.0, ..Sample::SMALL }),
    ] {
        let dir = out.join(name);
        fs::create_dir_all(&dir)?;
        for (file, bytes) in sample.asset().encode()? {
            fs::write(dir.join(file), bytes)?;
        }
    }
    Ok(())
}
