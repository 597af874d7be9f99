//! The compilation of a volume: read, compile level by level, encode.

use std::collections::BTreeMap;
use std::path::Path;

use formats::{VolumeAsset, VolumeLevel};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::super::action::Failure;
use super::super::clock::{StageClock, peak_bytes};
use super::super::encode::bytes_by_part;
use super::super::manifest::{Optimizer, VolumeSpec};
use super::super::{Event, StageSeconds};
use super::encode::{volume_asset, volume_level};
use super::input::{VolumeInput, read};
use super::walk::VolumeFiles;
use crate::medium::Medium;
use crate::prefilter::volume::{self as prefilter, CoarseVolume, VolumeSettings, compile};

/// One built level of a volume: what it cost and reached.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VolumeRecord {
    /// Volume.
    pub name: String,
    /// Number of the level, from 1.
    pub level: u32,
    /// Source voxels a voxel along x, y and z.
    pub factor: [f64; 3],
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// Voxels that hold something.
    pub occupied: usize,
    /// Most lobes of a voxel.
    pub lobes: usize,
    /// Mean relative error of image means in views and lights that the fit has not seen, of plain averages and of the level;
    /// `None` where nothing was fitted.
    pub validation: Option<[f64; 2]>,
    /// Error that was aimed at.
    pub target: f64,
    /// CPU seconds by stage, in order.
    pub stages: Vec<StageSeconds>,
    /// Bytes by part.
    pub bytes: BTreeMap<String, u64>,
    /// The most bytes that the process had held by the end of the level.
    pub peak_bytes: u64,
}

impl VolumeRecord {
    /// The record as one line of JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("numbers and strings are JSON")
    }

    /// Whether the level's error is above its target.
    pub fn missed(&self) -> bool {
        self.validation.is_some_and(|[averages, level]| averages.min(level) > self.target)
    }
}

/// The asset of a volume, not yet published.
#[derive(Debug)]
pub(super) struct Compiled {
    /// Its files by name.
    pub files: BTreeMap<String, Vec<u8>>,
    /// What its levels cost and reached.
    pub levels: Vec<VolumeRecord>,
    /// What the user should know, one line each; all of it has been told.
    pub warnings: Vec<String>,
}

