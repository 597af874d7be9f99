//! A V-groove of two walls at right angles, without end: its interreflection is a one-dimensional integral equation.
//!
//! From a point at distance x from the bottom of one wall, the strip at distance y on the other is seen under the form
//! factor ½ x y/(x² + y²)^{3/2} dy: the kernel is ½ d(sin φ) with the angle φ from the point's normal, sin φ = x/√(x² + y²).

use std::f64::consts::FRAC_1_PI;

use farfield::geometry::{Boundary, HeightField};
use farfield::transport::light::{ConstantLight, DirectionalLight, Light};
use farfield::transport::render::{Integrator, RenderSettings};
use glam::Vec3;

use super::scenes::{SETTINGS, camera, image, lambert, object, scene};
use super::statistics::{expect_mean, mean};

/// Length of a wall in texels: 16 up, 16 along.
const LENGTH: f64 = 16.0 * std::f64::consts::SQRT_2;
const PATHS: RenderSettings = RenderSettings { integrator: Integrator::Path, ..SETTINGS };

/// Walls of 45°, 32 texels from ridge to ridge along u.
fn groove() -> HeightField {
    let heights = (0..32 * 4).map(|k| (k as f32 % 32.0 - 16.0).abs()).collect();
    HeightField::new(heights, [32, 4], [1.0, 1.0], Boundary::Repeat)
}

/// Mean radiosity of both walls for the direct irradiance `direct(wall, x)`, all bounces: Nyström's method with midpoints.
fn radiosity(albedo: f64, direct: impl Fn(usize, f64) -> f64) -> f64 {
    let n = 1500;
    let at = |k: usize| (k as f64 + 0.5) / n as f64 * LENGTH;
    let edge = |k: usize| k as f64 / n as f64 * LENGTH;
    // exact form factors of strips: ½ (x/√(x² + y₀²) − x/√(x² + y₁²))
    let factor = |x: f64, k: usize| {
        let sine = |y: f64| x / (x * x + y * y).sqrt();
        0.5 * (sine(edge(k)) - sine(edge(k + 1)))
    };
    let emitted = [0, 1].map(|wall| (0..n).map(|k| albedo * direct(wall, at(k))).collect::<Vec<f64>>());
    let mut b = emitted.clone();
    // at 45° walls see each other by less than a half: 60 rounds leave 2⁻⁶⁰
    for _ in 0..60 {
        let gathered = [0, 1].map(|wall| {
            let other = &b[1 - wall];
            (0..n)
                .map(|k| emitted[wall][k] + albedo * (0..n).map(|j| factor(at(k), j) * other[j]).sum::<f64>())
                .collect::<Vec<f64>>()
        });
        b = gathered;
    }
    b.iter().flatten().sum::<f64>() / (2 * n) as f64
}

#[test]
fn one_bounce_between_the_walls_is_the_closed_form() {
    // The sun along the normal of one wall lights it evenly and grazes the other, which then gets
    // ρ E ∫ ½ x y/(x² + y²)^{3/2} dx = ρ E · ½ (1 − y/√(y² + L²)) at y.
    let heights = groove();
    let direction = Vec3::new(0.5_f32.sqrt(), 0.5_f32.sqrt(), 0.0);
    let light = || Light::Directional(DirectionalLight { direction, irradiance: [1.0; 3] });
    let albedo = 0.02;
    let render = |settings| {
        image(&scene(object(&heights, lambert(albedo), 99), light(), camera(0.0, 64.0, 16)), settings, 20_000)
    };
    let (all, direct) = (render(&PATHS), render(&SETTINGS));
    // half of what is seen from above is the lit wall
    expect_mean(&direct, 0.5 * 0.02 * FRAC_1_PI, 1e-5);
    let mean_gather = {
        // mean of ½ (1 − y/√(y² + L²)) over the wall: ½ (1 − (√2 − 1))
        0.5 * (2.0 - std::f64::consts::SQRT_2)
    };
    let bounced = 0.5 * 0.02 * 0.02 * FRAC_1_PI * mean_gather;
    let ((all, error), (direct, _)) = (mean(&all), mean(&direct));
    // second bounces are less than ρ/2 of the first
    assert!(
        (all - direct - bounced).abs() < 4.0 * error + 0.01 * bounced,
        "{} ± {error}, expected {bounced}",
        all - direct
    );
    assert!(error < 0.02 * bounced, "{error} is no test of {bounced}");
}

#[test]
fn all_bounces_between_the_walls_solve_the_integral_equation() {
    let heights = groove();
    for albedo in [0.5, 0.9] {
        let direction = Vec3::new(0.5_f32.sqrt(), 0.5_f32.sqrt(), 0.0);
        let sun = Light::Directional(DirectionalLight { direction, irradiance: [1.0; 3] });
        let sky = Light::Constant(ConstantLight { radiance: [1.0; 3] });
        // the open side fills the angles from the other wall's rim up: ½ (1 + x/√(x² + L²))·π
        let from_sky = |_: usize, x: f64| std::f64::consts::PI * 0.5 * (1.0 + x / (x * x + LENGTH * LENGTH).sqrt());
        for (light, expected) in
            [(sun, radiosity(albedo, |wall, _| if wall == 0 { 1.0 } else { 0.0 })), (sky, radiosity(albedo, from_sky))]
        {
            let film =
                image(&scene(object(&heights, lambert(albedo as f32), 99), light, camera(0.0, 64.0, 16)), &PATHS, 2000);
            // midpoints on 1500 strips
            expect_mean(&film, expected * FRAC_1_PI, 1e-4);
        }
    }
}
