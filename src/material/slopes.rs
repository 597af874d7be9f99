//! A bivariate Gaussian of facet slopes: density of normals, area shown, visible normals.
//!
//! The surface is z = h(x, y) over the base plane, its facets have the slope s = (∂h/∂x, ∂h/∂y) and the normal
//! (−s, 1)/√(1 + |s|²). Beckmann's distribution is the isotropic centred one; LEADR's is off-centre and anisotropic.

use glam::Vec3;

use crate::math::gaussian;

/// Slopes s = mean + L x with x standard normal and L lower triangular.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GaussianSlopes {
    /// Mean slope (∂h/∂x, ∂h/∂y).
    pub mean: [f32; 2],
    /// L as `[l00, l10, l11]`.
    pub factor: [f32; 3],
}

/// Exponents beyond which a density of slopes is taken as 0: exp(−80) = 2e-35.
const MAX_EXPONENT: f64 = 80.0;

impl GaussianSlopes {
    /// Beckmann of roughness `alpha` around z: variance α²/2 along each axis.
    pub(super) fn beckmann(alpha: f32) -> Self {
        let deviation = alpha * std::f32::consts::FRAC_1_SQRT_2;
        Self { mean: [0.0; 2], factor: [deviation, 0.0, deviation] }
    }

    /// The slopes of that mean and of the covariance `[xx, xy, yy]` + `extra`·1.
    ///
    /// Cholesky's factor, in `f64`: under slopes of 100 an `extra` of 1e-8 is still there.
    pub(super) fn new(mean: [f32; 2], covariance: [f32; 3], extra: f32) -> Self {
        let [xx, xy, yy] = covariance.map(f64::from);
        let extra = f64::from(extra);
        let l00 = (xx + extra).sqrt();
        let l10 = if l00 > 0.0 { xy / l00 } else { 0.0 };
        // What is left of yy is `extra` or more for every covariance; rounding of the moments may eat it.
        let l11 = (yy + extra - l10 * l10).max(extra).sqrt();
        Self { mean, factor: [l00, l10, l11].map(|l| l as f32) }
    }

    /// The slope at `x` deviations.
    pub(super) fn slope(&self, x: [f32; 2]) -> [f32; 2] {
        let [l00, l10, l11] = self.factor;
        [self.mean[0] + l00 * x[0], self.mean[1] + l10 * x[0] + l11 * x[1]]
    }

    /// D of the normal `half` (unit, base frame), facet area per base area and sr: P22(s)/⟨h, z⟩⁴, 0 below the base.
    ///
    /// P22 = exp(−|x|²/2)/(2π l00 l11) with x = L⁻¹(s − mean). Needs a factor without zeros on its diagonal.
    pub(super) fn density(&self, half: Vec3) -> f32 {
        if half.z <= 0.0 {
            return 0.0;
        }
        let [hx, hy, hz] = half.to_array().map(f64::from);
        let [l00, l10, l11] = self.factor.map(f64::from);
        debug_assert!(l00 > 0.0 && l11 > 0.0, "a density needs slopes in all directions");
        let x = (-hx / hz - f64::from(self.mean[0])) / l00;
        let y = (-hy / hz - f64::from(self.mean[1]) - l10 * x) / l11;
        let exponent = 0.5 * (x * x + y * y);
        if exponent > MAX_EXPONENT {
            return 0.0; // where ⟨h, z⟩⁴ may be too small to divide by
        }
        ((-exponent).exp() / (std::f64::consts::TAU * l00 * l11 * hz.powi(4))) as f32
    }

    /// ⟨n, ω⟩/⟨n, z⟩ of the mean plane: the area that it shows to `w`, per base area; negative from behind.
    pub(super) fn mean_area(&self, w: Vec3) -> f32 {
        w.z - self.mean[0] * w.x - self.mean[1] * w.y
    }

    /// Lᵀ(ωx, ωy): how the area shown to `w` falls with deviations of the slope.
    fn tilt(&self, w: Vec3) -> [f32; 2] {
        let [l00, l10, l11] = self.factor;
        [l00 * w.x + l10 * w.y, l11 * w.y]
    }

    /// A(ω) = ∫⟨n, ω⟩ D dn: area of all facets that face `w`, per base area.
    ///
    /// D dn = P22 ds/⟨n, z⟩ and ⟨n, ω⟩/⟨n, z⟩ = ωz − s·ωxy is normal with mean m = [`Self::mean_area`] and deviation
    /// σ = |Lᵀωxy|, so A = m Φ(m/σ) + σ φ(m/σ). In Smith's terms 1 + Λ = A/m.
    pub(super) fn shown_area(&self, w: Vec3) -> f32 {
        let [x, y] = self.tilt(w);
        gaussian::mean_of_positive_part(self.mean_area(w), x.hypot(y))
    }

