//! Errors of an image against a reference, noise told apart from bias.
//!
//! Every image is rendered as two independent [`Halves`] of equally many samples: what both agree on is the picture,
//! what they disagree on is noise. All figures are means over pixels and RGB, so a factor on both images changes
//! nothing relative. Pixels are independent of each other (every pixel has random numbers of its own), which is what the
//! intervals rest on; they say what another seed would give, with the scene as it is. Sums run in `f64`, in pixel order,
//! so no figure depends on the number of threads.
//!
//! Notation: r and m are the pixels of reference and model, a and b the halves, d = m − r; W = Σ r_a·r_b is the energy of
//! the reference without its noise, as r_a and r_b are independent. What is relative to a black reference is `None`.

use serde::Serialize;

/// Quantile of the normal distribution that 95 % of all draws stay within, both sides counted.
pub const NORMAL_95: f64 = 1.959_963_985;

/// A figure with the interval that holds its expectation in 95 % of all repetitions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// The figure.
    pub value: f64,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl Interval {
    /// The interval about a figure of known standard error.
    pub fn about(value: f64, standard_error: f64) -> Self {
        let reach = NORMAL_95 * standard_error;
        Self { value, low: value - reach, high: value + reach }
    }

    /// Standard error that the interval stands for.
    pub fn standard_error(&self) -> f64 {
        (self.high - self.low) / (2.0 * NORMAL_95)
    }
}

/// Two renders of one image with independent random numbers and equally many samples.
#[derive(Clone, Copy, Debug)]
pub struct Halves<'a> {
    a: &'a [[f32; 3]],
    b: &'a [[f32; 3]],
}

/// Relative mean square error, taken apart.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RelativeMse {
    /// Of the mean of both halves against the noiseless reference: `bias` + `noise`.
    pub total: f64,
    /// What more samples would not remove. Its estimate is unbiased and so falls below 0 where there is nothing to find.
    pub bias: Interval,
    /// Noise of the model's image, that of the reference not counted.
    pub noise: f64,
}

impl<'a> Halves<'a> {
    /// Two images of the same pixels; at least one.
    pub fn new(a: &'a [[f32; 3]], b: &'a [[f32; 3]]) -> Self {
        assert!(a.len() == b.len() && !a.is_empty(), "two halves of one image");
        Self { a, b }
    }

    /// The mean of both halves, pixel by pixel: the best image that there is.
    pub fn image(&self) -> Vec<[f32; 3]> {
        let middle = |(a, b): (&[f32; 3], &[f32; 3])| [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]));
        self.a.iter().zip(self.b).map(middle).collect()
    }

    /// Mean over pixels and RGB.
    ///
    /// The variance of a pixel's mean over both halves is (y_a − y_b)² / 4 in expectation, y the pixel's mean over RGB.
    pub fn mean(&self) -> Interval {
        let n = self.a.len() as f64;
        let [mut sum, mut variance] = [0.0; 2];
        for (a, b) in self.pixels() {
            sum += 0.5 * (grey(a) + grey(b));
            variance += (grey(a) - grey(b)).powi(2) / 4.0;
        }
        Interval::about(sum / n, variance.sqrt() / n)
    }

    /// Noise of the mean of both halves over the energy of the image: Σ |r_a − r_b|² / 4 / Σ r_a·r_b.
    pub fn relative_noise(&self) -> Option<f64> {
        Some(self.noise() / self.energy()?)
    }

    /// Σ r_a·r_b, if it is above 0.
    fn energy(&self) -> Option<f64> {
        let energy = self.pixels().map(|(a, b)| dot(a, b)).sum::<f64>();
        (energy > 0.0).then_some(energy)
    }

    /// Σ |r_a − r_b|² / 4.
    fn noise(&self) -> f64 {
        self.pixels().map(|(a, b)| square(minus(a, b)) / 4.0).sum()
    }

    /// Both halves pixel by pixel, in `f64`.
    fn pixels(&self) -> impl Iterator<Item = ([f64; 3], [f64; 3])> {
        self.a.iter().zip(self.b).map(|(a, b)| (a.map(f64::from), b.map(f64::from)))
    }
}

/// Relative error of the model's mean, M / R − 1.
///
/// Linearised, its noise is that of Σ (m − (M/R) r) over R: with z = (m_a − (M/R) r_a) − (m_b − (M/R) r_b), the variance is
/// Σ z² / 4 / (n R)². Noise that model and reference share through common random numbers is counted as such.
pub fn mean_error(reference: Halves, model: Halves) -> Option<Interval> {
    expect_same_pixels(reference, model);
    let n = reference.a.len() as f64;
    let mean = reference.mean().value;
    if mean <= 0.0 {
        return None;
    }
    let ratio = model.mean().value / mean;
    let residual = |m: [f64; 3], r: [f64; 3]| grey(m) - ratio * grey(r);
    let variance: f64 = reference
        .pixels()
        .zip(model.pixels())
        .map(|((ra, rb), (ma, mb))| (residual(ma, ra) - residual(mb, rb)).powi(2) / 4.0)
        .sum();
    Some(Interval::about(ratio - 1.0, variance.sqrt() / (n * mean)))
}

