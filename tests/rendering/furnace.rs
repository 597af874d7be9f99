//! White furnaces: a surface that absorbs nothing, in light of radiance 1 from everywhere, cannot be seen.

use farfield::geometry::{Boundary, HeightField};
use farfield::geometry::{DisplacedPlane, HeightTracer, LargeShape};
use farfield::material::{Brdf, Conductor};
use farfield::transport::light::{ConstantLight, Light};
use farfield::transport::render::{Integrator, RenderSettings};
use farfield::transport::scene::{RenderLevel, SurfaceObject};
use farfield::transport::shading::Shading;

use super::scenes::{SETTINGS, camera, flat, image, lambert, object, rough, scene};
use super::statistics::{expect_mean, expect_pixels, mean};

const WHITE_SKY: Light = Light::Constant(ConstantLight { radiance: [1.0; 3] });
const PATHS: RenderSettings = RenderSettings { integrator: Integrator::Path, ..SETTINGS };

#[test]
fn a_white_surface_of_any_shape_is_invisible() {
    for heights in [flat(), rough()] {
        for polar in [0.0, 0.8, 1.4] {
            let scene = scene(object(&heights, lambert(1.0), 41), WHITE_SKY, camera(polar, 20.0, 12));
            let film = image(&scene, &PATHS, 400);
            expect_pixels(&film, |_| ([1.0; 3], [0.0; 3]));
            expect_mean(&film, 1.0, 0.0);
        }
    }
}

#[test]
fn a_white_surface_on_a_large_shape_is_invisible() {
    let tile = rough();
    let hills = (0..400).map(|k| 20.0 * (k as f32 * 1.3).sin() * (k as f32 / 20.0).cos()).collect();
    let large = LargeShape::new(HeightField::new(hills, [20, 20], [65.6, 65.6], Boundary::Clamp));
    let plane = DisplacedPlane::new(HeightTracer::new(&tile), [41, 41], Some(&large));
    let shading = Shading::Base { brdf: lambert(1.0), color: None };
    let surface = SurfaceObject::new(vec![RenderLevel { factor: 1.0, plane, shading }], [1.0, 1.0]);
    let film = image(&scene(surface, WHITE_SKY, camera(0.7, 200.0, 12)), &PATHS, 400);
    expect_pixels(&film, |_| ([1.0; 3], [0.0; 3]));
    expect_mean(&film, 1.0, 0.0);
}

#[test]
fn a_grey_surface_returns_a_geometric_series_at_most() {
    // each bounce keeps the albedo: between one bounce (ρ) and all of them (1)
    let heights = rough();
    let render =
        |settings| image(&scene(object(&heights, lambert(0.5), 41), WHITE_SKY, camera(0.4, 20.0, 12)), settings, 200);
    let [direct, all] = [mean(&render(&SETTINGS)).0, mean(&render(&PATHS)).0];
    assert!(direct < all && direct < 0.5 && all < 0.5, "{direct} {all}: pits are darker than a plane");
    assert!(all > direct / (1.0 - 0.5 * direct) * 0.8, "{direct} {all}");
}

#[test]
fn a_white_conductor_gains_no_energy() {
    for alpha in [0.05, 0.3, 1.0] {
        let brdf = Brdf { diffuse: [0.0; 3], specular: Some(Conductor::ggx(alpha, [1.0; 3])) };
        for heights in [flat(), rough()] {
            let film = image(&scene(object(&heights, brdf, 41), WHITE_SKY, camera(0.9, 20.0, 12)), &PATHS, 200);
            let (mean, error) = mean(&film);
            assert!(mean < 1.0 + 4.0 * error && mean > 0.1, "α = {alpha}: {mean} ± {error}");
        }
    }
}

#[test]
fn the_sky_is_seen_where_the_surface_is_not() {
    let heights = flat();
    let film = image(&scene(object(&heights, lambert(0.0), 1), WHITE_SKY, camera(0.0, 16.0, 16)), &SETTINGS, 16);
    // the plane is 4 m wide, a quarter of the film
    let black = |pixel: usize| [pixel % 16, pixel / 16].iter().all(|i| (6..10).contains(i));
    expect_pixels(&film, |pixel| (if black(pixel) { [0.0; 3] } else { [1.0; 3] }, [0.0; 3]));
}
