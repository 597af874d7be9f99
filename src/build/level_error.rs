//! The error of a level as its reader sees it.
//!
//! The level comes decoded from its own bytes and is read through `formats`: T and S interpolated, every cell's own
//! lobes. At random triples (patch, ωi, ωo) F of both surfaces is found by exact ray casts; nothing of the fit's
//! machinery (visibility bits, normal bins, prototypes, table nodes) is used. Two independent halves a and b of points
//! keep the noise of the casts out of the squares: ε² = Σ d_a·d_b / Σ F_a·F_b with d = F_low − F_fine, F_low =
//! T·S·F_coarse and what the additive term brings: T_a·E·⟨ωg, ωi⟩ from every point that the viewer ωo sees.

use formats::asset::{Figure, LevelError, Light, SurfaceLevel};
use formats::{BaseBrdf, Boundary, lookup};
use glam::Vec3;
use rayon::prelude::*;

use crate::geometry::{self, HeightField, HeightTracer};
use crate::math::rng::Stream;
use crate::prefilter::surface::FineSurface;
use crate::prefilter::surface::fit::COS_75;
use crate::transport::PatchSampling;
use crate::transport::bounces::{BaseReflector, bounce};
use crate::transport::effective::{base_scatter, for_each_point};

/// What a level decoded from its own bytes is measured against.
#[derive(Clone, Copy, Debug)]
pub struct Reference<'a> {
    /// The surface at full resolution.
    pub fine: &'a FineSurface,
    /// The base BRDF as the asset holds it.
    pub bsdf: &'a BaseBrdf,
    /// Metres covered by the map.
    pub size: [f64; 2],
    /// The light that the level holds.
    pub light: Light,
    /// What lies beyond the map's rim.
    pub boundary: Boundary,
    /// ε below 75° of the fit at its own nodes, known from the fit.
    pub on_node: f64,
    /// Seed of the random triples.
    pub seed: u64,
}

/// Directions of a batch: every pair of them is a triple, so five rays a point serve ten.
const BATCH: usize = 5;

/// Triples to reach, over all patches; a level's figures then stand within a tenth of themselves.
const TRIPLES: usize = 1280;

/// Points per axis of a patch in each half: 4096 stratified points.
const STRATA: usize = 64;

/// Streams of [`Stream`] used here: directions, then two halves of points, then their paths.
const DIRECTIONS: u64 = 1 << 40;
const PATHS: u64 = 1 << 41;

/// The measured error of `level`, the level as decoded from the asset's bytes.
pub fn measure(reference: &Reference<'_>, level: &SurfaceLevel) -> LevelError {
    let coarse = coarse_field(reference, level);
    let tracers = [HeightTracer::new(&reference.fine.heights), HeightTracer::new(&coarse)];
    let patches = level.patches[0] * level.patches[1];
    let batches = TRIPLES.div_ceil(patches * BATCH * (BATCH - 1) / 2);
    let tasks: Vec<[usize; 2]> = (0..patches).flat_map(|patch| (0..batches).map(move |batch| [patch, batch])).collect();
    let triples: Vec<Triple> = tasks
        .par_iter()
        .flat_map_iter(|&[patch, batch]| measure_batch(reference, level, &tracers, patch, batch))
        .collect();
    // jackknife over patches; a map with few patches is resampled by its batches
    let group = |triple: &Triple| if patches >= 4 { triple.patch } else { triple.batch };
    let groups = if patches >= 4 { patches } else { batches };
    let below: Vec<&Triple> = triples.iter().filter(|triple| triple.below).collect();
    let above: Vec<&Triple> = triples.iter().filter(|triple| !triple.below).collect();
    let all: Vec<&Triple> = triples.iter().collect();
    LevelError {
        below_75: jackknife(&below, groups, group, epsilon),
        above_75: jackknife(&above, groups, group, epsilon),
        on_node: Figure { value: reference.on_node, standard_error: 0.0 },
        bias: jackknife(&below, groups, group, bias),
        furnace: jackknife(&all, groups, group, bias),
        reciprocity: Figure { value: reciprocity(reference, level), standard_error: 0.0 },
    }
}

