//! A scene of the manifest that shows a volume, with everything it needs from disk.

use std::path::Path;

use formats::VolumeAsset;

use super::super::ScenePlan;
use super::super::manifest::{ObjectSpec, VolumeSpec};
use super::super::models::Model;
use super::super::stage::{StageError, asset_folder, camera_and_lights, unreadable_asset};
use super::encode::medium_of;
use super::input;
use crate::medium::Medium;
use crate::transport::camera::Camera;
use crate::transport::light::Lights;
use crate::transport::volume::{Backdrop, VolumeLevel, VolumeObject, VolumeScene};

/// What a scene with a volume is made of; [`VolumeStage::scene`] lends it to the renderer.
#[derive(Debug)]
pub struct VolumeStage {
    levels: Vec<StagedLevel>,
    /// Geometric mean of the edges of a source voxel, metres.
    voxel: f64,
    camera: Camera,
    lights: Lights,
    /// What the user should know, one line each.
    pub warnings: Vec<String>,
}

/// A level in memory.
#[derive(Debug)]
struct StagedLevel {
    /// Number of the level; 0 is the source.
    index: u32,
    /// Source voxels an edge: the geometric mean of the three axes.
    factor: f64,
    medium: Medium,
}

impl VolumeStage {
    /// Reads what `plan` needs with `model` for its volume; assets are in `out`.
    pub fn read(plan: &ScenePlan, model: Model, out: &Path) -> Result<Self, StageError> {
        let senseless = |what: String| StageError::Senseless { scene: plan.scene.name.clone(), what };
        let spec = match plan.scene.objects.first() {
            Some(ObjectSpec::Volume { volume }) => plan.volumes.iter().find(|spec| spec.name == *volume),
            _ => None,
        };
        let spec = spec.ok_or_else(|| senseless("shows no volume of the manifest; wanted one".into()))?;
        let mut warnings = Vec::new();
        let levels = match model {
            Model::Full => vec![read_source(spec, &plan.folder, &mut warnings)?],
            Model::Farfield => read_levels(spec, out)?,
            Model::Naive | Model::Lobes | Model::Leadr => {
                let name = model.name();
                return Err(senseless(format!(
                    "shows a volume, which has no model `{name}`; wanted `farfield` or `full`"
                )));
            }
        };
        let (camera, lights) = camera_and_lights(plan, &mut warnings)?;
        Ok(Self { levels, voxel: mean_edge(spec.voxel), camera, lights, warnings })
    }

    /// Numbers of the levels, fine to coarse.
    pub fn indices(&self) -> impl Iterator<Item = u32> + '_ {
        self.levels.iter().map(|level| level.index)
    }

    /// Columns and rows of the film.
    pub fn film(&self) -> [usize; 2] {
        self.camera.size()
    }

    /// The scene, ready to be rendered.
    pub fn scene(&self) -> VolumeScene<'_> {
        let levels = self.levels.iter().map(|level| VolumeLevel { factor: level.factor, medium: &level.medium });
        VolumeScene {
            camera: self.camera,
            lights: self.lights.clone(),
            volume: VolumeObject::new(levels.collect(), self.voxel),
            backdrop: Backdrop::Lights,
        }
    }
}

/// Geometric mean of three edges.
fn mean_edge(edges: [f64; 3]) -> f64 {
    edges.iter().product::<f64>().cbrt()
}

/// The volume at full resolution.
fn read_source(spec: &VolumeSpec, folder: &Path, warnings: &mut Vec<String>) -> Result<StagedLevel, StageError> {
    let input = input::read(spec, folder).map_err(|error| StageError::Unreadable(error.to_string()))?;
    warnings.extend(input.warnings.iter().map(|text| format!("volume `{}`: {text}", spec.name)));
    Ok(StagedLevel { index: 0, factor: 1.0, medium: input.medium() })
}

/// The levels of the volume's asset in `out`.
fn read_levels(spec: &VolumeSpec, out: &Path) -> Result<Vec<StagedLevel>, StageError> {
    let name = spec.name.as_str();
    let folder = asset_folder(name, out)?;
    let asset = VolumeAsset::read(&folder).map_err(|error| unreadable_asset(name, &folder, &error))?;
    let fits = asset.levels.iter().all(|level| level.lobes.len() <= crate::medium::MAX_LOBES);
    if asset.levels.is_empty() || !fits {
        let most = crate::medium::MAX_LOBES;
        let line = format!("{}: wanted levels, of at most {most} lobes; build it anew", folder.display());
        return Err(StageError::Unreadable(line));
    }
    let level = |level: &formats::VolumeLevel| StagedLevel {
        index: level.index,
        factor: mean_edge(level.factor),
        medium: medium_of(&asset, level),
    };
    let mut levels: Vec<StagedLevel> = asset.levels.iter().map(level).collect();
    // A tiny volume ends before its last factor does.
    levels.dedup_by(|coarse, fine| coarse.factor <= fine.factor);
    Ok(levels)
}
