//! A rough conductor: GGX or Beckmann normals, height-correlated Smith shadowing, Schlick's Fresnel term.
//!
//! Distributions as in Walter et al., Microfacet Models for Refraction (2007); shadowing as in Heitz, Understanding the
//! Masking-Shadowing Function (2014). Visible normals: GGX by Dupuy and Benyoub, Sampling Visible GGX Normals with Spherical
//! Caps (2023); Beckmann by the slopes that are seen ([`super::slopes`]).

use std::f32::consts::{FRAC_1_SQRT_2, PI, TAU};

use glam::Vec3;

use super::slopes::GaussianSlopes;
use crate::math::frame::Frame;
use crate::math::gaussian;

/// A rough conductor with Schlick's Fresnel term and height-correlated Smith shadowing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    /// Roughness α, 0 < α <= 1; of GGX, or √2 times the deviation of Beckmann's slopes.
    pub alpha: f32,
    /// Reflectance at normal incidence, linear RGB in [0, 1].
    pub f0: [f32; 3],
    /// How the normals of its facets are spread.
    pub distribution: Distribution,
}

/// The distribution of the facets' normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distribution {
    /// GGX, or Trowbridge-Reitz: long tails. The one that is prefiltered.
    Ggx,
    /// Beckmann: slopes are Gaussian.
    Beckmann,
}

/// tan²θ/α² beyond which Beckmann's density is taken as 0: exp(−80) = 2e-35. Within it cos²θ is 1/81 or more.
const MAX_EXPONENT: f32 = 80.0;

impl Conductor {
    /// A conductor of GGX normals with roughness `alpha` in (0, 1] and reflectance `f0` at normal incidence.
    pub const fn ggx(alpha: f32, f0: [f32; 3]) -> Self {
        Self { alpha, f0, distribution: Distribution::Ggx }
    }

    /// A conductor of Beckmann normals with roughness `alpha` in (0, 1] and reflectance `f0` at normal incidence.
    pub const fn beckmann(alpha: f32, f0: [f32; 3]) -> Self {
        Self { alpha, f0, distribution: Distribution::Beckmann }
    }

    /// The BRDF without its Fresnel term, 1/sr: D(h)·G2(ωi, ωo)/(4 cosθi cosθo); 0 below the horizon of `normal`.
    pub fn eval_scalar(&self, normal: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let [cos_i, cos_o] = [normal.dot(wi), normal.dot(wo)];
        if cos_i <= 0.0 || cos_o <= 0.0 {
            return 0.0;
        }
        self.density(normal, half_vector(wi, wo)) * self.visibility(cos_i, cos_o)
    }

    /// Schlick's F = F0 + (1 − F0)(1 − cosθ)⁵ at the angle between `wi` and the half vector, RGB.
    pub fn fresnel(&self, cos_theta: f32) -> [f32; 3] {
        // Rounding of two unit vectors' dot product may leave [0, 1].
        let m = 1.0 - cos_theta.clamp(0.0, 1.0);
        let weight = (m * m) * (m * m) * m;
        self.f0.map(|f0| f0 + (1.0 - f0) * weight)
    }

    /// Density D of micro-normals in the direction `half`, 1/sr, with ∫ D ⟨n, h⟩ dh = 1; 0 below the horizon.
    ///
    /// GGX: α²/(π ((n·h)²(α² − 1) + 1)²). With 1 − (n·h)² taken as |n × h|², the denominator (n·h)²α² + |n × h|² keeps
    /// its digits at small α, where the textbook form subtracts 1 from 1. Beckmann: exp(−tan²θ/α²)/(π α² cos⁴θ), tan²θ
    /// likewise.
    pub fn density(&self, normal: Vec3, half: Vec3) -> f32 {
        let cos = normal.dot(half);
        if cos <= 0.0 {
            return 0.0;
        }
        let alpha2 = self.alpha * self.alpha;
        let sin2 = normal.cross(half).length_squared();
        match self.distribution {
            Distribution::Ggx => {
                let denominator = cos * cos * alpha2 + sin2;
                alpha2 / (PI * denominator * denominator)
            }
            Distribution::Beckmann => {
                let cos2 = cos * cos;
                if sin2 >= MAX_EXPONENT * alpha2 * cos2 {
                    return 0.0;
                }
                (-sin2 / (alpha2 * cos2)).exp() / (PI * alpha2 * cos2 * cos2)
            }
        }
    }

