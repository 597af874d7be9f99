//! The normal distribution: its integrals, and how a Gaussian of slopes is seen.
//!
//! A facet of slope x (standard normal) shows c − s·x of its area to an eye in the direction (s, c); what it shows is never
//! negative. Both the mean of that area and samples weighted by it have closed forms or a monotone equation. All in `f64`,
//! for the tails.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Deviations beyond which the normal distribution ends here: 1e-9 of it lies further out on either side, less than half
/// of the step 2⁻²⁴ of a random number.
const END: f64 = 6.0;

/// Newton steps of [`shown_quantile`] at most: those next to the silhouette gain a bit each, the others triple their digits.
const MAX_STEPS: usize = 40;

/// Deviations below which a Newton step ends the search: slopes are used in `f32`.
const LAST_STEP: f64 = 1e-8;

/// φ(x) = exp(−x²/2)/√(2π).
#[inline]
pub fn density(x: f64) -> f64 {
    (-0.5 * x * x).exp() / TAU.sqrt()
}

/// Φ(x) = ∫_{−∞}^x φ, with a relative error below 1e-8 in the lower tail.
#[inline]
pub fn cumulative(x: f64) -> f64 {
    let tail = 0.5 * erfc(x.abs() * FRAC_1_SQRT_2);
    if x < 0.0 { tail } else { 1.0 - tail }
}

/// erfc(x) = 2/√π ∫_x^∞ exp(−t²) dt for x >= 0, with a relative error below 1e-8.
///
/// exp(−x²)·t·P(t) with t = 1/(1 + 0.4 x): t maps [0, ∞) to (0, 1], where erfc(x) exp(x²)/t is smooth. P has the smallest
/// largest relative error (6.2e-9) of its degree, found by iteratively reweighted least squares on 1500 Chebyshev nodes.
pub fn erfc(x: f64) -> f64 {
    debug_assert!(x >= 0.0, "erfc of {x}");
    const P: [f64; 11] = [
        0.2256758336738,
        0.2256759100233,
        0.2076129211101,
        0.1717459214381,
        0.1189765683087,
        0.08401093254941,
        -0.04707594076544,
        0.1377833336512,
        -0.2356962935572,
        0.1405194115619,
        -0.02922860418494,
    ];
    let t = 1.0 / (1.0 + 0.4 * x);
    let polynomial = P.iter().rev().fold(0.0, |sum, p| sum * t + p);
    t * polynomial * (-x * x).exp()
}

/// E[max(0, X)] for X normal of that mean and standard deviation: m Φ(m/σ) + σ φ(m/σ).
///
/// With m = cosθ of an eye to the mean plane and σ the deviation of ⟨n, ω⟩/⟨n, z⟩ this is the area of all facets that face
/// the eye, cosθ (1 + Λ) in Smith's terms, without a division by cosθ.
pub fn mean_of_positive_part(mean: f32, deviation: f32) -> f32 {
    debug_assert!(deviation >= 0.0, "deviation {deviation}");
    let [m, sigma] = [mean, deviation].map(f64::from);
    // Beyond the end the other side adds less than 2e-11 σ; this is also what guards the quotient.
    if m.abs() >= END * sigma {
        return mean.max(0.0);
    }
    let k = m / sigma;
    (m * cumulative(k) + sigma * density(k)) as f32
}

