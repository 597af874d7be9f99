//! Sampling of SGGX lobes by visible normals, and what specular flakes reflect.
//!
//! σ and D are `formats::sggx`'s. Directions are unit vectors that point away from the flake.

use formats::sggx::Sggx;
use glam::Vec3;

use super::frame::Frame;
use super::warp;

/// A flake normal with the density ⟨ω, m⟩ D(m)/σ(ω), from two uniform numbers in [0, 1).
///
/// With S = L Lᵀ the flakes are those of the unit sphere, area vector a, mapped to L·a. What they show to ω is
/// (L·a)·ω = a·(Lᵀω): the sphere's flakes as seen from Lᵀω, which follow the cosine. So m = L·m′/|L·m′| with m′ cosine
/// distributed around Lᵀω. Any root of S would do; the triangular one costs least.
#[inline]
pub fn visible_normal(lobe: &Sggx, w: Vec3, u: [f32; 2]) -> Vec3 {
    let towards = Vec3::from(lobe.stretch_transposed(w.to_array())).normalize();
    let on_sphere = Frame::around(towards).to_outer(warp::cosine_hemisphere(u));
    Vec3::from(lobe.stretch(on_sphere.to_array())).normalize()
}

/// Density of [`visible_normal`] at `m`, 1/sr.
#[inline]
pub fn visible_normal_pdf(lobe: &Sggx, w: Vec3, m: Vec3) -> f32 {
    let cosine = w.dot(m).max(0.0); // flakes are seen from one side; the other belongs to −m
    cosine * lobe.density(m.to_array()) / lobe.projected_area(w.to_array())
}

/// The direction that a flake of normal `m` reflects to `w`, both away from it, unit.
#[inline]
pub fn reflected(w: Vec3, m: Vec3) -> Vec3 {
    // normalised anew: a walk of a hundred reflections would lose its length
    (2.0 * w.dot(m) * m - w).normalize()
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