/// Compiles one volume from the files that have the digests `wanted`.
pub(super) fn compile_volume(
    spec: &VolumeSpec,
    folder: &Path,
    wanted: &VolumeFiles,
    on_event: &mut dyn FnMut(Event<'_>),
) -> Result<Compiled, Failure> {
    let refused = |error: &dyn std::fmt::Display| Failure::Refused(error.to_string());
    let (name, levels) = (spec.name.as_str(), spec.levels.len());
    let mut clock = StageClock::default();
    clock.begin("read");
    on_event(Event::Stage { name, level: 0, levels, stage: "read" });
    let input = read(spec, folder).map_err(|error| refused(&error))?;
    if !is_read_from(&input, wanted) {
        return Err(Failure::InputChanged);
    }
    let mut warnings = input.warnings.clone();
    warnings.iter().for_each(|text| on_event(Event::VolumeWarning { name, text }));
    let fine = input.medium();
    clock.end();
    let mut built = Vec::with_capacity(levels);
    for index in 1..=levels {
        // Reading is counted with the first level.
        let (level, record) = build_level(spec, &input, &fine, index, std::mem::take(&mut clock), on_event);
        if let Some(text) = shortfall(&record) {
            on_event(Event::VolumeWarning { name, text: &text });
            warnings.push(text);
        }
        built.push((level, record));
    }
    let asset = volume_asset(spec, &input, built.iter().map(|(level, _)| level.clone()).collect());
    let files = asset.encode().map_err(|error| refused(&error))?;
    expect_readable(&files).map_err(Failure::Refused)?;
    let record = |(level, record): (VolumeLevel, VolumeRecord)| {
        let bytes = bytes_by_part(&files, level.index);
        VolumeRecord { bytes, ..record }
    };
    let levels = built.into_iter().map(record).collect();
    Ok(Compiled { files, levels, warnings })
}

/// Whether the bytes that were read are those with the digests `wanted`, and no others.
pub(super) fn is_read_from(input: &VolumeInput, wanted: &VolumeFiles) -> bool {
    let others = input.digests.iter().map(|(key, digest)| (*key, digest.as_str()));
    let found: BTreeMap<&str, &str> = others.chain([("density", input.density_digest.as_str())]).collect();
    found.len() == wanted.len() && wanted.iter().all(|(key, digest)| found.get(key) == Some(&&*digest.to_string()))
}

/// What is to be said of a level that misses its target.
fn shortfall(record: &VolumeRecord) -> Option<String> {
    let [averages, level] = record.validation.filter(|_| record.missed())?;
    let [found, target] = [averages.min(level), record.target].map(|e| e * 100.0);
    let index = record.level;
    Some(format!("level {index} reaches an error of {found:.2} % of image means; wanted {target:.2} %"))
}

/// Fails where a reader would refuse what is about to be published.
fn expect_readable(files: &BTreeMap<String, Vec<u8>>) -> Result<(), String> {
    let fetch = &mut |name: &str| {
        let missing = || std::io::Error::from(std::io::ErrorKind::NotFound);
        files.get(name).cloned().ok_or_else(|| formats::Error::Io { path: name.into(), source: missing() })
    };
    VolumeAsset::decode(fetch).map(drop).map_err(|error| error.to_string())
}

/// Compiles level `index`.
fn build_level(
    spec: &VolumeSpec,
    input: &VolumeInput,
    fine: &Medium,
    index: usize,
    mut clock: StageClock,
    on_event: &mut dyn FnMut(Event<'_>),
) -> (VolumeLevel, VolumeRecord) {
    let (name, levels) = (spec.name.as_str(), spec.levels.len());
    clock.begin("compile");
    on_event(Event::Stage { name, level: index, levels, stage: "compile" });
    let settings = VolumeSettings {
        factor: spec.levels[index - 1] as f64,
        lobes: spec.lobes,
        clusters: spec.clusters,
        optimizer: optimizer(spec.optimizer),
        seed: spec.seed,
        ..VolumeSettings::default()
    };
    let coarse = compile(fine, &settings);
    clock.begin("encode");
    let mut level = volume_level(index as u32, input.size, &coarse.medium);
    let validation = (coarse.diagnostics.validation != [0.0; 2]).then_some(coarse.diagnostics.validation);
    level.fit = fit(&coarse);
    clock.end();
    let stage = |&(stage, cpu_seconds): &(&'static str, f64)| StageSeconds { stage: stage.into(), cpu_seconds };
    let record = VolumeRecord {
        name: name.into(),
        level: level.index,
        factor: level.factor,
        size: level.size,
        occupied: level.occupied.len(),
        lobes: level.lobes.len(),
        validation,
        target: spec.error,
        stages: clock.stages().iter().map(stage).collect(),
        bytes: BTreeMap::new(),
        peak_bytes: peak_bytes(),
    };
    if record.missed() {
        level.limited_by = Some("model".into());
    }
    (level, record)
}

/// The manifest's optimizer in the words of `prefilter`.
fn optimizer(optimizer: Optimizer) -> prefilter::Optimizer {
    match optimizer {
        Optimizer::LevenbergMarquardt => prefilter::Optimizer::LevenbergMarquardt,
        Optimizer::GradientDescent => prefilter::Optimizer::StochasticGradient,
        Optimizer::Naive => prefilter::Optimizer::None,
    }
}

/// How the fit went, for whoever inspects the asset; `null` where nothing was fitted.
fn fit(coarse: &CoarseVolume) -> serde_json::Value {
    let found = &coarse.diagnostics;
    if *found == prefilter::Diagnostics::default() {
        return serde_json::Value::Null;
    }
    json!({
        "accepted": found.is_accepted,
        "clusters": coarse.clusters.count,
        "density_factor": found.density_factor,
        "effective_share": found.effective_share,
        "eigenvalues": found.eigenvalues,
        "objective": found.objective,
        "validation": found.validation,
    })
}