/// The level's coarse surface, as its reader displaces it.
fn coarse_field(reference: &Reference<'_>, level: &SurfaceLevel) -> HeightField {
    let spacing = [0, 1].map(|k| (reference.size[k] / level.cells[k] as f64) as f32);
    let boundary = match reference.boundary {
        Boundary::Repeat => geometry::Boundary::Repeat,
        Boundary::Clamp => geometry::Boundary::Clamp,
    };
    HeightField::new(level.heights.clone(), level.cells, spacing, boundary)
}

/// F of both surfaces at one (patch, ωi, ωo), RGB, from two independent halves of points.
#[derive(Clone, Copy, Debug)]
struct Triple {
    patch: usize,
    batch: usize,
    below: bool,
    fine: [[f64; 3]; 2],
    difference: [[f64; 3]; 2],
}

/// All pairs of a batch of random directions over one patch.
fn measure_batch(
    reference: &Reference<'_>,
    level: &SurfaceLevel,
    tracers: &[HeightTracer<'_>; 2],
    patch: usize,
    batch: usize,
) -> Vec<Triple> {
    let stream = Stream::new(reference.seed, DIRECTIONS + patch as u64);
    let square = |k: usize| stream.uniform_pair((batch * BATCH + k) as u64);
    let directions: [Vec3; BATCH] = std::array::from_fn(|k| Vec3::from(lookup::direction_of(square(k))));
    let pairs: Vec<[usize; 2]> = (0..BATCH).flat_map(|i| (0..i).map(move |o| [i, o])).collect();
    let mut cells = CellCache::new(reference, level, &directions, &pairs);
    let halves = [0, 1].map(|half| {
        let seed = reference.seed ^ (2 * batch as u64 + half + 1);
        let sampling = PatchSampling::of_grid(level.patches, patch, STRATA, seed);
        let fine = fine_sums(reference, &tracers[0], &sampling, &directions, &pairs);
        let coarse = coarse_sums(level, reference.boundary, &tracers[1], &sampling, &directions, &pairs, &mut cells);
        (fine, coarse)
    });
    let triples = pairs.iter().enumerate().map(|(k, &[i, o])| Triple {
        patch,
        batch,
        below: directions[i].z > COS_75 && directions[o].z > COS_75,
        fine: [0, 1].map(|half| halves[half].0[k]),
        difference: [0, 1].map(|half| [0, 1, 2].map(|c| halves[half].1[k][c] - halves[half].0[k][c])),
    });
    triples.collect()
}

/// F of the fine surface for every pair, RGB, of the light that the level holds.
fn fine_sums(
    reference: &Reference<'_>,
    tracer: &HeightTracer<'_>,
    sampling: &PatchSampling,
    directions: &[Vec3],
    pairs: &[[usize; 2]],
) -> Vec<[f64; 3]> {
    let fine = reference.fine;
    let width = fine.heights.size()[0];
    let reflector = BaseReflector { brdf: &fine.brdf, color: fine.color.as_deref(), width };
    let paths = Stream::new(sampling.seed, PATHS + sampling.patch);
    let mut sums = vec![[0.0; 3]; pairs.len()];
    for_each_point(tracer, sampling, directions, |point| {
        let [u, v] = point.point.cell;
        let brdf = fine.color.as_ref().map_or(fine.brdf, |color| fine.brdf.tinted(color[v * width + u]));
        for (sum, &[i, o]) in sums.iter_mut().zip(pairs) {
            if point.sees(i) && point.sees(o) {
                let s = base_scatter(&brdf, point.normal, directions[i], directions[o]);
                (0..3).for_each(|c| sum[c] += f64::from(s[c]));
            }
        }
        if reference.light == Light::Direct {
            return;
        }
        let path = bounce(tracer, &reflector, point, directions, paths.at((point.stratum as u64) << 20));
        if let Some(path) = path {
            for (sum, &[i, o]) in sums.iter_mut().zip(pairs) {
                let reflected = path.reflected(i, o);
                (0..3).for_each(|c| sum[c] += reflected[c]);
            }
        }
    });
    mean(sums)
}

/// F of the coarse surface with f_low and the additive term for every pair (ωi, ωo), RGB.
fn coarse_sums(
    level: &SurfaceLevel,
    boundary: Boundary,
    tracer: &HeightTracer<'_>,
    sampling: &PatchSampling,
    directions: &[Vec3],
    pairs: &[[usize; 2]],
    cells: &mut CellCache<'_>,
) -> Vec<[f64; 3]> {
    let mut sums = vec![[0.0; 3]; pairs.len()];
    for_each_point(tracer, sampling, directions, |point| {
        let seen = point.visible()[0].count_ones();
        if seen == 0 || seen < 2 && level.additive.is_none() {
            return;
        }
        let x = point.uv.map(|x| x as f32);
        let spatial: Vec<[f32; 3]> = (0..level.spatial.len()).map(|rank| level.spatial_at(rank, x, boundary)).collect();
        let additive = level.additive_spatial_at(x, boundary);
        let [u, v] = point.point.cell;
        let scatter = cells.get(v * level.cells[0] + u);
        for (k, (sum, &[i, o])) in sums.iter_mut().zip(pairs).enumerate() {
            if point.sees(i) && point.sees(o) {
                // f_c ⟨n_c, ωi⟩⟨n_c, ωo⟩/⟨n_c, ωg⟩ = N_c/(P_c P_c) · A_c(ωi) A_c(ωo)
                let areas = point.shown_area(directions[i]) * point.shown_area(directions[o]);
                for c in 0..3 {
                    let scale: f32 = spatial.iter().zip(&cells.angular[k]).map(|(t, s)| t[c] * s[c]).sum();
                    sum[c] += f64::from(scale * scatter[k][c] * areas);
                }
            }
            if point.sees(o) {
                let areas = directions[i].z * point.shown_area(directions[o]);
                (0..3).for_each(|c| sum[c] += f64::from(additive[c] * cells.additive[k][c] * areas));
            }
        }
    });
    mean(sums)
}

fn mean(sums: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    sums.into_iter().map(|sum| sum.map(|x| x / (STRATA * STRATA) as f64)).collect()
}

/// N_c/(P_c P_c) of the cells of a patch for the pairs of a batch, found when first asked for.
struct CellCache<'a> {
    reference: &'a Reference<'a>,
    level: &'a SurfaceLevel,
    directions: [Vec3; BATCH],
    pairs: &'a [[usize; 2]],
    /// S at every pair, `[pair][rank]`.
    angular: Vec<Vec<[f32; 3]>>,
    /// E at every pair.
    additive: Vec<[f32; 3]>,
    values: std::collections::HashMap<usize, std::rc::Rc<Vec<[f32; 3]>>>,
}

