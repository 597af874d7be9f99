//! LEADR: one off-centre anisotropic Beckmann lobe from the slope moments of a cell. A baseline to compare with.
//!
//! Dupuy et al., Linear Efficient Antialiased Displacement and Reflectance Mapping (2013). The facets of a cell have Gaussian
//! slopes with the mean and covariance of its fine surface; the micro-surface of the base adds α²/2 to the variance for the
//! specular part. Smith's function for Gaussian slopes stands for all shadows, height-correlated as there:
//! G2 = 1/(1 + Λi + Λo). A GGX base is taken as Beckmann with the same α: LEADR knows no other.
//!
//! With m = ⟨n_c, ω⟩/⟨n_c, z⟩ the area that the mean plane shows to ω per base area and A = ∫⟨n, ω⟩ D dn what all facets
//! show, 1 + Λ = A/m. A cell reflects F = ∫ f ⟨n, ωi⟩ ⟨n, ωo⟩ G2 D dn per base area, both cosines included; the coarse
//! surface under f_leadr reflects f_leadr ⟨n_c, ωi⟩ ⟨n_c, ωo⟩/⟨n_c, z⟩. Equal where
//!
//! f_leadr = ∫ f ⟨n, ωi⟩ ⟨n, ωo⟩ D dn / (⟨n_c, z⟩ (Ai mo + Ao mi − mi mo)).
//!
//! On a Gaussian surface with slopes of 0.3 and a Beckmann base of α = 0.2 the mean over pairs of directions up to 70° is
//! within 0.3 %, single pairs are 10 % off (root mean square over mean), a diffuse base 0.2 % (`tests/statistics/leadr.rs`):
//! Gaussians of slope add exactly only for small slopes.
//!
//! Frame: the base plane's, x = +u, y = −v, z out. Directions point away from the surface.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::brdf::Brdf;
use super::conductor::{half_vector, mirrored};
use super::sampling::BrdfSample;
use super::slopes::GaussianSlopes;
use crate::math::frame::Frame;
use crate::math::warp;

/// The BRDF of a cell by LEADR: its facets' slopes as one Gaussian, under Smith's shadowing and masking.
///
/// It is one for the coarse surface, whose normal is that of the mean slope: times ⟨n_c, ωi⟩ it gives what the cell
/// reflects. Cast no shadow rays against what the moments hold: those shadows are in it. All directions in the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeadrBrdf {
    /// Mean slope (∂h/∂x, ∂h/∂y) of the cell: that of the coarse surface, with the normal (−mean, 1)/√(1 + |mean|²).
    pub mean_slope: [f32; 2],
    /// Covariance `[xx, xy, yy]` of the fine slopes within the cell, without the base's roughness; positive semidefinite.
    pub covariance: [f32; 3],
    /// The base BRDF.
    pub base: Brdf,
}

/// Mean and covariance of the slopes within a cell, y = −v.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SlopeMoments {
    /// Mean (∂h/∂x, ∂h/∂y).
    pub mean: [f32; 2],
    /// Covariance `[xx, xy, yy]`.
    pub covariance: [f32; 3],
}

/// Abscissae and weights of the eight-point Gauss-Hermite rule for the weight φ, one half: the other has the opposite sign.
///
/// On the diffuse integral, for slopes of deviation 0.3, 64 products are 1.5 % off on average over views up to 85°, within
/// 2e-3 of full reflection everywhere (five points: 2.4 %, 4e-3). The kink at each silhouette is what is left.
const HERMITE: [[f32; 2]; 4] =
    [[0.539_079_8, 0.373_012_26], [1.636_519, 0.117_239_91], [2.802_486, 0.009_635_22], [4.144_547, 0.000_112_614_54]];

impl LeadrBrdf {
    /// The BRDF for light from `wi` seen from `wo`, 1/sr, RGB, cosine not included; 0 where either is not above the horizon
    /// of `n_c` or of the mean plane.
    ///
    /// `n_c` is the normal of the coarse surface. It is meant to be that of `mean_slope`; where it differs it gives the
    /// horizon and the area of the surface, and the lobe stays.
    pub fn eval(&self, n_c: Vec3, wi: Vec3, wo: Vec3) -> [f32; 3] {
        let meso = self.slopes(0.0);
        let areas = [wi, wo].map(|w| meso.mean_area(w));
        if [n_c.dot(wi), n_c.dot(wo)].into_iter().chain(areas).any(|area| area <= 0.0) {
            return [0.0; 3];
        }
        let scale = 1.0 / n_c.z; // the coarse surface is a height field too: its normals lie above the base
        let diffuse = match self.base.diffuse {
            [0.0, 0.0, 0.0] => [0.0; 3],
            albedo => {
                let scalar = scale * diffuse_scalar(&meso, areas, [wi, wo]);
                albedo.map(|albedo| albedo * scalar)
            }
        };
        let Some(conductor) = self.base.specular else { return diffuse };
        let half = half_vector(wi, wo);
        let slopes = self.slopes(conductor.alpha);
        // Mirrors: f ⟨n, ωi⟩ ⟨n, ωo⟩ D dn is F D(h)/4.
        let shown = [wi, wo].map(|w| slopes.shown_area(w));
        let scalar = 0.25 * scale * slopes.density(half) * masking(areas, shown);
        let fresnel = conductor.fresnel(half.dot(wi));
        [0, 1, 2].map(|c| diffuse[c] + scalar * fresnel[c])
    }

