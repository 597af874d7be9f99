//! Which level a path meets: footprints and blending.

use farfield::geometry::{Boundary, DisplacedPlane, HeightField, HeightTracer, LargeShape};
use farfield::transport::camera::{Camera, Projection};
use farfield::transport::light::{ConstantLight, Light};
use farfield::transport::render::RenderSettings;
use farfield::transport::scene::{Lod, RenderLevel, SurfaceObject};
use farfield::transport::shading::Shading;
use glam::DVec3;

use super::scenes::{SETTINGS, camera, flat, image, lambert, level, scene};
use super::statistics::{expect_mean, expect_pixels};

const SKY: Light = Light::Constant(ConstantLight { radiance: [1.0; 3] });

#[test]
fn footprints_are_the_root_of_a_pixels_area_in_texels() {
    let heights = flat();
    for (polar, texel, expected) in [
        (0.0_f64, [1.0, 1.0], 2.0),
        (0.0, [0.5, 2.0], 2.0),
        // longer by 1/cos along the view
        (1.0, [1.0, 1.0], 2.0 / 1.0_f64.cos().sqrt()),
        // 1/cos 85° is 11.5, of which 8 count
        (85.0_f64.to_radians(), [1.0, 1.0], 2.0 * 8.0_f64.sqrt()),
    ] {
        let surface = SurfaceObject::new(vec![level(&heights, lambert(0.5), 9, 1.0)], texel);
        let scene = scene(surface, SKY, camera(polar, 32.0, 16));
        let texels = scene.central_footprint().unwrap();
        assert!((texels / expected - 1.0).abs() < 1e-6, "{polar}: {texels}, expected {expected}");
    }
}

#[test]
fn a_tilted_base_has_the_footprint_of_its_own_plane() {
    // a slope of 1 along x turned towards a camera that looks along x and down: head on, the base shows 45° of itself
    let heights = flat();
    let ramp: Vec<f32> = (0..16).map(|k| 9.0 * (k % 4) as f32).collect();
    let large = LargeShape::new(HeightField::new(ramp, [4, 4], [9.0, 9.0], Boundary::Clamp));
    let plane = DisplacedPlane::new(HeightTracer::new(&heights), [9, 9], Some(&large));
    let shading = Shading::Base { brdf: lambert(0.5), color: None };
    let surface = SurfaceObject::new(vec![RenderLevel { factor: 1.0, plane, shading }], [1.0, 1.0]);
    let projection = Projection::Orthographic { width: 32.0 };
    let target = DVec3::new(-5.0, 13.0, 0.0); // on the ramp
    let camera = Camera::look_at(target + DVec3::new(-50.0, 50.0, 0.0), target, DVec3::Y, projection, [16; 2]).unwrap();
    let texels = scene(surface, SKY, camera).central_footprint().unwrap();
    // 2 m across, 2 m along the slope, of which the projection on the base is 2/√2
    assert!((texels - (2.0 * 2.0 / 2.0_f64.sqrt()).sqrt()).abs() < 1e-6, "{texels}");
}

#[test]
fn two_levels_are_blended_by_the_logarithm_of_the_footprint() {
    let heights = flat();
    let albedos = [0.2, 0.5, 0.9];
    let factors = [2.0, 8.0, 64.0];
    for texels in [1.0, 2.0, 3.0, 8.0, 20.0, 64.0, 100.0_f64] {
        let levels = (0..3).map(|k| level(&heights, lambert(albedos[k]), 9999, factors[k])).collect();
        let surface = SurfaceObject::new(levels, [1.0, 1.0]);
        let film = image(&scene(surface, SKY, camera(0.0, 8.0 * texels, 8)), &SETTINGS, 4000);
        let weight = |a: f64, b: f64| ((texels / a).ln() / (b / a).ln()).clamp(0.0, 1.0);
        let [first, second] = [weight(2.0, 8.0), weight(8.0, 64.0)];
        let expected = 0.2 + first * 0.3 + second * 0.4;
        expect_mean(&film, expected, 1e-6);
    }
}

#[test]
fn a_fixed_level_is_met_whatever_the_footprint() {
    let heights = flat();
    for (place, albedo) in [(0, 0.2), (1, 0.5)] {
        let levels = vec![level(&heights, lambert(0.2), 9, 2.0), level(&heights, lambert(0.5), 9, 8.0)];
        let settings = RenderSettings { lod: Lod::Fixed(place), ..SETTINGS };
        let film = image(&scene(SurfaceObject::new(levels, [1.0, 1.0]), SKY, camera(0.3, 8.0, 4)), &settings, 50);
        // the cosine is sampled: no noise but rounding
        expect_pixels(&film, |_| ([albedo; 3], [1e-9; 3]));
    }
}