impl<'a> CellCache<'a> {
    fn new(
        reference: &'a Reference<'a>,
        level: &'a SurfaceLevel,
        directions: &[Vec3; BATCH],
        pairs: &'a [[usize; 2]],
    ) -> Self {
        let w = directions.map(|w| w.to_array());
        let ranks = 0..level.angular.len();
        let angular =
            pairs.iter().map(|&[i, o]| ranks.clone().map(|rank| level.angular_at(rank, w[i], w[o])).collect());
        let additive = |&[i, o]: &[usize; 2]| level.additive.as_ref().map_or([0.0; 3], |e| e.angular_at(w[i], w[o]));
        Self {
            reference,
            level,
            directions: *directions,
            pairs,
            angular: angular.collect(),
            additive: pairs.iter().map(additive).collect(),
            values: Default::default(),
        }
    }

    fn get(&mut self, cell: usize) -> std::rc::Rc<Vec<[f32; 3]>> {
        let (level, bsdf, w) = (self.level, self.reference.bsdf, self.directions.map(|w| w.to_array()));
        let pairs = self.pairs;
        let value = self.values.entry(cell).or_insert_with(|| {
            let brdf = level.cell_brdf(cell, bsdf);
            std::rc::Rc::new(pairs.iter().map(|&[i, o]| brdf.normalised(w[i], w[o])).collect())
        });
        value.clone()
    }
}

