//! F of light that is reflected twice or more, on the table directions (4.15–4.17).
//!
//! A path starts at a point p of a patch and goes on into the surface. Its first vertex answers for all directions ωo to
//! the viewer and every further vertex q for all directions ωi to the light, through the visibility bits of its texel, so
//! one path serves all N⁴ pairs as an outer product:
//!
//! ```text
//! b(ωo) = f(ωo, ω1) ⟨n_p, ωo⟩/⟨n_p, ωg⟩ V(p, ωo) · ⟨n_p, ω1⟩/p(ω1)
//! a(ωi) = Σ_k β_k f(ωi, −ω_k) ⟨n_q, ωi⟩ V(q, ωi),    F += a ⊗ b
//! ```
//!
//! with β_k the throughput from the first vertex on. Products are summed as a matrix product and made symmetric, for f is
//! reciprocal. Paths come in two independent halves: their difference is the noise, and there are more paths until it is
//! small enough. The directions are few, for this light is smooth: an outer product of 49 directions costs a twentieth of
//! one of 225.
//!
//! Paths start by area: a wall of 80:1 is one texel of the base in 80, and most of what light meets. ω1 is drawn for all
//! viewers at once: by the cosine, or by the visible normals of a random viewer that sees p; its density is that of the
//! mixture, so no narrow lobe is missed and none needs clamping.

mod area;
mod bound;
mod paths;
mod product;
mod vectors;

use super::FineSurface;
use super::fine::SortedSurface;
use super::reflectance::{PatchReflectance, TableDirections, pair};
use super::splits::Splits;
use super::visibility::VisibilityBits;
use crate::geometry::HeightTracer;
use area::PatchArea;
pub use bound::ReflectionBound;
pub(super) use bound::relative_bound;
use paths::{Start, trace};
use product::Products;
use rayon::prelude::*;
use std::ops::Range;
use vectors::Vectors;

/// Share of the error asked for that the paths' noise may be: root mean square over pairs of the error of the map's mean,
/// over that of F. In quadrature an eighth adds under 1 % to ε.
pub(super) const NOISE_SHARE: f64 = 0.125;

/// Share of the error asked for that interreflection is left out for, where a bound shows that it is less: in quadrature a
/// quarter adds 3 % to ε.
pub(super) const SKIPPED_SHARE: f64 = 0.25;

/// Rays of a half in the first round, over all patches.
const FIRST_RAYS: usize = 32_768;

/// Rays of a half at most, over all patches: what is noisier then stays so, and is reported.
const MOST_RAYS: usize = 1 << 20;

/// A round takes at least and at most this many times the rays of all before it.
const GROWTH: [f64; 2] = [0.25, 4.0];

/// Rays of a task: its vectors are held at once.
const TASK_RAYS: usize = 2048;

/// What the estimate needs of a surface.
struct Scene<'a> {
    fine: &'a FineSurface,
    tracer: HeightTracer<'a>,
    /// The steep texels' parts.
    splits: &'a Splits,
    /// What every slot sees of the directions.
    bits: VisibilityBits,
    /// Slot of every place.
    slot_of: Vec<u32>,
    directions: &'a TableDirections,
    patches: [usize; 2],
    /// Where paths start in each patch.
    areas: Vec<PatchArea>,
    /// Whether all channels are alike: then one stands for all.
    gray: bool,
}

/// F of light reflected twice or more.
#[derive(Clone, Debug, PartialEq)]
pub struct Interreflection {
    /// F on directions of its own.
    pub reflectance: PatchReflectance,
    /// Noise that is left: root mean square error of the map's mean over that of all F, at most.
    pub noise: f64,
}

/// What the paths are to reach.
#[derive(Clone, Copy, Debug)]
pub(super) struct PathSettings {
    /// The noise at which they end.
    pub(super) noise: f64,
    /// Seed of their random numbers.
    pub(super) seed: u64,
}

/// F of light reflected twice or more between `directions`, beside that of direct light, `direct`, on any directions.
pub(super) fn interreflection(
    fine: &FineSurface,
    sorted: &SortedSurface<'_>,
    direct: &PatchReflectance,
    patches: [usize; 2],
    directions: &TableDirections,
    settings: PathSettings,
) -> Interreflection {
    let splits = sorted.splits();
    let mut slot_of = vec![0; splits.places()];
    for (slot, &place) in sorted.slots().iter().enumerate() {
        if let Some(own) = slot_of.get_mut(place as usize) {
            *own = slot as u32;
        }
    }
    let tracer = HeightTracer::new(&fine.heights);
    let area = |patch| PatchArea::new(&fine.heights, splits, patches, patch);
    let areas = (0..patches[0] * patches[1]).map(area).collect();
    let bits = sorted.sees(directions);
    let scene = Scene { fine, tracer, splits, bits, slot_of, directions, patches, areas, gray: is_gray(fine) };
    let mut halves = [0, 1].map(|_| Sums::new(&scene));
    let signal = mean_square_of_map(direct);
    let mut rays = 0;
    let mut more = FIRST_RAYS.div_ceil(scene.patch_count());
    let most = MOST_RAYS / scene.patch_count();
    let mut noise = f64::INFINITY;
    while more > 0 {
        for (half, sums) in halves.iter_mut().enumerate() {
            sums.add_rays(&scene, rays..rays + more, settings.seed.wrapping_add(half as u64));
        }
        rays += more;
        noise = relative_noise(&halves, scene.patch_count(), signal);
        if noise <= settings.noise {
            break;
        }
        // the noise falls with the root of the rays
        let missing = ((noise / settings.noise).powi(2) - 1.0).clamp(GROWTH[0], GROWTH[1]);
        more = ((missing * rays as f64).ceil() as usize).min(most.saturating_sub(rays));
    }
    Interreflection { reflectance: mean_of(&halves, scene.patch_count()), noise }
}

