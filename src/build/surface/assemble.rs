//! From the results of a surface's actions to levels, their measured errors, and the files of the asset.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use formats::asset::{DOCUMENT, LevelError, SurfaceAsset, SurfaceLevel};

use super::SurfaceFiles;
use super::needs::{colors, fine_surface, fit, heights, lobes, of_another_kind};
use crate::build::SurfaceSpec;
use crate::build::action::{Facts, Failure, Made, Need, Record};
use crate::build::artifact::Artifact;
use crate::build::encode::{self, Sources, level_of_map, surface_asset};
use crate::build::key::Digest;
use crate::build::level_error::{Reference, measure};
use crate::build::record::{LevelRecord, StageSeconds};
use crate::prefilter::surface::{CoarseLevel, LevelSettings};

/// Actions of a level before its colours: `downsample`, `lobes`, `fine`, `smooth`, `coarse`, `fit`, `measure`.
const ACTIONS: usize = 7;

/// What a level is put together from.
struct Parts<'n> {
    smooth: &'n Need,
    lobes: &'n Need,
    fit: &'n Need,
    tint: Option<&'n Need>,
}

impl Parts<'_> {
    fn level(&self, index: usize, fine_size: [usize; 2], settings: &LevelSettings) -> Result<SurfaceLevel, Failure> {
        let (heights, fit) = (heights(self.smooth)?.clone(), fit(self.fit)?.clone());
        let cells = heights.size();
        let coarse = CoarseLevel {
            patches: crate::prefilter::surface::patch_counts(cells, settings.patches),
            heights,
            lobes: lobes(self.lobes)?.clone(),
            base_color: colors(self.tint)?.map(<[_]>::to_vec),
            spatial: fit.spatial,
            directions: settings.directions,
            angular: fit.angular,
            on_node: fit.on_node,
            warnings: fit.warnings,
        };
        Ok(level_of_map(index, fine_size, coarse))
    }
}

/// `measure`: the error of a level as its reader sees it. Needs heights, smooth, lobes, fit, and colors, tint if there are.
pub(super) fn measured(
    spec: &SurfaceSpec,
    settings: &LevelSettings,
    needs: &[Need],
    on_stage: &mut dyn FnMut(&'static str),
) -> Result<Artifact, Failure> {
    on_stage("encode");
    let fine = fine_surface(&needs[0], needs.get(4), &spec.brdf)?;
    let parts = Parts { smooth: &needs[1], lobes: &needs[2], fit: &needs[3], tint: needs.get(5) };
    let level = parts.level(1, fine.heights.size(), settings)?;
    // The error depends on no name, number of a level, digest of a file, or target.
    let nameless = Sources { height: Digest::of(b""), size: fine.heights.size(), color: None };
    let decoded = through_bytes(&surface_asset(spec, &nameless, vec![level]))?;
    on_stage("measure");
    let reference = Reference {
        fine: &fine,
        bsdf: &decoded.bsdf,
        light: decoded.light,
        size: decoded.size,
        boundary: decoded.boundary,
        on_node: fit(&needs[3])?.on_node,
        seed: settings.seed,
    };
    Ok(Artifact::Error(measure(&reference, &decoded.levels[0])))
}

/// The asset as its reader sees it.
fn through_bytes(asset: &SurfaceAsset) -> Result<SurfaceAsset, Failure> {
    asset.encode().and_then(|files| encode::decoded(&files)).map_err(|error| Failure::Refused(error.to_string()))
}

/// Actions of a level among the needs of `asset`, and those before the first.
fn layout(spec: &SurfaceSpec) -> (usize, usize) {
    if spec.color.is_some() { (2, ACTIONS + 1) } else { (1, ACTIONS) }
}

/// Whether `asset` takes more than the record of a need: of a level's actions `lobes`, `smooth`, `fit`, `measure`, tint.
pub(super) fn is_loaded(spec: &SurfaceSpec, need: usize, needs: usize) -> bool {
    let (before, each) = layout(spec);
    debug_assert_eq!(needs, before + each * spec.levels.len(), "all actions of the surface");
    need.checked_sub(before).is_some_and(|k| [1, 3, 5, 6, 7].contains(&(k % each)))
}

/// `asset`: all files, and what is to be known of the levels.
pub(super) fn asset(spec: &SurfaceSpec, files: SurfaceFiles, needs: &[Need]) -> Result<Made, Failure> {
    let (before, each) = layout(spec);
    let source = needs.first().ok_or_else(of_another_kind)?;
    let size = source.record.facts.size.ok_or_else(of_another_kind)?;
    let mut warnings = source.record.facts.warnings.clone();
    let mut levels = Vec::with_capacity(spec.levels.len());
    for (index, (settings, of_level)) in (1..).zip(spec.levels.iter().zip(needs[before..].chunks(each))) {
        let parts = Parts { smooth: &of_level[3], lobes: &of_level[1], fit: &of_level[5], tint: of_level.get(7) };
        let error = error(&of_level[6])?;
        let is_missed = error.below_75.value > spec.error;
        if is_missed {
            let [value, target] = [error.below_75.value, spec.error].map(|e| e * 100.0);
            warnings.push(format!("level {index} reaches an error of {value:.2} % below 75°; wanted {target:.2} %"));
        }
        warnings.extend(fit(parts.fit)?.warnings.iter().map(|text| format!("level {index}: {text}")));
        let limited_by = is_missed.then(|| "model".to_string());
        levels.push(SurfaceLevel { error: Some(error), limited_by, ..parts.level(index, size, settings)? });
    }
    let sources = Sources { height: files.height, size, color: files.color };
    let asset = surface_asset(spec, &sources, levels);
    let encoded = asset.encode().map_err(|error| Failure::Refused(error.to_string()))?;
    let levels = level_records(spec, &asset, &encoded, needs)?;
    Ok(Made { artifact: Artifact::Files(encoded), facts: Facts { size: Some(size), warnings, levels } })
}

fn error(need: &Need) -> Result<LevelError, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Error(error)) => Ok(*error),
        _ => Err(of_another_kind()),
    }
}

