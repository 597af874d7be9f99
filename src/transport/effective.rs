//! The effective BRDF of a patch, by exact ray casts.
//!
//! F(x; ωi, ωo) = mean over p in patch x of s(p) · V(p, ωi) · V(p, ωo) and A(x; ωo) = mean of ⟨ωm, ωo⟩/⟨ωm, ωg⟩ · V(p, ωo),
//! where s is f ⟨ωm, ωi⟩ ⟨ωm, ωo⟩/⟨ωm, ωg⟩ on the fine surface (4.6–4.8, both cosines kept) and g(ωi) g(ωo) N_c on the
//! coarse one. A point is a place on the base: p has the same (u, v) on both surfaces, so that their noise is shared.
//!
//! Directions are unit, point away from the surface and live in the frame of the base plane: x = +u, y = −v, z out.

use glam::Vec3;

use super::estimate::{Accumulator, Estimate};
use crate::geometry::{HeightField, HeightTracer, SurfacePoint};
use crate::material::Brdf;
use crate::math::rng::Stream;

/// Which points of a map are sampled: one in each of `strata²` rectangles of a part of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchSampling {
    /// The part of the map: [from, to] along u and along v, in fractions of its extent, 0 to 1.
    pub bounds: [[f64; 2]; 2],
    /// Strata per axis, at least 1.
    pub strata: usize,
    /// Jitter is a function of (seed, patch, stratum).
    pub seed: u64,
    /// A number for the patch, different for every patch that is to have its own jitter.
    pub patch: u64,
}

/// A sampled point of a surface and the directions that it sees.
#[derive(Clone, Copy, Debug)]
pub struct PatchPoint<'a> {
    /// Number of its stratum, from 0, row-major.
    pub stratum: usize,
    /// Place on the base in fractions of the map.
    pub uv: [f64; 2],
    /// Place on this surface.
    pub point: SurfacePoint,
    /// Unit normal of this surface there, z > 0.
    pub normal: Vec3,
    visible: &'a [u64],
}

impl PatchPoint<'_> {
    /// Whether direction `k` of the list is in front of this point's tangent plane and meets no surface.
    #[inline]
    pub fn sees(&self, k: usize) -> bool {
        (self.visible[k / 64] >> (k % 64)) & 1 == 1
    }

    /// The directions that the point sees, direction k at bit k mod 64 of word k / 64.
    pub fn visible(&self) -> &[u64] {
        self.visible
    }

    /// ⟨ωm, ω⟩/⟨ωm, ωg⟩: area that the surface around the point shows to `direction`, per base area.
    #[inline]
    pub fn shown_area(&self, direction: Vec3) -> f32 {
        // A direction behind the tangent plane is shown nothing.
        self.normal.dot(direction).max(0.0) / self.normal.z
    }
}

impl PatchSampling {
    /// Patch `index` (row-major) of `patches[0] × patches[1]` equal parts of the map.
    pub fn of_grid(patches: [usize; 2], index: usize, strata: usize, seed: u64) -> Self {
        debug_assert!(index < patches[0] * patches[1], "a patch of the grid");
        let place = [index % patches[0], index / patches[0]];
        let bounds = [0, 1].map(|k| [place[k], place[k] + 1].map(|x| x as f64 / patches[k] as f64));
        Self { bounds, strata, seed, patch: index as u64 }
    }

    /// Place of the point in stratum `k`, in fractions of the map, below the upper bounds.
    pub fn place(&self, k: usize) -> [f64; 2] {
        let jitter = Stream::new(self.seed, self.patch).uniform_pair(k as u64);
        let stratum = [k % self.strata, k / self.strata];
        [0, 1].map(|axis| {
            let [from, to] = self.bounds[axis];
            from + (to - from) * (stratum[axis] as f64 + f64::from(jitter[axis])) / self.strata as f64
        })
    }
}

/// The point of a surface at the fraction `uv` ∈ [0, 1]² of the map.
pub fn surface_point(heights: &HeightField, uv: [f64; 2]) -> SurfacePoint {
    let size = heights.size();
    let place = [0, 1].map(|k| uv[k] * size[k] as f64);
    let cell = [0, 1].map(|k| (place[k] as usize).min(size[k] - 1));
    SurfacePoint { cell, st: [0, 1].map(|k| (place[k] - cell[k] as f64) as f32) }
}

