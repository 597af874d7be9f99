//! Paths from the camera: direct light by multiple importance sampling, and what bounces after it.
//!
//! One sample of a pixel is one path. At each hit one light is sampled and one direction of the BRDF; what either finds is
//! weighted by the power heuristic (Veach 1997). `Direct` stops after the first hit's light, `Path` goes on along the
//! BRDF's direction with Russian roulette. An area light ends the paths that meet its front; it reflects nothing.
//!
//! A level's additive term is a second BRDF of its hits, that of the base plane: it has the same light sample and a
//! direction of its own, and shadow rays that start above the relief. Only what comes from outside of the relief meets
//! it: a path that has stayed inside comes from below the horizon of the base, where term and f_low are 0. On a large
//! shape `Path` goes on along either BRDF.

use std::ops::Range;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::film::Film;
use super::sampler::{Sampler, Sampling};
use super::scene::{Lod, RenderLevel, Scene, direction_in_base, direction_in_world};
use super::shading::{Bounce, BoundShading};
use crate::geometry::{PlaneHit, Ray};
use formats::level_brdf::BoundAdditive;

/// Which light is counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integrator {
    /// Light that comes straight from a source to the first hit.
    Direct,
    /// All light, however often it bounces.
    Path,
}

/// How a scene is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderSettings {
    /// Which light is counted.
    pub integrator: Integrator,
    /// Which level paths meet.
    pub lod: Lod,
    /// Seed of all random numbers.
    pub seed: u64,
    /// How the samples of a pixel are spread.
    pub sampling: Sampling,
}

/// Bounces before Russian roulette.
const SURE_BOUNCES: u32 = 3;
/// Largest probability to go on: an albedo of 1 must not trap a path.
const MAX_SURVIVAL: f32 = 0.95;

/// Adds the samples `samples` to every pixel of `film`, whose size is that of the scene's camera.
///
/// Each pixel is a function of the settings and its place alone: any number of threads gives the same bits.
///
/// # Panics
/// If the film has another size than the camera's.
pub fn render(scene: &Scene<'_>, settings: &RenderSettings, samples: Range<u64>, film: &mut Film) {
    let [width, height] = film.size();
    assert_eq!([width, height], scene.camera.size(), "the film is the camera's");
    film.pixels.par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
        for (column, pixel) in pixels.iter_mut().enumerate() {
            for sample in samples.clone() {
                let index = (row * width + column) as u64;
                let sampler = Sampler::new(settings.sampling, settings.seed, index, sample);
                let radiance = Path { scene, settings, sampler }.radiance(column, row);
                (0..3).for_each(|c| pixel[c].add(f64::from(radiance[c])));
            }
        }
    });
}

/// Share of paths on a large shape that go on along the additive term: it brings less than f_low but on white walls.
const ADDITIVE_SHARE: f32 = 0.25;

/// First group of numbers of the additive term, beyond those of any path.
const ADDITIVE_GROUPS: u32 = 1 << 15;

/// One path under way.
struct Path<'s, 'a> {
    scene: &'s Scene<'a>,
    settings: &'s RenderSettings,
    sampler: Sampler,
}

/// A hit on a level and the BRDF there, in the base frame.
struct Vertex<'s> {
    hit: PlaneHit,
    shading: BoundShading<'s>,
    /// The additive term, at the first hit of a level that has one.
    additive: Option<BoundAdditive<'s>>,
    /// Where it is in the world.
    world: DVec3,
}

/// Where a path goes on to.
struct Next {
    wi: Vec3,
    /// BRDF times cosine over density.
    weight: Vec3,
    /// Light met on the way, weighted against the light samples.
    emitted: Vec3,
    /// The surface, unless a light was met before it.
    hit: Option<PlaneHit>,
}

impl<'s, 'a> Path<'s, 'a> {
    /// Radiance along a random ray of the pixel.
    fn radiance(&self, column: usize, row: usize) -> Vec3 {
        let [dx, dy, level_u, _] = self.sampler.four(0);
        let camera = self.scene.camera_ray(column as f64 + f64::from(dx), row as f64 + f64::from(dy));
        let level = self.scene.surface.level(&camera, self.settings.lod, level_u);
        let ray = camera.ray();
        let hit = level.plane.intersect(&ray);
        let seen = self.emitted(ray, hit.map_or(f64::INFINITY, |hit| hit.t));
        match hit {
            Some(hit) if seen == Vec3::ZERO => self.reflected(level, hit, -ray.direction),
            _ => seen,
        }
    }