    /// A normal as it is seen from `w`, density ⟨n, ω⟩ D(n)/A(ω); `None` from behind the mean plane.
    ///
    /// Along Lᵀωxy the deviation x has the density max(0, m − σx) φ(x)/A, across it φ: both are inverted.
    pub(super) fn sample_visible(&self, w: Vec3, u: [f32; 2]) -> Option<Vec3> {
        let m = self.mean_area(w);
        if m <= 0.0 {
            return None;
        }
        let [tx, ty] = self.tilt(w);
        let sigma = tx.hypot(ty);
        // Straight above the mean plane no azimuth is special.
        let [cos, sin] = if sigma > 0.0 { [tx / sigma, ty / sigma] } else { [1.0, 0.0] };
        let along = gaussian::shown_quantile(m, sigma, u[0]);
        let across = gaussian::shown_quantile(1.0, 0.0, u[1]);
        let [sx, sy] = self.slope([cos * along - sin * across, sin * along + cos * across]);
        Some(Vec3::new(-sx, -sy, 1.0).normalize())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cases() -> [GaussianSlopes; 4] {
        [
            GaussianSlopes::beckmann(0.3),
            GaussianSlopes::beckmann(1.0),
            GaussianSlopes::new([0.3, -0.2], [0.09, 0.02, 0.04], 0.02),
            GaussianSlopes::new([-1.0, 0.5], [0.25, -0.2, 0.2], 0.005),
        ]
    }

    /// ∫ value(s) P22(s) ds by the midpoint rule on deviations within ±7.
    fn over_slopes(slopes: &GaussianSlopes, value: impl Fn([f32; 2]) -> f64) -> f64 {
        let n = 400;
        let at = |k: usize| 14.0 * (k as f64 + 0.5) / n as f64 - 7.0;
        let cell = (14.0 / n as f64).powi(2);
        let term = |k: usize| {
            let x = [at(k % n), at(k / n)];
            value(slopes.slope(x.map(|x| x as f32))) * gaussian::density(x[0]) * gaussian::density(x[1])
        };
        (0..n * n).map(term).sum::<f64>() * cell
    }

    #[test]
    fn the_density_is_that_of_the_slopes() {
        for slopes in cases() {
            // D⟨n, z⟩⁴ integrated over s is 1 on a grid of slopes of its own.
            let (n, width) = (600, 10.0);
            let at = |k: usize| width * ((k as f32 + 0.5) / n as f32 - 0.5);
            let sum: f64 = (0..n * n)
                .map(|k| {
                    let normal = Vec3::new(-at(k % n), -at(k / n), 1.0).normalize();
                    f64::from(slopes.density(normal) * normal.z.powi(4))
                })
                .sum();
            let total = sum * f64::from(width / n as f32).powi(2);
            assert!((total - 1.0).abs() < 1e-4, "{slopes:?}: {total}");
        }
    }

    #[test]
    fn shown_area_is_its_integral() {
        for slopes in cases() {
            for w in [Vec3::Z, Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.5, 0.8, 0.2).normalize(), Vec3::X, -Vec3::Y] {
                let shown = |s: [f32; 2]| f64::from((w.z - s[0] * w.x - s[1] * w.y).max(0.0));
                let expected = over_slopes(&slopes, shown);
                let area = f64::from(slopes.shown_area(w));
                // The midpoint rule meets a kink: second order in 14/400.
                assert!((area - expected).abs() < 1e-4, "{slopes:?} {w}: {area} is {expected}");
            }
        }
    }

    #[test]
    fn beckmanns_lambda_is_the_textbook_one() {
        // Λ = (erf(a) − 1)/2 + exp(−a²)/(2a√π), a = 1/(α tan θ).
        for alpha in [0.1f32, 0.5, 1.0] {
            for cos in [0.05f32, 0.3, 0.9] {
                let w = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                let a = f64::from(cos) / f64::from(alpha * w.x);
                let lambda = (-a * a).exp() / (2.0 * a * std::f64::consts::PI.sqrt()) - 0.5 * gaussian::erfc(a);
                let area = f64::from(GaussianSlopes::beckmann(alpha).shown_area(w));
                assert!((area / f64::from(cos) / (1.0 + lambda) - 1.0).abs() < 1e-6, "α = {alpha}, cos = {cos}");
            }
        }
    }

    #[test]
    fn moments_of_rank_one_or_zero_are_factored() {
        let ridge = GaussianSlopes::new([0.0; 2], [1e4, 1e4, 1e4], 5e-9);
        assert!(ridge.factor[2] >= 7e-5 && ridge.factor.iter().all(|l| l.is_finite()), "{ridge:?}");
        let flat = GaussianSlopes::new([0.5, 0.0], [0.0; 3], 0.0);
        assert_eq!(flat.factor, [0.0; 3]);
        assert_eq!(flat.shown_area(Vec3::Z), 1.0);
    }
}
