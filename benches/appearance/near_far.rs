//! From near to far: the mean of the image, and how it flickers as the camera moves by parts of a pixel.

use farfield::transport::camera::Camera;
use farfield::transport::scene::{Lod, Scene};

use super::subjects::{GGX_03, Subject, TEXEL, area_light, film, parallel};

const DISTANCES: usize = 24;
const PIXELS: usize = 128;
const SAMPLES: u32 = 16;
/// Sub-pixel shifts, and samples a pixel of each of their images.
const SHIFTS: usize = 16;
const FLICKER_SAMPLES: u32 = 16;
/// Samples a pixel of the original that stand for the picture itself: what changes in it as the camera moves is no noise.
const TRUE_SAMPLES: u32 = 128;
/// Pixels a side of these images.
const FLICKER_PIXELS: usize = 32;
const TILES: [u32; 2] = [100, 100];

/// Prints the table.
pub(crate) fn run() {
    println!(
        "near to far: twill, GGX 0.3, levels 2 to 128, 45°, area light; {PIXELS}² pixels, 4 × {SAMPLES} samples for means, {SHIFTS} shifts of {FLICKER_SAMPLES} samples"
    );
    println!(
        "| φ | mean of level over original, % | standard error | temporal variance, original | level | ratio | of the picture itself, over the original's | of the error, original | level |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let subject = Subject::new("twill", GGX_03, &[2, 4, 8, 16, 32, 64, 128]);
    let [full, level] = [subject.full(), subject.farfield()];
    for k in 0..DISTANCES {
        let texels = 128.0_f64.powf(k as f64 / (DISTANCES - 1) as f64);
        let width = PIXELS as f64 * texels * TEXEL;
        let scene = |data: &'static str, camera: Camera| Scene {
            camera,
            // far and large against the relief, so that it is the same light at every distance
            lights: area_light(width.max(1.0)),
            surface: if data == "full" { full.object(TILES, None) } else { level.object(TILES, None) },
        };
        let camera = parallel(45.0, texels, PIXELS);
        let means = |data| -> Vec<f64> {
            (0..4).map(|seed| grey(&film(&scene(data, camera), Lod::Auto, seed, SAMPLES).radiance())).collect()
        };
        let [a, b] = [means("full"), means("level")].map(|means| mean_and_error(&means));
        let shown = |data, shift: usize, seed: u64, samples| {
            let moved = scene(data, shifted(parallel(45.0, texels, FLICKER_PIXELS), shift));
            film(&moved, Lod::Auto, seed + shift as u64, samples).radiance()
        };
        let images = |data| -> Vec<_> { (0..SHIFTS).map(|shift| shown(data, shift, 1000, FLICKER_SAMPLES)).collect() };
        let truth: Vec<_> = (0..SHIFTS).map(|shift| shown("full", shift, 2000, TRUE_SAMPLES)).collect();
        let [full_images, level_images] = [images("full"), images("level")];
        let [f, l, t] = [&full_images, &level_images, &truth].map(|images| temporal_variance(images));
        let [fe, le] = [full_images, level_images].map(|images| temporal_variance(&differences(&images, &truth)));
        let error = (a.1 / a.0).hypot(b.1 / b.0);
        println!(
            "| {texels:.1} | {:+.2} | {:.2} | {f:.2e} | {l:.2e} | {:.3} | {:.2} | {fe:.2e} | {le:.2e} |",
            100.0 * (b.0 / a.0 - 1.0),
            100.0 * error,
            l / f,
            t / f
        );
    }
}

/// The camera moved across its film by a part of a pixel, low-discrepancy over the shifts.
fn shifted(camera: Camera, shift: usize) -> Camera {
    let part = |base: f64| (shift as f64 * base).fract() - 0.5;
    camera.shifted(part(0.754_877_666), part(0.569_840_291))
}

fn grey(image: &[[f32; 3]]) -> f64 {
    image.iter().map(|p| f64::from(p[1])).sum::<f64>() / image.len() as f64
}

fn mean_and_error(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// What images differ by, one by one.
fn differences(images: &[Vec<[f32; 3]>], truth: &[Vec<[f32; 3]>]) -> Vec<Vec<[f32; 3]>> {
    let minus = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|k| a[k] - b[k]);
    images.iter().zip(truth).map(|(image, truth)| image.iter().zip(truth).map(minus).collect()).collect()
}

/// Variance of a pixel over the shifts, mean over the pixels.
fn temporal_variance(images: &[Vec<[f32; 3]>]) -> f64 {
    let pixels = images[0].len();
    let of_pixel = |pixel: usize| {
        let values: Vec<f64> = images.iter().map(|image| f64::from(image[pixel][1])).collect();
        mean_and_error(&values).1.powi(2) * images.len() as f64
    };
    (0..pixels).map(of_pixel).sum::<f64>() / pixels as f64
}
