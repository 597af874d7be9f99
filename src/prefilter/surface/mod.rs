//! From a height map and its base BRDF to one coarse level: what a height map meets on its way, in this order.

pub mod additive;
pub mod baselines;
pub mod coarse;
pub mod downsample;
pub mod fine;
pub mod fit;
mod interreflection;
pub mod lobes;
pub mod published;
pub mod reflectance;
mod smoothing;
pub mod visibility;

pub use downsample::coarse_cells;

use crate::geometry::{Boundary, HeightField};
use crate::material::{Brdf, ggx_gaussians};
use additive::{AdditiveTerm, fit_additive};
use coarse::{CoarseSurface, coarse_reflectance};
use fine::SortedSurface;
use fit::{Factors, deconvolve, error_below_75, fit_scaling, full_table};
pub use interreflection::{Interreflection, ReflectionBound};
use interreflection::{NOISE_SHARE, PathSettings, SKIPPED_SHARE, interreflection, relative_bound};
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
    /// The light that the level holds.
    pub light: LightTransport,
    /// ε below 75° to aim at: the paths of interreflection go on until their noise is an eighth of it.
    pub error: f64,
    /// Seed of the paths of interreflection and of the error measurement.
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
    /// Interreflection, where the light holds any.
    pub additive: Option<AdditiveTerm>,
    /// Bound of what ε lost because interreflection was left out, where the light was to hold it.
    pub skipped_interreflection: Option<f64>,
    /// ε below 75° of the fit at the nodes of S; F of interreflection is interpolated to them.
    pub on_node: f64,
    /// Warnings for the user, one line each.
    pub warnings: Vec<String>,
}

