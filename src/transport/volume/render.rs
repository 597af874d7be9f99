//! Images of volumes: at every meeting one light is sampled and one direction of the phase function; what either finds is
//! weighted by the power heuristic (\[VEACH97\]).
//!
//! Nothing in a volume is opaque: light samples are weighted by the transmittance. An area light ends the
//! flights that meet its front.

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;

use super::scene::{Backdrop, VolumeScene};
use super::walk::{Meeting, Walk};
use crate::math::rng::{Draws, Stream};
use crate::transport::film::Film;
use crate::transport::render::{Integrator, RenderSettings, power_heuristic};
use crate::transport::sampler::Sampler;
use crate::transport::scene::{direction_in_base, direction_in_world};

/// Streams that a pixel's walks may have, one a sample.
const SAMPLES_A_PIXEL: u64 = 1 << 32;

/// Adds the samples `samples` to every pixel of `film`, whose size is that of the scene's camera.
///
/// `Direct` counts light that is scattered once. Each pixel is a function of the settings and its place alone.
///
/// # Panics
/// If the film has another size than the camera's.
pub fn render(scene: &VolumeScene<'_>, settings: &RenderSettings, samples: Range<u64>, film: &mut Film) {
    let [width, height] = film.size();
    assert_eq!([width, height], scene.camera.size(), "the film is the camera's");
    film.pixels.par_chunks_mut(width).enumerate().for_each(|(row, pixels)| {
        for (column, pixel) in pixels.iter_mut().enumerate() {
            for sample in samples.clone() {
                let index = (row * width + column) as u64;
                let radiance = radiance(scene, settings, [column, row], index, sample);
                (0..3).for_each(|c| pixel[c].add(f64::from(radiance[c])));
            }
        }
    });
}

/// Radiance along a random ray of the pixel.
fn radiance(scene: &VolumeScene<'_>, settings: &RenderSettings, at: [usize; 2], index: u64, sample: u64) -> Vec3 {
    let [dx, dy, level_u, _] = Sampler::new(settings.sampling, settings.seed, index, sample).four(0);
    let mut draws = Draws::new(Stream::new(settings.seed, index * SAMPLES_A_PIXEL + sample));
    let ray = scene.camera_ray(at[0] as f64 + f64::from(dx), at[1] as f64 + f64::from(dy));
    let medium = scene.volume.level(&ray, settings.lod, level_u);
    let entered = Walk::enter(medium, ray.origin, ray.direction);
    // Lights between the camera and the grid, or behind where it would have been.
    let before = entered.as_ref().map_or(f64::INFINITY, |walk| (walk.point - ray.origin).length());
    let (origin, along) = (scene.point_in_world(ray.origin), direction_in_world(ray.direction_f32()));
    let seen = backdrop(scene, scene.lights.emitted(origin, along, before).into());
    let Some(walk) = entered.filter(|_| seen == Vec3::ZERO) else { return seen };
    scattered(scene, settings, walk, &mut draws)
}

/// What a camera ray sees of lights.
fn backdrop(scene: &VolumeScene<'_>, seen: Vec3) -> Vec3 {
    if scene.backdrop == Backdrop::Lights { seen } else { Vec3::ZERO }
}

/// Radiance that comes back along a walk that begins at the camera.
fn scattered(scene: &VolumeScene<'_>, settings: &RenderSettings, mut walk: Walk<'_>, draws: &mut Draws) -> Vec3 {
    let mut sum = Vec3::ZERO;
    // Density of the flight's direction; none for the camera's, which no light sample could have found.
    let mut pdf = None;
    for bounce in 0.. {
        let from = walk.point;
        let meeting = walk.fly(draws);
        let reach = meeting.map_or(f64::INFINITY, |meeting| meeting.distance);
        let (world, along) = (scene.point_in_world(from), direction_in_world(walk.direction));
        let emitted = Vec3::from(scene.lights.emitted(world, along, reach));
        if emitted != Vec3::ZERO {
            let Some(pdf) = pdf else { return backdrop(scene, emitted) };
            let weight = power_heuristic(pdf, scene.lights.pdf(world, along));
            return sum + walk.throughput * emitted * weight;
        }
        let Some(meeting) = meeting else { break };
        if bounce == 1 && settings.integrator == Integrator::Direct {
            break;
        }
        sum += walk.throughput * light_sample(scene, &walk, &meeting, draws);
        walk.scatter(&meeting, draws);
        pdf = Some(meeting.flakes.pdf(walk.direction));
        if !walk.survives(draws) {
            break;
        }
    }
    sum
}

/// What one sample of one light brings back along the walk.
fn light_sample(scene: &VolumeScene<'_>, walk: &Walk<'_>, meeting: &Meeting, draws: &mut Draws) -> Vec3 {
    let (choice, u) = (draws.uniform(), draws.pair());
    let Some(sample) = scene.lights.sample(scene.point_in_world(walk.point), choice, u) else { return Vec3::ZERO };
    let wi = direction_in_base(sample.wi);
    let value = Vec3::from(meeting.flakes.eval(wi));
    if value == Vec3::ZERO {
        return value;
    }
    let weight = if sample.is_delta { 1.0 } else { power_heuristic(sample.pdf, meeting.flakes.pdf(wi)) };
    let transmittance = walk.transmittance(wi, sample.distance);
    value * Vec3::from(sample.radiance) * (weight * transmittance / sample.pdf)
}
