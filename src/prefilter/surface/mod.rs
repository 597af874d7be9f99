//! From a height map and its base BRDF to one coarse level: what a height map meets on its way, in this order.

pub mod additive;
pub mod baselines;
mod choice;
pub mod coarse;
mod compile;
pub mod downsample;
pub mod fine;
pub mod fit;
mod interpolant;
mod interreflection;
pub mod lobes;
pub mod published;
pub mod reflectance;
mod smoothing;
pub mod splits;
pub mod visibility;

pub use choice::{Alternative, Choice, TableSizes, choose};
pub use compile::{
    FineTables, LevelFit, LevelTables, base_gaussians, coarse_heights, coarse_table, compile, fine_tables, fit_level,
    level_heights, level_lobes, level_tables,
};
pub use downsample::coarse_cells;

use crate::geometry::HeightField;
use crate::material::Brdf;
use additive::AdditiveTerm;
use fine::SortedSurface;
pub use interreflection::{Interreflection, ReflectionBound};
use interreflection::{NOISE_SHARE, PathSettings, interreflection};
use reflectance::{PatchReflectance, TableDirections};

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

/// The light that a level's scaling holds; asset.json says which.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightTransport {
    /// Shadowing and masking of direct light.
    Direct,
    /// Interreflection within the surface as well, in a term of its own: the level under direct light is the original
    /// under all light.
    Baked,
    /// The same, for who draws the level under all light (design 4.8): its cells do not light one another, for f_low is 0
    /// below the horizon of the base, so nothing counts twice.
    Global,
}

/// How one level is compiled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelSettings {
    /// Downsampling factor, at least 1; cells per axis are max(1, round(n / factor)).
    pub factor: f32,
    /// Patches of T per axis (M), never more than cells; `None` chooses by the error.
    pub patches: Option<usize>,
    /// Direction cells of S per axis (N); `None` chooses by the error.
    pub directions: Option<usize>,
    /// Rank of the factorisation, 1 to 3; `None` chooses by the error.
    pub rank: Option<usize>,
    /// vMF lobes a cell, 1 to 8; `None` chooses from the error of the normal distribution.
    pub lobes: Option<usize>,
    /// The light that the level holds.
    pub light: LightTransport,
    /// ε below 75° to aim at, by the choice of sizes and by the paths of interreflection, whose noise may be an eighth of it.
    pub error: f64,
    /// Seed of the paths of interreflection and of the error measurement.
    pub seed: u64,
}

impl LevelSettings {
    /// The sizes of the tables of a level of so many cells, unless M, N or rank are to be chosen.
    pub fn fixed_sizes(&self, cells: [usize; 2]) -> Option<TableSizes> {
        let patches = self.patches?;
        let patches = cells.map(|cells| patches.clamp(1, cells));
        Some(TableSizes { patches, directions: self.directions?, rank: self.rank? })
    }
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
    /// Interreflection, where the light holds any.
    pub additive: Option<AdditiveTerm>,
    /// Bound of what ε lost because interreflection was left out, where the light was to hold it.
    pub skipped_interreflection: Option<f64>,
    /// ε below 75° of the fit at the nodes of S, before S is made right between them; F of interreflection is interpolated to
    /// them.
    pub on_node: f64,
    /// ε below 75° that was predicted when the tables' sizes were chosen; `None` where nothing was.
    pub predicted: Option<f64>,
    /// What other sizes of the tables would have given, the chosen one among them; empty where nothing was chosen.
    pub alternatives: Vec<Alternative>,
    /// Warnings for the user, one line each.
    pub warnings: Vec<String>,
}

/// F of the fine surface on `directions`: of direct light, and of light reflected twice or more.
pub fn reflectance(
    fine: &FineSurface,
    patches: [usize; 2],
    directions: &TableDirections,
    settings: &LevelSettings,
) -> (PatchReflectance, Interreflection) {
    let sorted = SortedSurface::new(fine, patches, directions, &mut |_| ());
    let direct = sorted.direct(directions, &mut |_| ());
    let paths = PathSettings { noise: NOISE_SHARE * settings.error, seed: settings.seed };
    let interreflected = interreflection(fine, &sorted, &direct, patches, directions, paths);
    (direct, interreflected)
}

/// Largest lobe weight, and largest T or S, that is kept: half floats end at 65504.
const LARGEST_STORED: f32 = 6e4;

/// Area-weighted mean colour of every cell; texels that straddle a border count in proportion.
pub fn cell_colors(color: &[[f32; 3]], size: [usize; 2], cells: [usize; 2]) -> Vec<[f32; 3]> {
    (0..cells[0] * cells[1])
        .map(|cell| {
            let at = [cell % cells[0], cell / cells[0]];
            let spans = [0, 1].map(|axis| overlaps(at[axis], cells[axis], size[axis]));
            let mut sum = [0.0_f64; 4];
            for &(v, wv) in &spans[1] {
                for &(u, wu) in &spans[0] {
                    let texel = color[v * size[0] + u];
                    (0..3).for_each(|k| sum[k] += wu * wv * f64::from(texel[k]));
                    sum[3] += wu * wv;
                }
            }
            [0, 1, 2].map(|k| (sum[k] / sum[3]) as f32)
        })
        .collect()
}

/// Texels that cell `at` of `cells` covers along an axis of `texels`, and the overlap of each.
fn overlaps(at: usize, cells: usize, texels: usize) -> Vec<(usize, f64)> {
    let bound = |k: usize| k as f64 * texels as f64 / cells as f64;
    let (start, end) = (bound(at), bound(at + 1));
    (start.floor() as usize..(end.ceil() as usize).min(texels))
        .map(|texel| (texel, end.min(texel as f64 + 1.0) - start.max(texel as f64)))
        .collect()
}

/// Patch (row-major index) of texel or cell `at` on a grid of `size`.
pub fn patch_of(at: [usize; 2], size: [usize; 2], patches: [usize; 2]) -> usize {
    let [u, v] = [0, 1].map(|axis| patch_along(at[axis], size[axis], patches[axis]));
    v * patches[0] + u
}

/// Patch of texel or cell `at` of `size` along one axis.
fn patch_along(at: usize, size: usize, patches: usize) -> usize {
    ((2 * at + 1) * patches / (2 * size)).min(patches - 1)
}
