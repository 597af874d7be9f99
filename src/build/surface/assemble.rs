//! From the results of a surface's actions to levels, their measured errors, and the files of the asset.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use formats::asset::{DOCUMENT, SurfaceAsset, SurfaceLevel};

use super::SurfaceFiles;
use super::needs::{choice, colors, error, fine_surface, fit, heights, lobes, of_another_kind};
use crate::build::SurfaceSpec;
use crate::build::action::{Facts, Failure, Made, Need, Record};
use crate::build::artifact::Artifact;
use crate::build::encode::{self, Sources, level_of_map, surface_asset};
use crate::build::key::Digest;
use crate::build::level::through_bytes;
use crate::build::level_error::{Reference, measure};
use crate::build::record::{LevelRecord, StageSeconds};
use crate::prefilter::surface::{CoarseLevel, LevelSettings};

/// What a level is put together from.
struct Parts<'n> {
    lobes: &'n Need,
    sizes: &'n Need,
    smooth: &'n Need,
    fit: &'n Need,
    tint: Option<&'n Need>,
}

impl<'n> Parts<'n> {
    /// Those of the needs of `asset` that are a level's: lobes, sizes, smooth, fit, measure, tint.
    fn of_asset(of_level: &'n [Need], is_colored: bool) -> Self {
        let [lobes, sizes, smooth, fit] = [0, 1, 2, 3].map(|k| &of_level[k]);
        Self { lobes, sizes, smooth, fit, tint: is_colored.then(|| &of_level[5]) }
    }

    fn level(&self, index: usize, fine_size: [usize; 2]) -> Result<SurfaceLevel, Failure> {
        let lobes = lobes(self.lobes)?.clone();
        let base_color = colors(self.tint)?.map(<[_]>::to_vec);
        let (heights, choice, fit) = (heights(self.smooth)?, choice(self.sizes)?, fit(self.fit)?);
        let coarse = CoarseLevel::new(heights.clone(), lobes, base_color, choice.clone(), fit.clone());
        Ok(level_of_map(index, fine_size, coarse))
    }
}

/// `measure`: the error of a level as its reader sees it. Needs heights, smooth, lobes, sizes, fit, and colors, tint if
/// there are.
pub(super) fn measured(
    spec: &SurfaceSpec,
    settings: &LevelSettings,
    needs: &[Need],
    on_stage: &mut dyn FnMut(&'static str),
) -> Result<Artifact, Failure> {
    on_stage("encode");
    let fine = fine_surface(&needs[0], needs.get(5), &spec.brdf)?;
    let [smooth, lobes, sizes, own_fit] = [1, 2, 3, 4].map(|k| &needs[k]);
    let parts = Parts { smooth, lobes, sizes, fit: own_fit, tint: needs.get(6) };
    let level = parts.level(1, fine.heights.size())?;
    // The error depends on no name, number of a level, digest of a file, or target.
    let nameless = Sources { height: Digest::of(b""), size: fine.heights.size(), color: None };
    let decoded = through_bytes(&surface_asset(spec, &nameless, vec![level])).map_err(Failure::Refused)?;
    on_stage("measure");
    let reference = Reference {
        fine: &fine,
        bsdf: &decoded.bsdf,
        light: decoded.light,
        size: decoded.size,
        boundary: decoded.boundary,
        on_node: fit(own_fit)?.on_node,
        seed: settings.seed,
    };
    Ok(Artifact::Error(measure(&reference, &decoded.levels[0])))
}

/// How the needs of `asset` begin, and how many belong to each level.
fn layout(spec: &SurfaceSpec, needs: usize) -> (usize, usize) {
    let before = if spec.color.is_some() { 2 } else { 1 };
    (before, (needs - before) / spec.levels.len().max(1))
}

/// Whether `asset` takes more than the record of a need: of a level's actions those that it is made of, which come first.
pub(super) fn is_loaded(spec: &SurfaceSpec, need: usize, needs: usize) -> bool {
    let (before, each) = layout(spec, needs);
    let made_of = if spec.color.is_some() { 6 } else { 5 };
    need.checked_sub(before).is_some_and(|k| k % each < made_of)
}

/// `asset`: all files, and what is to be known of the levels.
pub(super) fn asset(spec: &SurfaceSpec, files: SurfaceFiles, needs: &[Need]) -> Result<Made, Failure> {
    let (before, each) = layout(spec, needs.len());
    let source = needs.first().ok_or_else(of_another_kind)?;
    let size = source.record.facts.size.ok_or_else(of_another_kind)?;
    let mut warnings = source.record.facts.warnings.clone();
    let mut levels = Vec::with_capacity(spec.levels.len());
    for (index, of_level) in (1..).zip(needs[before..].chunks(each)) {
        let parts = Parts::of_asset(of_level, spec.color.is_some());
        let error = error(&of_level[4])?;
        let is_missed = error.below_75.value > spec.error();
        if is_missed {
            let [value, target] = [error.below_75.value, spec.error()].map(|e| e * 100.0);
            warnings.push(format!("level {index} reaches an error of {value:.2} % below 75°; wanted {target:.2} %"));
        }
        warnings.extend(fit(parts.fit)?.warnings.iter().map(|text| format!("level {index}: {text}")));
        let limited_by = is_missed.then(|| "model".to_string());
        levels.push(SurfaceLevel { error: Some(error), limited_by, ..parts.level(index, size)? });
    }
    let sources = Sources { height: files.height, size, color: files.color };
    let asset = surface_asset(spec, &sources, levels);
    let encoded = asset.encode().map_err(|error| Failure::Refused(error.to_string()))?;
    let levels = level_records(spec, &asset, &encoded, needs)?;
    Ok(Made {
        artifact: Artifact::Files(encoded),
        facts: Facts { size: Some(size), warnings, levels, ..Facts::default() },
    })
}

/// What the levels reached, and cost when they were computed; what several share is counted with the first.
fn level_records(
    spec: &SurfaceSpec,
    asset: &SurfaceAsset,
    files: &BTreeMap<String, Vec<u8>>,
    needs: &[Need],
) -> Result<Vec<LevelRecord>, Failure> {
    let (before, each) = layout(spec, needs.len());
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
            patches: level.patches,
            directions: level.directions,
            rank: level.spatial.len(),
            on_node: fit(&of_level[3])?.on_node,
            error: level.error,
            target: spec.error(),
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
