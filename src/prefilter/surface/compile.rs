//! One level from beginning to end: the stages in their order, and which tables they work on.

use super::choice::{Choice, Scout, TableSizes, choose};
use super::coarse::{CoarseSurface, coarse_reflectance};
use super::fit::{fit_scaling, full_table, node_error};
use super::reflectance::{PatchReflectance, TableDirections};
use super::{
    CoarseLevel, FineSurface, LARGEST_STORED, LevelSettings, VmfLobe, cell_colors, downsample, lobes, reflectance,
    smoothing,
};
use crate::geometry::HeightField;
use crate::material::ggx_gaussians;

/// Compiles one level.
///
/// The stages, named to `on_stage` as they begin: `downsample`, `lobes`, `choose` where M, N or rank are to be chosen,
/// `group`, `visibility`, `fine`, `interreflect` unless the light is direct, `smooth`, `coarse`, `fit`. From `group` to
/// `coarse` they are left out where the tables that the choice was made on serve as they are, and `smooth` after a choice.
pub fn compile(fine: &FineSurface, settings: &LevelSettings, on_stage: &mut dyn FnMut(&'static str)) -> CoarseLevel {
    let parts = Parts::new(fine, settings, on_stage);
    let surface = parts.surface(fine);
    let cells = parts.heights.size();
    let scout = settings.has_choice().then(|| {
        on_stage("choose");
        Scout::new(fine, settings, &surface)
    });
    let choice = scout.as_ref().map(|scout| choose(scout, settings));
    let sizes = choice.as_ref().map_or_else(|| fixed_sizes(settings, cells), |choice| choice.sizes);
    let tables = match scout {
        Some(scout) if scout.serves(sizes, settings.light) => Tables::of_scout(scout, sizes),
        scout => Tables::new(fine, settings, &surface, sizes, scout.map(Scout::into_heights), on_stage),
    };
    on_stage("fit");
    let Tables { directions, heights, f_fine, f_coarse, noise } = tables;
    let mut factors = fit_scaling(&f_fine, &f_coarse, &directions, sizes.rank);
    let spatial = factors.stored_spatial(&f_coarse, sizes.patches, heights.boundary());
    let on_node = node_error(&f_fine, &f_coarse, &directions, &factors.spatial, &factors.angular);
    let angular = factors.angular.iter().map(|s| full_table(s, directions.len())).collect();
    let warnings = scaling_warning(&factors.angular, &f_fine, &directions).into_iter().chain(noise_warning(noise));
    let warnings = warnings.collect();
    let Choice { alternatives, predicted, .. } = choice.unwrap_or_else(|| Choice::fixed(sizes));
    CoarseLevel {
        heights,
        lobes: parts.lobes,
        base_color: parts.base_color,
        patches: sizes.patches,
        spatial,
        directions: sizes.directions,
        angular,
        on_node,
        predicted,
        alternatives,
        warnings,
    }
}

/// F of both surfaces of a level on tables of the sizes that `settings` name, as T and S are fitted to it.
pub fn level_tables(fine: &FineSurface, settings: &LevelSettings) -> LevelTables {
    let parts = Parts::new(fine, settings, &mut |_| {});
    let sizes = fixed_sizes(settings, parts.heights.size());
    let tables = Tables::new(fine, settings, &parts.surface(fine), sizes, None, &mut |_| {});
    LevelTables { directions: tables.directions, fine: tables.f_fine, coarse: tables.f_coarse }
}

/// F of both surfaces of a level.
#[derive(Clone, Debug)]
pub struct LevelTables {
    /// The directions.
    pub directions: TableDirections,
    /// F of the fine surface.
    pub fine: PatchReflectance,
    /// F of the coarse surface with f_c.
    pub coarse: PatchReflectance,
}

/// What a level consists of before its scaling.
struct Parts {
    heights: HeightField,
    lobes: Vec<Vec<VmfLobe>>,
    base_color: Option<Vec<[f32; 3]>>,
    gaussians: Vec<[f32; 2]>,
}

impl Parts {
    fn new(fine: &FineSurface, settings: &LevelSettings, on_stage: &mut dyn FnMut(&'static str)) -> Self {
        on_stage("downsample");
        let heights = downsample::downsample(&fine.heights, settings.factor);
        on_stage("lobes");
        let cells = heights.size();
        let mut lobes = lobes::fit_lobes(&fine.heights, cells, settings.lobes);
        limit_weights(&mut lobes);
        let base_color = fine.color.as_ref().map(|color| cell_colors(color, fine.heights.size(), cells));
        let gaussians = fine.brdf.specular.map_or_else(Vec::new, |conductor| ggx_gaussians(conductor.alpha));
        Self { heights, lobes, base_color, gaussians }
    }

    fn surface<'a>(&'a self, fine: &'a FineSurface) -> CoarseSurface<'a> {
        CoarseSurface {
            heights: &self.heights,
            lobes: &self.lobes,
            base_color: self.base_color.as_deref(),
            brdf: &fine.brdf,
            gaussians: &self.gaussians,
        }
    }
}

/// The sizes that `settings` name.
fn fixed_sizes(settings: &LevelSettings, cells: [usize; 2]) -> TableSizes {
    let named = "sizes are fixed where nothing is to be chosen";
    let patches = settings.patches.expect(named);
    TableSizes {
        patches: cells.map(|cells| patches.clamp(1, cells)),
        directions: settings.directions.expect(named),
        rank: settings.rank.expect(named),
    }
}

/// F of both surfaces, and the coarse heights that it was found with.
struct Tables {
    directions: TableDirections,
    heights: HeightField,
    f_fine: PatchReflectance,
    f_coarse: PatchReflectance,
    noise: f64,
}

impl Tables {
    /// The tables of these sizes; `smoothed` are the coarse heights where they are known already.
    fn new(
        fine: &FineSurface,
        settings: &LevelSettings,
        surface: &CoarseSurface<'_>,
        sizes: TableSizes,
        smoothed: Option<HeightField>,
        on_stage: &mut dyn FnMut(&'static str),
    ) -> Self {
        let directions = TableDirections::new(sizes.directions);
        let (f_fine, noise) = reflectance(fine, sizes.patches, &directions, settings, on_stage);
        let heights = smoothed.unwrap_or_else(|| {
            on_stage("smooth");
            smoothing::smoothed(&fine.heights, settings.factor, surface, &f_fine, &directions)
        });
        on_stage("coarse");
        let surface = CoarseSurface { heights: &heights, ..*surface };
        let f_coarse = coarse_reflectance(&surface, sizes.patches, &directions);
        Self { directions, heights, f_fine, f_coarse, noise }
    }

    /// The tables that a choice was made on, merged to these sizes.
    fn of_scout(scout: Scout, sizes: TableSizes) -> Self {
        let [f_fine, f_coarse] = scout.merged(sizes.patches);
        let (directions, heights) = scout.into_parts();
        Self { directions, heights, f_fine, f_coarse, noise: 0.0 }
    }
}

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

/// Noise of interreflection that goes unmentioned: what narrow lobes are allowed, and a third as much again.
const UNMENTIONED_NOISE: f64 = 0.02;

/// A line for the user if the paths of interreflection did not converge.
fn noise_warning(noise: f64) -> Option<String> {
    (noise > UNMENTIONED_NOISE).then(|| {
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