/// Whether every BRDF of the surface is the same in all channels.
fn is_gray(fine: &FineSurface) -> bool {
    let alike = |rgb: [f32; 3]| rgb[0] == rgb[1] && rgb[1] == rgb[2];
    fine.color.is_none() && alike(fine.brdf.diffuse) && fine.brdf.specular.is_none_or(|conductor| alike(conductor.f0))
}

impl Scene<'_> {
    fn patch_count(&self) -> usize {
        self.patches[0] * self.patches[1]
    }

    fn channels(&self) -> usize {
        if self.gray { 1 } else { 3 }
    }
}

/// What the rays of one half have brought.
struct Sums {
    /// `[patch][part][channel]`: Σ a ⊗ b.
    products: Vec<Products>,
    channels: usize,
    /// Parts of a patch, for threads to share; a function of the number of patches alone.
    parts: usize,
    /// Rays a patch.
    rays: usize,
}

/// Tables that threads can fill at once, at least.
const TABLES: usize = 8;

impl Sums {
    fn new(scene: &Scene<'_>) -> Self {
        let (channels, parts) = (scene.channels(), TABLES.div_ceil(scene.patch_count()));
        let tables = scene.patch_count() * parts * channels;
        let products = (0..tables).map(|_| Products::new(scene.directions.len())).collect();
        Self { products, channels, parts, rays: 0 }
    }

    /// Traces the rays of these numbers in every patch.
    fn add_rays(&mut self, scene: &Scene<'_>, rays: Range<usize>, seed: u64) {
        self.rays = rays.end;
        let parts = self.parts;
        self.products.par_chunks_mut(self.channels).enumerate().for_each(|(table, products)| {
            let (patch, part) = (table / parts, table % parts);
            let starts = rays.clone().step_by(TASK_RAYS).skip(part).step_by(parts);
            for start in starts {
                let vectors = vectors_of(scene, patch, start..(start + TASK_RAYS).min(rays.end), seed);
                products.iter_mut().enumerate().for_each(|(channel, products)| products.add(&vectors, channel));
            }
        });
    }

    /// F of the pair (i, o) of a patch and channel, symmetric.
    fn value(&self, patch: usize, channel: usize, i: usize, o: usize) -> f64 {
        let tables = (0..self.parts).map(|part| &self.products[(patch * self.parts + part) * self.channels + channel]);
        tables.map(|table| table.at(i, o) + table.at(o, i)).sum::<f64>() * 0.5 / self.rays as f64
    }
}

/// Traces some rays of a patch and finds the vectors of those that met the surface.
fn vectors_of(scene: &Scene<'_>, patch: usize, rays: Range<usize>, seed: u64) -> Vectors {
    let starts = Start::of_patch(scene, patch, rays, seed);
    Vectors::new(scene, &trace(scene, &starts))
}

/// Mean square over pairs and channels of the map's mean F.
fn mean_square_of_map(f: &PatchReflectance) -> f64 {
    let (patches, pairs) = (f.patch_count(), f.pair_count());
    // N² = n directions have n(n + 1)/2 pairs
    let directions = (2.0 * pairs as f64).sqrt() as usize;
    let square = |channel: usize, k: usize| {
        let mean = (0..patches).map(|patch| f64::from(f.channel(patch, channel)[k])).sum::<f64>() / patches as f64;
        mean * mean
    };
    let of_channel = |channel: usize| {
        let all: f64 = (0..pairs).map(|k| 2.0 * square(channel, k)).sum();
        all - (0..directions).map(|i| square(channel, pair(i, i))).sum::<f64>()
    };
    (0..3).map(of_channel).sum::<f64>() / (3 * directions * directions) as f64
}

/// Root mean square over pairs and channels of half the halves' difference in the map's mean, over that of all F, whose
/// part of direct light has the mean square `direct`.
///
/// Both parts are positive, so the square of their sum is more than that of either: the quotient is at most this.
fn relative_noise(halves: &[Sums; 2], patches: usize, direct: f64) -> f64 {
    let (channels, directions) = (halves[0].channels, halves[0].products[0].directions());
    let [mut noise, mut signal] = [0.0; 2];
    for channel in 0..channels {
        for i in 0..directions {
            for o in 0..=i {
                let weight = if i == o { 1.0 } else { 2.0 };
                let [a, b] = [0, 1].map(|half: usize| {
                    (0..patches).map(|patch| halves[half].value(patch, channel, i, o)).sum::<f64>() / patches as f64
                });
                noise += weight * (0.5 * (a - b)).powi(2);
                signal += weight * (0.5 * (a + b)).powi(2);
            }
        }
    }
    let signal = signal + direct * (channels * directions * directions) as f64;
    if signal > 0.0 { (noise / signal).sqrt() } else { 0.0 }
}

/// The mean of both halves.
fn mean_of(halves: &[Sums; 2], patches: usize) -> PatchReflectance {
    let channels = halves[0].channels;
    PatchReflectance::from_fn(patches, halves[0].products[0].directions(), |patch, channel, i, o| {
        let own = channel.min(channels - 1);
        let mean = 0.5 * (halves[0].value(patch, own, i, o) + halves[1].value(patch, own, i, o));
        mean as f32
    })
}
