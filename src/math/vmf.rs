//! The von Mises-Fisher distribution on the sphere, in forms that hold from κ = 0 to 1e6.
//!
//! γ(ω; κ, μ) = κ/(4π sinh κ) · exp(κ ω·μ) overflows at κ = 89 and cancels everywhere else; nothing here uses it.

use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// Largest concentration: the lobe is 0.06° wide, and 1 − r = 1e-6 is still 17 units in the last place of 1.
pub const MAX_KAPPA: f32 = 1e6;

/// One von Mises-Fisher lobe, a density on the unit sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vmf {
    /// Mean direction μ, unit.
    pub mean: Vec3,
    /// Concentration κ, 0 (uniform) to [`MAX_KAPPA`].
    pub kappa: f32,
}

impl Vmf {
    /// Density in the direction `w` (unit), per steradian.
    ///
    /// γ = κ/(2π(1 − e^{−2κ})) · exp(−κ|ω − μ|²/2): the exponent does not cancel near μ, where the lobe is.
    pub fn pdf(&self, w: Vec3) -> f32 {
        peak_density(self.kappa) * (-0.5 * self.kappa * (w - self.mean).length_squared()).exp()
    }

    /// A direction that follows the density, from two uniform numbers in [0, 1).
    ///
    /// Inverting the distribution of t = 1 − cos θ: t = −ln(1 − u(1 − e^{−2κ}))/κ, which is 2u for κ → 0.
    pub fn sample(&self, u: [f32; 2]) -> Vec3 {
        let falloff = (-2.0 * self.kappa).exp_m1();
        let t = if self.kappa > 0.0 { -(u[0] * falloff).ln_1p() / self.kappa } else { 2.0 * u[0] };
        // Rounding may put t just outside of its range [0, 2].
        let t = t.clamp(0.0, 2.0);
        let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
        let (tangent, bitangent) = self.mean.any_orthonormal_pair();
        let sin_theta = (t * (2.0 - t)).sqrt();
        sin_theta * (cos_phi * tangent + sin_phi * bitangent) + (1.0 - t) * self.mean
    }
}

/// Density at the mean direction, κ/(2π(1 − e^{−2κ})); 1/4π for κ = 0.
pub fn peak_density(kappa: f32) -> f32 {
    debug_assert!((0.0..=MAX_KAPPA).contains(&kappa), "concentration {kappa} out of range");
    if kappa > 0.0 { kappa / (-TAU * (-2.0 * kappa).exp_m1()) } else { 0.25 / PI }
}

/// Mean resultant length r = |∫ω γ dω| = coth κ − 1/κ.
///
/// The two terms cancel for small κ: there κ/3 − κ³/45 + 2κ⁵/945 − κ⁷/4725, below 4e-8 off at κ = 0.3.
pub fn mean_resultant_length(kappa: f32) -> f32 {
    if kappa < 0.3 {
        let [k, k2] = [kappa, kappa * kappa];
        return k * (1.0 / 3.0 - k2 * (1.0 / 45.0 - k2 * (2.0 / 945.0 - k2 / 4725.0)));
    }
    (1.0 - f64::from(one_minus_resultant(kappa))) as f32
}

/// 1 − r without cancellation: 1/κ − 2/(e^{2κ} − 1) for κ that is not small.
pub fn one_minus_resultant(kappa: f32) -> f32 {
    if kappa < 0.3 {
        return 1.0 - mean_resultant_length(kappa);
    }
    if kappa > 10.0 {
        return 1.0 / kappa; // the rest is 4e-8 of it
    }
    let k = f64::from(kappa);
    (1.0 / k - 2.0 / (2.0 * k).exp_m1()) as f32
}

