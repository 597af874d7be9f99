//! A stored image with its variance: what an earlier version drew, pixel by pixel.
//!
//! `FARFIELD_DRAW=1 cargo test --release --test rendering stored` draws it anew; the commit that changes it says why.

use std::path::Path;

use farfield::material::{Brdf, Conductor};
use farfield::transport::film::Film;
use farfield::transport::light::{ConstantLight, Light};
use farfield::transport::render::{Integrator, RenderSettings};

use super::scenes::{SETTINGS, camera, image, object, rough, scene};
use super::statistics::expect_pixels;

const FILE: &str = "tests/rendering/stored.f32";
const SIDE: usize = 24;

fn draw_with(seed: u64, samples: u64) -> Film {
    let heights = rough();
    let brdf = Brdf { diffuse: [0.6, 0.4, 0.2], specular: Some(Conductor::ggx(0.25, [0.5, 0.7, 0.9])) };
    let sky = Light::Constant(ConstantLight { radiance: [1.0, 0.8, 1.2] });
    let settings = RenderSettings { integrator: Integrator::Path, seed, ..SETTINGS };
    image(&scene(object(&heights, brdf, 41), sky, camera(0.9, 40.0, SIDE)), &settings, samples)
}

fn draw() {
    let film = draw_with(4711, 8192);
    let values = film.radiance().into_iter().chain(film.variance()).flatten();
    let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
    std::fs::write(Path::new(env!("CARGO_MANIFEST_DIR")).join(FILE), bytes).unwrap();
}

#[test]
fn every_pixel_is_that_of_the_stored_image() {
    if std::env::var_os("FARFIELD_DRAW").is_some() {
        draw();
    }
    let bytes = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join(FILE)).unwrap();
    let values: Vec<f32> = bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
    let pixels = SIDE * SIDE;
    assert_eq!(values.len(), 6 * pixels);
    let at = |k: usize| [0, 1, 2].map(|c| f64::from(values[3 * k + c]));
    expect_pixels(&draw_with(1, 256), |pixel| (at(pixel), at(pixels + pixel)));
}
