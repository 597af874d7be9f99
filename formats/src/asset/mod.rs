//! A surface asset as plain arrays: what the files of one folder say.
//!
//! [`SurfaceAsset::encode`] gives the bytes of every file, [`SurfaceAsset::read`] and [`SurfaceAsset::decode`] take
//! them apart again and refuse whatever is not exactly as written, [`SurfaceLevel::f_low`] is what it all stands for.

pub(crate) mod decode;
pub(crate) mod document;
mod encode;
mod evaluate;
pub(crate) mod folder;
mod payload;

pub use folder::PayloadFile;
pub use payload::{quantised, quantised_lobe};

use crate::cell_brdf::{BaseBrdf, Lobe};
use crate::lookup::Boundary;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the format that this crate writes, and the only one that it reads.
pub const VERSION: u32 = 1;

/// Name of the file that names all others.
pub const DOCUMENT: &str = "asset.json";

/// What an asset is made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A displacement map: [`SurfaceAsset`].
    Surface,
    /// A cloud of microflakes: [`crate::VolumeAsset`].
    Volume,
}

impl Kind {
    /// The kind of the asset whose `asset.json` has these bytes.
    pub fn of(document: &[u8]) -> Result<Self, crate::Error> {
        match document::parse_preamble(document)?.kind.as_str() {
            "surface" => Ok(Self::Surface),
            "volume" => Ok(Self::Volume),
            other => Err(crate::Error::malformed(DOCUMENT, "`kind`", "surface or volume", other)),
        }
    }
}

/// Largest magnitude that a half float payload may hold; halves end at 65504.
pub const MAX_HALF: f32 = 6e4;

/// Largest ln(1 + κ) of a lobe.
pub const MAX_LOG_KAPPA: f32 = 20.0;

/// Most levels of an asset.
pub const MAX_LEVELS: usize = 32;
/// Most cells of a level along one axis, and most texels of a source.
pub const MAX_CELLS: usize = 16384;
/// Most lobes of a cell.
pub const MAX_LOBES: usize = 8;
/// Most terms Σ_r T_r·S_r.
pub const MAX_RANK: usize = 8;
/// Most patches along one axis.
pub const MAX_PATCHES: usize = 1024;
/// Most direction cells along one axis of the concentric square (N); S then has N⁴ texels.
pub const MAX_DIRECTIONS: usize = 63;

/// A prefiltered surface: its coarse levels and where they come from.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceAsset {
    /// Name in the manifest.
    pub name: String,
    /// Which transport the scaling holds, and so which one a renderer adds.
    pub light: Light,
    /// Metres covered by the map along u and v.
    pub size: [f64; 2],
    /// What lies beyond the map's rim.
    pub boundary: Boundary,
    /// The height map that was compiled.
    pub source: Source,
    /// Base BRDF of the micro-surface.
    pub bsdf: BaseBrdf,
    /// Settings of the build, canonical; not needed to read the asset.
    pub settings: serde_json::Value,
    /// Version of each stage that made the asset.
    pub versions: BTreeMap<String, String>,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Instruction set of the float kernels; bytes are equal within one.
    pub isa: String,
    /// Levels from fine to coarse.
    pub levels: Vec<SurfaceLevel>,
}

/// Which light transport the scaling function accounts for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Light {
    /// Shadowing and masking of direct light.
    Direct,
    /// Light reflected within the surface as well: the level under direct light is the original under all light. What
    /// was reflected more than once is the level's [`AdditiveTerm`].
    Baked,
    /// What light between the level's cells does not bring already: the level under all light, as a path tracer finds it,
    /// is the original under all light. The additive term is met by light from outside of the relief alone.
    Global,
}

impl Light {
    /// As asset.json calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Direct => "direct",
            Self::Baked => "baked",
            Self::Global => "global",
        }
    }
}

/// The height map behind an asset.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// BLAKE3 of the file's bytes, 64 hex digits.
    pub digest: String,
    /// Texels along u.
    pub width: u32,
    /// Texels along v.
    pub height: u32,
}