/// Compiles one level.
///
/// The stages, named to `on_stage` as they begin: `downsample`, `lobes`, `group`, `visibility`, `fine`, `interreflect`
/// unless the light is direct or a bound shows that there is next to none, `smooth`, `coarse`, `fit`.
pub fn compile(fine: &FineSurface, settings: &LevelSettings, on_stage: &mut dyn FnMut(&'static str)) -> CoarseLevel {
    on_stage("downsample");
    let heights = downsample::downsample(&fine.heights, settings.factor);
    on_stage("lobes");
    let cells = heights.size();
    let mut lobes = lobes::fit_lobes(&fine.heights, cells, settings.lobes);
    limit_weights(&mut lobes);
    let base_color = fine.color.as_ref().map(|color| cell_colors(color, fine.heights.size(), cells));
    let patches = cells.map(|cells| settings.patches.clamp(1, cells));
    let directions = TableDirections::new(settings.directions);
    let sorted = SortedSurface::new(fine, patches, &directions, on_stage);
    let f_fine = sorted.direct(&directions, on_stage);
    let additive_directions = TableDirections::new(additive::DIRECTIONS);
    let wanted = settings.light == LightTransport::Baked;
    let bound = ReflectionBound::new(fine).filter(|_| wanted).map(|bound| relative_bound(&bound, &f_fine, &directions));
    let skipped_interreflection = bound.filter(|bound| *bound <= SKIPPED_SHARE * settings.error);
    let interreflected = (wanted && skipped_interreflection.is_none()).then(|| {
        on_stage("interreflect");
        let paths = PathSettings { noise: NOISE_SHARE * settings.error, seed: settings.seed };
        interreflection(fine, &sorted, &f_fine, patches, &additive_directions, paths)
    });
    drop(sorted);
    on_stage("smooth");
    let gaussians = fine.brdf.specular.map_or_else(Vec::new, |conductor| ggx_gaussians(conductor.alpha));
    let surface = CoarseSurface {
        heights: &heights,
        lobes: &lobes,
        base_color: base_color.as_deref(),
        brdf: &fine.brdf,
        gaussians: &gaussians,
    };
    let smoothed = smoothing::smoothed(&fine.heights, settings.factor, &surface, &f_fine, &directions);
    on_stage("coarse");
    let surface = CoarseSurface { heights: &smoothed, ..surface };
    let f_coarse = coarse_reflectance(&surface, patches, &directions);
    on_stage("fit");
    let (factors, spatial) = (1..=settings.rank)
        .rev()
        .map(|rank| {
            let factors = fit_scaling(&f_fine, &f_coarse, &directions, rank);
            let spatial = stored_spatial(&factors.spatial, patches, heights.boundary());
            (factors, spatial)
        })
        .find(|(factors, spatial)| spatial.len() == 1 || is_positive(spatial, &factors.angular))
        .expect("rank 1 is always accepted");
    let angular = factors.angular.iter().map(|s| full_table(s, directions.len())).collect();
    let fitted = interreflected.as_ref().map(|light| fit_additive(light, &smoothed, patches, &additive_directions));
    let noise = interreflected.and_then(|light| noise_warning(light.noise, settings.error));
    let warnings = scaling_warning(&factors.angular, &f_fine, &directions).into_iter().chain(noise).collect();
    let on_node = fitted.as_ref().map_or(factors.on_node, |fitted| {
        let additive = fitted.resampled(&additive_directions, &directions);
        node_error(&factors, [&f_fine, &f_coarse], &additive, &directions)
    });
    CoarseLevel {
        heights: smoothed,
        lobes,
        base_color,
        patches,
        spatial,
        directions: settings.directions,
        angular,
        additive: fitted.map(|fitted| fitted.term),
        skipped_interreflection,
        on_node,
        warnings,
    }
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

/// ε at the nodes of S with both terms; `direct` is F of the fine and the coarse surface, `additive` that of the additive
/// term and of the light that it stands for.
fn node_error(
    factors: &Factors,
    [fine, coarse]: [&PatchReflectance; 2],
    [term, light]: &[PatchReflectance; 2],
    directions: &TableDirections,
) -> f64 {
    error_below_75(fine.patch_count(), directions, |patch, channel, k| {
        let scale = |(t, s): (&Vec<[f32; 3]>, &Vec<[f32; 3]>)| t[patch][channel] * s[k][channel];
        let scale: f32 = factors.spatial.iter().zip(&factors.angular).map(scale).sum();
        let of = |f: &PatchReflectance| f.channel(patch, channel)[k];
        let wanted = of(fine) + of(light);
        [scale * of(coarse) + of(term) - wanted, wanted]
    })
}

/// T as it is stored: deconvolved, and not negative where it is the only factor.
fn stored_spatial(means: &[Vec<[f32; 3]>], patches: [usize; 2], boundary: Boundary) -> Vec<Vec<[f32; 3]>> {
    let mut stored: Vec<Vec<[f32; 3]>> = means.iter().map(|t| deconvolve(t, patches, boundary)).collect();
    if let [only] = stored.as_mut_slice() {
        // a patch that is black among bright ones asks for a negative texel
        only.iter_mut().flatten().for_each(|t| *t = t.max(0.0));
    }
    stored
}

/// Whether Σ_r T_r S_r >= 0 at every texel of T, and so at every place between them.
fn is_positive(spatial: &[Vec<[f32; 3]>], angular: &[Vec<[f32; 3]>]) -> bool {
    let texels = spatial[0].len();
    (0..angular[0].len()).all(|k| {
        (0..texels)
            .all(|p| (0..3).all(|c| spatial.iter().zip(angular).map(|(t, s)| t[p][c] * s[k][c]).sum::<f32>() >= 0.0))
    })
}

/// Largest lobe weight, and largest T or S, that is kept: half floats end at 65504.
const LARGEST_STORED: f32 = 6e4;

/// Scales the lobes of cells whose micro-area exceeds what can be stored; S takes up the common factor.
fn limit_weights(lobes: &mut [Vec<VmfLobe>]) {
    for cell in 0..lobes[0].len() {
        let largest = lobes.iter().map(|lobes| lobes[cell].weight).fold(0.0, f32::max);
        if largest > LARGEST_STORED {
            lobes.iter_mut().for_each(|lobes| lobes[cell].weight *= LARGEST_STORED / largest);
        }
    }
}

/// S above this where light matters means that f_c is far off: reported, not hidden.
const LARGEST_SCALE: f32 = 64.0;

/// A line for the user if the paths of interreflection ended with half as much noise again as they were allowed.
fn noise_warning(noise: f64, error: f64) -> Option<String> {
    (noise > 1.5 * NOISE_SHARE * error).then(|| {
        format!("interreflection is left with {:.1} % of noise: walls too steep, or a base too narrow", 100.0 * noise)
    })
}

/// A line for the user if S exceeds [`LARGEST_SCALE`] at a pair that reflects more than 1 % of the mean.
fn scaling_warning(angular: &[Vec<[f32; 3]>], fine: &PatchReflectance, directions: &TableDirections) -> Option<String> {
    let patches = fine.patch_count();
    let mean = |k: usize| (0..patches).map(|p| fine.channel(p, 1)[k]).sum::<f32>() / patches as f32;
    let overall = (0..fine.pair_count()).map(mean).sum::<f32>() / fine.pair_count() as f32;
    let (k, largest) = (0..fine.pair_count())
        .filter(|&k| mean(k) > 0.01 * overall)
        .map(|k| (k, angular.iter().map(|s| s[k][1]).sum::<f32>()))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    let i = (0..directions.len()).rfind(|&i| reflectance::pair(i, 0) <= k).unwrap_or(0);
    let [a, b] = [i, k - reflectance::pair(i, 0)].map(|d| directions.vectors[d][2].acos().to_degrees());
    (largest > LARGEST_SCALE).then(|| {
        format!("S is {largest:.0} at polar angles {a:.0}° and {b:.0}°; the lobes miss normals that reflect there")
    })
}

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
    let [u, v] = [0, 1].map(|axis| ((2 * at[axis] + 1) * patches[axis] / (2 * size[axis])).min(patches[axis] - 1));
    v * patches[0] + u
}
