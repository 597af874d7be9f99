//! Small scenes, built by hand.

use farfield::geometry::{Boundary, DisplacedPlane, HeightField, HeightTracer};
use farfield::material::Brdf;
use farfield::math::rng::Stream;
use farfield::transport::camera::{Camera, Projection};
use farfield::transport::film::Film;
use farfield::transport::light::{Light, Lights};
use farfield::transport::render::{Integrator, RenderSettings, render};
use farfield::transport::sampler::Sampling;
use farfield::transport::scene::{Lod, RenderLevel, Scene, SurfaceObject};
use farfield::transport::shading::Shading;
use glam::DVec3;

/// Independent samples, so that variances are what they say.
pub(super) const SETTINGS: RenderSettings =
    RenderSettings { integrator: Integrator::Direct, lod: Lod::Auto, seed: 1, sampling: Sampling::Independent };

/// A grey Lambertian.
pub(super) fn lambert(albedo: f32) -> Brdf {
    Brdf { diffuse: [albedo; 3], specular: None }
}

/// A flat map of 4 × 4 texels, 1 m each.
pub(super) fn flat() -> HeightField {
    HeightField::new(vec![0.0; 16], [4, 4], [1.0, 1.0], Boundary::Repeat)
}

/// A rough map: smooth waves with random heights on top, slopes up to about 3.
pub(super) fn rough() -> HeightField {
    let n = 32;
    let stream = Stream::new(11, 1);
    let heights = (0..n * n)
        .map(|k| {
            let [x, y] = [k % n, k / n].map(|i| i as f32 * std::f32::consts::TAU / n as f32);
            3.0 * (2.0 * x).sin() * y.cos() + 2.0 * stream.uniform(k as u64)
        })
        .collect();
    HeightField::new(heights, [n, n], [1.0, 1.0], Boundary::Repeat)
}

/// One level of `brdf` over `heights`.
pub(super) fn level(heights: &HeightField, brdf: Brdf, tiles: u32, factor: f64) -> RenderLevel<'_> {
    let plane = DisplacedPlane::new(HeightTracer::new(heights), [tiles; 2], None);
    RenderLevel { factor, plane, shading: Shading::Base { brdf, color: None } }
}

/// A surface of that one level.
pub(super) fn object(heights: &HeightField, brdf: Brdf, tiles: u32) -> SurfaceObject<'_> {
    SurfaceObject::new(vec![level(heights, brdf, tiles, 1.0)], heights.spacing().map(f64::from))
}

/// A parallel camera `polar` from the normal (radians) that sees `width` metres around the origin, `pixels` square.
pub(super) fn camera(polar: f64, width: f64, pixels: usize) -> Camera {
    let away = DVec3::new(polar.sin() * 0.6, polar.cos(), polar.sin() * 0.8);
    let up = if polar == 0.0 { DVec3::NEG_Z } else { DVec3::Y };
    Camera::look_at(away * 500.0, DVec3::ZERO, up, Projection::Orthographic { width }, [pixels; 2]).unwrap()
}

/// The scene of one surface.
pub(super) fn scene(surface: SurfaceObject<'_>, light: Light, camera: Camera) -> Scene<'_> {
    Scene { camera, lights: Lights::new(vec![light]), surface }
}

/// The image of `samples` samples a pixel.
pub(super) fn image(scene: &Scene<'_>, settings: &RenderSettings, samples: u64) -> Film {
    let mut film = Film::new(scene.camera.size());
    render(scene, settings, 0..samples, &mut film);
    film
}
