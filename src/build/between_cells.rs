//! Light that the cells of a level reflect to one another, which a path tracer finds by itself (`light = "global"`).
//!
//! A level under all light is F of direct light, what its cells reflect among them with f_low, and the additive term. The
//! second is found by exact paths on the coarse surface, and the third becomes what the original's interreflection has
//! beyond it. The term meets light from outside of the relief alone, so it does not take part in the second, and one step
//! is all: the fixed point is reached at once.

use formats::level_brdf::LevelBrdf;
use glam::Vec3;
use rayon::prelude::*;

use super::encode::{bare_asset, base_brdf, boundary, surface_level};
use crate::geometry::HeightTracer;
use crate::math::rng::Stream;
use crate::prefilter::surface::additive::fit_remaining;
use crate::prefilter::surface::reflectance::{PatchReflectance, TableDirections, pair, pair_count};
use crate::prefilter::surface::{CoarseLevel, FineSurface, LevelSettings};
use crate::transport::PatchSampling;
use crate::transport::bounces::{LevelReflector, bounce};
use crate::transport::effective::for_each_point;

/// Paths over all patches: their noise in the map's mean is 1 % of this light, which is a tenth of F.
const PATHS: usize = 32_768;

/// Stream of the paths.
const STREAM: u64 = 1 << 42;

/// `coarse` without the light that its cells reflect among them; a level of other light than `global` is left as it is.
pub fn without_light_between_cells(
    coarse: CoarseLevel,
    fine: &FineSurface,
    settings: &LevelSettings,
    on_stage: &mut dyn FnMut(&'static str),
) -> CoarseLevel {
    let (Some(light), Some(term)) = (&coarse.interreflection, &coarse.additive) else { return coarse };
    on_stage("between cells");
    let directions = TableDirections::new(term.directions);
    let between = light_between_cells(&coarse, fine, &directions, settings.seed);
    let additive = Some(fit_remaining(light, &between, &coarse.heights, &directions, coarse.patches));
    CoarseLevel { additive, ..coarse }
}

/// F of light that the cells of a level reflect twice or more with f_low, on `directions`.
pub fn light_between_cells(
    coarse: &CoarseLevel,
    fine: &FineSurface,
    directions: &TableDirections,
    seed: u64,
) -> PatchReflectance {
    let level = surface_level(1, &fine.heights, coarse.clone());
    let asset = bare_asset(base_brdf(&fine.brdf), boundary(fine.heights.boundary()));
    let brdf = LevelBrdf::new(&asset, &level);
    let reflector = LevelReflector { level: &brdf, cells: level.cells };
    let tracer = HeightTracer::new(&coarse.heights);
    let w: Vec<Vec3> = directions.vectors.iter().map(|&w| Vec3::from(w)).collect();
    let patches = level.patches[0] * level.patches[1];
    let strata = (PATHS as f64 / patches as f64).sqrt().ceil() as usize;
    let sums: Vec<Vec<[f64; 3]>> = (0..patches)
        .into_par_iter()
        .map(|patch| {
            let sampling = PatchSampling::of_grid(level.patches, patch, strata, seed);
            let paths = Stream::new(seed, STREAM + patch as u64);
            let mut sums = vec![[0.0; 3]; pair_count(w.len())];
            for_each_point(&tracer, &sampling, &w, |point| {
                let stream = paths.at((point.stratum as u64) << 20);
                let Some(path) = bounce(&tracer, &reflector, point, &w, stream) else { return };
                for i in 0..w.len() {
                    for o in 0..=i {
                        let reflected = path.reflected(i, o);
                        let sum = &mut sums[pair(i, o)];
                        (0..3).for_each(|c| sum[c] += reflected[c]);
                    }
                }
            });
            sums
        })
        .collect();
    let points = (strata * strata) as f64;
    PatchReflectance::from_fn(patches, w.len(), |patch, channel, i, o| {
        (sums[patch][pair(i.max(o), i.min(o))][channel] / points) as f32
    })
}
