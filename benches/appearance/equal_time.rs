//! Error of level and original at the CPU time in which the original takes 64 samples a pixel, by the coarsest level.

use super::subjects::{DIFFUSE, GGX_03, Subject, TEXEL, area_light, cpu_seconds, film, halves, heights, parallel};
use farfield::build::ModelData;
use farfield::geometry::{Boundary, HeightField, LargeShape};
use farfield::report::metrics::{Halves, relative_mse, relative_mse_of_image};
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
/// Samples of the two halves that tell a level's bias from its noise.
const BIAS_HALF: u32 = 256;

/// Source texels a pixel: all of the tiles in an image of 512².
const FOOTPRINT: f64 = 200.0;
/// The levels that are compiled.
const FACTORS: [u32; 5] = [8, 16, 32, 64, 128];
/// How many of them an asset keeps: the footprint is larger than the coarsest, which is what it chooses.
const KEPT: [usize; 5] = [1, 2, 3, 4, 5];
/// Of these the one whose curve over samples is printed.
const CURVE: usize = 2;

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

/// `logo` over the whole plane, under its own tiles.
fn large_shape() -> LargeShape {
    let tile = heights("logo");
    let metres = tile.heights().iter().map(|h| h * TILES as f32).collect();
    LargeShape::new(HeightField::new(metres, tile.size(), [TEXEL as f32 * TILES as f32; 2], Boundary::Clamp))
}

/// Prints the table and the curves, of the scenes that are named or of all; a word `patches=M` sets M.
pub(crate) fn run(words: &[String]) {
    let is_named = |case: &&Case| words.iter().any(|word| word == case.0);
    let named: Vec<Case> = CASES.iter().filter(is_named).copied().collect();
    let cases = if named.is_empty() { CASES.to_vec() } else { named };
    let patches = words.iter().find_map(|word| word.strip_prefix("patches=")?.parse().ok()).unwrap_or(4);
    println!(
        "equal time: M = {patches}, levels up to the coarsest; {PIXELS}² pixels ({PIXELS_BI_SCALE}² bi-scale), 45°, area light, {TILES}² tiles, against {} samples",
        2 * REFERENCE_HALF
    );
    println!(
        "| scene | base | φ | coarsest | µs a sample, original | level | MSE, original at 64 | level at the same time | its samples | ratio | bias | noise at 64 |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    let large = large_shape();
    let results: Vec<Comparison> = cases.iter().map(|case| compare(case, patches, &large)).collect();
    for (place, kept) in KEPT.into_iter().enumerate() {
        let sum: f64 = results.iter().map(|result| result.ratios[place].ln()).sum();
        let mean = (sum / results.len() as f64).exp();
        println!("coarsest level {}: geometric mean {mean:.3}", FACTORS[kept - 1]);
    }
    println!("| scene | samples | MSE, original | level {} |", FACTORS[KEPT[CURVE] - 1]);
    println!("|---|---|---|---|");
    for (case, result) in cases.iter().zip(&results) {
        for (n, [a, b]) in SAMPLES.iter().zip(result.curve) {
            println!("| {} | {n} | {a:.2e} | {b:.2e} |", case.0);
        }
    }
}

/// What one scene gives.
struct Comparison {
    /// Error of the level over that of the original, by coarsest level.
    ratios: [f64; KEPT.len()],
    /// Error of original and level by samples.
    curve: [[f64; 2]; SAMPLES.len()],
}

fn compare(&(map, base, bsdf, bi_scale): &Case, patches: usize, large: &LargeShape) -> Comparison {
    let large = bi_scale.then_some(large);
    let pixels = if bi_scale { PIXELS_BI_SCALE } else { PIXELS };
    let subject = Subject::with_patches(map, bsdf, &FACTORS, patches);
    let camera = parallel(45.0, FOOTPRINT, pixels);
    let lights = || area_light(pixels as f64 * FOOTPRINT * TEXEL);
    let full = subject.full();
    let original = Scene { camera, lights: lights(), surface: full.object([TILES; 2], large) };
    let reference = halves(&original, Lod::Auto, 1, REFERENCE_HALF);
    let reference = Halves::new(&reference[0], &reference[1]);
    let mse = |scene: &Scene<'_>, samples: u32, seeds: u64| {
        // several seeds: one image's error is itself noisy
        let error = |seed| relative_mse_of_image(reference, &film(scene, Lod::Auto, 100 + seed, samples).radiance());
        (0..seeds).map(|seed| error(seed).expect("not black")).sum::<f64>() / seeds as f64
    };
    let texels = original.central_footprint().unwrap_or(f64::NAN);
    let error = mse(&original, SAMPLES[COMPARED], 4);
    let mut curve = SAMPLES.map(|n| [mse(&original, n, 1), 0.0]);
    let ratios = std::array::from_fn(|place| {
        let mut asset = subject.asset.clone();
        asset.levels.truncate(KEPT[place]);
        let level = ModelData::farfield(asset);
        let coarse = Scene { camera, lights: lights(), surface: level.object([TILES; 2], large) };
        let seconds = [&original, &coarse].map(seconds_a_sample);
        let same_time = (f64::from(SAMPLES[COMPARED]) * seconds[0] / seconds[1]).round().max(1.0) as u32;
        let own = mse(&coarse, same_time, 4);
        let image = halves(&coarse, Lod::Auto, 50, BIAS_HALF);
        let parts = relative_mse(reference, Halves::new(&image[0], &image[1])).expect("not black");
        let micro = seconds.map(|s| s / (pixels * pixels) as f64 * 1e6);
        println!(
            "| {map} | {base} | {texels:.1} | {} | {:.2} | {:.2} | {error:.2e} | {own:.2e} | {same_time} | {:.3} | {:.2e} | {:.2e} |",
            FACTORS[KEPT[place] - 1],
            micro[0],
            micro[1],
            own / error,
            parts.bias.value,
            parts.noise * f64::from(2 * BIAS_HALF) / f64::from(SAMPLES[COMPARED])
        );
        if place == CURVE {
            (0..SAMPLES.len()).for_each(|k| curve[k][1] = mse(&coarse, SAMPLES[k], 1));
        }
        own / error
    });
    Comparison { ratios, curve }
}

/// CPU seconds that a sample of every pixel takes.
fn seconds_a_sample(scene: &Scene<'_>) -> f64 {
    const SAMPLES: u32 = 256;
    let started = cpu_seconds();
    film(scene, Lod::Auto, 77, SAMPLES);
    (cpu_seconds() - started) / f64::from(SAMPLES)
}