    /// G2/(4 cosθi cosθo) of the height-correlated Smith function, both cosines greater than 0.
    ///
    /// G2 = 1/(1 + Λi + Λo). With A = cosθ(1 + Λ) ([`Self::shown_area`]) the quotient is
    /// 1/(4 (Ai cosθo + Ao cosθi − cosθi cosθo)), finite at grazing angles. For GGX, Λ = (√(1 + α² tan²θ) − 1)/2, it is
    /// 1/(2 (cosθo √(cos²θi + α² sin²θi) + cosθi √(cos²θo + α² sin²θo))).
    pub fn visibility(&self, cos_i: f32, cos_o: f32) -> f32 {
        match self.distribution {
            Distribution::Ggx => {
                let root = |cos: f32| self.ggx_root(cos);
                0.5 / (cos_o * root(cos_i) + cos_i * root(cos_o))
            }
            Distribution::Beckmann => {
                let [area_i, area_o] = [cos_i, cos_o].map(|cos| self.shown_area(cos));
                0.25 / (area_i * cos_o + area_o * cos_i - cos_i * cos_o)
            }
        }
    }

    /// A(θ) = ∫⟨h, ω⟩ D(h) dh = cosθ (1 + Λ): area that all facets towards a direction show to it, per area of the plane.
    ///
    /// At least α/4 where cosθ > 0, so that densities of visible normals never divide by less.
    pub fn shown_area(&self, cos_theta: f32) -> f32 {
        match self.distribution {
            Distribution::Ggx => 0.5 * (cos_theta + self.ggx_root(cos_theta)),
            Distribution::Beckmann => {
                // Rounding of a unit vector's cosine may pass 1.
                let sin = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
                gaussian::mean_of_positive_part(cos_theta, self.alpha * FRAC_1_SQRT_2 * sin)
            }
        }
    }

    /// √(cos²θ + α² sin²θ).
    fn ggx_root(&self, cos: f32) -> f32 {
        let alpha2 = self.alpha * self.alpha;
        (alpha2 + (1.0 - alpha2) * cos * cos).sqrt()
    }

    /// The direction that a facet seen from `wo` mirrors it to; may lie below the horizon. `wo` lies above it.
    pub(super) fn sample(&self, normal: Vec3, wo: Vec3, u: [f32; 2]) -> Option<Vec3> {
        let frame = Frame::around(normal);
        let local = frame.to_local(wo);
        let half = match self.distribution {
            Distribution::Ggx => ggx_visible_normal(self.alpha, local, u),
            Distribution::Beckmann => GaussianSlopes::beckmann(self.alpha).sample_visible(local, u)?,
        };
        Some(mirrored(wo, frame.to_outer(half)))
    }

    /// Density of [`Self::sample`] at `wi`, 1/sr; both directions above the horizon.
    ///
    /// Visible normals have the density ⟨h, ωo⟩ D(h)/A(ωo), and mirroring spreads dh over dωi = 4⟨h, ωo⟩ dh: D/(4 A(ωo)).
    pub(super) fn pdf(&self, normal: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        0.25 * self.density(normal, half_vector(wi, wo)) / self.shown_area(normal.dot(wo))
    }
}

