//! The base BRDF: a Lambertian part plus a GGX conductor with Schlick's Fresnel term.
//!
//! GGX with height-correlated Smith shadowing as in Walter et al., Microfacet Models for Refraction (2007), and Heitz,
//! Understanding the Masking-Shadowing Function (2014).

use std::f32::consts::{FRAC_1_PI, PI};

use glam::Vec3;

/// A base BRDF: `diffuse`/π plus an optional rough conductor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brdf {
    /// Albedo of the Lambertian part, linear RGB in [0, 1]; 0 for a pure conductor.
    pub diffuse: [f32; 3],
    /// The rough specular part.
    pub specular: Option<Conductor>,
}

/// A GGX conductor with Schlick's Fresnel term and height-correlated Smith shadowing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    /// Roughness α of GGX, 0 < α <= 1.
    pub alpha: f32,
    /// Reflectance at normal incidence, linear RGB in [0, 1].
    pub f0: [f32; 3],
}

impl Brdf {
    /// The BRDF for light from `wi` seen from `wo`, 1/sr, RGB; 0 where either is not above the horizon of `normal`.
    ///
    /// f = diffuse/π + F(h·ωi)·[`Conductor::eval_scalar`], without a cosine. All directions are unit, in one frame, and
    /// point away from the surface.
    pub fn eval(&self, normal: Vec3, wi: Vec3, wo: Vec3) -> [f32; 3] {
        if normal.dot(wi) <= 0.0 || normal.dot(wo) <= 0.0 {
            return [0.0; 3];
        }
        let lambertian = self.diffuse.map(|albedo| albedo * FRAC_1_PI);
        let Some(conductor) = self.specular else { return lambertian };
        let scalar = conductor.eval_scalar(normal, wi, wo);
        let fresnel = conductor.fresnel(half_vector(wi, wo).dot(wi));
        [0, 1, 2].map(|c| lambertian[c] + scalar * fresnel[c])
    }

    /// This BRDF with diffuse albedo and specular `f0` multiplied by `color`.
    pub fn tinted(&self, color: [f32; 3]) -> Self {
        let tint = |rgb: [f32; 3]| [0, 1, 2].map(|c| rgb[c] * color[c]);
        Self {
            diffuse: tint(self.diffuse),
            specular: self.specular.map(|conductor| Conductor { f0: tint(conductor.f0), ..conductor }),
        }
    }
}

impl Conductor {
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

    /// GGX density of micro-normals in the direction `half`, 1/sr: α²/(π ((n·h)²(α² − 1) + 1)²).
    ///
    /// With 1 − (n·h)² taken as |n × h|², the denominator (n·h)²α² + |n × h|² keeps its digits at small α, where the
    /// textbook form subtracts 1 from 1.
    pub fn density(&self, normal: Vec3, half: Vec3) -> f32 {
        let cos = normal.dot(half);
        if cos <= 0.0 {
            return 0.0;
        }
        let alpha2 = self.alpha * self.alpha;
        let denominator = cos * cos * alpha2 + normal.cross(half).length_squared();
        alpha2 / (PI * denominator * denominator)
    }

    /// G2/(4 cosθi cosθo) of the height-correlated Smith function, both cosines greater than 0.
    ///
    /// G2 = 1/(1 + Λi + Λo), Λ = (√(1 + α² tan²θ) − 1)/2, so that
    /// G2/(4 cosθi cosθo) = 1/(2 (cosθo √(cos²θi + α² sin²θi) + cosθi √(cos²θo + α² sin²θo))): finite at grazing angles.
    pub fn visibility(&self, cos_i: f32, cos_o: f32) -> f32 {
        let alpha2 = self.alpha * self.alpha;
        let root = |cos: f32| (alpha2 + (1.0 - alpha2) * cos * cos).sqrt();
        0.5 / (cos_o * root(cos_i) + cos_i * root(cos_o))
    }
}