/// The concentration whose mean resultant length is 1 − `one_minus_r`, at most [`MAX_KAPPA`].
///
/// κ ≈ r(3 − r²)/((1 − r)(1 + r)) \[VMF\], refined by Newton steps on coth κ − 1/κ = r. For 1 − r < 0.1 the coth is 1
/// to 4e-9 and κ = 1/(1 − r); for r < 0.1 the inverse series 3r + 9r³/5 + 297r⁵/175 + 1539r⁷/875 is as exact.
pub fn kappa_from_one_minus_r(one_minus_r: f32) -> f32 {
    debug_assert!((0.0..=1.0).contains(&one_minus_r), "1 - r = {one_minus_r} out of range");
    if one_minus_r < 0.1 {
        return (1.0 / one_minus_r).min(MAX_KAPPA);
    }
    let q = f64::from(one_minus_r);
    let r = 1.0 - q;
    let r2 = r * r;
    if r < 0.1 {
        return (r * (3.0 + r2 * (9.0 / 5.0 + r2 * (297.0 / 175.0 + r2 * 1539.0 / 875.0)))) as f32;
    }
    let mut kappa = r * (3.0 - r2) / (q * (1.0 + r));
    // The start is within 4 %; each step squares the error (see the test of the inverse).
    for _ in 0..3 {
        let coth = 1.0 / kappa.tanh();
        let slope = 1.0 / (kappa * kappa) - (coth * coth - 1.0);
        kappa -= (coth - 1.0 / kappa - r) / slope;
    }
    kappa as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    const KAPPAS: [f32; 14] = [0.0, 1e-6, 1e-3, 0.1, 0.29, 0.31, 1.0, 3.0, 9.0, 11.0, 100.0, 1e4, 9e5, 1e6];

    #[test]
    fn the_density_integrates_to_one_and_its_mean_is_the_resultant() {
        for kappa in KAPPAS {
            // Substituting t = (1 − cos θ) in steps that follow the lobe; midpoint rule, 2π for the azimuth.
            let lobe = Vmf { mean: Vec3::Z, kappa };
            let steps = 100_000;
            let reach = (40.0 / f64::from(kappa).max(1e-9)).min(2.0);
            let [mut mass, mut first] = [0.0, 0.0];
            for k in 0..steps {
                let t = (k as f64 + 0.5) / steps as f64 * reach;
                let w = Vec3::new((t * (2.0 - t)).sqrt() as f32, 0.0, (1.0 - t) as f32);
                // The exponent through the distance that this w has, so that f32 rounding of w does not matter.
                let t = 0.5 * f64::from((w - lobe.mean).length_squared());
                let pdf = f64::from(lobe.pdf(w)) * std::f64::consts::TAU * reach / steps as f64;
                mass += pdf;
                first += pdf * t;
            }
            // f32 density: a few roundings, and the rounding of w for the narrowest lobes.
            assert!((mass - 1.0).abs() < 2e-5, "kappa {kappa}: {mass}");
            let expected = f64::from(one_minus_resultant(kappa));
            assert!((first - expected).abs() < 4e-5 * expected, "kappa {kappa}: {first} {expected}");
        }
    }

    #[test]
    fn concentration_and_resultant_are_inverse_of_each_other() {
        let mut kappa = 1e-3_f32;
        while kappa < 1e6 {
            let back = kappa_from_one_minus_r(one_minus_resultant(kappa));
            // 1 − r is stored to 6e-8: 2e-7 of κ where it is small, a relative rounding where it is large.
            assert!((back - kappa).abs() < 3e-7 + 6e-7 * kappa, "{kappa} {back}");
            kappa *= 1.01;
        }
        assert_eq!(kappa_from_one_minus_r(1.0), 0.0);
        assert_eq!(kappa_from_one_minus_r(0.0), MAX_KAPPA);
        assert_eq!(kappa_from_one_minus_r(1e-7), MAX_KAPPA);
    }

    #[test]
    fn the_resultant_is_smooth_across_its_branches() {
        assert_eq!(mean_resultant_length(0.0), 0.0);
        for kappa in [0.05, 0.2999, 0.3001, 0.5_f32] {
            let k = f64::from(kappa);
            let exact = 1.0 / k.tanh() - 1.0 / k;
            assert!((f64::from(mean_resultant_length(kappa)) / exact - 1.0).abs() < 2e-7, "{kappa}");
        }
    }

    #[test]
    fn samples_follow_the_density() {
        const BINS: usize = 20;
        const COUNT: usize = 40_000;
        for kappa in KAPPAS {
            for mean in [Vec3::Z, Vec3::NEG_Z, Vec3::new(0.6, -0.48, 0.64)] {
                let lobe = Vmf { mean, kappa };
                let (tangent, bitangent) = mean.any_orthonormal_pair();
                let mut counts = [[0_u32; BINS]; BINS];
                for k in 0..COUNT {
                    // Independent numbers: hashes of the index.
                    let u = [0, 1].map(|d| hashed(2 * k as u32 + d));
                    let w = lobe.sample(u);
                    assert!((w.length() - 1.0).abs() < 1e-6);
                    // Bins of equal probability: the distribution function of t, and the azimuth.
                    let t = 0.5 * f64::from((w - mean).length_squared());
                    let k2 = 2.0 * f64::from(kappa);
                    let below = if kappa < 1e-4 { t / 2.0 } else { (-0.5 * k2 * t).exp_m1() / (-k2).exp_m1() };
                    let azimuth = f64::from(w.dot(bitangent).atan2(w.dot(tangent))) / std::f64::consts::TAU + 0.5;
                    let bin = |x: f64| ((x * BINS as f64) as usize).min(BINS - 1);
                    counts[bin(below)][bin(azimuth)] += 1;
                }
                let expected = COUNT as f64 / (BINS * BINS) as f64;
                let chi2: f64 = counts.iter().flatten().map(|&c| (f64::from(c) - expected).powi(2) / expected).sum();
                // 399 degrees of freedom: mean 399, deviation 28; 42 cases share 1e-3 of false alarm: 4.1 deviations.
                assert!(chi2 < 399.0 + 4.1 * 28.3, "kappa {kappa}, mean {mean}: chi-square {chi2}");
            }
        }
    }

    /// Uniform in [0, 1), a function of the index alone.
    fn hashed(index: u32) -> f32 {
        let mut x = index.wrapping_mul(0x9E37_79B9) ^ 0x85EB_CA6B;
        for _ in 0..2 {
            x = (x ^ (x >> 16)).wrapping_mul(0x7FEB_352D);
            x = (x ^ (x >> 15)).wrapping_mul(0x846C_A68B);
        }
        ((x ^ (x >> 16)) >> 8) as f32 / (1 << 24) as f32
    }
}