/// A normal of GGX as it is seen from `wo`, frame of the normal; density ⟨h, ωo⟩ D(h)/A(ωo).
///
/// Stretched by α, GGX becomes a hemisphere, and visible normals of a hemisphere are the half vectors of the view and a
/// direction uniform over the cap z > −ωo.z.
fn ggx_visible_normal(alpha: f32, wo: Vec3, u: [f32; 2]) -> Vec3 {
    let stretched = Vec3::new(alpha * wo.x, alpha * wo.y, wo.z).normalize();
    let above = (1.0 - u[1]) * (1.0 + stretched.z); // z + ωo.z of the half vector, greater than 0
    let z = above - stretched.z;
    let (sin_phi, cos_phi) = (TAU * u[0]).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt(); // rounding of z near ±1
    Vec3::new(alpha * (r * cos_phi + stretched.x), alpha * (r * sin_phi + stretched.y), above).normalize()
}

/// `wo` mirrored by a facet of normal `half`, unit.
pub(super) fn mirrored(wo: Vec3, half: Vec3) -> Vec3 {
    (2.0 * half.dot(wo) * half - wo).normalize()
}

/// The unit half vector of two unit directions; +z for opposite ones, where every conductor value is 0 anyway.
pub(super) fn half_vector(wi: Vec3, wo: Vec3) -> Vec3 {
    (wi + wo).try_normalize().unwrap_or(Vec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALPHAS: [f32; 6] = [0.02, 0.05, 0.1, 0.3, 0.7, 1.0];

    /// White, of every roughness and distribution.
    fn conductors() -> impl Iterator<Item = Conductor> {
        let white = [1.0; 3];
        ALPHAS.into_iter().flat_map(move |alpha| [Conductor::ggx(alpha, white), Conductor::beckmann(alpha, white)])
    }

    /// ∫ f(ω) dω over the upper hemisphere for an integrand of tan θ/α and φ: the substitution tan θ = α·x resolves the
    /// peak at every roughness.
    fn hemisphere(alpha: f64, integrand: impl Fn(Vec3) -> f64) -> f64 {
        let (rings, sectors) = (2000, 64);
        let mut sum = 0.0;
        for ring in 0..rings {
            // x = u/(1 − u) maps [0, 1) to all slopes.
            let u = (ring as f64 + 0.5) / rings as f64;
            let (x, dx) = (u / (1.0 - u), 1.0 / (1.0 - u).powi(2));
            let tan = alpha * x;
            let cos = 1.0 / (1.0 + tan * tan).sqrt();
            let measure = alpha * dx * tan * cos.powi(3); // sin θ dθ = tan θ cos³θ d tan θ
            for sector in 0..sectors {
                let phi = (sector as f64 + 0.5) / sectors as f64 * std::f64::consts::TAU;
                let direction = Vec3::new((cos * tan * phi.cos()) as f32, (cos * tan * phi.sin()) as f32, cos as f32);
                sum += integrand(direction) * measure;
            }
        }
        sum / rings as f64 / sectors as f64 * std::f64::consts::TAU
    }

    #[test]
    fn the_area_of_the_normals_is_that_of_the_plane() {
        for conductor in conductors() {
            let area = hemisphere(conductor.alpha.into(), |h| f64::from(conductor.density(Vec3::Z, h) * h.z));
            assert!((area - 1.0).abs() < 2e-4, "{conductor:?}: {area}");
        }
    }

    #[test]
    fn shown_area_is_that_of_the_normals_towards_a_direction() {
        for conductor in conductors() {
            for cos in [0.02f32, 0.3, 0.8, 1.0] {
                let w = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                let shown = |h: Vec3| f64::from(conductor.density(Vec3::Z, h) * h.dot(w).max(0.0));
                let expected = hemisphere(conductor.alpha.into(), shown);
                let area = f64::from(conductor.shown_area(cos));
                // The silhouette crosses sectors: second order in 1/64, relative to the α that is seen from grazing angles.
                assert!((area - expected).abs() < 1e-3 * expected, "{conductor:?}, cos = {cos}: {area} is {expected}");
            }
        }
    }

    #[test]
    fn a_white_conductor_reflects_no_more_than_it_receives() {
        for conductor in conductors() {
            let alpha = conductor.alpha;
            for cos in [0.1f32, 0.5, 0.9, 1.0] {
                let wi = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                // Over half vectors: dωo = 4 (h·ωi) dωh.
                let albedo = hemisphere(f64::from(alpha), |h| {
                    let wo = 2.0 * h.dot(wi) * h - wi;
                    f64::from(conductor.eval_scalar(Vec3::Z, wi, wo) * wo.z * 4.0 * h.dot(wi).max(0.0))
                });
                assert!(albedo < 1.0 + 1e-3, "{conductor:?}, cos = {cos}: {albedo}");
                // A mirror loses nothing: shadowing takes its share of order α² away from grazing angles.
                assert!(alpha > 0.02 || cos < 0.5 || albedo > 0.995, "{conductor:?}, cos = {cos}: {albedo}");
            }
        }
    }

    #[test]
    fn shadowing_equals_the_smith_function_in_lambdas() {
        for conductor in conductors() {
            let alpha = f64::from(conductor.alpha);
            let lambda = |c: f64| {
                let tan = (1.0 - c * c).sqrt() / c;
                match conductor.distribution {
                    Distribution::Ggx => ((1.0 + (alpha * tan).powi(2)).sqrt() - 1.0) / 2.0,
                    Distribution::Beckmann if tan == 0.0 => 0.0,
                    Distribution::Beckmann => {
                        let a = 1.0 / (alpha * tan);
                        ((-a * a).exp() / (a * f64::from(PI).sqrt()) - gaussian::erfc(a)) / 2.0
                    }
                }
            };
            for [ci, co] in [[0.3f64, 0.9], [0.05, 0.05], [1.0, 0.5]] {
                let expected = 1.0 / (1.0 + lambda(ci) + lambda(co)) / (4.0 * ci * co);
                let value = f64::from(conductor.visibility(ci as f32, co as f32));
                assert!((value / expected - 1.0).abs() < 1e-5, "{conductor:?}: {value} is {expected}");
            }
        }
    }

    #[test]
    fn beckmann_is_a_gaussian_of_slopes() {
        for alpha in ALPHAS {
            let (conductor, slopes) = (Conductor::beckmann(alpha, [1.0; 3]), GaussianSlopes::beckmann(alpha));
            for x in [0.0, 0.5, 1.0, 3.0] {
                let half = Vec3::new(0.6 * x * alpha, -0.8 * x * alpha, 1.0).normalize();
                let [d, expected] = [conductor.density(Vec3::Z, half), slopes.density(half)];
                assert!((d / expected - 1.0).abs() < 2e-5, "α = {alpha}, {x}: {d} is {expected}");
            }
            for cos in [0.01, 0.3, 0.9] {
                let w = Vec3::new(0.0, (1.0f32 - cos * cos).sqrt(), cos);
                assert!((conductor.shown_area(cos) / slopes.shown_area(w) - 1.0).abs() < 1e-5, "α = {alpha}, {cos}");
            }
        }
    }

    #[test]
    fn densities_stay_finite_at_the_horizon_and_at_the_smallest_roughness() {
        for alpha in [1e-4, 0.02, 1.0] {
            for conductor in [Conductor::ggx(alpha, [1.0; 3]), Conductor::beckmann(alpha, [1.0; 3])] {
                for cos in [0.0, 1e-20, 1e-6, 0.5, 1.0] {
                    let half = Vec3::new((1.0f32 - cos * cos).sqrt(), 0.0, cos);
                    let d = conductor.density(Vec3::Z, half);
                    assert!(d.is_finite() && d >= 0.0, "{conductor:?}, cos = {cos}: {d}");
                    let area = conductor.shown_area(cos);
                    assert!(area >= 0.25 * alpha && area <= 1.0, "{conductor:?}, cos = {cos}: {area}");
                }
            }
        }
    }

    #[test]
    fn fresnel_runs_from_f0_to_one() {
        let conductor = Conductor::ggx(0.3, [0.04, 0.5, 1.0]);
        assert_eq!(conductor.fresnel(1.0), [0.04, 0.5, 1.0]);
        assert_eq!(conductor.fresnel(0.0), [1.0; 3]);
    }
}