/// Calls `visit` with each sampled point and which of `directions` it sees, by exact ray casts.
pub fn for_each_point(
    tracer: &HeightTracer,
    sampling: &PatchSampling,
    directions: &[Vec3],
    mut visit: impl FnMut(&PatchPoint),
) {
    let mut visible = vec![0u64; directions.len().div_ceil(64)];
    for stratum in 0..sampling.strata * sampling.strata {
        let uv = sampling.place(stratum);
        let point = surface_point(tracer.heights(), uv);
        let normal = tracer.normal(point);
        visible.fill(0);
        for (k, &direction) in directions.iter().enumerate() {
            let seen = normal.dot(direction) > 0.0 && !tracer.occluded(point, direction);
            visible[k / 64] |= u64::from(seen) << (k % 64);
        }
        visit(&PatchPoint { stratum, uv, point, normal, visible: &visible });
    }
}

/// F of a patch for light from `wi` seen from `wo`, RGB, where `scatter` gives s(p) of a point that sees both.
pub fn reflectance(
    tracer: &HeightTracer,
    sampling: &PatchSampling,
    [wi, wo]: [Vec3; 2],
    mut scatter: impl FnMut(&PatchPoint) -> [f32; 3],
) -> [Estimate; 3] {
    let mut sums = [Accumulator::default(); 3];
    for_each_point(tracer, sampling, &[wi, wo], |point| {
        let s = if point.sees(0) && point.sees(1) { scatter(point) } else { [0.0; 3] };
        (0..3).for_each(|c| sums[c].add(f64::from(s[c])));
    });
    sums.map(|sum| sum.estimate())
}

/// A of a patch: the area that it shows to `wo`, as a fraction of its base area.
pub fn projected_area(tracer: &HeightTracer, sampling: &PatchSampling, wo: Vec3) -> Estimate {
    let mut sum = Accumulator::default();
    for_each_point(tracer, sampling, &[wo], |point| {
        sum.add(if point.sees(0) { f64::from(point.shown_area(wo)) } else { 0.0 });
    });
    sum.estimate()
}

/// s(p) of the fine surface: f ⟨ωm, ωi⟩ ⟨ωm, ωo⟩/⟨ωm, ωg⟩, RGB.
pub fn base_scatter(brdf: &Brdf, normal: Vec3, wi: Vec3, wo: Vec3) -> [f32; 3] {
    // f is 0 where either cosine is not positive.
    let cosines = normal.dot(wi) * normal.dot(wo) / normal.z;
    brdf.eval(normal, wi, wo).map(|f| f * cosines)
}

#[cfg(test)]
mod tests {
    use std::f32::consts::{FRAC_1_PI, PI};

    use super::*;
    use crate::geometry::Boundary;
    use crate::material::Conductor;

    const WHITE: Brdf = Brdf { diffuse: [1.0; 3], specular: None };

    fn towards(theta: f32, phi: f32) -> Vec3 {
        Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }

    /// 45° grooves along y, 8 texels wide.
    fn groove() -> HeightField {
        let heights = (0..32).map(|k| (k as f32 % 8.0 - 4.0).abs()).collect();
        HeightField::new(heights, [8, 4], [1.0, 1.0], Boundary::Repeat)
    }

    fn patch(strata: usize, seed: u64) -> PatchSampling {
        PatchSampling::of_grid([1, 1], 0, strata, seed)
    }

    fn f_of(field: &HeightField, strata: usize, wi: Vec3, wo: Vec3) -> Estimate {
        let scatter = |p: &PatchPoint| base_scatter(&WHITE, p.normal, wi, wo);
        reflectance(&HeightTracer::new(field), &patch(strata, 1), [wi, wo], scatter)[0]
    }

    #[test]
    fn a_flat_plane_keeps_its_brdf() {
        let field = HeightField::new(vec![0.7; 35], [7, 5], [1.0, 2.0], Boundary::Repeat);
        let tracer = HeightTracer::new(&field);
        let brdf = Brdf { diffuse: [0.1, 0.5, 0.9], specular: Some(Conductor::ggx(0.3, [0.9, 0.5, 0.1])) };
        for [wi, wo] in [[towards(0.3, 1.0), towards(1.0, 4.0)], [towards(1.55, 0.0), towards(1.5, PI)]] {
            let f = reflectance(&tracer, &patch(4, 1), [wi, wo], |p| base_scatter(&brdf, p.normal, wi, wo));
            let expected = brdf.eval(Vec3::Z, wi, wo).map(|f| f * wi.z * wo.z);
            for c in 0..3 {
                assert!((f[c].mean / f64::from(expected[c]) - 1.0).abs() < 1e-6, "{f:?}");
                assert!(f[c].variance < 1e-14, "{f:?}");
            }
            assert!((projected_area(&tracer, &patch(4, 1), wo).mean - f64::from(wo.z)).abs() < 1e-6);
        }
    }