/// Relative mean square error in its parts: bias B = Σ d_a·d_b / W and noise Σ |m_a − m_b|² / 4 / W.
///
/// d_a and d_b are independent, so that noise does not enter the expectation of their product. The interval of B follows
/// from the quadratic form q = |d|² − B |r|²: the product of its two halves has the variance (q_a − q_b)² / 4 in
/// expectation (for noise that is normal: with s = a + b and t = a − b independent, q_a − q_b = sᵀQt), so the standard error
/// is √(Σ (q_a − q_b)²) / 2 / W.
pub fn relative_mse(reference: Halves, model: Halves) -> Option<RelativeMse> {
    expect_same_pixels(reference, model);
    let energy = reference.energy()?;
    let pairs = || reference.pixels().zip(model.pixels());
    let bias = pairs().map(|((ra, rb), (ma, mb))| dot(minus(ma, ra), minus(mb, rb))).sum::<f64>() / energy;
    let form = |m: [f64; 3], r: [f64; 3]| square(minus(m, r)) - bias * square(r);
    let spread: f64 = pairs().map(|((ra, rb), (ma, mb))| (form(ma, ra) - form(mb, rb)).powi(2)).sum();
    let noise = model.noise() / energy;
    Some(RelativeMse { total: bias + noise, bias: Interval::about(bias, spread.sqrt() / 2.0 / energy), noise })
}

/// Relative mean square error of one image, its own noise counted and that of the reference not:
/// Σ (m − r_a)·(m − r_b) / W.
///
/// `image` must be independent of both halves of the reference.
pub fn relative_mse_of_image(reference: Halves, image: &[[f32; 3]]) -> Option<f64> {
    assert_eq!(reference.a.len(), image.len(), "images of one size");
    let products = reference.pixels().zip(image).map(|((ra, rb), m)| {
        let m = m.map(f64::from);
        dot(minus(m, ra), minus(m, rb))
    });
    Some(products.sum::<f64>() / reference.energy()?)
}

fn expect_same_pixels(reference: Halves, model: Halves) {
    assert_eq!(reference.a.len(), model.a.len(), "images of one size");
}

