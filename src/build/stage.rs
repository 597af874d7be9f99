//! A scene of the manifest with everything it needs from disk: model, lights, camera, large shape.

use std::path::{Path, PathBuf};

use formats::asset::{DOCUMENT, SurfaceAsset};
use glam::DVec3;

use super::manifest::{CameraSpec, Displacement, LightSpec, ObjectSpec, Projection};
use super::models::{Model, ModelData};
use super::{Input, ScenePlan, SurfaceSpec, encode, input};
use crate::geometry::{Boundary, HeightField, LargeShape};
use crate::io::environment::decode_environment;
use crate::io::heights::decode_heights;
use crate::io::{Error, SourceFile};
use crate::prefilter::surface::coarse_cells;
use crate::transport::camera::{self, Camera};
use crate::transport::light::{AreaLight, ConstantLight, DirectionalLight, ImageLight, Light, Lights};
use crate::transport::render::Integrator;
use crate::transport::scene::Scene;

/// What a scene is made of; [`Stage::scene`] lends it to the renderer.
#[derive(Debug)]
pub struct Stage {
    model: ModelData,
    light: formats::asset::Light,
    camera: Camera,
    lights: Lights,
    tiles: [u32; 2],
    large: Option<LargeShape>,
    /// What the user should know, one line each.
    pub warnings: Vec<String>,
}

/// Why a scene cannot be drawn, as one line.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StageError {
    /// Something on disk is not what it should be.
    #[error("{0}")]
    Unreadable(String),
    /// The scene makes no sense.
    #[error("scene `{scene}`: {what}")]
    Senseless {
        /// Name of the scene.
        scene: String,
        /// What was found, and what was wanted.
        what: String,
    },
}

impl From<Error> for StageError {
    fn from(error: Error) -> Self {
        Self::Unreadable(error.to_string())
    }
}

impl Stage {
    /// Reads what `plan` needs with `model` for its surface; assets are in `out`.
    pub fn read(plan: &ScenePlan, model: Model, out: &Path) -> Result<Self, StageError> {
        let senseless = |what: &str| StageError::Senseless { scene: plan.scene.name.clone(), what: what.into() };
        let object = plan.scene.objects.first().ok_or_else(|| senseless("has no object; wanted one"))?;
        let ObjectSpec::Surface(object) = object else { return Err(senseless("shows a volume; wanted a surface")) };
        let spec = plan.surfaces.iter().find(|spec| spec.name == object.surface);
        let spec = spec.ok_or_else(|| senseless("names a surface that the manifest does not have"))?;
        let mut warnings = Vec::new();
        let (model, light) = read_model(spec, &plan.folder, model, out, &mut warnings)?;
        let extent = [0, 1].map(|k| spec.size[k] * f64::from(object.tiling[k]));
        let large = match &object.displacement {
            None => None,
            Some(displacement) => Some(read_large(displacement, &plan.folder, extent)?),
        };
        let (camera, lights) = camera_and_lights(plan, &mut warnings)?;
        let stage = Self { model, light, camera, lights, tiles: object.tiling, large, warnings };
        let is_parallel = matches!(plan.scene.camera.projection, Projection::Orthographic { .. });
        if !is_parallel && !stage.scene().camera_is_outside() {
            return Err(senseless("the camera is inside the surface; wanted a `position` above it"));
        }
        Ok(stage)
    }

    /// The model of the surface.
    pub fn model(&self) -> &ModelData {
        &self.model
    }

    /// The integrator that shows the light which the surface's asset stands for.
    pub fn integrator(&self) -> Integrator {
        self.model.integrator(self.light)
    }

    /// Columns and rows of the film.
    pub fn film(&self) -> [usize; 2] {
        self.camera.size()
    }

    /// The scene, ready to be rendered.
    pub fn scene(&self) -> Scene<'_> {
        Scene {
            camera: self.camera,
            lights: self.lights.clone(),
            surface: self.model.object(self.tiles, self.large.as_ref()),
        }
    }
}

/// The model of a surface, from its source or its asset, and the light that its levels hold.
fn read_model(
    spec: &SurfaceSpec,
    folder: &Path,
    model: Model,
    out: &Path,
    warnings: &mut Vec<String>,
) -> Result<(ModelData, formats::asset::Light), StageError> {
    let source = |warnings: &mut Vec<String>| -> Result<Input, StageError> {
        let input = input::read(spec, folder).map_err(|error| StageError::Unreadable(error.to_string()))?;
        warnings.extend(input.warnings.iter().map(|text| format!("surface `{}`: {text}", spec.name)));
        Ok(input)
    };
    let cells = |input: &Input| -> Vec<[usize; 2]> {
        let size = input.fine.heights.size();
        spec.levels.iter().map(|level| coarse_cells(size, level.factor)).collect()
    };
    let wanted = encode::light(spec.light());
    Ok(match model {
        Model::Full => (ModelData::full(&source(warnings)?), wanted),
        Model::Naive | Model::Leadr => {
            let input = source(warnings)?;
            let cells = cells(&input);
            let data = if model == Model::Naive { ModelData::naive } else { ModelData::leadr };
            (data(&input, &cells), wanted)
        }
        Model::Farfield | Model::Lobes => {
            let asset = read_asset(&spec.name, out)?.0;
            let light = asset.light;
            (if model == Model::Farfield { ModelData::farfield(asset) } else { ModelData::lobes(&asset) }, light)
        }
    })
}

