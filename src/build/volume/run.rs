//! The build of a volume: read, compile level by level, encode, publish.

use std::collections::BTreeMap;
use std::path::Path;

use formats::asset::DOCUMENT;
use formats::{VolumeAsset, VolumeLevel};
use serde::Serialize;
use serde_json::json;

use super::super::clock::{StageClock, peak_bytes};
use super::super::encode::{bytes_by_part, is_payload};
use super::super::manifest::{Optimizer, VolumeSpec};
use super::super::{Event, StageSeconds};
use super::encode::{volume_asset, volume_level};
use super::input::{VolumeInput, read};
use crate::io::publish::Publisher;
use crate::medium::Medium;
use crate::prefilter::volume::{self as prefilter, CoarseVolume, VolumeSettings, compile};

/// One built level of a volume: what it cost and reached.
#[derive(Clone, Debug, PartialEq, Serialize)]
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

/// Builds and publishes one volume; the error is one line.
pub(in crate::build) fn build_volume(
    spec: &VolumeSpec,
    folder: &Path,
    out: &Path,
    publisher: &Publisher,
    on_event: &mut dyn FnMut(Event<'_>),
) -> Result<Vec<VolumeRecord>, String> {
    let (name, levels) = (spec.name.as_str(), spec.levels.len());
    let mut clock = StageClock::default();
    clock.begin("read");
    on_event(Event::Stage { name, level: 0, levels, stage: "read" });
    let input = read(spec, folder).map_err(|error| error.to_string())?;
    for text in &input.warnings {
        on_event(Event::VolumeWarning { name, text });
    }
    let fine = input.medium();
    clock.end();
    let mut built = Vec::with_capacity(levels);
    for index in 1..=levels {
        // Reading is counted with the first level.
        built.push(build_level(spec, &input, &fine, index, std::mem::take(&mut clock), on_event));
    }
    on_event(Event::Stage { name, level: levels, levels, stage: "publish" });
    let asset = volume_asset(spec, &input, built.iter().map(|(level, _)| level.clone()).collect());
    let files = asset.encode().map_err(|error| error.to_string())?;
    expect_readable(&files)?;
    publisher.folder(&out.join(name), &files, DOCUMENT, is_payload).map_err(|error| error.to_string())?;
    let record = |(level, record): (VolumeLevel, VolumeRecord)| {
        let bytes = bytes_by_part(&files, level.index);
        VolumeRecord { bytes, ..record }
    };
    Ok(built.into_iter().map(record).collect())
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
        let found = record.validation.map_or(0.0, |[averages, level]| averages.min(level));
        let [found, target] = [found, spec.error].map(|e| e * 100.0);
        let text = format!("level {index} reaches an error of {found:.2} % of image means; wanted {target:.2} %");
        on_event(Event::VolumeWarning { name, text: &text });
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
