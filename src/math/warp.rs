//! The unit square as directions and points: what turns two uniform numbers into a sample.
//!
//! Disk and hemisphere go through the concentric equal-area map of `formats::lookup`, which keeps strata of the square
//! compact. Local frame: z is the axis.

use std::f32::consts::{FRAC_1_PI, TAU};

use formats::lookup;
use glam::Vec3;

/// Uniform over the hemisphere z >= 0; density 1/(2π).
#[inline]
pub fn hemisphere(u: [f32; 2]) -> Vec3 {
    Vec3::from(lookup::direction_of(u))
}

/// Over the hemisphere z >= 0 with density z/π ([`cosine_hemisphere_pdf`]).
///
/// Malley: a point (p, q) of the concentric disk, lifted to z = √(1 − p² − q²). The equal-area map has the same r, with
/// 1 − r² as its z: its (x, y)/√(1 + z) is (p, q), and √z is the height, without 1 − r² losing its digits at the rim.
#[inline]
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let [x, y, z] = lookup::direction_of(u);
    let scale = 1.0 / (1.0 + z).sqrt();
    // Rounding may leave z a hair below 0 on the rim.
    Vec3::new(x * scale, y * scale, z.max(0.0).sqrt())
}

/// Density of [`cosine_hemisphere`] at a direction with that z, 1/sr; 0 below the horizon.
#[inline]
pub fn cosine_hemisphere_pdf(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * FRAC_1_PI // below the horizon lies nothing
}

/// Uniform over the sphere; density 1/(4π).
#[inline]
pub fn sphere(u: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u[0];
    let (sin, cos) = (TAU * u[1]).sin_cos();
    // 1 − z² = 4u(1 − u): exact near both poles.
    let r = 2.0 * (u[0] * (1.0 - u[0])).sqrt();
    Vec3::new(r * cos, r * sin, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean of `value` over the centres of 256² strata: every warp here is smooth but at a few lines.
    fn mean(value: impl Fn([f32; 2]) -> f32) -> f64 {
        let n = 256;
        let at = |k: usize| (k as f32 + 0.5) / n as f32;
        (0..n * n).map(|k| f64::from(value([at(k % n), at(k / n)]))).sum::<f64>() / (n * n) as f64
    }

    #[test]
    fn directions_are_unit_from_corner_to_corner() {
        let below_one = 1.0 - f32::EPSILON / 2.0;
        for u in [0.0, 1e-7, 0.25, 0.5, 0.75, below_one] {
            for v in [0.0, 1e-7, 0.3, 0.5, 0.9, below_one] {
                for w in [hemisphere([u, v]), cosine_hemisphere([u, v]), sphere([u, v])] {
                    assert!((w.length() - 1.0).abs() < 1e-6, "{u} {v}: {w}");
                }
                assert!(hemisphere([u, v]).z >= 0.0 && cosine_hemisphere([u, v]).z >= 0.0);
            }
        }
    }

    #[test]
    fn moments_are_those_of_the_densities() {
        // E[z], E[z²], E[x²] of z/π, 1/2π and 1/4π; z ~ √distance at a rim costs the midpoint rule 256^−1.5 = 2.4e-4.
        type Warp = fn([f32; 2]) -> Vec3;
        let warps: [(Warp, [f64; 3]); 3] = [
            (cosine_hemisphere, [2.0 / 3.0, 0.5, 0.25]),
            (hemisphere, [0.5, 1.0 / 3.0, 1.0 / 3.0]),
            (sphere, [0.0, 1.0 / 3.0, 1.0 / 3.0]),
        ];
        for (k, (warp, [z, zz, xx])) in warps.into_iter().enumerate() {
            assert!((mean(|u| warp(u).z) - z).abs() < 3e-4, "warp {k}");
            assert!((mean(|u| warp(u).z.powi(2)) - zz).abs() < 3e-4, "warp {k}");
            assert!((mean(|u| warp(u).x.powi(2)) - xx).abs() < 3e-4, "warp {k}");
            assert!(mean(|u| warp(u).x).abs() < 1e-6 && mean(|u| warp(u).y).abs() < 1e-6, "warp {k}");
        }
    }
}