    /// Light that leaves `hit` towards `wo`, over as many bounces as the integrator counts.
    fn reflected(&self, level: &'s RenderLevel<'a>, mut hit: PlaneHit, mut wo: Vec3) -> Vec3 {
        let size = level.plane.tile().heights().size();
        let [mut sum, mut throughput] = [Vec3::ZERO, Vec3::ONE];
        for bounce in 0.. {
            // The underside and what is cut open at a rim are black.
            if hit.normal.dot(wo) <= 0.0 {
                break;
            }
            let shading = level.shading.at(&hit, size, wo);
            let additive = level.shading.additive_at(&hit, size, wo);
            let vertex = Vertex { hit, shading, additive, world: self.scene.point_in_world(hit.position) };
            let [a, b, choice, survive] = self.sampler.four(2 * bounce + 1);
            let [c, d, e, f] = self.sampler.four(2 * bounce + 2);
            sum += throughput * self.light_sample(level, &vertex, choice, [a, b]);
            if let Some(additive) = &vertex.additive {
                // one of the camera's four numbers is left
                let u = if bounce == 0 { [f, self.sampler.four(0)[3]] } else { [f, self.above_relief(bounce)[0]] };
                sum += throughput * self.light_along_additive(level, &vertex, additive, u);
            }
            if self.settings.integrator == Integrator::Direct {
                sum += throughput * self.light_along_brdf(level, &vertex, [c, d, e]);
                break;
            }
            let Some(next) = self.next_hit(level, &vertex, bounce, [c, d, e]) else { break };
            throughput *= next.weight;
            sum += throughput * next.emitted;
            let Some(again) = next.hit else { break };
            if bounce >= SURE_BOUNCES {
                let survival = throughput.max_element().min(MAX_SURVIVAL);
                if survive >= survival {
                    break;
                }
                throughput /= survival;
            }
            (hit, wo) = (again, -next.wi);
        }
        sum
    }

    /// Numbers of the additive term at a bounce, beside those of all others.
    fn above_relief(&self, bounce: u32) -> [f32; 4] {
        self.sampler.four(ADDITIVE_GROUPS + bounce)
    }

    /// Where the path goes on: along f_low, or along the additive term where anything but the relief can be met.
    fn next_hit(&self, level: &RenderLevel<'_>, vertex: &Vertex<'_>, bounce: u32, u: [f32; 3]) -> Option<Next> {
        let Some(additive) = vertex.additive.as_ref().filter(|_| level.plane.large().is_some()) else {
            return self.next_bounce(level, vertex, u);
        };
        let [_, a, b, choice] = self.above_relief(bounce);
        let (next, share) = if choice < ADDITIVE_SHARE {
            (self.next_above_relief(level, vertex, additive, [a, b])?, ADDITIVE_SHARE)
        } else {
            (self.next_bounce(level, vertex, u)?, 1.0 - ADDITIVE_SHARE)
        };
        Some(Next { weight: next.weight / share, ..next })
    }

    /// A direction of the additive term, and what of the surface it meets: lights are [`Self::light_along_additive`]'s.
    fn next_above_relief(
        &self,
        level: &RenderLevel<'_>,
        vertex: &Vertex<'_>,
        additive: &BoundAdditive<'_>,
        u: [f32; 2],
    ) -> Option<Next> {
        let sample = additive.sample(u)?;
        let wi = Vec3::from(sample.wi);
        let hit = level.plane.intersect_above_relief(&vertex.hit, wi)?;
        let (distance, seen) = self.scene.lights.met(vertex.world, direction_in_world(wi));
        if seen != [0.0; 3] && distance < hit.t {
            return None;
        }
        let weight = Vec3::from(sample.f) * (Vec3::from(additive.normal()).dot(wi) / sample.pdf);
        Some(Next { wi, weight, emitted: Vec3::ZERO, hit: Some(hit) })
    }

    /// A direction of the BRDF at `vertex`, the light that it meets and where it goes on.
    fn next_bounce(&self, level: &RenderLevel<'_>, vertex: &Vertex<'_>, u: [f32; 3]) -> Option<Next> {
        let Bounce { wi, pdf, value } = vertex.shading.sample(u)?;
        let cosine = vertex.hit.normal.dot(wi);
        if cosine <= 0.0 {
            return None;
        }
        let hit = level.plane.intersect_from(&vertex.hit, wi);
        let ray = Ray { origin: vertex.hit.position, direction: wi };
        let seen = self.emitted(ray, hit.map_or(f64::INFINITY, |hit| hit.t));
        let weight = value * (cosine / pdf);
        if seen == Vec3::ZERO {
            return Some(Next { wi, weight, emitted: seen, hit });
        }
        let emitted = seen * power_heuristic(pdf, self.light_pdf(vertex, wi));
        Some(Next { wi, weight, emitted, hit: None })
    }

