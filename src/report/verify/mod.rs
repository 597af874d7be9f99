//! The comparison itself: original and models rendered side by side, level by level.
//!
//! Every image is two halves of independent samples. Model and reference share nothing but the scene: their random numbers
//! are different, so that the noise of one says nothing of the other.

mod level;
pub(super) mod setups;
mod timed;

use std::path::Path;

use formats::asset::SurfaceAsset;

use self::level::LevelRun;
use self::setups::Subject;
use super::flip::PIXELS_PER_DEGREE;
use super::html::Pictures;
use super::verification::{
    AssetVerification, Cost, LevelVerification, Light, SCHEMA, Settings, SourceFile, Verification, View,
};
use crate::build::clock::cpu_seconds;
use crate::build::key::Digest;
use crate::build::models::ModelData;
use crate::build::{Plan, SurfaceSpec, stage};

/// How much is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VerifySettings {
    /// Width and height of the images in pixels.
    pub size: usize,
    /// Samples a pixel of either half of an image.
    pub samples_per_half: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The one level to verify; `None` is all.
    pub level: Option<u32>,
}

/// What happens during a verification.
#[derive(Clone, Copy, Debug)]
pub enum VerifyEvent<'a> {
    /// An image is about to be rendered.
    Image {
        /// Surface.
        name: &'a str,
        /// Number of the level.
        level: u32,
        /// Light and view.
        case: (Light, View),
        /// `full` or a model.
        model: &'a str,
    },
    /// A level begins.
    Level {
        /// Surface.
        name: &'a str,
        /// Number of the level.
        level: u32,
    },
    /// Something the user should know.
    Warning {
        /// Surface.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
    /// A surface cannot be verified.
    Failed {
        /// Surface.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
    /// A level is done.
    Done {
        /// Surface.
        name: &'a str,
        /// Its figures.
        level: &'a LevelVerification,
    },
}

/// A verification with its pictures, and how many surfaces could not be verified.
#[derive(Debug)]
pub struct Verified {
    /// The figures.
    pub verification: Verification,
    /// The pictures.
    pub pictures: Pictures,
    /// Surfaces without figures.
    pub failed: usize,
}

/// Compares the assets of `plan` in `out` with their originals.
pub fn verify(
    plan: &Plan,
    out: &Path,
    settings: &VerifySettings,
    on_event: &mut dyn FnMut(VerifyEvent<'_>),
) -> Verified {
    let started = cpu_seconds();
    let mut pictures = Pictures::default();
    let mut assets = Vec::new();
    let mut failed = 0;
    for spec in &plan.surfaces {
        match Surface::read(spec, &plan.folder, out, on_event) {
            Ok(surface) => assets.push(surface.verify(settings, &mut pictures, on_event)),
            Err(text) => {
                failed += 1;
                on_event(VerifyEvent::Failed { name: &spec.name, text: &text });
            }
        }
    }
    let verification = Verification {
        schema: SCHEMA,
        farfield_version: env!("CARGO_PKG_VERSION").into(),
        settings: settings.written(),
        assets,
        timing: Cost { cpu_seconds: cpu_seconds() - started },
    };
    Verified { verification, pictures, failed }
}

impl VerifySettings {
    /// As the report states them.
    fn written(&self) -> Settings {
        Settings {
            image_size: [self.size as u32; 2],
            samples_per_half: self.samples_per_half,
            reference_samples_per_half: self.samples_per_half,
            seed: self.seed,
            levels: self.level.map(|level| vec![level]),
            lights: setups::light_settings(),
            views: setups::view_settings(),
            flip_pixels_per_degree: f64::from(PIXELS_PER_DEGREE),
        }
    }
}

/// Original, asset and baselines of one surface.
struct Surface {
    name: String,
    asset: SurfaceAsset,
    asset_digest: String,
    sources: Vec<SourceFile>,
    subject: Subject,
    full: ModelData,
    models: [ModelData; 4],
}

impl Surface {
    fn read(
        spec: &SurfaceSpec,
        folder: &Path,
        out: &Path,
        on_event: &mut dyn FnMut(VerifyEvent<'_>),
    ) -> Result<Self, String> {
        let (asset, asset_digest) = stage::read_asset(&spec.name, out).map_err(|error| error.to_string())?;
        let input = crate::build::input::read(spec, folder).map_err(|error| error.to_string())?;
        for text in &input.warnings {
            on_event(VerifyEvent::Warning { name: &spec.name, text });
        }
        if asset.source.digest != input.height_digest.to_string() {
            return Err(format!(
                "the asset in `{}` was built from another height map than `{}` is now; wanted `farfield build {}` first",
                out.join(&spec.name).display(),
                spec.height,
                spec.name
            ));
        }
        let texels = input.fine.heights.size();
        let subject = Subject::new(spec, &input.fine.heights);
        let source = |role: &str, digest: Digest| SourceFile {
            role: role.into(),
            digest: digest.to_string(),
            size: texels.map(|n| n as u32),
        };
        let mut sources = vec![source("height", input.height_digest)];
        sources.extend(input.color_digest.iter().map(|&digest| source("color", digest)));
        let cells: Vec<[usize; 2]> = asset.levels.iter().map(|level| level.cells).collect();
        let models = [
            ModelData::farfield(asset.clone()),
            ModelData::lobes(&asset),
            ModelData::leadr(&input, &cells),
            ModelData::naive(&input, &cells),
        ];
        Ok(Self {
            name: spec.name.clone(),
            asset,
            asset_digest,
            sources,
            subject,
            full: ModelData::full(&input),
            models,
        })
    }

    fn verify(
        &self,
        settings: &VerifySettings,
        pictures: &mut Pictures,
        on_event: &mut dyn FnMut(VerifyEvent<'_>),
    ) -> AssetVerification {
        let wanted = |index: u32| settings.level.is_none_or(|level| level == index);
        let places = (0..self.asset.levels.len()).filter(|&place| wanted(self.asset.levels[place].index));
        let levels = places
            .map(|place| {
                on_event(VerifyEvent::Level { name: &self.name, level: self.asset.levels[place].index });
                let level = LevelRun { surface: self, place, settings }.verify(pictures, on_event);
                on_event(VerifyEvent::Done { name: &self.name, level: &level });
                level
            })
            .collect();
        AssetVerification {
            name: self.name.clone(),
            asset_digest: self.asset_digest.clone(),
            light: self.asset.light.name().into(),
            surface_settings: self.asset.settings.clone(),
            sources: self.sources.clone(),
            levels,
        }
    }
}
