//! Levels in views and lights that no fit has seen: bias of image means, and root mean square error of images.
//!
//! Spherical harmonics of three bands, a sky with a narrow key light, and an area light close by; views off those of training
//! and validation. Images show the volume's own light before a black backdrop. Two independent halves of every image keep
//! noise out of squares.

use std::path::Path;

use farfield::medium::Medium;
use farfield::prefilter::volume::{Density, Optimizer, VolumeSettings, compile};
use farfield::transport::camera::{Camera, Projection};
use farfield::transport::film::Film;
use farfield::transport::light::{AreaLight, ImageLight, Light, Lights, ShLight};
use farfield::transport::render::{Integrator, RenderSettings};
use farfield::transport::sampler::Sampling;
use farfield::transport::scene::Lod;
use farfield::transport::volume::render::render;
use farfield::transport::volume::{Backdrop, VolumeLevel, VolumeObject, VolumeScene};
use glam::DVec3;

use crate::vol::Scene;

/// Pixels along an edge, and samples a pixel of each half.
const PIXELS: usize = 40;
const SAMPLES: u64 = 10;

/// The names of the lights.
const LIGHTS: [&str; 3] = ["sh", "peaky", "area"];

/// To the viewer, world; y is the axis across a cloth. The last sees a cloth from behind.
const VIEWS: [[f64; 3]; 5] =
    [[0.31, 0.9, 0.22], [-0.62, 0.71, 0.35], [0.2, 0.62, -0.76], [0.82, 0.44, 0.33], [0.35, -0.8, 0.45]];

/// One line a scene, factor and model.
pub(crate) fn run(scenes: &[Scene], folder: &Path) {
    println!("bias of the mean over views | mean of |bias| of a view | RMSE over RMS, each for {LIGHTS:?}, per cent");
    for scene in scenes {
        let fine = scene.medium(folder);
        let reference = images(&fine, 1);
        for factor in [4.0, 8.0] {
            let level = |optimizer, density| {
                let settings = VolumeSettings { factor, optimizer, density, ..VolumeSettings::default() };
                compile(&fine, &settings).medium
            };
            for (name, optimizer, density) in [
                ("naive", Optimizer::None, Density::Average),
                ("weights", Optimizer::LevenbergMarquardt, Density::Average),
                ("factor", Optimizer::LevenbergMarquardt, Density::Factor),
                ("transmittance", Optimizer::LevenbergMarquardt, Density::Transmittance),
                ("auto", Optimizer::LevenbergMarquardt, Density::Auto),
            ] {
                let errors = errors(&images(&level(optimizer, density), 2), &reference);
                let cells = |k: usize| errors.iter().map(|e| format!("{:>6.1}", 100.0 * e[k])).collect::<String>();
                println!("{:<8} {factor}  {name:<14} {} | {} | {}", scene.name, cells(0), cells(1), cells(2));
            }
        }
    }
}

/// Two halves of an image.
type Halves = [Vec<[f32; 3]>; 2];

/// `[light][view]`.
fn images(medium: &Medium, seed: u64) -> Vec<Vec<Halves>> {
    let extent = DVec3::from_array(medium.shape().extent());
    let is_cloth = medium.shape().repeat[0];
    let image = |light: usize, view: usize| {
        let towards = DVec3::from_array(VIEWS[view]).normalize();
        // A cloth fills the view; another volume is seen whole.
        let width = if is_cloth { extent.x } else { 1.75 * extent.max_element() };
        let projection = Projection::Orthographic { width };
        let position = towards * 10.0 * extent.max_element();
        let camera = Camera::look_at(position, DVec3::ZERO, DVec3::new(0.1, 0.2, 1.0), projection, [PIXELS; 2]);
        let volume = VolumeObject::new(vec![VolumeLevel { factor: 1.0, medium }], medium.unit());
        let lights = Lights::new(vec![made(light, extent)]);
        let scene = VolumeScene { camera: camera.expect("a view"), lights, volume, backdrop: Backdrop::Black };
        [0, 1].map(|half| {
            let settings = RenderSettings {
                integrator: Integrator::Path,
                lod: Lod::Fixed(0),
                seed: 100 * seed + half,
                sampling: Sampling::Sobol,
            };
            let mut film = Film::new([PIXELS; 2]);
            render(&scene, &settings, 0..SAMPLES, &mut film);
            film.radiance()
        })
    };
    (0..LIGHTS.len()).map(|light| (0..VIEWS.len()).map(|view| image(light, view)).collect()).collect()
}

/// The light of that number around a volume of that extent (its z up).
fn made(light: usize, extent: DVec3) -> Light {
    match light {
        0 => {
            let bands = [2.0, 0.35, 0.2, 0.5, 0.15, -0.2, 0.1, 0.25, -0.15_f32];
            Light::Sh(ShLight::new(bands.map(|c| [c, 0.9 * c, 0.8 * c]).to_vec()))
        }
        1 => {
            let size = [128, 64];
            let texel = |k: usize| {
                let [u, v] = [(k % size[0]) as f64 + 0.5, (k / size[0]) as f64 + 0.5];
                let azimuth = std::f64::consts::TAU * (u / size[0] as f64 - 0.5);
                let polar = std::f64::consts::PI * v / size[1] as f64;
                let (x, y, z) = (polar.sin() * azimuth.sin(), polar.cos(), -polar.sin() * azimuth.cos());
                let key = DVec3::new(0.5, 0.7, 0.51).normalize().dot(DVec3::new(x, y, z));
                let radiance = 12.0 * (80.0 * (key - 1.0)).exp() + if y > 0.0 { 0.1 } else { 0.0 };
                [radiance as f32; 3]
            };
            Light::Image(ImageLight::new((0..size[0] * size[1]).map(texel).collect(), size, 1.0, 0.0))
        }
        _ => {
            let reach = extent.max_element();
            let centre = DVec3::new(-0.4, 0.8, 0.5) * reach;
            Light::Area(AreaLight::facing(centre, DVec3::ZERO, None, [0.5 * reach; 2], [4.0; 3]))
        }
    }
}

/// A light: bias of the mean over views, mean of |bias| of a view, RMSE over RMS.
fn errors(level: &[Vec<Halves>], reference: &[Vec<Halves>]) -> Vec<[f64; 3]> {
    let mean = |halves: &Halves| halves.iter().flatten().flatten().map(|&v| f64::from(v)).sum::<f64>();
    let of_light = |(level, reference): (&Vec<Halves>, &Vec<Halves>)| {
        let pairs = || level.iter().zip(reference);
        let totals = pairs().fold([0.0; 2], |t, (a, b)| [t[0] + mean(a), t[1] + mean(b)]);
        let each = pairs().map(|(a, b)| (mean(a) / mean(b) - 1.0).abs()).sum::<f64>() / level.len() as f64;
        let [mut off, mut square] = [0.0; 2];
        for (a, b) in pairs() {
            for (k, c) in (0..b[0].len()).flat_map(|k| (0..3).map(move |c| (k, c))) {
                let value = |image: &Halves, half: usize| f64::from(image[half][k][c]);
                off += (value(a, 0) - value(b, 0)) * (value(a, 1) - value(b, 1));
                square += value(b, 0) * value(b, 1);
            }
        }
        // Noise may leave a product of halves below 0 where there is no error to see.
        [totals[0] / totals[1] - 1.0, each, (off.max(0.0) / square).sqrt()]
    };
    level.iter().zip(reference).map(of_light).collect()
}
