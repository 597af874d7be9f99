//! From a height map and its base BRDF to one coarse level: what a height map meets on its way, in this order.

pub mod coarse;
pub mod downsample;
pub mod fine;
pub mod fit;
pub mod lobes;
pub mod published;
pub mod reflectance;
pub mod visibility;

use crate::geometry::HeightField;
use crate::material::Brdf;

/// A fine surface: what is prefiltered.
#[derive(Clone, Debug)]
pub struct FineSurface {
    /// The displacement.
    pub heights: HeightField,
    /// The base BRDF, the same everywhere but for `color`.
    pub brdf: Brdf,
    /// Optional linear RGB factor of diffuse albedo and specular `f0` a texel, `[v][u]`, same size as `heights`.
    pub color: Option<Vec<[f32; 3]>>,
}

/// How one level is compiled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelSettings {
    /// Downsampling factor, at least 1; cells per axis are max(1, round(n / factor)).
    pub factor: f32,
    /// Patches of T per axis (M); never more than cells.
    pub patches: usize,
    /// Direction cells of S per axis (N).
    pub directions: usize,
    /// Rank of the factorisation, 1 to 3.
    pub rank: usize,
    /// vMF lobes a cell, 1 to 8; `None` chooses from the error of the normal distribution.
    pub lobes: Option<usize>,
    /// Seed of the error measurement.
    pub seed: u64,
}

/// One vMF lobe of a cell's normal distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VmfLobe {
    /// Mean direction μ, unit.
    pub mean: [f32; 3],
    /// Concentration κ >= 0.
    pub kappa: f32,
    /// Micro-area per base area.
    pub weight: f32,
}

/// A coarse level, before it is quantised and written.
#[derive(Clone, Debug)]
pub struct CoarseLevel {
    /// Coarse heights: as many vertices as cells.
    pub heights: HeightField,
    /// `[lobe][cell]`, by falling weight within a cell; weight 0 where a cell needs fewer.
    pub lobes: Vec<Vec<VmfLobe>>,
    /// Mean colour factor a cell, where the surface has a colour map.
    pub base_color: Option<Vec<[f32; 3]>>,
    /// Patches of T along u and v.
    pub patches: [usize; 2],
    /// T, `[rank][patch]`, RGB; read bilinearly.
    pub spatial: Vec<Vec<[f32; 3]>>,
    /// Direction cells of S per axis (N).
    pub directions: usize,
    /// S, `[rank][wo][wi]`, N² × N² directions, RGB.
    pub angular: Vec<Vec<[f32; 3]>>,
    /// ε below 75° of the fit at the nodes of its own tables.
    pub on_node: f64,
    /// CPU seconds of each stage, in order.
    pub stage_seconds: Vec<(&'static str, f64)>,
    /// Warnings for the user, one line each.
    pub warnings: Vec<String>,
}

/// Patch (row-major index) of texel or cell `at` on a grid of `size`.
pub fn patch_of(at: [usize; 2], size: [usize; 2], patches: [usize; 2]) -> usize {
    let [u, v] = [0, 1].map(|axis| ((2 * at[axis] + 1) * patches[axis] / (2 * size[axis])).min(patches[axis] - 1));
    v * patches[0] + u
}