    /// A direction to the light for the viewer in `wo`, from uniform numbers in [0, 1); `None` as for [`Brdf::sample`].
    ///
    /// Visible normals of the Gaussian for the specular part, with weights up to 1; for the diffuse part cosine-weighted
    /// and uniform directions in equal shares. Cosine-weighted ones alone leave weights without a bound, for facets that
    /// face grazing light reflect it as well as any; with the uniform ones a weight is at most 4.
    pub fn sample(&self, n_c: Vec3, wo: Vec3, u: [f32; 3]) -> Option<BrdfSample> {
        let cos_o = n_c.dot(wo);
        if cos_o <= 0.0 {
            return None;
        }
        let share = self.base.specular_share(cos_o)?;
        let square = [u[0], u[1]];
        let wi = match self.base.specular {
            Some(conductor) if u[2] < share => mirrored(wo, self.slopes(conductor.alpha).sample_visible(wo, square)?),
            _ if u[2] < 0.5 * (1.0 + share) => Frame::around(n_c).to_outer(warp::cosine_hemisphere(square)),
            _ => Frame::around(n_c).to_outer(warp::hemisphere(square)),
        };
        let pdf = self.pdf(n_c, wi, wo);
        (pdf > 0.0).then(|| BrdfSample { wi, pdf, value: self.eval(n_c, wi, wo) })
    }

    /// Density of [`Self::sample`] at `wi` for the viewer in `wo`, 1/sr; 0 where either is not above the horizon of `n_c`.
    pub fn pdf(&self, n_c: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let [cos_i, cos_o] = [n_c.dot(wi), n_c.dot(wo)];
        if cos_i <= 0.0 || cos_o <= 0.0 {
            return 0.0;
        }
        let Some(share) = self.base.specular_share(cos_o) else { return 0.0 };
        let uniform = 0.5 * FRAC_1_PI;
        let diffuse = 0.5 * (warp::cosine_hemisphere_pdf(cos_i) + uniform);
        let specular = self.base.specular.map_or(0.0, |conductor| {
            let slopes = self.slopes(conductor.alpha);
            match slopes.mean_area(wo) > 0.0 {
                true => 0.25 * slopes.density(half_vector(wi, wo)) / slopes.shown_area(wo),
                false => 0.0,
            }
        });
        (1.0 - share) * diffuse + share * specular
    }

    /// Slopes of the facets of a micro-surface with roughness `alpha` on the cell's.
    fn slopes(&self, alpha: f32) -> GaussianSlopes {
        GaussianSlopes::new(self.mean_slope, self.covariance, 0.5 * alpha * alpha)
    }
}

/// G2/(mi mo) = 1/(Ai mo + Ao mi − mi mo) for areas m > 0 of the mean plane and A >= m of the facets.
fn masking([mi, mo]: [f32; 2], [ai, ao]: [f32; 2]) -> f32 {
    1.0 / (ai * mo + ao * mi - mi * mo)
}