/// The unit half vector of two unit directions; +z for opposite ones, where every conductor value is 0 anyway.
fn half_vector(wi: Vec3, wo: Vec3) -> Vec3 {
    (wi + wo).try_normalize().unwrap_or(Vec3::Z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Stream;

    const ALPHAS: [f32; 6] = [0.02, 0.05, 0.1, 0.3, 0.7, 1.0];

    fn brdfs() -> Vec<Brdf> {
        let conductors = ALPHAS.map(|alpha| Some(Conductor { alpha, f0: [0.95, 0.6, 0.3] }));
        [None].into_iter().chain(conductors).map(|specular| Brdf { diffuse: [0.2, 0.5, 0.05], specular }).collect()
    }

    /// Uniform on the sphere.
    fn on_sphere(u: [f32; 2]) -> Vec3 {
        let z = 1.0 - 2.0 * u[0];
        let (sin, cos) = (u[1] * 2.0 * PI).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt(); // rounding of z near ±1
        Vec3::new(r * cos, r * sin, z)
    }

    #[test]
    fn brdfs_are_reciprocal_finite_and_not_negative() {
        let rng = Stream::new(1, 0);
        for brdf in brdfs() {
            for k in 0..3000 {
                let [n, wi, wo] = [0, 1, 2].map(|d| on_sphere(rng.uniform_pair(3 * k + d)));
                let [f, g] = [brdf.eval(n, wi, wo), brdf.eval(n, wo, wi)];
                for c in 0..3 {
                    assert!(f[c] >= 0.0 && f[c].is_finite());
                    assert!((f[c] - g[c]).abs() <= 1e-5 * f[c], "{brdf:?}: {f:?} {g:?}");
                }
            }
        }
    }

    #[test]
    fn nothing_is_reflected_below_the_horizon() {
        let up = Vec3::new(0.6, 0.0, 0.8);
        let down = Vec3::new(0.6, 0.0, -0.8);
        for brdf in brdfs() {
            assert_eq!(brdf.eval(Vec3::Z, up, down), [0.0; 3]);
            assert_eq!(brdf.eval(Vec3::Z, down, up), [0.0; 3]);
            assert_eq!(brdf.eval(Vec3::Z, Vec3::X, -Vec3::X), [0.0; 3]);
        }
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
    fn visible_area_of_the_normals_is_one() {
        for alpha in ALPHAS {
            let conductor = Conductor { alpha, f0: [1.0; 3] };
            let area = hemisphere(f64::from(alpha), |h| f64::from(conductor.density(Vec3::Z, h) * h.z));
            assert!((area - 1.0).abs() < 2e-4, "α = {alpha}: {area}");
        }
    }

    #[test]
    fn a_white_conductor_reflects_no_more_than_it_receives() {
        for alpha in [0.02, 0.1, 0.3, 0.7, 1.0] {
            let conductor = Conductor { alpha, f0: [1.0; 3] };
            for cos in [0.1f32, 0.5, 0.9, 1.0] {
                let wi = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
                // Over half vectors: dωo = 4 (h·ωi) dωh.
                let albedo = hemisphere(f64::from(alpha), |h| {
                    let wo = 2.0 * h.dot(wi) * h - wi;
                    f64::from(conductor.eval_scalar(Vec3::Z, wi, wo) * wo.z * 4.0 * h.dot(wi).max(0.0))
                });
                assert!(albedo < 1.0 + 1e-3, "α = {alpha}, cos = {cos}: {albedo}");
                // A mirror loses nothing: shadowing takes its share of order α² away from grazing angles.
                assert!(alpha > 0.02 || cos < 0.5 || albedo > 0.995, "α = {alpha}, cos = {cos}: {albedo}");
            }
        }
    }

    #[test]
    fn shadowing_equals_the_smith_function_in_lambdas() {
        for alpha in ALPHAS.map(f64::from) {
            for [ci, co] in [[0.3f64, 0.9], [0.05, 0.05], [1.0, 0.5]] {
                let lambda = |c: f64| ((1.0 + alpha * alpha * (1.0 - c * c) / (c * c)).sqrt() - 1.0) / 2.0;
                let expected = 1.0 / (1.0 + lambda(ci) + lambda(co)) / (4.0 * ci * co);
                let value = Conductor { alpha: alpha as f32, f0: [1.0; 3] }.visibility(ci as f32, co as f32);
                assert!((f64::from(value) / expected - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn fresnel_runs_from_f0_to_one() {
        let conductor = Conductor { alpha: 0.3, f0: [0.04, 0.5, 1.0] };
        assert_eq!(conductor.fresnel(1.0), [0.04, 0.5, 1.0]);
        assert_eq!(conductor.fresnel(0.0), [1.0; 3]);
    }

    #[test]
    fn a_colour_multiplies_diffuse_and_f0() {
        let brdf = Brdf { diffuse: [0.5; 3], specular: Some(Conductor { alpha: 0.3, f0: [0.8; 3] }) };
        let tinted = brdf.tinted([1.0, 0.5, 0.0]);
        assert_eq!(tinted.diffuse, [0.5, 0.25, 0.0]);
        assert_eq!(tinted.specular.unwrap().f0, [0.8, 0.4, 0.0]);
    }
}
