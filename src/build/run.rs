//! The build itself: read, compile level by level, encode, measure through the asset's own bytes, publish.

use std::collections::BTreeMap;
use std::path::Path;

use formats::asset::{DOCUMENT, SurfaceAsset, SurfaceLevel};

use super::clock::{StageClock, peak_bytes};
use super::encode::{self, surface_asset, surface_level};
use super::level_error::{Reference, measure};
use super::record::{self, LevelRecord, StageSeconds};
use super::volume::VolumeRecord;
use super::volume::run::build_volume;
use super::{Input, Plan, SurfaceSpec, input};
use crate::io::publish::Publisher;
use crate::prefilter::surface::compile;

/// What happens during a build, for whoever watches.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// A stage begins.
    Stage {
        /// Surface.
        name: &'a str,
        /// Number of the level, from 1; 0 before the first.
        level: usize,
        /// Levels of the surface.
        levels: usize,
        /// What is done.
        stage: &'static str,
    },
    /// Something the user should know about a result that is usable.
    Warning {
        /// Surface.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
    /// A surface is published.
    Built {
        /// Surface.
        name: &'a str,
        /// Its levels.
        records: &'a [LevelRecord],
    },
    /// A surface could not be built.
    Failed {
        /// Surface.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
    /// Something the user should know about a volume that is usable.
    VolumeWarning {
        /// Volume.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
    /// A volume is published.
    VolumeBuilt {
        /// Volume.
        name: &'a str,
        /// Its levels.
        records: &'a [VolumeRecord],
    },
    /// A volume could not be built.
    VolumeFailed {
        /// Volume.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
}

/// How a build ended.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// All levels of surfaces that were built.
    pub records: Vec<LevelRecord>,
    /// All levels of volumes that were built.
    pub volumes: Vec<VolumeRecord>,
    /// Surfaces and volumes that could not be built.
    pub failed: usize,
    /// Levels above their target.
    pub missed: usize,
}

/// Builds all surfaces and volumes of `plan` into `out`. One that fails does not stop the others.
pub fn build(plan: &Plan, out: &Path, publisher: &Publisher, on_event: &mut dyn FnMut(Event<'_>)) -> Outcome {
    let mut outcome = Outcome::default();
    for spec in &plan.surfaces {
        let name = spec.name.as_str();
        match build_surface(spec, &plan.folder, out, publisher, on_event) {
            Ok(records) => {
                on_event(Event::Built { name, records: &records });
                outcome.missed += records.iter().filter(|record| record.missed()).count();
                outcome.records.extend(records);
            }
            Err(text) => {
                outcome.failed += 1;
                on_event(Event::Failed { name, text: &text });
            }
        }
    }
    for spec in &plan.volumes {
        let name = spec.name.as_str();
        match build_volume(spec, &plan.folder, out, publisher, on_event) {
            Ok(records) => {
                on_event(Event::VolumeBuilt { name, records: &records });
                outcome.missed += records.iter().filter(|record| record.missed()).count();
                outcome.volumes.extend(records);
            }
            Err(text) => {
                outcome.failed += 1;
                on_event(Event::VolumeFailed { name, text: &text });
            }
        }
    }
    outcome
}

/// A level on its way into the asset.
struct Built {
    level: SurfaceLevel,
    on_node: f64,
    clock: StageClock,
    peak_bytes: u64,
}

/// Builds and publishes one surface; the error is one line.
fn build_surface(
    spec: &SurfaceSpec,
    folder: &Path,
    out: &Path,
    publisher: &Publisher,
    on_event: &mut dyn FnMut(Event<'_>),
) -> Result<Vec<LevelRecord>, String> {
    let (name, levels) = (spec.name.as_str(), spec.levels.len());
    let mut clock = StageClock::default();
    clock.begin("read");
    on_event(Event::Stage { name, level: 0, levels, stage: "read" });
    let input = input::read(spec, folder).map_err(|error| error.to_string())?;
    clock.end();
    for text in &input.warnings {
        on_event(Event::Warning { name, text });
    }
    let mut built = Vec::with_capacity(levels);
    for index in 1..=levels {
        // Reading is counted with the first level.
        let level = build_level(spec, &input, index, std::mem::take(&mut clock), on_event)?;
        built.push(level);
    }
    on_event(Event::Stage { name, level: levels, levels, stage: "publish" });
    let asset = surface_asset(spec, &input, built.iter().map(|built| built.level.clone()).collect());
    let files = asset.encode().map_err(|error| error.to_string())?;
    publisher.folder(&out.join(name), &files, DOCUMENT, encode::is_payload).map_err(|error| error.to_string())?;
    let digest = blake3::hash(&files[DOCUMENT]).to_hex().to_string();
    let records: Vec<_> = built.into_iter().map(|built| record_of(spec, built, &files, &digest)).collect();
    record::replace(out, name, &records, publisher).map_err(|error| error.to_string())?;
    Ok(records)
}

/// Compiles level `index` and measures what its bytes say.
fn build_level(
    spec: &SurfaceSpec,
    input: &Input,
    index: usize,
    mut clock: StageClock,
    on_event: &mut dyn FnMut(Event<'_>),
) -> Result<Built, String> {
    let (name, levels, settings) = (spec.name.as_str(), spec.levels.len(), &spec.levels[index - 1]);
    let mut enter = |clock: &mut StageClock, stage| {
        clock.begin(stage);
        on_event(Event::Stage { name, level: index, levels, stage });
    };
    let coarse = compile(&input.fine, settings, &mut |stage| enter(&mut clock, stage));
    let (on_node, warnings) = (coarse.on_node, coarse.warnings.clone());
    enter(&mut clock, "encode");
    let level = surface_level(index, &input.fine.heights, coarse);
    let asset = surface_asset(spec, input, vec![level]);
    let decoded = through_bytes(&asset)?;
    enter(&mut clock, "measure");
    let reference = Reference {
        fine: &input.fine,
        bsdf: &decoded.bsdf,
        light: decoded.light,
        size: decoded.size,
        boundary: decoded.boundary,
        on_node,
        seed: settings.seed,
    };
    let error = measure(&reference, &decoded.levels[0]);
    clock.end();
    let missed = Some(error.below_75.value).filter(|value| *value > spec.error);
    let limited_by = missed.map(|_| "model".to_string());
    if let Some(value) = missed {
        let [value, target] = [value, spec.error].map(|e| e * 100.0);
        let text = format!("level {index} reaches an error of {value:.2} % below 75°; wanted {target:.2} %");
        on_event(Event::Warning { name, text: &text });
    }
    for text in &warnings {
        on_event(Event::Warning { name, text: &format!("level {index}: {text}") });
    }
    let [level] = <[SurfaceLevel; 1]>::try_from(asset.levels).map_err(|_| "one level went in".to_string())?;
    Ok(Built {
        level: SurfaceLevel { error: Some(error), limited_by, ..level },
        on_node,
        clock,
        peak_bytes: peak_bytes(),
    })
}

/// The asset as its reader sees it.
fn through_bytes(asset: &SurfaceAsset) -> Result<SurfaceAsset, String> {
    asset.encode().and_then(|files| encode::decoded(&files)).map_err(|error| error.to_string())
}

/// What a level cost and reached.
fn record_of(spec: &SurfaceSpec, built: Built, files: &BTreeMap<String, Vec<u8>>, digest: &str) -> LevelRecord {
    let stage = |&(stage, cpu_seconds): &(&'static str, f64)| StageSeconds { stage: stage.into(), cpu_seconds };
    LevelRecord {
        name: spec.name.clone(),
        level: built.level.index,
        factor: built.level.factor,
        cells: built.level.cells,
        lobes: built.level.lobes.len(),
        on_node: built.on_node,
        error: built.level.error,
        target: spec.error,
        stages: built.clock.stages().iter().map(stage).collect(),
        bytes: encode::bytes_by_part(files, built.level.index),
        peak_bytes: built.peak_bytes,
        asset: digest.into(),
    }
}
