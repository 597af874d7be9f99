//! The build itself: read, compile level by level, encode, measure through the asset's own bytes, publish.

use std::collections::BTreeMap;
use std::path::Path;

use formats::asset::DOCUMENT;

use super::clock::StageClock;
use super::encode::{self, surface_asset};
use super::level::{self, BuiltLevel};
use super::record::{self, LevelRecord, StageSeconds};
use super::{Input, Plan, SurfaceSpec, input};
use crate::io::publish::Publisher;

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
}

/// How a build ended.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// All levels that were built.
    pub records: Vec<LevelRecord>,
    /// Surfaces that could not be built.
    pub failed: usize,
    /// Levels above their target.
    pub missed: usize,
}

/// Builds all surfaces of `plan` into `out`. One that fails does not stop the others.
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
    outcome
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

/// Builds level `index` and says what it reached.
fn build_level(
    spec: &SurfaceSpec,
    input: &Input,
    index: usize,
    clock: StageClock,
    on_event: &mut dyn FnMut(Event<'_>),
) -> Result<BuiltLevel, String> {
    let (name, levels) = (spec.name.as_str(), spec.levels.len());
    let mut on_stage = |stage| on_event(Event::Stage { name, level: index, levels, stage });
    let mut built = level::build_level(spec, input, index, clock, &mut on_stage)?;
    let reached = built.error.below_75.value;
    if reached > spec.error() {
        built.level.limited_by = Some("model".into());
        let [value, target] = [reached, spec.error()].map(|e| e * 100.0);
        let text = format!("level {index} reaches an error of {value:.2} % below 75°; wanted {target:.2} %");
        on_event(Event::Warning { name, text: &text });
    }
    for text in &built.warnings {
        on_event(Event::Warning { name, text: &format!("level {index}: {text}") });
    }
    Ok(built)
}

/// What a level cost and reached.
fn record_of(spec: &SurfaceSpec, built: BuiltLevel, files: &BTreeMap<String, Vec<u8>>, digest: &str) -> LevelRecord {
    let stage = |&(stage, cpu_seconds): &(&'static str, f64)| StageSeconds { stage: stage.into(), cpu_seconds };
    LevelRecord {
        name: spec.name.clone(),
        level: built.level.index,
        factor: built.level.factor,
        cells: built.level.cells,
        lobes: built.level.lobes.len(),
        patches: built.level.patches,
        directions: built.level.directions,
        rank: built.level.spatial.len(),
        on_node: built.on_node,
        error: Some(built.error),
        target: spec.error(),
        stages: built.clock.stages().iter().map(stage).collect(),
        bytes: encode::bytes_by_part(files, built.level.index),
        peak_bytes: built.peak_bytes,
        asset: digest.into(),
    }
}