/// √(Σ d_a·d_b / Σ F_a·F_b), RGB summed; 0 where noise makes the numerator negative.
fn epsilon(triples: &[&Triple]) -> f64 {
    let product = |pair: fn(&Triple) -> &[[f64; 3]; 2]| -> f64 {
        triples.iter().map(|&triple| (0..3).map(|c| pair(triple)[0][c] * pair(triple)[1][c]).sum::<f64>()).sum()
    };
    let (error, total) = (product(|triple| &triple.difference), product(|triple| &triple.fine));
    // max(0): two halves of an error below their noise may have a negative product
    if total > 0.0 { (error.max(0.0) / total).sqrt() } else { 0.0 }
}

/// Σ d / Σ F, RGB and halves summed.
fn bias(triples: &[&Triple]) -> f64 {
    let sum = |pair: fn(&Triple) -> &[[f64; 3]; 2]| triples.iter().flat_map(|&t| pair(t).as_flattened()).sum::<f64>();
    let total = sum(|triple| &triple.fine);
    if total > 0.0 { sum(|triple| &triple.difference) / total } else { 0.0 }
}

/// A figure over all triples, with its standard error from leaving out one group at a time.
fn jackknife(
    triples: &[&Triple],
    groups: usize,
    group: impl Fn(&Triple) -> usize,
    figure: impl Fn(&[&Triple]) -> f64,
) -> Figure {
    let value = figure(triples);
    let without = |g: usize| {
        let rest: Vec<&Triple> = triples.iter().copied().filter(|triple| group(triple) != g).collect();
        figure(&rest)
    };
    let left: Vec<f64> = (0..groups).map(without).collect();
    let n = groups as f64;
    let mean = left.iter().sum::<f64>() / n;
    let variance = (n - 1.0) / n * left.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
    Figure { value, standard_error: variance.sqrt() }
}

/// Root mean square of f(ωi, ωo) − f(ωo, ωi) over that of f, at random places and directions; f is f_low and, beside it,
/// the additive term.
fn reciprocity(reference: &Reference<'_>, level: &SurfaceLevel) -> f64 {
    const PLACES: u64 = 1000;
    let stream = Stream::new(reference.seed, DIRECTIONS - 1);
    let [mut difference, mut total] = [0.0; 2];
    for k in 0..PLACES {
        let x = stream.uniform_pair(3 * k);
        let [wi, wo] = [1, 2].map(|d| lookup::direction_of(stream.uniform_pair(3 * k + d)));
        let cell = level.cell_brdf(level.cell_at(x), reference.bsdf);
        let value = |wi, wo| {
            let (f, scale) = (cell.normalised(wi, wo), level.scaling_at(x, reference.boundary, wi, wo));
            let additive = level.additive_at(x, reference.boundary, wi, wo);
            std::array::from_fn::<_, 6, _>(|c| f64::from(if c < 3 { f[c] * scale[c] } else { additive[c - 3] }))
        };
        let (there, back) = (value(wi, wo), value(wo, wi));
        for c in 0..6 {
            difference += (there[c] - back[c]).powi(2);
            total += 0.5 * (there[c].powi(2) + back[c].powi(2));
        }
    }
    if total > 0.0 { (difference / total).sqrt() } else { 0.0 }
}
