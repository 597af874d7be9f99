//! Real spherical harmonics, in the order l(l + 1) + m.

use std::f64::consts::PI;

use glam::Vec3;

/// Highest band of [`basis`].
pub const MAX_BAND: usize = 8;

/// Calls `visit(l(l + 1) + m, Y_lm(w))` for all bands up to `max_band` at the unit vector `w`.
///
/// \[WU19\] (2.16), (2.17), without the Condon-Shortley phase. With r = (x + iy)^m as a pair of real recurrences there are no
/// angles: Y_lm = √2 K_lm P̃_lm(z)·Re r (m > 0) or ·Im r (m < 0), P̃ the Legendre function over sin^m θ.
///
/// # Panics
/// If `max_band` is over [`MAX_BAND`].
pub fn basis(max_band: usize, w: Vec3, mut visit: impl FnMut(usize, f64)) {
    assert!(max_band <= MAX_BAND, "bands up to {MAX_BAND}");
    let [x, y, z] = w.as_dvec3().to_array();
    let [mut re, mut im] = [1.0, 0.0];
    let mut sectoral = 1.0; // P̃_mm = (2m − 1)!!
    for m in 0..=max_band {
        let [mut before, mut p] = [0.0, sectoral];
        for l in m..=max_band {
            let value = normalisation(l, m) * p;
            if m == 0 {
                visit(l * (l + 1), value);
            } else {
                let value = value * 2f64.sqrt();
                visit(l * (l + 1) + m, value * re);
                visit(l * (l + 1) - m, value * im);
            }
            // (l − m + 1) P̃_{l+1} = (2l + 1) z P̃_l − (l + m) P̃_{l−1}
            let next = ((2 * l + 1) as f64 * z * p - (l + m) as f64 * before) / (l - m + 1) as f64;
            (before, p) = (p, next);
        }
        (re, im) = (re * x - im * y, re * y + im * x);
        sectoral *= (2 * m + 1) as f64;
    }
}

/// K_lm = √((2l + 1)/4π · (l − m)!/(l + m)!).
fn normalisation(l: usize, m: usize) -> f64 {
    let ratio: f64 = (l - m + 1..=l + m).map(|k| k as f64).product();
    ((2 * l + 1) as f64 / (4.0 * PI * ratio)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::warp;

    #[test]
    fn the_first_bands_are_the_textbook_ones() {
        let w = Vec3::new(0.36, -0.48, 0.8);
        let [x, y, z] = w.as_dvec3().to_array();
        let mut values = [0.0; 9];
        basis(2, w, |k, value| values[k] = value);
        let one = (3.0 / (4.0 * PI)).sqrt();
        let two = (15.0 / (4.0 * PI)).sqrt();
        let expected = [
            (1.0 / (4.0 * PI)).sqrt(),
            one * y,
            one * z,
            one * x,
            two * x * y,
            two * y * z,
            (5.0 / (16.0 * PI)).sqrt() * (3.0 * z * z - 1.0),
            two * x * z,
            0.5 * two * (x * x - y * y),
        ];
        for k in 0..9 {
            assert!((values[k] - expected[k]).abs() < 1e-7, "{k}: {} {}", values[k], expected[k]);
        }
    }

    #[test]
    fn they_are_orthonormal() {
        let n = 128;
        let count = (MAX_BAND + 1) * (MAX_BAND + 1);
        let mut products = vec![0.0; count * count];
        for k in 0..n * n {
            let u = [(k % n) as f32 + 0.5, (k / n) as f32 + 0.5].map(|x| x / n as f32);
            let mut values = vec![0.0; count];
            basis(MAX_BAND, warp::sphere(u), |i, value| values[i] = value);
            for i in 0..count {
                (0..count).for_each(|j| products[i * count + j] += values[i] * values[j] * 4.0 * PI / (n * n) as f64);
            }
        }
        for i in 0..count {
            for j in 0..count {
                let expected = if i == j { 1.0 } else { 0.0 };
                // midpoint rule in z: (Δz)²/24 times a second derivative of up to l⁴
                assert!((products[i * count + j] - expected).abs() < 2e-2, "{i} {j}: {}", products[i * count + j]);
            }
        }
    }
}
