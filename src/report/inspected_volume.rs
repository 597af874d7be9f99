//! What is in a volume asset.

use std::collections::BTreeMap;

use formats::asset::PayloadFile;
use formats::volume::{VolumeAsset, VolumeLevel};
use serde_json::json;

use super::table::{aligned, percent};
use crate::build::encode::part_of;

/// A volume asset that was read and whose hashes are right.
#[derive(Clone, Debug)]
pub struct InspectedVolume {
    /// Its content.
    pub asset: VolumeAsset,
    /// Its payload files.
    pub files: Vec<PayloadFile>,
    /// Bytes of `asset.json`.
    pub document_bytes: u64,
}

impl InspectedVolume {
    /// Bytes of a level by part.
    fn parts(&self, level: &VolumeLevel) -> BTreeMap<String, u64> {
        let mut parts = BTreeMap::new();
        for file in self.files.iter().filter(|file| file.level == level.index) {
            *parts.entry(part_of(&file.role)).or_insert(0) += file.bytes;
        }
        parts
    }
}

/// What the voxels of a level hold.
struct Content {
    occupied: usize,
    /// Smallest, mean and largest of the occupied voxels, 1/m.
    density: [f64; 3],
    /// Voxels that use so many lobes, from one.
    lobes: Vec<usize>,
}

impl Content {
    fn of(level: &VolumeLevel) -> Self {
        let occupied = level.occupied.len();
        let densities = || level.density.iter().map(|&density| f64::from(density));
        let mean = densities().sum::<f64>() / occupied.max(1) as f64;
        let least = densities().reduce(f64::min).unwrap_or(0.0);
        let mut lobes = vec![0; level.lobes.len()];
        for voxel in 0..occupied {
            let used = level.lobes.iter().filter(|lobe| lobe[voxel].area > 0.0).count();
            lobes[used.max(1) - 1] += 1;
        }
        Self { occupied, density: [least, mean, densities().fold(0.0, f64::max)], lobes }
    }
}

/// The asset as text.
pub fn volume_text(inspected: &InspectedVolume) -> String {
    let asset = &inspected.asset;
    let versions: Vec<String> = asset.versions.iter().map(|(stage, version)| format!("{stage} {version}")).collect();
    let files = inspected.files.len();
    let bytes = inspected.files.iter().map(|file| file.bytes).sum::<u64>() + inspected.document_bytes;
    let axes: String =
        ["x", "y", "z"].into_iter().zip(asset.repeat).filter(|(_, on)| *on).map(|(axis, _)| axis).collect();
    let repeat = if axes.is_empty() { String::new() } else { format!(", repeats along {axes}") };
    let extent: Vec<String> = (0..3).map(|k| short(asset.voxel[k] * f64::from(asset.source.size[k]))).collect();
    let [x, y, z] = asset.source.size;
    let mut rows = vec![
        vec!["volume".into(), asset.name.clone()],
        vec!["size".into(), format!("{} m{repeat}", extent.join(" × "))],
        vec!["source".into(), format!("{x} × {y} × {z} voxels, BLAKE3 {}", asset.source.digest)],
        vec!["settings".into(), asset.settings.to_string()],
        vec!["versions".into(), format!("{}; {}; seed {}", versions.join(", "), asset.isa, asset.seed)],
        vec!["hashes".into(), format!("{files} files, {bytes} bytes: all as published")],
    ];
    rows.extend(asset.levels.iter().flat_map(|level| level_rows(inspected, level)));
    aligned(&rows)
}

/// A level as rows of two columns.
fn level_rows(inspected: &InspectedVolume, level: &VolumeLevel) -> Vec<Vec<String>> {
    let parts = inspected.parts(level);
    let total: u64 = parts.values().sum();
    let parts: Vec<String> = parts.iter().map(|(part, bytes)| format!("{part} {bytes}")).collect();
    let content = Content::of(level);
    let occupied = content.occupied;
    let [x, y, z] = level.size;
    let factor: Vec<String> = level.factor.iter().map(|factor| short(*factor)).collect();
    let share = 100.0 * occupied as f64 / (x * y * z) as f64;
    let lobes: Vec<String> = content.lobes.iter().zip(1..).map(|(n, count)| format!("{n} of {count}")).collect();
    let [least, mean, most] = content.density.map(short);
    let each = total as f64 / occupied.max(1) as f64;
    let errors: Vec<String> = level.error.iter().map(|(name, figure)| format!("{name} {}", percent(*figure))).collect();
    let errors = if errors.is_empty() { "not measured".into() } else { errors.join(", ") };
    let mut rows = vec![
        vec![
            format!("level {}", level.index),
            format!("factor {}, {x} × {y} × {z} voxels, {occupied} occupied ({share:.1} %)", factor.join(" × ")),
        ],
        vec!["  lobes".into(), format!("voxels by number of lobes: {}", lobes.join(", "))],
        vec!["  density".into(), format!("{least} to {most} 1/m, mean {mean}")],
        vec!["  bytes".into(), format!("{total}, {each:.2} an occupied voxel: {}", parts.join(", "))],
        vec!["  error".into(), errors],
    ];
    if !level.fit.is_null() {
        rows.push(vec!["  fit".into(), level.fit.to_string()]);
    }
    if let Some(limit) = &level.limited_by {
        rows.push(vec!["  limited by".into(), limit.clone()]);
    }
    rows
}

/// A number of at most four digits.
fn short(value: f64) -> String {
    let text = format!("{value:.3e}").parse::<f64>().unwrap_or(value);
    format!("{text}")
}

/// The asset as one line of JSON.
pub fn volume_json(inspected: &InspectedVolume) -> String {
    let asset = &inspected.asset;
    let level = |level: &VolumeLevel| {
        let content = Content::of(level);
        json!({
            "level": level.index,
            "factor": level.factor,
            "size": level.size,
            "occupied": content.occupied,
            "lobes": content.lobes,
            "density": content.density,
            "bytes": inspected.parts(level),
            "error": level.error,
            "fit": level.fit,
            "limited_by": level.limited_by,
        })
    };
    let line = json!({
        "name": asset.name,
        "kind": "volume",
        "voxel": asset.voxel,
        "repeat": asset.repeat,
        "source": asset.source,
        "settings": asset.settings,
        "versions": asset.versions,
        "seed": asset.seed,
        "isa": asset.isa,
        "hashes": "ok",
        "levels": asset.levels.iter().map(level).collect::<Vec<_>>(),
    });
    format!("{line}\n")
}
