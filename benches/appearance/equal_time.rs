//! Error of level and original at the CPU time in which the original takes 64 samples a pixel.

use super::subjects::{DIFFUSE, GGX_03, Subject, TEXEL, area_light, cpu_seconds, film, halves, heights, parallel};
use farfield::geometry::{Boundary, HeightField, LargeShape};
use farfield::report::metrics::{Halves, relative_mse_of_image};
use farfield::transport::scene::{Lod, Scene};

const TILES: u32 = 100;
const PIXELS: usize = 48;
/// Pixels on a large shape, where a sample costs more by far.
const PIXELS_BI_SCALE: usize = 24;
/// 8192 samples in all.
const REFERENCE_HALF: u32 = 4096;
const SAMPLES: [u32; 9] = [4, 8, 16, 32, 64, 128, 256, 512, 1024];
/// The original's samples whose time is given to the level.
const COMPARED: usize = 4;

/// `logo` over the whole plane, under its own tiles.
fn large_shape() -> LargeShape {
    let tile = heights("logo");
    let metres = tile.heights().iter().map(|h| h * TILES as f32).collect();
    LargeShape::new(HeightField::new(metres, tile.size(), [TEXEL as f32 * TILES as f32; 2], Boundary::Clamp))
}

/// Source texels a pixel: all of the tiles in an image of 512².
const FOOTPRINT: f64 = 200.0;
/// The levels of the assets: one that is finer than a pixel by far, and a ladder from which the footprint chooses.
const LADDERS: [&[u32]; 2] = [&[8, 16, 32, 64, 128], &[8]];

/// A map with its base, and whether it lies on the large shape.
type Case = (&'static str, &'static str, &'static str, bool);

const CASES: [Case; 6] = [
    ("twill", "GGX 0.3", GGX_03, false),
    ("silk", "GGX 0.3", GGX_03, false),
    ("bump", "diffuse", DIFFUSE, false),
    ("fbm", "diffuse", DIFFUSE, false),
    ("logo", "GGX 0.3, bi-scale", GGX_03, true),
    ("relief", "diffuse", DIFFUSE, false),
];

/// Prints the table and the curves, of the scenes that are named or of all.
pub(crate) fn run(words: &[String]) {
    let is_named = |case: &&Case| words.iter().any(|word| word == case.0);
    let named: Vec<Case> = CASES.iter().filter(is_named).copied().collect();
    let cases = if named.is_empty() { CASES.to_vec() } else { named };
    LADDERS.iter().for_each(|factors| run_with(factors, &cases));
}

fn run_with(factors: &[u32], cases: &[Case]) {
    println!(
        "equal time: levels {factors:?}; {PIXELS}² pixels ({PIXELS_BI_SCALE}² bi-scale), 45°, area light, {TILES}² tiles, against {} samples",
        2 * REFERENCE_HALF
    );
    println!(
        "| scene | base | φ | µs a sample, original | level | MSE, original at 64 | level at the same time | its samples | ratio |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let large = large_shape();
    let mut ratios = Vec::new();
    let mut curves = Vec::new();
    for &(map, base, bsdf, bi_scale) in cases {
        let large = bi_scale.then_some(&large);
        let pixels = if bi_scale { PIXELS_BI_SCALE } else { PIXELS };
        let subject = Subject::new(map, bsdf, factors);
        let [full, level] = [subject.full(), subject.farfield()];
        let width = pixels as f64 * FOOTPRINT * TEXEL;
        let camera = parallel(45.0, FOOTPRINT, pixels);
        let scene = |data| Scene { camera, lights: area_light(width), surface: data };
        let original = scene(full.object([TILES; 2], large));
        let coarse = scene(level.object([TILES; 2], large));
        let reference = halves(&original, Lod::Auto, 1, REFERENCE_HALF);
        let reference = Halves::new(&reference[0], &reference[1]);
        let seconds_a_sample = |scene: &Scene<'_>| {
            let started = cpu_seconds();
            film(scene, Lod::Auto, 77, 512);
            (cpu_seconds() - started) / 512.0
        };
        let seconds = [&original, &coarse].map(seconds_a_sample);
        let mse = |scene: &Scene<'_>, samples: u32, seeds: u64| {
            // several seeds: one image's error is itself noisy
            let errors = (0..seeds).map(|seed| {
                relative_mse_of_image(reference, &film(scene, Lod::Auto, 100 + seed, samples).radiance())
                    .expect("not black")
            });
            errors.sum::<f64>() / seeds as f64
        };
        let same_time = (f64::from(SAMPLES[COMPARED]) * seconds[0] / seconds[1]).round().max(1.0) as u32;
        let [a, b] = [mse(&original, SAMPLES[COMPARED], 4), mse(&coarse, same_time, 4)];
        ratios.push(b / a);
        let micro = seconds.map(|s| s / (pixels * pixels) as f64 * 1e6);
        let texels = original.central_footprint().unwrap_or(f64::NAN);
        println!(
            "| {map} | {base} | {texels:.1} | {:.2} | {:.2} | {a:.2e} | {b:.2e} | {same_time} | {:.3} |",
            micro[0],
            micro[1],
            b / a
        );
        curves.push((map, SAMPLES.map(|n| [mse(&original, n, 1), mse(&coarse, n, 1)])));
    }
    let mean = (ratios.iter().map(|r| r.ln()).sum::<f64>() / ratios.len() as f64).exp();
    println!("geometric mean {mean:.3}");
    println!("| scene | samples | MSE, original | level |");
    println!("|---|---|---|---|");
    for (map, curve) in curves {
        for (n, [a, b]) in SAMPLES.iter().zip(curve) {
            println!("| {map} | {n} | {a:.2e} | {b:.2e} |");
        }
    }
}
