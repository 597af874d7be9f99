//! What a build would do.

use std::path::Path;

use serde_json::json;

use crate::build::{SurfaceSpec, VolumeSpec};

/// The levels that would be built of a surface, one a line.
pub fn planned(surface: &SurfaceSpec, out: &Path, as_json: bool) -> String {
    let asset = out.join(&surface.name).join(formats::asset::DOCUMENT);
    let asset = asset.display();
    let name = &surface.name;
    let mut text = String::new();
    for (i, level) in surface.levels.iter().enumerate() {
        let index = i + 1;
        text += &if as_json {
            let line = json!({
                "name": name, "level": index, "factor": level.factor, "M": level.patches, "N": level.directions,
                "rank": level.rank, "lobes": level.lobes, "height": surface.height, "asset": asset.to_string(),
            });
            format!("{line}\n")
        } else {
            let [m, n, rank, lobes] = [level.patches, level.directions, level.rank, level.lobes]
                .map(|size| size.map_or("auto".into(), |size| size.to_string()));
            let factor = level.factor;
            format!(
                "{name} level {index}: factor {factor}, {lobes} lobes, M {m}, N {n}, rank {rank}: {} -> {asset}\n",
                surface.height
            )
        };
    }
    text
}

/// The levels that would be built of a volume, one a line.
pub fn planned_volume(volume: &VolumeSpec, out: &Path, as_json: bool) -> String {
    let asset = out.join(&volume.name).join(formats::asset::DOCUMENT);
    let (asset, name, density) = (asset.display(), &volume.name, &volume.density.grid.file);
    let line = |(i, factor): (usize, &usize)| match as_json {
        true => {
            let line = json!({
                "name": name, "level": i + 1, "factor": factor, "lobes": volume.lobes, "clusters": volume.clusters,
                "density": density, "asset": asset.to_string(),
            });
            format!("{line}\n")
        }
        false => {
            let lobes = volume.lobes.map_or("auto".into(), |lobes| lobes.to_string());
            format!("{name} level {}: factor {factor}, {lobes} lobes: {density} -> {asset}\n", i + 1)
        }
    };
    volume.levels.iter().enumerate().map(line).collect()
}
