//! The figures of a verification: what `report.json` holds, documented in `docs/report.md`.
//!
//! The order of the fields is that of the keys. Whatever depends on how fast a machine is stands in members named
//! `timing`: without them, the document is a function of inputs, settings and version.

use formats::asset::Figure;
use serde::Serialize;

use super::equal_time::{EqualTime, LevelTiming};
use super::metrics::{Halves, Interval, RelativeMse, mean_error, relative_mse};
use super::summary::ModelSummary;

/// Version of the document's schema. A key that is added leaves it as it is; one that changes or goes raises it.
pub const SCHEMA: u32 = 1;

/// A light that every level is seen under.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub enum Light {
    /// A rectangle above the surface.
    #[serde(rename = "area")]
    Area,
    /// An image of the surroundings.
    #[serde(rename = "image")]
    Image,
    /// A distant light low over the surface.
    #[serde(rename = "grazing directional")]
    Grazing,
}

/// A direction that every level is seen from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub enum View {
    /// Along the normal.
    #[serde(rename = "normal")]
    Normal,
    /// 45° from the normal.
    #[serde(rename = "45°")]
    Oblique,
    /// 80° from the normal.
    #[serde(rename = "80°")]
    Grazing,
}

/// What is drawn in place of the original.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Model {
    /// The level: T · S · f_c over the coarse heights.
    Farfield,
    /// The level without its scaling: f_c over the coarse heights.
    Lobes,
    /// One Beckmann lobe from the moments of the slopes.
    Leadr,
    /// The base BRDF over the coarse heights.
    Naive,
}

impl Light {
    /// All lights, in the order of the report.
    pub const ALL: [Self; 3] = [Self::Area, Self::Image, Self::Grazing];

    /// As `report.json` and `report.html` call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Area => "area",
            Self::Image => "image",
            Self::Grazing => "grazing directional",
        }
    }
}

impl View {
    /// All views, in the order of the report.
    pub const ALL: [Self; 3] = [Self::Normal, Self::Oblique, Self::Grazing];

    /// As `report.json` and `report.html` call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Oblique => "45°",
            Self::Grazing => "80°",
        }
    }

    /// Degrees between the view and the normal of the base plane.
    pub fn degrees(self) -> f64 {
        match self {
            Self::Normal => 0.0,
            Self::Oblique => 45.0,
            Self::Grazing => 80.0,
        }
    }
}

impl Model {
    /// All models, ours first.
    pub const ALL: [Self; 4] = [Self::Farfield, Self::Lobes, Self::Leadr, Self::Naive];

    /// As `report.json` calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Farfield => "farfield",
            Self::Lobes => "lobes",
            Self::Leadr => "leadr",
            Self::Naive => "naive",
        }
    }

    /// As a text calls it: LEADR is an abbreviation, the others are words.
    pub fn title(self) -> &'static str {
        if self == Self::Leadr { "LEADR" } else { self.name() }
    }
}

/// A comparison of assets with what they were made from.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verification {
    /// [`SCHEMA`].
    pub schema: u32,
    /// Version of the program.
    pub farfield_version: String,
    /// What was asked for.
    pub settings: Settings,
    /// The assets, in the order of the manifest.
    pub assets: Vec<AssetVerification>,
    /// What it took.
    pub timing: Cost,
}

/// CPU seconds of all threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Cost {
    /// Seconds.
    pub cpu_seconds: f64,
}

/// What a verification was asked for. The number of threads is not here: no figure depends on it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// Width and height of every image, pixels.
    pub image_size: [u32; 2],
    /// Samples a pixel of either half of a model's image.
    pub samples_per_half: u32,
    /// Samples a pixel of either half of a reference.
    pub reference_samples_per_half: u32,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Levels that were asked for; `None` is all of them.
    pub levels: Option<Vec<u32>>,
    /// The lights.
    pub lights: Vec<LightSetting>,
    /// The views.
    pub views: Vec<ViewSetting>,
    /// Pixels a degree of the viewing angle, for FLIP.
    pub flip_pixels_per_degree: f64,
}

/// A light in words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LightSetting {
    /// Which one.
    pub light: Light,
    /// Size, direction, radiance.
    pub description: String,
}

/// A view in words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewSetting {
    /// Which one.
    pub view: View,
    /// Camera, distance, field of view.
    pub description: String,
}

/// One asset.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AssetVerification {
    /// Name in the manifest.
    pub name: String,
    /// BLAKE3 of its `asset.json`, hex; that file names the digest of every other.
    pub asset_digest: String,
    /// Light transport that the asset stands for, as in `asset.json`.
    pub light: String,
    /// Canonical settings of its build, as in `asset.json`.
    pub surface_settings: serde_json::Value,
    /// What the original was read from.
    pub sources: Vec<SourceFile>,
    /// Its levels, fine to coarse.
    pub levels: Vec<LevelVerification>,
}

/// A file that the original was read from.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SourceFile {
    /// `height` or `color`.
    pub role: String,
    /// BLAKE3 of its bytes, hex.
    pub digest: String,
    /// Width and height, texels.
    pub size: [u32; 2],
}

/// One level of an asset.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelVerification {
    /// Number of the level, from 1.
    pub index: u32,
    /// Source texels a cell along u and v.
    pub factor: [f64; 2],
    /// Cells along u and v.
    pub cells: [usize; 2],
    /// ε below 75° as the asset records it, if it does.
    pub epsilon_below_75: Option<Figure>,
    /// Every model over all cases: [`super::summary::summaries`] of `cases`.
    pub summary: Vec<ModelSummary>,
    /// Every light and view.
    pub cases: Vec<Case>,
    /// Error against time, for some of the cases.
    pub equal_time: Vec<EqualTime>,
    /// The verdict of `equal_time`: [`LevelTiming::of`] it.
    pub timing: LevelTiming,
}

/// One light and view of a level.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Case {
    /// The light.
    pub light: Light,
    /// The view.
    pub view: View,
    /// φ, the root of a pixel's footprint on the base surface in source texels.
    pub footprint_texels: f64,
    /// Mean of the reference over pixels and RGB, linear radiance.
    pub reference_mean: Interval,
    /// Noise of the reference relative to its energy; `None` where it is black.
    pub reference_noise: Option<f64>,
    /// Factor on radiance before sRGB in the pictures and in FLIP, the same for all models.
    pub exposure: f64,
    /// The models.
    pub models: Vec<ModelResult>,
    /// CPU seconds of the reference, both halves.
    pub timing: Cost,
}

/// One model against the reference of its case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelResult {
    /// The model.
    pub model: Model,
    /// Samples a pixel of either half.
    pub samples_per_half: u32,
    /// Mean over pixels and RGB, linear radiance.
    pub mean: Interval,
    /// Relative error of the mean; `None` where the reference is black.
    pub mean_error: Option<Interval>,
    /// Relative mean square error in its parts; `None` where the reference is black.
    pub relative_mse: Option<RelativeMse>,
    /// Mean FLIP of the mean of both halves, 0 to 1.
    pub flip: f64,
    /// CPU seconds, both halves.
    pub timing: Cost,
}

impl ModelResult {
    /// The figures of a model's halves, each of `samples_per_half`, against those of the reference.
    pub fn measured(model: Model, samples_per_half: u32, images: [Halves; 2], flip: f64, timing: Cost) -> Self {
        let [reference, image] = images;
        Self {
            model,
            samples_per_half,
            mean: image.mean(),
            mean_error: mean_error(reference, image),
            relative_mse: relative_mse(reference, image),
            flip,
            timing,
        }
    }
}

impl Verification {
    /// The text of `report.json`.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("every key is a string") + "\n"
    }
}