/// One coarse level, complete in itself.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceLevel {
    /// Number of the level, from 1; 0 is the source.
    pub index: u32,
    /// Source texels a cell along u and v.
    pub factor: [f64; 2],
    /// Cells along u and v; as many height vertices.
    pub cells: [usize; 2],
    /// Heights of the vertices in metres above the base plane, `[v][u]`.
    pub heights: Vec<f32>,
    /// Normal distributions, `[lobe][cell]`; weight 0 where a cell uses fewer.
    pub lobes: Vec<Vec<Lobe>>,
    /// Mean colour factor a cell, `[cell]`, linear RGB; `None` is 1.
    pub base_color: Option<Vec<[f32; 3]>>,
    /// Patches of T along u and v.
    pub patches: [usize; 2],
    /// T, `[rank][patch]`, RGB; no unit.
    pub spatial: Vec<Vec<[f32; 3]>>,
    /// Direction cells along one axis of the concentric square (N).
    pub directions: usize,
    /// S, `[rank][wo·N² + wi]`, RGB; no unit.
    pub angular: Vec<Vec<[f32; 3]>>,
    /// Light that the relief reflects within itself before it leaves, where the tables hold any.
    pub additive: Option<AdditiveTerm>,
    /// Bound of what leaving interreflection out costs the relative error, where it was left out because that is little.
    pub skipped_interreflection: Option<f64>,
    /// Measured error, if it was measured.
    pub error: Option<LevelError>,
    /// What kept the level from its target, if anything.
    pub limited_by: Option<String>,
    /// What other sizes of T and S would have given, where these were chosen by their error.
    pub alternatives: Vec<Alternative>,
}

/// Sizes of T and S that were considered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Alternative {
    /// Patches of T along u and v.
    #[serde(rename = "M")]
    pub patches: [usize; 2],
    /// Direction cells of S per axis.
    #[serde(rename = "N")]
    pub directions: usize,
    /// Terms of the scaling.
    pub rank: usize,
    /// Predicted relative root mean square error of F under direct light, both directions below 75°, over one grid of
    /// patches for all alternatives.
    pub error: f64,
    /// Bytes of T and S before compression.
    pub bytes: u64,
}

/// Light that a relief reflects within itself before it leaves: T_a(x)·E(ωi, ωo), a BRDF of the **base plane**.
///
/// It meets light with the cosine of the base plane, and the relief does not shadow it: what comes in at the top leaves
/// again wherever the relief is seen, from walls that see no light themselves too. No BRDF of the displaced surface can
/// do that.
#[derive(Clone, Debug, PartialEq)]
pub struct AdditiveTerm {
    /// Direction cells along one axis of the concentric square (N_a).
    pub directions: usize,
    /// T_a, `[patch]` with the level's patches, RGB >= 0; no unit.
    pub spatial: Vec<[f32; 3]>,
    /// E, `[wo·N_a² + wi]`, RGB >= 0; 1/sr.
    pub angular: Vec<[f32; 3]>,
}

/// The error of a level as measured through its own bytes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LevelError {
    /// Relative root mean square error of F, both directions below 75°, off the nodes.
    pub below_75: Figure,
    /// The same with at least one direction above 75°.
    pub above_75: Figure,
    /// The same at the nodes of the tables: a diagnostic of the fit.
    pub on_node: Figure,
    /// Σ(F_low − F) / ΣF.
    pub bias: Figure,
    /// White furnace: effective albedo minus 1, or over the original's minus 1.
    pub furnace: Figure,
    /// Relative residual of F(ωi, ωo) = F(ωo, ωi).
    pub reciprocity: Figure,
}

/// A measured number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// The estimate.
    pub value: f64,
    /// Its standard error.
    pub standard_error: f64,
}

impl LevelError {
    /// The figures with their names in `asset.json`.
    pub fn figures(&self) -> [(&'static str, Figure); 6] {
        [
            ("below_75", self.below_75),
            ("above_75", self.above_75),
            ("on_node", self.on_node),
            ("bias", self.bias),
            ("furnace", self.furnace),
            ("reciprocity", self.reciprocity),
        ]
    }
}