/// 1/π ∫⟨n, ωi⟩ ⟨n, ωo⟩ D dn · G2/(mi mo) by quadrature over slopes; ⟨n_c, z⟩/π for a flat cell.
///
/// With D dn = P22 ds/⟨n, z⟩ the integrand is P22 (ωi.z − s·ωi) (ωo.z − s·ωo)/√(1 + |s|²), either factor not negative. The
/// nodes stand for the distribution in all three integrals: with A from the closed form, the error of the quadrature at
/// grazing angles would reflect 2 % more than there is.
fn diffuse_scalar(slopes: &GaussianSlopes, areas: [f32; 2], [wi, wo]: [Vec3; 2]) -> f32 {
    let nodes = || HERMITE.iter().flat_map(|&[x, weight]| [[x, weight], [-x, weight]]);
    let (mut sum, mut shown) = (0.0, [0.0; 2]);
    for [x, weight_x] in nodes() {
        for [y, weight_y] in nodes() {
            let s = slopes.slope([x, y]);
            let weight = weight_x * weight_y;
            let [i, o] = [wi, wo].map(|w| (w.z - s[0] * w.x - s[1] * w.y).max(0.0)); // facets from behind show nothing
            shown = [shown[0] + weight * i, shown[1] + weight * o];
            sum += weight * i * o / (1.0 + s[0] * s[0] + s[1] * s[1]).sqrt();
        }
    }
    FRAC_1_PI * sum * masking(areas, shown)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::Conductor;
    use crate::math::rng::Stream;

    const WHITE: Brdf = Brdf { diffuse: [1.0; 3], specular: None };

    fn mirror(alpha: f32) -> Brdf {
        Brdf { diffuse: [0.0; 3], specular: Some(Conductor::beckmann(alpha, [1.0; 3])) }
    }

    fn normal(slope: [f32; 2]) -> Vec3 {
        Vec3::new(-slope[0], -slope[1], 1.0).normalize()
    }

    fn cells(base: Brdf) -> [LeadrBrdf; 5] {
        let cell = |mean_slope, covariance| LeadrBrdf { mean_slope, covariance, base };
        [
            cell([0.0; 2], [0.0; 3]),
            cell([0.0; 2], [0.09, 0.0, 0.09]),
            cell([0.4, -0.2], [0.09, 0.03, 0.02]),
            cell([-1.5, 1.0], [0.5, -0.5, 0.5]),
            cell([0.1, 3.0], [40.0, 20.0, 90.0]),
        ]
    }

    #[test]
    fn a_flat_cell_is_its_base() {
        let rng = Stream::new(1, 0);
        for alpha in [0.1, 0.3, 1.0] {
            let base = Brdf { diffuse: [0.2, 0.5, 0.05], specular: Some(Conductor::beckmann(alpha, [0.9, 0.5, 0.1])) };
            let cell = LeadrBrdf { mean_slope: [0.0; 2], covariance: [0.0; 3], base };
            for k in 0..2000 {
                let [wi, wo] = [0, 1].map(|d| warp::hemisphere(rng.uniform_pair(2 * k + d)));
                let [f, expected] = [cell.eval(Vec3::Z, wi, wo), base.eval(Vec3::Z, wi, wo)];
                for c in 0..3 {
                    // exp(−tan²θ/α²) multiplies the rounding of h by up to 80.
                    assert!((f[c] - expected[c]).abs() < 1e-4 * expected[c], "α = {alpha}: {f:?} is {expected:?}");
                }
            }
        }
    }

    #[test]
    fn a_tilted_flat_cell_is_lambertian_around_its_own_normal() {
        let cell = LeadrBrdf { mean_slope: [0.7, -0.3], covariance: [0.0; 3], base: WHITE };
        let n_c = normal(cell.mean_slope);
        let rng = Stream::new(2, 0);
        for k in 0..1000 {
            let [wi, wo] = [0, 1].map(|d| warp::sphere(rng.uniform_pair(2 * k + d)));
            // Beside the horizon rounding decides.
            if n_c.dot(wi).abs() > 1e-3 && n_c.dot(wo).abs() > 1e-3 {
                let seen = n_c.dot(wi) > 0.0 && n_c.dot(wo) > 0.0;
                let expected = if seen { FRAC_1_PI } else { 0.0 };
                assert!((cell.eval(n_c, wi, wo)[1] - expected).abs() < 1e-4, "{wi} {wo}");
            }
        }
    }

    #[test]
    fn values_are_reciprocal_finite_and_not_negative() {
        let rng = Stream::new(3, 0);
        for alpha in [1e-4, 0.02, 0.3, 1.0] {
            for cell in cells(Brdf { diffuse: [0.5; 3], ..mirror(alpha) }) {
                let n_c = normal(cell.mean_slope);
                for k in 0..2000 {
                    let [wi, wo] = [0, 1].map(|d| warp::sphere(rng.uniform_pair(2 * k + d)));
                    let [f, g] = [cell.eval(n_c, wi, wo)[0], cell.eval(n_c, wo, wi)[0]];
                    assert!(f >= 0.0 && f.is_finite(), "{cell:?}: {f}");
                    assert!((f - g).abs() <= 1e-5 * f, "{cell:?}: {f} {g}");
                }
            }
        }
    }

    #[test]
    fn weights_of_samples_are_bounded_and_no_more_comes_out_than_goes_in() {
        let rng = Stream::new(4, 0);
        let samples = 40_000;
        for (base, largest) in [(WHITE, 4.0), (mirror(0.02), 1.0), (mirror(0.3), 1.0)] {
            for cell in cells(base) {
                let n_c = normal(cell.mean_slope);
                let frame = Frame::around(n_c);
                for cos in [1.0f32, 0.7, 0.2, 0.02] {
                    let wo = frame.to_outer(Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos));
                    let (mut sum, mut squares) = (0.0, 0.0);
                    for k in 0..samples {
                        let [a, b] = rng.uniform_pair(2 * k);
                        let Some(s) = cell.sample(n_c, wo, [a, b, rng.uniform(2 * k + 1)]) else { continue };
                        let weight = f64::from(s.value[0] * n_c.dot(s.wi) / s.pdf);
                        // Both sides of a quotient are rounded, near the horizon by 1e-7 over a cosine of 1e-3.
                        assert!(weight <= largest * 1.001, "{cell:?}, cos = {cos}: {weight}");
                        (sum, squares) = (sum + weight, squares + weight * weight);
                    }
                    let mean = sum / samples as f64;
                    let error = ((squares / samples as f64 - mean * mean) / samples as f64).sqrt();
                    // Four deviations in 60 tests: one in 500 such suites would fail by chance.
                    assert!(mean < 1.0 + 1e-3 + 4.0 * error, "{cell:?}, cos = {cos}: {mean} ± {error}");
                }
            }
        }
    }
}