/// What the levels reached, and cost when they were computed; what several share is counted with the first.
fn level_records(
    spec: &SurfaceSpec,
    asset: &SurfaceAsset,
    files: &BTreeMap<String, Vec<u8>>,
    needs: &[Need],
) -> Result<Vec<LevelRecord>, Failure> {
    let (before, each) = layout(spec);
    let digest = Digest::of(&files[DOCUMENT]).to_string();
    let mut counted = BTreeSet::new();
    let mut records = Vec::with_capacity(asset.levels.len());
    for (level, of_level) in asset.levels.iter().zip(needs[before..].chunks(each)) {
        let reading = if records.is_empty() { &needs[..before] } else { &[] };
        let all: Vec<&Arc<Record>> = reading.iter().chain(of_level).map(|need| &need.record).collect();
        let new: Vec<&Arc<Record>> = all.iter().copied().filter(|record| counted.insert(record.key)).collect();
        records.push(LevelRecord {
            name: spec.name.clone(),
            level: level.index,
            factor: level.factor,
            cells: level.cells,
            lobes: level.lobes.len(),
            on_node: fit(&of_level[5])?.on_node,
            error: level.error,
            target: spec.error,
            stages: summed(new.iter().flat_map(|record| &record.cost)),
            bytes: encode::bytes_by_part(files, level.index),
            peak_bytes: all.iter().map(|record| record.peak_bytes).max().unwrap_or(0),
            asset: digest.clone(),
        });
    }
    Ok(records)
}

/// Seconds by stage, in the order in which stages occur.
fn summed<'a>(costs: impl Iterator<Item = &'a StageSeconds>) -> Vec<StageSeconds> {
    let mut sums: Vec<StageSeconds> = Vec::new();
    for cost in costs {
        match sums.iter_mut().find(|sum| sum.stage == cost.stage) {
            Some(sum) => sum.cpu_seconds += cost.cpu_seconds,
            None => sums.push(cost.clone()),
        }
    }
    sums
}
