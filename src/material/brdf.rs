//! The base BRDF: a Lambertian part plus a rough conductor.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;

use super::conductor::{Conductor, half_vector};

/// A base BRDF: `diffuse`/π plus an optional rough conductor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brdf {
    /// Albedo of the Lambertian part, linear RGB in [0, 1]; 0 for a pure conductor.
    pub diffuse: [f32; 3],
    /// The rough specular part.
    pub specular: Option<Conductor>,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Stream;
    use crate::math::warp;

    const ALPHAS: [f32; 6] = [0.02, 0.05, 0.1, 0.3, 0.7, 1.0];

    fn brdfs() -> Vec<Brdf> {
        let f0 = [0.95, 0.6, 0.3];
        let conductors = ALPHAS.iter().flat_map(|&alpha| [Conductor::ggx(alpha, f0), Conductor::beckmann(alpha, f0)]);
        let parts = [None].into_iter().chain(conductors.map(Some));
        parts.map(|specular| Brdf { diffuse: [0.2, 0.5, 0.05], specular }).collect()
    }

    #[test]
    fn brdfs_are_reciprocal_finite_and_not_negative() {
        let rng = Stream::new(1, 0);
        for brdf in brdfs() {
            for k in 0..3000 {
                let [n, wi, wo] = [0, 1, 2].map(|d| warp::sphere(rng.uniform_pair(3 * k + d)));
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

    #[test]
    fn a_colour_multiplies_diffuse_and_f0() {
        let brdf = Brdf { diffuse: [0.5; 3], specular: Some(Conductor::ggx(0.3, [0.8; 3])) };
        let tinted = brdf.tinted([1.0, 0.5, 0.0]);
        assert_eq!(tinted.diffuse, [0.5, 0.25, 0.0]);
        assert_eq!(tinted.specular.unwrap().f0, [0.8, 0.4, 0.0]);
    }
}