    #[test]
    fn a_groove_shows_the_area_that_it_must() {
        // Across the groove both walls face directions up to 45°, one wall those beyond; what is shown is the
        // plane's cosine, for the groove has no overhang and nothing is above it: A(ωo) = cos θo (4.8).
        let field = groove();
        let tracer = HeightTracer::new(&field);
        for theta in [0.0, 0.5, 0.785, 1.0, 1.3, 1.5] {
            let wo = towards(theta, 0.3);
            let area = projected_area(&tracer, &patch(64, 3), wo);
            assert!((area.mean - f64::from(wo.z)).abs() < 5.0 * area.standard_error() + 1e-6, "{theta}: {area:?}");
        }
    }

    #[test]
    fn a_groove_reflects_what_its_walls_reflect() {
        let half = 0.5f32.sqrt();
        let [left, right] = [Vec3::new(-half, 0.0, half), Vec3::new(half, 0.0, half)];
        let field = groove();
        // Along the groove and above 45° nothing is hidden: F is the mean of both walls'.
        for [wi, wo] in [[towards(0.4, 0.2), towards(0.6, 2.0)], [towards(1.2, PI / 2.0), towards(0.1, 0.0)]] {
            let walls = [left, right].map(|n| base_scatter(&WHITE, n, wi, wo)[0]);
            let f = f_of(&field, 32, wi, wo);
            assert!((f.mean - f64::from(0.5 * (walls[0] + walls[1]))).abs() < 5.0 * f.standard_error() + 1e-6);
        }
        // Light at elevation e = 30° across the groove: the rim hides the lower part of the wall that faces it. From the
        // rim, 4 up and 8 away from the facing rim, the shadow falls on that wall at height y = 4 − (4 + y) tan e: lit is
        // 1 − y/4 = 2 tan e/(1 + tan e) of it, and it stands on half of the base.
        let wi = towards(PI / 3.0, 0.0);
        let slope = (PI / 6.0).tan();
        let lit = 2.0 * slope / (1.0 + slope);
        let f = f_of(&field, 128, wi, Vec3::Z);
        let expected = 0.5 * lit * FRAC_1_PI * right.dot(wi);
        assert!((f.mean - f64::from(expected)).abs() < 5.0 * f.standard_error(), "{f:?} {expected}");
    }

    #[test]
    fn estimates_converge_and_their_variance_covers_the_error() {
        let [wi, wo] = [towards(1.2, 0.3), towards(0.9, 2.0)];
        let field = groove();
        let reference = f_of(&field, 512, wi, wo).mean;
        let errors = [8, 32, 128].map(|strata| {
            let f = f_of(&field, strata, wi, wo);
            assert!((f.mean - reference).abs() < 4.0 * f.standard_error(), "{strata}: {f:?} is {reference}");
            f.standard_error()
        });
        assert!(errors[2] < 0.1 * errors[0]);
    }

    #[test]
    fn swapping_light_and_view_changes_nothing() {
        let [wi, wo] = [towards(1.2, 0.3), towards(0.9, 2.0)];
        let field = groove();
        let [f, g] = [f_of(&field, 32, wi, wo), f_of(&field, 32, wo, wi)];
        assert!((f.mean - g.mean).abs() < 1e-6 * f.mean);
    }

    #[test]
    fn points_lie_in_their_strata_at_the_same_places_of_both_surfaces() {
        let sampling = PatchSampling::of_grid([3, 2], 4, 5, 9);
        let fine = groove();
        let coarse = HeightField::new(vec![0.0; 6], [3, 2], [8.0 / 3.0, 2.0], Boundary::Repeat);
        let mut places = [Vec::new(), Vec::new()];
        for (field, places) in [&fine, &coarse].into_iter().zip(&mut places) {
            for_each_point(&HeightTracer::new(field), &sampling, &[], |p| places.push(p.uv));
        }
        assert_eq!(places[0], places[1]);
        for (k, [u, v]) in places[0].iter().enumerate() {
            assert_eq!([(u * 15.0) as usize, (v * 10.0) as usize], [5 + k % 5, 5 + k / 5]);
        }
    }
}
