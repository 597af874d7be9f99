//! FLIP: how visible a difference is to someone who flips between two pictures (Andersson et al. 2020; `docs/report.md`).
//!
//! FLIP compares pictures as a screen shows them, so radiance is exposed, clipped at white and coded as sRGB in 8 bits
//! first. One exposure serves a reference and all models beside it; else a model could hide a wrong brightness.

use nv_flip::{FlipImageRgb8, FlipPool};

use super::error_map::srgb_code;

/// Pixels a degree of the viewing angle: a screen of 3840 pixels and 0.7 m width, 0.7 m away, as FLIP's authors take it.
pub const PIXELS_PER_DEGREE: f32 = nv_flip::DEFAULT_PIXELS_PER_DEGREE;

/// Share of the pixels that the exposure keeps at or below [`EXPOSED`].
const PERCENTILE: f64 = 0.99;
/// What a pixel of that rank becomes: linear, 1 is white; so 1 % of the pixels may come near white or clip.
const EXPOSED: f32 = 0.9;

/// The difference between two pictures, as seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Flip {
    /// Mean over the pixels, 0 (none) to 1.
    pub mean: f64,
    /// Every pixel's, row-major, 0 to 1.
    pub map: Vec<f32>,
}

/// Factor that takes the 99th percentile of a picture's pixels to 0.9; 1 where that pixel is black.
///
/// A pixel counts by its largest channel, so that colours keep their hue up to there.
pub fn exposure(reference: &[[f32; 3]]) -> f32 {
    assert!(!reference.is_empty(), "a picture has pixels");
    let mut largest: Vec<f32> = reference.iter().map(|c| c[0].max(c[1]).max(c[2])).collect();
    largest.sort_by(f32::total_cmp);
    let bright = largest[((largest.len() - 1) as f64 * PERCENTILE).round() as usize];
    if bright > 0.0 { EXPOSED / bright } else { 1.0 }
}

/// FLIP between two pictures of linear radiance, `size` wide and high, at that exposure.
pub fn flip(reference: &[[f32; 3]], image: &[[f32; 3]], size: [u32; 2], exposure: f32) -> Flip {
    let map = nv_flip::flip(coded(reference, size, exposure), coded(image, size, exposure), PIXELS_PER_DEGREE);
    // The pool sums in pixel order; its quantiles are coarse, its mean is exact.
    let mean = f64::from(FlipPool::from_image(&map).mean());
    Flip { mean, map: map.to_vec() }
}

/// The picture as a screen gets it.
fn coded(pixels: &[[f32; 3]], size: [u32; 2], exposure: f32) -> FlipImageRgb8 {
    let [width, height] = size;
    assert_eq!(pixels.len(), width as usize * height as usize, "a picture of that size");
    let bytes: Vec<u8> = pixels.iter().flat_map(|c| c.map(|linear| srgb_code(linear * exposure))).collect();
    FlipImageRgb8::with_data(width, height, &bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Stream;

    const SIZE: [u32; 2] = [48, 40];

    fn picture(gain: f32, noise: f32) -> Vec<[f32; 3]> {
        let stream = Stream::new(3, 1);
        (0..SIZE[0] * SIZE[1])
            .map(|i| {
                let wave = 0.4 + 0.2 * (i as f32 * 0.05).sin();
                [1.0, 0.8, 0.6].map(|k| k * gain * wave + noise * (stream.uniform(u64::from(i)) - 0.5))
            })
            .collect()
    }

    #[test]
    fn a_picture_does_not_differ_from_itself() {
        let flip = flip(&picture(1.0, 0.0), &picture(1.0, 0.0), SIZE, 1.0);
        assert_eq!(flip.mean, 0.0);
        assert!(flip.map.iter().all(|&value| value == 0.0));
    }

    #[test]
    fn black_against_white_is_the_largest_difference() {
        let pixels = (SIZE[0] * SIZE[1]) as usize;
        let flip = flip(&vec![[0.0; 3]; pixels], &vec![[1.0; 3]; pixels], SIZE, 1.0);
        // FLIP maps the largest difference of hue, not that of grey, to 1: black to white is 0.96 to 1 in its paper's
        // colour space; no feature differs.
        assert!(flip.mean > 0.9 && flip.mean <= 1.0, "{}", flip.mean);
    }

    #[test]
    fn the_mean_is_that_of_the_map_and_grows_with_the_difference() {
        let reference = picture(1.0, 0.0);
        let means = [1.02, 1.1, 1.5].map(|gain| {
            let flip = flip(&reference, &picture(gain, 0.0), SIZE, 1.0);
            let mean = flip.map.iter().map(|&v| f64::from(v)).sum::<f64>() / flip.map.len() as f64;
            // The mean is summed in f32 there: 1920 terms.
            assert!((flip.mean - mean).abs() < 1e-5, "{} {mean}", flip.mean);
            flip.mean
        });
        assert!(means[0] < means[1] && means[1] < means[2], "{means:?}");
    }

    #[test]
    fn exposure_undoes_the_scale_of_the_scene() {
        let [dim, bright] = [picture(1e-3, 0.0), picture(1e3, 0.0)];
        let [a, b] = [exposure(&dim), exposure(&bright)];
        assert!((a / b / 1e6 - 1.0).abs() < 1e-5);
        let brightest = bright.iter().filter(|c| c[0] * b > EXPOSED).count();
        assert!(brightest <= bright.len() / 100 + 1, "{brightest}");
        assert_eq!(exposure(&[[0.0; 3]]), 1.0);
    }
}