/// The x below which lies the fraction `u` of the density proportional to max(0, c − s x) φ(x), c > 0, s >= 0.
///
/// Its cumulative is c Φ(x) + s φ(x) up to the silhouette x = c/s. Newton's steps start at the mode
/// −2s/(c + √(c² + 4s²)), where the cumulative turns from convex to concave: from there they run to the solution from one
/// side and never past it. The result lies within [−6, 6].
pub fn shown_quantile(c: f32, s: f32, u: f32) -> f32 {
    debug_assert!(c > 0.0 && s >= 0.0, "an eye above the mean plane, not ({s}, {c})");
    let [c, s, u] = [c, s, u].map(f64::from);
    let end = if c >= END * s { END } else { c / s };
    let shown = |x: f64| c * cumulative(x) + s * density(x);
    let target = u * shown(end);
    let mut x = -2.0 * s / (c + (c * c + 4.0 * s * s).sqrt());
    for _ in 0..MAX_STEPS {
        let slope = (c - s * x) * density(x);
        if slope <= 0.0 {
            break; // on the silhouette, within rounding
        }
        // Steps stay on their side but for rounding; they stop at the ends: u = 0 is met at −∞.
        let next = (x - (shown(x) - target) / slope).clamp(-END, end);
        let step = (next - x).abs();
        x = next;
        if step < LAST_STEP || x <= -END {
            break;
        }
    }
    x as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Simpson's rule with 4000 intervals.
    fn integral(from: f64, to: f64, f: impl Fn(f64) -> f64) -> f64 {
        let n = 4000;
        let h = (to - from) / n as f64;
        let weight = |k: usize| if k == 0 || k == n { 1.0 } else { 2.0 + 2.0 * (k % 2) as f64 };
        (0..=n).map(|k| weight(k) * f(from + k as f64 * h)).sum::<f64>() * h / 3.0
    }

    #[test]
    fn erfc_keeps_its_relative_error_into_the_tail() {
        for k in 0..=400 {
            let x = 0.02 * f64::from(k);
            // exp(−x²)·2/√π ∫_0^∞ exp(−t² − 2xt) dt: nothing under- or overflows.
            let scale = (-x * x).exp() * 2.0 / std::f64::consts::PI.sqrt();
            let expected = scale * integral(0.0, 7.0, |t| (-t * t - 2.0 * x * t).exp());
            assert!((erfc(x) / expected - 1.0).abs() < 1e-8, "{x}: {} is {expected}", erfc(x));
        }
    }

    #[test]
    fn the_cumulative_is_symmetric_and_known_at_one_and_two_deviations() {
        assert!((cumulative(1.0) - 0.841_344_746_068_543).abs() < 1e-9);
        assert!((cumulative(2.0) - 0.977_249_868_051_821).abs() < 1e-9);
        for x in [0.0, 0.1, 1.0, 3.0, 5.0] {
            assert!((cumulative(x) + cumulative(-x) - 1.0).abs() < 1e-8);
        }
    }

    #[test]
    fn the_mean_of_the_positive_part_is_its_integral() {
        for m in [-0.9f32, -0.1, 0.0, 1e-3, 0.2, 1.0] {
            for sigma in [0.02f32, 0.2, 1.0, 5.0] {
                let [mean, deviation] = [m, sigma].map(f64::from);
                let end = -mean / deviation;
                let shown = integral(end.clamp(-9.0, 9.0), 9.0, |x| (mean + deviation * x).max(0.0) * density(x));
                let value = f64::from(mean_of_positive_part(m, sigma));
                assert!((value - shown).abs() < 1e-6 * shown + 1e-9 * deviation, "{m} {sigma}: {value} is {shown}");
            }
        }
        assert_eq!(mean_of_positive_part(0.3, 0.0), 0.3);
        assert_eq!(mean_of_positive_part(-0.3, 0.0), 0.0);
    }

    #[test]
    fn quantiles_leave_their_fraction_below_them() {
        for [c, s] in [[1.0f32, 0.0], [0.99, 0.01], [0.7, 0.7], [0.2, 1.0], [1e-3, 1.0], [1e-6, 0.3]] {
            let [cd, sd] = [c, s].map(f64::from);
            let shown = |x: f64| cd * cumulative(x) + sd * density(x);
            let whole = shown(if s > 0.0 { (cd / sd).min(9.0) } else { 9.0 });
            let mut last = -7.0;
            for u in [1e-6f32, 1e-3, 0.1, 0.3, 0.5, 0.9, 0.999, 1.0 - 6e-8] {
                let x = shown_quantile(c, s, u);
                assert!(x > last, "quantiles grow: {x} after {last}");
                last = x;
                // The cumulative is off by 1e-8; x is rounded to f32.
                let fraction = shown(x.into()) / whole;
                assert!((fraction - f64::from(u)).abs() < 5e-7, "({c}, {s}) {u}: {x} leaves {fraction}");
            }
            assert_eq!(shown_quantile(c, s, 0.0), -6.0);
        }
    }
}
