//! Planes and bumps under light whose reflection is known in closed form.

use std::f64::consts::{FRAC_1_PI, PI};

use farfield::geometry::{Boundary, HeightField};
use farfield::transport::light::{AreaLight, DirectionalLight, ImageLight, Light};
use glam::{DVec3, Vec3};

use super::scenes::{SETTINGS, camera, flat, image, lambert, object, scene};
use super::statistics::{expect_mean, expect_pixels};

fn sun(polar: f32, azimuth: f32) -> Light {
    let direction = Vec3::new(polar.sin() * azimuth.cos(), polar.cos(), polar.sin() * azimuth.sin());
    Light::Directional(DirectionalLight { direction, irradiance: [2.0, 1.0, 0.5] })
}

#[test]
fn a_plane_reflects_the_cosine_of_the_sun() {
    let heights = flat();
    for polar in [0.0_f32, 0.5, 1.2, 1.5] {
        let film = image(&scene(object(&heights, lambert(0.6), 9), sun(polar, 0.3), camera(0.7, 4.0, 8)), &SETTINGS, 4);
        let expected = [2.0, 1.0, 0.5].map(|e| 0.6 * FRAC_1_PI * e * f64::from(polar).cos());
        expect_pixels(&film, |_| (expected, [1e-14; 3]));
    }
}

#[test]
fn a_plane_under_a_rectangle_reflects_its_form_factor() {
    let heights = flat();
    for (half, height) in [(1.0, 2.0), (0.1, 1.0), (30.0, 1.0)] {
        let light =
            AreaLight::facing(DVec3::new(0.0, height, 0.0), DVec3::ZERO, Some(DVec3::Z), [2.0 * half; 2], [3.0; 3]);
        // a small film: the closed form holds below the centre; seen from the side, past the light's edge
        let film = image(
            &scene(object(&heights, lambert(0.5), 999), Light::Area(light), camera(1.52, 1e-3, 4)),
            &SETTINGS,
            4000,
        );
        let a = half / height;
        let root = (1.0 + a * a).sqrt();
        let form_factor = 2.0 / PI * 2.0 * (a / root) * (a / root).atan();
        expect_mean(&film, 0.5 * 3.0 * form_factor, 1e-3);
    }
}

/// A spherical cap of radius `radius` around the middle of a flat map of `n`² texels of 1 m, cut at `reach` metres.
fn cap(n: usize, radius: f32, reach: f32) -> HeightField {
    let base = (radius * radius - reach * reach).sqrt();
    let heights = (0..n * n)
        .map(|k| {
            let [x, y] = [k % n, k / n].map(|i| i as f32 - n as f32 / 2.0);
            let square = x * x + y * y;
            if square < reach * reach { (radius * radius - square).sqrt() - base } else { 0.0 }
        })
        .collect();
    HeightField::new(heights, [n, n], [1.0, 1.0], Boundary::Clamp)
}

/// The largest square that fits into the cap, so that every pixel sees it.
const CAP: (f32, f32) = (120.0, 80.0);

#[test]
fn a_bump_reflects_the_cosine_of_its_normal() {
    let (radius, reach) = CAP;
    let heights = cap(512, radius, reach);
    let width = 100.0;
    let pixels = 10;
    // 20° from the zenith: the cap's rim is 42° steep, nothing is in shadow
    let (polar, azimuth) = (0.35_f32, 0.6_f32);
    let film = image(
        &scene(object(&heights, lambert(0.8), 1), sun(polar, azimuth), camera(0.0, width, pixels)),
        &SETTINGS,
        256,
    );
    let towards = DVec3::new(
        f64::from(polar.sin() * azimuth.cos()),
        f64::from(polar.cos()),
        f64::from(polar.sin() * azimuth.sin()),
    );
    let expected = |pixel: usize| {
        // mean over the pixel by a fine midpoint rule; film columns run along +x, rows along +z
        let steps = 50;
        let mut sum = 0.0;
        for k in 0..steps * steps {
            let place = [pixel % pixels * steps + k % steps, pixel / pixels * steps + k / steps];
            let [x, z] = place.map(|i| (i as f64 + 0.5) / (pixels * steps) as f64 * width - 0.5 * width);
            let normal = DVec3::new(x, (f64::from(radius).powi(2) - x * x - z * z).sqrt(), z) / f64::from(radius);
            sum += normal.dot(towards);
        }
        let cosine = sum / (steps * steps) as f64;
        // chords for arcs: heights are 1/(8 · 120) off a texel, slopes 1/240
        ([2.0, 1.0, 0.5].map(|e| 0.8 * FRAC_1_PI * e * cosine), [2.0, 1.0, 0.5].map(|e| (1e-3 * e * 0.25_f64).powi(2)))
    };
    expect_pixels(&film, expected);
}

#[test]
fn a_bump_under_an_even_sky_reflects_what_its_normal_sees_of_it() {
    let (radius, reach) = CAP;
    let heights = cap(512, radius, reach);
    // black below the horizon: what looks under it sees the plane or nothing
    let texels = (0..64 * 32).map(|k| if k < 64 * 16 { [1.0; 3] } else { [0.0; 3] }).collect();
    let sky = Light::Image(ImageLight::new(texels, [64, 32], 1.0, 0.0));
    let width = 100.0;
    let film = image(&scene(object(&heights, lambert(0.8), 1), sky, camera(0.0, width, 10)), &SETTINGS, 2000);
    // A convex bump hides nothing from itself: (1 + n_y)/2 of the sky. Mean of n_y over the square by midpoints.
    let steps = 1000;
    let mut sum = 0.0;
    for k in 0..steps * steps {
        let [x, z] = [k % steps, k / steps].map(|i| (i as f64 + 0.5) / steps as f64 * width - 0.5 * width);
        sum += (f64::from(radius).powi(2) - x * x - z * z).sqrt() / f64::from(radius);
    }
    let cosine = sum / (steps * steps) as f64;
    expect_mean(&film, 0.8 * 0.5 * (1.0 + cosine), 5e-4);
}
