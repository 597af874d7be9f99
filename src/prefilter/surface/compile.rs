//! One level from beginning to end: the stages in their order, and which tables they work on.

use super::additive::{self, fit_additive};
use super::choice::{Choice, TableSizes, choose};
use super::coarse::{CoarseSurface, coarse_reflectance};
use super::fine::SortedSurface;
use super::fit::{Factors, error_below_75, fit_scaling, full_table, node_error};
use super::interpolant::fit_between_nodes;
use super::interreflection::{
    Interreflection, NOISE_SHARE, PathSettings, ReflectionBound, SKIPPED_SHARE, interreflection, relative_bound,
};
use super::reflectance::{PatchReflectance, TableDirections};
use super::{
    AdditiveTerm, CoarseLevel, FineSurface, LARGEST_STORED, LevelSettings, LightTransport, VmfLobe, cell_colors,
    downsample, lobes, reflectance, smoothing,
};
use crate::geometry::HeightField;
use crate::material::{Brdf, ggx_gaussians};

/// Compiles one level: the stages below in their order, which `build` runs one by one.
///
/// The stages, named to `on_stage` as they begin: `downsample`, `lobes`, `choose` where M, N or rank are to be chosen,
/// `group`, `visibility`, `fine`, `interreflect` unless the light is direct or a bound shows that there is next to none, `smooth`, `coarse`, `fit`. From `group` to
/// `coarse` they are left out where the tables that the choice was made on serve as they are, and `smooth` after a choice.
pub fn compile(fine: &FineSurface, settings: &LevelSettings, on_stage: &mut dyn FnMut(&'static str)) -> CoarseLevel {
    let parts = Parts::new(fine, settings, on_stage);
    let surface = parts.surface(fine);
    let choice = choose(fine, settings, &surface, on_stage);
    let f_fine = fine_tables(fine, &choice, settings, on_stage);
    let heights = coarse_heights(&fine.heights, &choice, settings, &surface, &f_fine, on_stage);
    let f_coarse = coarse_table(&choice, &CoarseSurface { heights: &heights, ..surface }, on_stage);
    on_stage("fit");
    let fit = fit_level(&f_fine, &f_coarse, &heights, choice.sizes, settings.error);
    CoarseLevel::new(heights, parts.lobes, parts.base_color, choice, fit)
}

/// F of both surfaces of a level under direct light, as T and S are fitted to it, on tables of the sizes that `settings`
/// name or leave to be chosen.
pub fn level_tables(fine: &FineSurface, settings: &LevelSettings) -> LevelTables {
    let settings = LevelSettings { light: LightTransport::Direct, ..*settings };
    let parts = Parts::new(fine, &settings, &mut |_| {});
    let surface = parts.surface(fine);
    let choice = choose(fine, &settings, &surface, &mut |_| {});
    let f_fine = fine_tables(fine, &choice, &settings, &mut |_| {});
    let heights = coarse_heights(&fine.heights, &choice, &settings, &surface, &f_fine, &mut |_| {});
    let coarse = coarse_table(&choice, &CoarseSurface { heights: &heights, ..surface }, &mut |_| {});
    LevelTables { directions: TableDirections::new(choice.sizes.directions), fine: f_fine.direct, coarse }
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
        let heights = level_heights(&fine.heights, settings.factor);
        on_stage("lobes");
        let cells = heights.size();
        let lobes = level_lobes(&fine.heights, cells, settings.lobes);
        let base_color = fine.color.as_ref().map(|color| cell_colors(color, fine.heights.size(), cells));
        Self { heights, lobes, base_color, gaussians: base_gaussians(&fine.brdf) }
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

/// The heights of a level, before they are smoothed.
pub fn level_heights(fine: &HeightField, factor: f32) -> HeightField {
    downsample::downsample(fine, factor)
}

/// The lobes of a level of `cells` cells, `[lobe][cell]`, in weights that can be stored.
pub fn level_lobes(fine: &HeightField, cells: [usize; 2], count: Option<usize>) -> Vec<Vec<VmfLobe>> {
    let mut lobes = lobes::fit_lobes(fine, cells, count);
    limit_weights(&mut lobes);
    lobes
}

/// The spherical Gaussians of a base BRDF's normal distribution; none for a diffuse one.
pub fn base_gaussians(brdf: &Brdf) -> Vec<[f32; 2]> {
    brdf.specular.map_or_else(Vec::new, |conductor| ggx_gaussians(conductor.alpha))
}

/// F of the fine surface.
#[derive(Clone, Debug, PartialEq)]
pub struct FineTables {
    /// Of direct light, on the directions of S.
    pub direct: PatchReflectance,
    /// Of light reflected twice or more, on the directions of E, where the level holds it.
    pub interreflection: Option<Interreflection>,
    /// Bound of what ε loses where the level was to hold it, and it is left out.
    pub skipped_interreflection: Option<f64>,
}

/// F of the fine surface on tables of the chosen sizes.
pub fn fine_tables(
    fine: &FineSurface,
    choice: &Choice,
    settings: &LevelSettings,
    on_stage: &mut dyn FnMut(&'static str),
) -> FineTables {
    if let Some([f_fine, _]) = &choice.tables {
        return FineTables { direct: f_fine.clone(), interreflection: None, skipped_interreflection: None };
    }
    let TableSizes { patches, directions, .. } = choice.sizes;
    let directions = TableDirections::new(directions);
    let sorted = SortedSurface::new(fine, patches, &directions, on_stage);
    let direct = sorted.direct(&directions, on_stage);
    let wanted = settings.light != LightTransport::Direct;
    let bound = ReflectionBound::new(fine).filter(|_| wanted).map(|bound| relative_bound(&bound, &direct, &directions));
    let skipped_interreflection = bound.filter(|bound| *bound <= SKIPPED_SHARE * settings.error);
    let interreflection = (wanted && skipped_interreflection.is_none()).then(|| {
        on_stage("interreflect");
        let directions = TableDirections::new(additive::DIRECTIONS);
        let paths = PathSettings { noise: NOISE_SHARE * settings.error, seed: settings.seed };
        interreflection(fine, &sorted, &direct, patches, &directions, paths)
    });
    FineTables { direct, interreflection, skipped_interreflection }
}

/// The heights of a level: those of `surface`, or smoother ones where they fold.
pub fn coarse_heights(
    fine: &HeightField,
    choice: &Choice,
    settings: &LevelSettings,
    surface: &CoarseSurface<'_>,
    f_fine: &FineTables,
    on_stage: &mut dyn FnMut(&'static str),
) -> HeightField {
    choice.heights.clone().unwrap_or_else(|| {
        on_stage("smooth");
        let directions = TableDirections::new(choice.sizes.directions);
        smoothing::smoothed(fine, settings.factor, surface, &f_fine.direct, &directions)
    })
}

/// F of the coarse surface under direct light, on tables of the chosen sizes.
pub fn coarse_table(
    choice: &Choice,
    surface: &CoarseSurface<'_>,
    on_stage: &mut dyn FnMut(&'static str),
) -> PatchReflectance {
    if let Some([_, f_coarse]) = &choice.tables {
        return f_coarse.clone();
    }
    on_stage("coarse");
    coarse_reflectance(surface, choice.sizes.patches, &TableDirections::new(choice.sizes.directions))
}

/// The tables of a level as they are stored.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelFit {
    /// T, `[rank][patch]`, RGB; read bilinearly.
    pub spatial: Vec<Vec<[f32; 3]>>,
    /// S, `[rank][wo][wi]`, N² × N² directions, RGB.
    pub angular: Vec<Vec<[f32; 3]>>,
    /// Interreflection, where the light holds any.
    pub additive: Option<AdditiveTerm>,
    /// Bound of what ε lost because interreflection was left out, where the light was to hold it.
    pub skipped_interreflection: Option<f64>,
    /// ε below 75° of the fit at the nodes of S, before S is made right between them; F of interreflection is interpolated to
    /// them.
    pub on_node: f64,
    /// Warnings for the user, one line each.
    pub warnings: Vec<String>,
}

/// Fits T and S to F of direct light, T_a and E to the rest; `heights` are the coarse ones, `error` is what was aimed at.
pub fn fit_level(
    f_fine: &FineTables,
    f_coarse: &PatchReflectance,
    heights: &HeightField,
    sizes: TableSizes,
    error: f64,
) -> LevelFit {
    let FineTables { direct, interreflection, skipped_interreflection } = f_fine;
    let directions = TableDirections::new(sizes.directions);
    let mut factors = fit_scaling(direct, f_coarse, &directions, sizes.rank);
    let on_node = node_error(direct, f_coarse, &directions, &factors.spatial, &factors.angular);
    let few = TableDirections::new(additive::DIRECTIONS);
    let fitted = interreflection.as_ref().map(|light| fit_additive(light, heights, sizes.patches, &few));
    let on_node = fitted.as_ref().map_or(on_node, |fitted| {
        let additive = fitted.resampled(&few, &directions);
        node_error_of_both(&factors, [direct, f_coarse], &additive, &directions)
    });
    if bend(direct, f_coarse, &directions) > STRAIGHT {
        fit_between_nodes(&mut factors.angular, f_coarse, &directions);
    }
    let spatial = factors.stored_spatial(f_coarse, sizes.patches, heights.boundary());
    let noise = interreflection.as_ref().and_then(|light| noise_warning(light.noise, error));
    LevelFit {
        spatial,
        on_node,
        additive: fitted.map(|fitted| fitted.term),
        skipped_interreflection: *skipped_interreflection,
        warnings: scaling_warning(&factors.angular, direct, &directions).into_iter().chain(noise).collect(),
        angular: factors.angular.iter().map(|s| full_table(s, directions.len())).collect(),
    }
}

/// What linear interpolation of S costs below which its nodes stay where they are, over F.
///
/// Between the nodes F is had from a cubic, which overshoots under lobes as narrow as their distance: of a plane with α = 0.02,
/// whose S should be 1 and bends by 0.8 % for f_c's own error, it would move nodes by 5 %. Diffuse levels, fbm and twill with
/// α = 0.3 bend by 0.1 to 0.6 % and gain nothing; silk with 0.3 and twill with 0.1 by 1.7 and 2.0 %.
const STRAIGHT: f64 = 0.01;

/// What linear interpolation costs of S between the nodes, mean over the map.
fn bend(f_fine: &PatchReflectance, f_coarse: &PatchReflectance, directions: &TableDirections) -> f64 {
    let all: Vec<usize> = (0..directions.len()).collect();
    let [fine, coarse] = [f_fine, f_coarse].map(|f| smoothing::means(f, &all));
    smoothing::interpolation_error(&fine, &coarse, directions.resolution)
}

/// ε at the nodes of S with both terms; `direct` is F of the fine and the coarse surface, `additive` that of the additive
/// term and of the light that it stands for.
fn node_error_of_both(
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

impl CoarseLevel {
    /// A level of the results of its stages.
    pub fn new(
        heights: HeightField,
        lobes: Vec<Vec<VmfLobe>>,
        base_color: Option<Vec<[f32; 3]>>,
        choice: Choice,
        fit: LevelFit,
    ) -> Self {
        let Choice { sizes, predicted, alternatives, .. } = choice;
        let LevelFit { spatial, angular, additive, skipped_interreflection, on_node, warnings } = fit;
        Self {
            heights,
            lobes,
            base_color,
            patches: sizes.patches,
            spatial,
            directions: sizes.directions,
            angular,
            additive,
            skipped_interreflection,
            on_node,
            predicted,
            alternatives,
            warnings,
        }
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
