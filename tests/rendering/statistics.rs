//! Images against expectations, by z-scores.

use farfield::math::gaussian;
use farfield::transport::film::Film;

/// False alarms allowed a test; the suite has about 20 of them.
const SIGNIFICANCE: f64 = 5e-4;
/// Pixels that may fail although each is held to the corrected significance.
const PIXEL_SHARE: f64 = 0.0025;

/// |z| that a normal variable exceeds with the probability `p`, on both sides.
pub(super) fn two_sided_z(p: f64) -> f64 {
    let [mut low, mut high] = [0.0, 40.0];
    for _ in 0..100 {
        let z = 0.5 * (low + high);
        if 2.0 * gaussian::cumulative(-z) > p { low = z } else { high = z }
    }
    high
}

/// Holds every pixel of `film` against `expected` (with a variance of its own) at a Šidák-corrected significance: at most
/// 0.25 % may fail.
pub(super) fn expect_pixels(film: &Film, expected: impl Fn(usize) -> ([f64; 3], [f64; 3])) {
    let (radiance, variance) = (film.radiance(), film.variance());
    let count = 3 * radiance.len();
    let threshold = two_sided_z(1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / count as f64));
    let mut failed = Vec::new();
    for pixel in 0..radiance.len() {
        let (mean, own) = expected(pixel);
        for c in 0..3 {
            let error = (f64::from(radiance[pixel][c]) - mean[c]).abs();
            let deviation = (f64::from(variance[pixel][c]) + own[c]).sqrt();
            // stored values are f32
            if error > threshold * deviation + 1e-6 * mean[c].abs() {
                failed.push((pixel, radiance[pixel], mean, deviation));
            }
        }
    }
    assert!(
        failed.len() as f64 <= PIXEL_SHARE * count as f64,
        "{} of {count} differ: {:?}",
        failed.len(),
        failed.first()
    );
}

/// Mean of the green channel over all pixels and the standard error of that mean.
pub(super) fn mean(film: &Film) -> (f64, f64) {
    let n = film.radiance().len() as f64;
    let mean = film.radiance().iter().map(|pixel| f64::from(pixel[1])).sum::<f64>() / n;
    let variance = film.variance().iter().map(|pixel| f64::from(pixel[1])).sum::<f64>() / (n * n);
    (mean, variance.sqrt())
}

/// Holds the mean of the image against `expected`, with `allowed` relative error beside the noise.
pub(super) fn expect_mean(film: &Film, expected: f64, allowed: f64) {
    let (mean, error) = mean(film);
    let limit = two_sided_z(SIGNIFICANCE) * error + allowed * expected;
    assert!((mean - expected).abs() <= limit, "mean {mean} ± {error}, expected {expected} within {limit}");
}