/// The asset of the surface `name` in `out`, and the BLAKE3 of its document.
pub fn read_asset(name: &str, out: &Path) -> Result<(SurfaceAsset, String), StageError> {
    let folder = asset_folder(name, out)?;
    let document = SourceFile::read(&folder.join(DOCUMENT))?;
    let digest = blake3::hash(document.bytes()).to_hex().to_string();
    let asset = SurfaceAsset::read(&folder).map_err(|error| unreadable_asset(name, &folder, &error))?;
    Ok((asset, digest))
}

/// The folder of the asset `name` in `out`, if there is one.
pub(super) fn asset_folder(name: &str, out: &Path) -> Result<PathBuf, StageError> {
    let folder: PathBuf = out.join(name);
    let path = folder.join(DOCUMENT);
    if path.exists() {
        return Ok(folder);
    }
    let line = format!("`{}`: is not there; wanted the asset of `{name}`: `farfield build {name}`", path.display());
    Err(StageError::Unreadable(line))
}

/// What is wrong with the asset `name` in `folder`.
pub(super) fn unreadable_asset(name: &str, folder: &Path, error: &formats::Error) -> StageError {
    StageError::Unreadable(match error {
        formats::Error::Io { .. } => format!("asset `{name}`: {error}"),
        _ => format!("{}: {error}; build it anew with `farfield build {name}`", folder.display()),
    })
}

/// The large shape of `displacement` over `extent` metres.
fn read_large(displacement: &Displacement, folder: &Path, extent: [f64; 2]) -> Result<LargeShape, StageError> {
    let file = SourceFile::read(&folder.join(&displacement.file))?;
    let raw = decode_heights(&file, displacement.channel.as_deref())?;
    let metres = |value: &f32| (displacement.offset + displacement.amplitude * f64::from(*value)) as f32;
    let size = [raw.width, raw.height];
    let spacing = [0, 1].map(|k| (extent[k] / size[k] as f64) as f32);
    let heights: Vec<f32> = raw.values.iter().map(metres).collect();
    if let Some(i) = heights.iter().position(|h| !h.is_finite()) {
        let texel = [i % size[0], i / size[0]];
        let line = format!(
            "`{}`: the height of texel ({}, {}) overflows; wanted a smaller `amplitude`",
            displacement.file, texel[0], texel[1]
        );
        return Err(StageError::Unreadable(line));
    }
    Ok(LargeShape::new(HeightField::new(heights, size, spacing, Boundary::Clamp)))
}

/// The camera and the lights of a scene.
pub(super) fn camera_and_lights(plan: &ScenePlan, warnings: &mut Vec<String>) -> Result<(Camera, Lights), StageError> {
    let lights: Result<Vec<Light>, StageError> =
        plan.scene.lights.iter().map(|light| read_light(light, &plan.folder, warnings)).collect();
    let lights = Lights::new(lights?);
    let camera = camera(&plan.scene.camera, plan.scene.film).ok_or_else(|| StageError::Senseless {
        scene: plan.scene.name.clone(),
        what: "the camera looks nowhere; wanted another `target` or `up`".into(),
    })?;
    Ok((camera, lights))
}

/// The camera of a scene.
fn camera(spec: &CameraSpec, film: [usize; 2]) -> Option<Camera> {
    let projection = match spec.projection {
        Projection::Perspective { fov_degrees } => {
            camera::Projection::Perspective { tan_half_fov: (0.5 * fov_degrees.to_radians()).tan() }
        }
        Projection::Orthographic { width } => camera::Projection::Orthographic { width },
    };
    let [position, target, up] = [spec.position, spec.target, spec.up].map(DVec3::from_array);
    Camera::look_at(position, target, up, projection, film)
}

/// A light of a scene.
fn read_light(spec: &LightSpec, folder: &Path, warnings: &mut Vec<String>) -> Result<Light, StageError> {
    Ok(match spec {
        LightSpec::Directional { direction, irradiance } => Light::Directional(DirectionalLight {
            direction: DVec3::from_array(*direction).as_vec3().normalize(),
            irradiance: *irradiance,
        }),
        LightSpec::Constant { radiance } => Light::Constant(ConstantLight { radiance: *radiance }),
        LightSpec::Area { position, target, up, size, radiance } => {
            let [position, target, up] = [*position, *target, *up].map(DVec3::from_array);
            Light::Area(AreaLight::facing(position, target, Some(up), *size, *radiance))
        }
        LightSpec::Image { file, scale, rotation_degrees } => {
            let source = SourceFile::read(&folder.join(file))?;
            let environment = decode_environment(&source)?;
            if environment.negative_count > 0 {
                warnings.push(format!("`{file}`: {} negative values were taken as 0", environment.negative_count));
            }
            let size = [environment.width, environment.height];
            Light::Image(ImageLight::new(environment.texels, size, *scale as f32, rotation_degrees.to_radians()))
        }
    })
}
