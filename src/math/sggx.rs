//! Sampling of SGGX lobes by visible normals, and what specular flakes reflect.
//!
//! σ and D are `formats::sggx`'s. Directions are unit vectors that point away from the flake.

use formats::sggx::Sggx;
use glam::Vec3;

use super::warp;

/// A flake normal with the density ⟨ω, m⟩ D(m)/σ(ω), from two uniform numbers in [0, 1).
///
/// With S = L Lᵀ the flakes are those of the unit sphere, area vector a, mapped to L·a. What they show to ω is
/// (L·a)·ω = a·(Lᵀω): the sphere's flakes as seen from t = Lᵀω/|Lᵀω|, which follow the cosine. So m = L·m′/|L·m′| with m′
/// cosine distributed around t, which is t + s for a uniform s of the unit sphere, but for its length. Any root of S would
/// do; the triangular one costs least.
#[inline]
pub fn visible_normal(lobe: &Sggx, w: Vec3, u: [f32; 2]) -> Vec3 {
    let towards = Vec3::from(lobe.stretch_transposed(w.to_array())).normalize();
    let on_sphere = towards + warp::sphere(u);
    // s = −t is the rim of the cosine, where all azimuths are alike.
    let on_sphere = if on_sphere.length_squared() > MIN_SQUARED_LENGTH { on_sphere } else { towards };
    Vec3::from(lobe.stretch(on_sphere.to_array())).normalize()
}

/// |t + s|² below which rounding decides where t + s points: a chance of 3e-13.
const MIN_SQUARED_LENGTH: f32 = 1e-12;

/// Density of [`visible_normal`] at `m`, 1/sr.
#[inline]
pub fn visible_normal_pdf(lobe: &Sggx, w: Vec3, m: Vec3) -> f32 {
    let cosine = w.dot(m).max(0.0); // flakes are seen from one side; the other belongs to −m
    cosine * lobe.density(m.to_array()) / lobe.projected_area(w.to_array())
}

/// The direction that a flake of normal `m` reflects to `w`, both away from it, unit.
#[inline]
pub fn reflected(w: Vec3, m: Vec3) -> Vec3 {
    let wi = 2.0 * w.dot(m) * m - w;
    // A step of Newton's towards unit length, which a walk of many reflections would lose; it is a rounding away.
    wi * (1.5 - 0.5 * wi.length_squared())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Stream;

    #[test]
    fn visible_normals_face_the_viewer_whatever_the_lobe() {
        let rng = Stream::new(1, 2);
        let corners = [0.0, 1e-7, 0.5, 1.0 - f32::EPSILON / 2.0];
        for along in [1.0, 0.1, 0.01, 0.001] {
            for k in 0..200 {
                let w = warp::sphere(rng.uniform_pair(2 * k));
                let axis = warp::sphere(rng.uniform_pair(2 * k + 1));
                let lobe = Sggx::fibre(axis.to_array(), along);
                for u in corners.iter().flat_map(|&a| corners.map(|b| [a, b])) {
                    let m = visible_normal(&lobe, w, u);
                    // at the rim of the cosine m′·Lᵀω is 0, and L⁻¹ magnifies its rounding
                    assert!(m.is_normalized() && m.dot(w) > -1e-3, "{along} {w} {m}");
                    assert!((reflected(w, m).length() - 1.0).abs() < 1e-6);
                }
            }
        }
    }
}
