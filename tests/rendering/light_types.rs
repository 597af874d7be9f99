//! The same light, expressed by every type that can: the same image.

use farfield::transport::light::{AreaLight, ConstantLight, DirectionalLight, ImageLight, Light, Lights};
use farfield::transport::scene::Scene;
use glam::{DVec3, Vec3};

use super::scenes::{SETTINGS, camera, image, lambert, object, rough, scene};
use super::statistics::{mean, two_sided_z};
use farfield::material::{Brdf, Conductor};
use farfield::transport::film::Film;

/// Holds two images' means against each other.
fn expect_same(a: &Film, b: &Film, allowed: f64) {
    let ((a, error_a), (b, error_b)) = (mean(a), mean(b));
    let limit = two_sided_z(1e-3) * error_a.hypot(error_b) + allowed * a;
    assert!((a - b).abs() < limit, "{a} ± {error_a}, {b} ± {error_b}");
}

fn glossy() -> Brdf {
    Brdf { diffuse: [0.3; 3], specular: Some(Conductor::ggx(0.2, [0.8; 3])) }
}

#[test]
fn a_constant_sky_is_an_image_of_one_colour() {
    let heights = rough();
    for brdf in [lambert(0.7), glossy()] {
        let render = |light| image(&scene(object(&heights, brdf, 41), light, camera(0.6, 20.0, 12)), &SETTINGS, 500);
        let constant = render(Light::Constant(ConstantLight { radiance: [1.5; 3] }));
        let picture = render(Light::Image(ImageLight::new(vec![[0.5; 3]; 16 * 8], [16, 8], 3.0, 1.0)));
        expect_same(&constant, &picture, 0.0);
    }
}

#[test]
fn the_sun_is_a_small_far_rectangle_and_a_bright_texel() {
    let heights = rough();
    let direction = Vec3::new(0.35, 0.9, -0.26).normalize();
    let sun = || Light::Directional(DirectionalLight { direction, irradiance: [2.0; 3] });
    // 4 m square at 1 km: 0.23° across
    let far = direction.as_dvec3() * 1000.0;
    let square = || Light::Area(AreaLight::facing(far, DVec3::ZERO, Some(DVec3::Y), [4.0; 2], [2.0 * 1e6 / 16.0; 3]));
    for brdf in [lambert(0.7), glossy()] {
        let render = |light| image(&scene(object(&heights, brdf, 41), light, camera(0.6, 20.0, 12)), &SETTINGS, 500);
        // shadow borders of 0.23° and of the sun differ by less than a thousandth of the lit area
        expect_same(&render(sun()), &render(square()), 2e-3);
    }
    // the sun in the middle of a texel of 1024 × 512: 0.35° across
    let [columns, rows] = [1024, 512];
    let [column, row] = [700, 120];
    let polar = (row as f32 + 0.5) / rows as f32 * std::f32::consts::PI;
    let u = (column as f32 + 0.5) / columns as f32;
    let azimuth = (u - 0.5) * std::f32::consts::TAU;
    let middle = Vec3::new(polar.sin() * azimuth.sin(), polar.cos(), -polar.sin() * azimuth.cos());
    let rim = |k: usize| (k as f64 / rows as f64 * std::f64::consts::PI).cos();
    let solid_angle = std::f64::consts::TAU / columns as f64 * (rim(row) - rim(row + 1));
    let mut texels = vec![[0.0; 3]; columns * rows];
    texels[row * columns + column] = [(2.0 / solid_angle) as f32; 3];
    let picture = Light::Image(ImageLight::new(texels, [columns, rows], 1.0, 0.0));
    let sun = Light::Directional(DirectionalLight { direction: middle, irradiance: [2.0; 3] });
    let [a, b] = [sun, picture]
        .map(|light| image(&scene(object(&heights, lambert(0.7), 41), light, camera(0.6, 20.0, 12)), &SETTINGS, 500));
    expect_same(&a, &b, 2e-3);
}

#[test]
fn several_lights_add_up() {
    let heights = rough();
    let lights = || {
        vec![
            Light::Constant(ConstantLight { radiance: [0.3; 3] }),
            Light::Directional(DirectionalLight { direction: Vec3::new(0.6, 0.8, 0.0), irradiance: [1.0; 3] }),
            Light::Area(AreaLight::facing(
                DVec3::new(-20.0, 40.0, 0.0),
                DVec3::ZERO,
                Some(DVec3::Z),
                [10.0; 2],
                [4.0; 3],
            )),
        ]
    };
    let brdf = glossy();
    let render = |lights: Vec<Light>| {
        let surface = object(&heights, brdf, 41);
        image(&Scene { camera: camera(0.6, 20.0, 12), lights: Lights::new(lights), surface }, &SETTINGS, 800)
    };
    let (all, error) = mean(&render(lights()));
    let alone: Vec<(f64, f64)> = lights().into_iter().map(|light| mean(&render(vec![light]))).collect();
    // the rectangle hides the sky behind it, 0.3 of 4.3: alone it shows its own radiance, together that alone
    let sum: f64 = alone.iter().map(|(mean, _)| mean).sum();
    let noise = alone.iter().map(|(_, error)| error * error).sum::<f64>().sqrt().hypot(error);
    let hidden = alone[2].0 * 0.3 / 4.0;
    assert!((all - sum + hidden).abs() < 4.0 * noise + 0.5 * hidden, "{all} ± {noise}, expected {sum} − {hidden}");
}
