//! What is in an asset.

use std::collections::BTreeMap;

use formats::asset::{PayloadFile, SurfaceAsset, SurfaceLevel};
use serde_json::json;

use super::table::{aligned, factor, percent, stages};
use crate::build::LevelRecord;
use crate::build::encode::part_of;

/// An asset that was read and whose hashes are right.
#[derive(Clone, Debug)]
pub struct Inspected {
    /// Its content.
    pub asset: SurfaceAsset,
    /// Its payload files.
    pub files: Vec<PayloadFile>,
    /// Bytes of `asset.json`.
    pub document_bytes: u64,
    /// What its build cost; empty where that is not known.
    pub records: Vec<LevelRecord>,
}

impl Inspected {
    /// Bytes of a level by part.
    fn parts(&self, level: &SurfaceLevel) -> BTreeMap<String, u64> {
        let mut parts = BTreeMap::new();
        for file in self.files.iter().filter(|file| file.level == level.index) {
            *parts.entry(part_of(&file.role)).or_insert(0) += file.bytes;
        }
        parts
    }

    /// What the build of a level cost.
    fn record(&self, level: &SurfaceLevel) -> Option<&LevelRecord> {
        self.records.iter().find(|record| record.level == level.index)
    }
}

/// The asset as text.
pub fn asset_text(inspected: &Inspected) -> String {
    let asset = &inspected.asset;
    let [w, h] = asset.size;
    let boundary = serde_json::to_value(asset.boundary).unwrap_or_default();
    let versions: Vec<String> = asset.versions.iter().map(|(stage, version)| format!("{stage} {version}")).collect();
    let files = inspected.files.len();
    let bytes = inspected.files.iter().map(|file| file.bytes).sum::<u64>() + inspected.document_bytes;
    let mut rows = vec![
        vec!["surface".into(), asset.name.clone()],
        vec!["light".into(), asset.light.name().into()],
        vec!["size".into(), format!("{w} × {h} m, {}", boundary.as_str().unwrap_or_default())],
        vec![
            "source".into(),
            format!("{} × {} texels, BLAKE3 {}", asset.source.width, asset.source.height, asset.source.digest),
        ],
        vec!["settings".into(), asset.settings.to_string()],
        vec!["versions".into(), format!("{}; {}; seed {}", versions.join(", "), asset.isa, asset.seed)],
        vec!["hashes".into(), format!("{files} files, {bytes} bytes: all as published")],
    ];
    rows.extend(asset.levels.iter().flat_map(|level| level_rows(inspected, level)));
    aligned(&rows)
}

/// A level as rows of two columns.
fn level_rows(inspected: &Inspected, level: &SurfaceLevel) -> Vec<Vec<String>> {
    let parts = inspected.parts(level);
    let total: u64 = parts.values().sum();
    let parts: Vec<String> = parts.iter().map(|(part, bytes)| format!("{part} {bytes}")).collect();
    let error = match &level.error {
        Some(error) => error.figures().map(|(name, figure)| format!("{name} {}", percent(figure))).join(", "),
        None => "not measured".into(),
    };
    let [cells, patches] = [level.cells, level.patches].map(|[u, v]| format!("{u} × {v}"));
    let (lobes, n, rank) = (level.lobes.len(), level.directions, level.spatial.len());
    let tables = format!("{cells} cells, {lobes} lobes, M {patches}, N {n}, rank {rank}");
    let mut rows = vec![
        vec![format!("level {}", level.index), format!("factor {}, {tables}", factor(level.factor))],
        vec!["  bytes".into(), format!("{total}: {}", parts.join(", "))],
        vec!["  error".into(), error],
    ];
    if let Some(term) = &level.additive {
        rows.push(vec!["  additive".into(), format!("N {}", term.directions)]);
    }
    if let Some(bound) = level.skipped_interreflection {
        rows.push(vec!["  interreflection".into(), format!("skipped, below {:.2} % of F", 100.0 * bound)]);
    }
    if let Some(limit) = &level.limited_by {
        rows.push(vec!["  limited by".into(), limit.clone()]);
    }
    if let Some(record) = inspected.record(level) {
        rows.push(vec!["  CPU seconds".into(), stages(&record.stages)]);
    }
    rows
}

/// The asset as one line of JSON.
pub fn asset_json(inspected: &Inspected) -> String {
    let asset = &inspected.asset;
    let level = |level: &SurfaceLevel| {
        json!({
            "level": level.index,
            "factor": level.factor,
            "cells": level.cells,
            "lobes": level.lobes.len(),
            "M": level.patches,
            "N": level.directions,
            "rank": level.spatial.len(),
            "bytes": inspected.parts(level),
            "error": level.error,
            "additive": level.additive.as_ref().map(|term| json!({ "N": term.directions })),
            "skipped_interreflection": level.skipped_interreflection,
            "limited_by": level.limited_by,
            "stages": inspected.record(level).map(|record| &record.stages),
        })
    };
    let line = json!({
        "name": asset.name,
        "light": asset.light,
        "size": asset.size,
        "boundary": asset.boundary,
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