fn grey(c: [f64; 3]) -> f64 {
    (c[0] + c[1] + c[2]) / 3.0
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn square(a: [f64; 3]) -> f64 {
    dot(a, a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Stream;

    type Image = Vec<[f32; 3]>;

    const PIXELS: usize = 400;
    /// True mean error of the made-up model.
    const TOO_BRIGHT: f64 = 0.05;

    /// A picture with structure, in colour; mean near 1.
    fn truth(pixel: usize) -> [f64; 3] {
        let wave = 1.0 + 0.5 * (pixel as f64 * 0.37).sin();
        [1.2 * wave, wave, 0.8 * wave]
    }

    /// A half: `gain` times the truth, with noise of that deviation, partly shared by the channels.
    fn half(gain: f64, deviation: f64, seed: u64) -> Image {
        let stream = Stream::new(seed, 7);
        // Sum of 12 uniforms minus 6: normal but for tails beyond 6 deviations, deviation 1.
        let normal =
            |index: usize| (0..12).map(|k| f64::from(stream.uniform((index * 12 + k) as u64))).sum::<f64>() - 6.0;
        let pixel = |i: usize| {
            let shared = normal(4 * i + 3);
            [0, 1, 2].map(|k| (gain * truth(i)[k] + deviation * (normal(4 * i + k) + shared)) as f32)
        };
        (0..PIXELS).map(pixel).collect()
    }

    /// Calls `measure` on renders of `repetitions` seeds; how often it says that the truth is in its interval.
    fn coverage(repetitions: u64, measure: impl Fn(Halves, Halves) -> bool) -> f64 {
        let hits = (0..repetitions).filter(|k| {
            let images: Vec<Image> = (0..4)
                .map(|i| if i < 2 { half(1.0, 0.1, 10 * k + i) } else { half(1.0 + TOO_BRIGHT, 0.3, 10 * k + i) })
                .collect();
            measure(Halves::new(&images[0], &images[1]), Halves::new(&images[2], &images[3]))
        });
        hits.count() as f64 / repetitions as f64
    }

    /// Repetitions of a coverage test, and how far its result may lie from 95 %: 3.5 standard errors of a share of 95 %.
    const REPETITIONS: u64 = 600;
    const COVERAGE_REACH: f64 = 0.031;

    #[test]
    fn the_interval_of_the_mean_error_covers_the_truth_in_95_percent() {
        let share = coverage(REPETITIONS, |reference, model| {
            let error = mean_error(reference, model).unwrap();
            (error.low..=error.high).contains(&TOO_BRIGHT)
        });
        assert!((share - 0.95).abs() < COVERAGE_REACH, "{share}");
    }

    #[test]
    fn the_interval_of_the_bias_covers_the_truth_in_95_percent() {
        // (gain − 1)² is the relative mean square error of a picture that is `gain` times the truth.
        let share = coverage(REPETITIONS, |reference, model| {
            let bias = relative_mse(reference, model).unwrap().bias;
            (bias.low..=bias.high).contains(&TOO_BRIGHT.powi(2))
        });
        assert!((share - 0.95).abs() < COVERAGE_REACH, "{share}");
    }

    #[test]
    fn the_mean_of_an_image_is_that_of_its_pixels_within_its_interval() {
        let share = coverage(REPETITIONS, |reference, _| {
            let mean = reference.mean();
            let expected = (0..PIXELS).map(|i| grey(truth(i))).sum::<f64>() / PIXELS as f64;
            (mean.low..=mean.high).contains(&expected)
        });
        assert!((share - 0.95).abs() < COVERAGE_REACH, "{share}");
    }

    #[test]
    fn noise_and_bias_add_up_and_are_what_was_put_in() {
        let images: Vec<Image> = [(1.0, 0.0), (1.0, 0.0), (1.1, 0.2), (1.1, 0.2)]
            .iter()
            .enumerate()
            .map(|(seed, &(gain, deviation))| half(gain, deviation, seed as u64))
            .collect();
        let [reference, model] = [Halves::new(&images[0], &images[1]), Halves::new(&images[2], &images[3])];
        let mse = relative_mse(reference, model).unwrap();
        assert_eq!(mse.total, mse.bias.value + mse.noise);
        // A channel of a half has the variance 2 σ², the mean of both σ²; three channels over the mean energy of a pixel.
        let energy: f64 = (0..PIXELS).map(|i| square(truth(i))).sum::<f64>() / PIXELS as f64;
        let expected = 3.0 * 0.2 * 0.2 / energy;
        // Variance of |m_a − m_b|²: covariance of the channels 4 σ² on the diagonal, 2 σ² off it; 2 tr C² = 36 of 12²
        // squared means a pixel, so the sum over n pixels is off by √(144 / 144 / n), 5 %; four of these.
        assert!((mse.noise / expected - 1.0).abs() < 0.2, "{} {expected}", mse.noise);
        assert!((mse.bias.value - 0.01).abs() < 3.5 * mse.bias.standard_error(), "{mse:?}");
        assert_eq!(reference.relative_noise(), Some(0.0));
    }

    #[test]
    fn without_noise_every_figure_is_exact() {
        let [reference, model] = [half(1.0, 0.0, 0), half(0.75, 0.0, 0)];
        let [reference, model] = [Halves::new(&reference, &reference), Halves::new(&model, &model)];
        let error = mean_error(reference, model).unwrap();
        let mse = relative_mse(reference, model).unwrap();
        // Pixels are rounded to f32: 6e-8 of each, in both images.
        assert!((error.value + 0.25).abs() < 1e-6 && error.high - error.low < 1e-12, "{error:?}");
        assert!((mse.bias.value - 0.0625).abs() < 1e-6 && mse.noise == 0.0, "{mse:?}");
        assert!((relative_mse_of_image(reference, &model.image()).unwrap() - 0.0625).abs() < 1e-6);
    }

    #[test]
    fn the_noise_of_the_reference_does_not_enter_the_error_of_an_image() {
        let clean = half(1.0, 0.0, 0);
        let errors: Vec<f64> = (0..200)
            .map(|k| {
                let [a, b] = [half(1.0, 0.5, 2 * k), half(1.0, 0.5, 2 * k + 1)];
                relative_mse_of_image(Halves::new(&a, &b), &clean).unwrap()
            })
            .collect();
        let n = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / n;
        let deviation = (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (n - 1.0) / n).sqrt();
        assert!(mean.abs() < 3.5 * deviation, "{mean} ± {deviation}: the image is the truth");
    }

    #[test]
    fn nothing_is_relative_to_a_black_reference() {
        let [black, grey] = [vec![[0.0; 3]; 4], vec![[0.5; 3]; 4]];
        let [reference, model] = [Halves::new(&black, &black), Halves::new(&grey, &grey)];
        assert_eq!(mean_error(reference, model), None);
        assert_eq!(relative_mse(reference, model), None);
        assert_eq!(relative_mse_of_image(reference, &grey), None);
        assert_eq!(reference.relative_noise(), None);
    }
}