    /// The light that a direction of the BRDF meets, if nothing is between: what `Direct` needs of [`Self::next_bounce`].
    ///
    /// Most directions meet no light, which is known before the BRDF is evaluated and a ray cast.
    fn light_along_brdf(&self, level: &RenderLevel<'_>, vertex: &Vertex<'_>, u: [f32; 3]) -> Vec3 {
        if self.scene.lights.are_all_delta() {
            return Vec3::ZERO;
        }
        let Some(wi) = vertex.shading.sample_direction(u) else { return Vec3::ZERO };
        let cosine = vertex.hit.normal.dot(wi);
        if cosine <= 0.0 {
            return Vec3::ZERO;
        }
        let towards = direction_in_world(wi);
        let (distance, seen) = self.scene.lights.met(vertex.world, towards);
        if seen == [0.0; 3] {
            return Vec3::ZERO;
        }
        let (value, pdf) = vertex.shading.eval_pdf(wi);
        if pdf <= 0.0 || value == Vec3::ZERO || level.plane.occluded(&vertex.hit, wi, distance) {
            return Vec3::ZERO;
        }
        value * Vec3::from(seen) * (cosine / pdf * power_heuristic(pdf, self.light_pdf(vertex, wi)))
    }

    /// Density with which light samples at `vertex` propose `wi`.
    fn light_pdf(&self, vertex: &Vertex<'_>, wi: Vec3) -> f32 {
        self.scene.lights.pdf(vertex.world, direction_in_world(wi))
    }

    /// What one sample of one light brings to the viewer of `vertex`.
    fn light_sample(&self, level: &RenderLevel<'_>, vertex: &Vertex<'_>, choice: f32, u: [f32; 2]) -> Vec3 {
        let Some(sample) = self.scene.lights.sample(vertex.world, choice, u) else { return Vec3::ZERO };
        let wi = direction_in_base(sample.wi);
        let additive = vertex.additive.as_ref().map_or(Vec3::ZERO, |additive| {
            let weight = if sample.is_delta { 1.0 } else { power_heuristic(sample.pdf, additive.pdf(wi.to_array())) };
            let value = Vec3::from(additive.eval(wi.to_array())) * Vec3::from(additive.normal()).dot(wi).max(0.0);
            if value == Vec3::ZERO || level.plane.occluded_above_relief(&vertex.hit, wi, sample.distance) {
                return Vec3::ZERO;
            }
            value * Vec3::from(sample.radiance) * (weight / sample.pdf)
        });
        let cosine = vertex.hit.normal.dot(wi);
        if cosine <= 0.0 {
            return additive;
        }
        let (value, weight) = if sample.is_delta {
            (vertex.shading.eval(wi), 1.0)
        } else {
            let (value, pdf) = vertex.shading.eval_pdf(wi);
            (value, power_heuristic(sample.pdf, pdf))
        };
        if value == Vec3::ZERO || level.plane.occluded(&vertex.hit, wi, sample.distance) {
            return additive;
        }
        additive + value * Vec3::from(sample.radiance) * (cosine * weight / sample.pdf)
    }

    /// The light that a direction of the additive term meets, if nothing but the relief is between.
    fn light_along_additive(
        &self,
        level: &RenderLevel<'_>,
        vertex: &Vertex<'_>,
        additive: &BoundAdditive<'_>,
        u: [f32; 2],
    ) -> Vec3 {
        if self.scene.lights.are_all_delta() {
            return Vec3::ZERO;
        }
        let Some(sample) = additive.sample(u) else { return Vec3::ZERO };
        let wi = Vec3::from(sample.wi);
        let (distance, seen) = self.scene.lights.met(vertex.world, direction_in_world(wi));
        if seen == [0.0; 3] || level.plane.occluded_above_relief(&vertex.hit, wi, distance) {
            return Vec3::ZERO;
        }
        let weight = power_heuristic(sample.pdf, self.light_pdf(vertex, wi));
        let cosine = Vec3::from(additive.normal()).dot(wi);
        Vec3::from(sample.f) * Vec3::from(seen) * (cosine / sample.pdf * weight)
    }

    /// Light of the sources that `ray` (base frame) meets within `reach`; not zero means that the ray ends there.
    fn emitted(&self, ray: Ray, reach: f64) -> Vec3 {
        let origin = self.scene.point_in_world(ray.origin);
        self.scene.lights.emitted(origin, direction_in_world(ray.direction), reach).into()
    }
}

/// Weight of a sample of density `own` where another way to find it has density `other`.
#[inline]
pub(super) fn power_heuristic(own: f32, other: f32) -> f32 {
    // a quotient first: squares of the densities of narrow lobes overflow
    let ratio = other / own;
    1.0 / (1.0 + ratio * ratio)
}
