//! How much light a Lambertian surface can reflect twice or more, without following any.
//!
//! With s the steepest slope of the surface, e = atan s: a chord between two of its points rises by at most s, so every
//! point sees all directions of an elevation above e. Its own normal leans by at most e, so all of these face it, and
//! since ∫ω dω over them is π cos²e along z, the share of its cosine-weighted hemisphere that is hidden is at most
//!
//! ```text
//! η = 1 − n_z cos²e <= 1 − (1 + s²)^(−3/2)
//! ```
//!
//! Light of one direction gives a radiance of at most a/π directly, with albedo a. What comes back from the surface is
//! reflected as at most a·η times the largest radiance, so that is at most (a/π)/(1 − aη), and the part of it reflected
//! twice or more a·η times as much. To ωo a facet shows at most cosθo + s·sinθo of its base area, hence
//!
//! ```text
//! F(ωi, ωo) <= a/π · aη/(1 − aη) · (cosθo + s·sinθo),    and by reciprocity with ωi for ωo.
//! ```

use super::super::FineSurface;
use super::super::fit::error_below_75;
use super::super::reflectance::TableDirections;
use crate::geometry::HeightField;
use std::f32::consts::FRAC_1_PI;

/// Bound of F of light reflected twice or more.
#[derive(Clone, Copy, Debug)]
pub struct ReflectionBound {
    /// a/π · aη/(1 − aη), RGB.
    radiance: [f32; 3],
    /// Steepest slope.
    slope: f32,
}

impl ReflectionBound {
    /// The bound for a surface with a Lambertian base, whatever its colours; none for other bases.
    pub fn new(fine: &FineSurface) -> Option<Self> {
        if fine.brdf.specular.is_some() {
            return None;
        }
        let slope = steepest_slope(&fine.heights);
        let hidden = 1.0 - (1.0 + slope * slope).powf(-1.5);
        let tint =
            |c: usize| fine.color.as_ref().map_or(1.0, |color| color.iter().fold(0.0_f32, |a, rgb| a.max(rgb[c])));
        let radiance = [0, 1, 2].map(|c| {
            let albedo = fine.brdf.diffuse[c] * tint(c);
            // albedos above 1 make no sense, and walls without end no bound
            let back = (albedo * hidden).min(1.0);
            FRAC_1_PI * albedo * back / (1.0 - back).max(f32::MIN_POSITIVE)
        });
        Some(Self { radiance, slope })
    }

    /// Most that F can be between two directions, RGB.
    pub fn between(&self, wi: [f32; 3], wo: [f32; 3]) -> [f32; 3] {
        let shown = |w: [f32; 3]| w[2] + self.slope * (1.0 - w[2] * w[2]).max(0.0).sqrt();
        self.radiance.map(|radiance| radiance * shown(wi).min(shown(wo)))
    }
}

/// Bound of the steepest slope of the bilinear patches: their slopes along each axis are linear, and largest at an edge.
fn steepest_slope(heights: &HeightField) -> f32 {
    let [width, height] = heights.size();
    let cells = (0..width * height).map(|k| [k % width, k / width]);
    cells.fold(0.0, |steepest, [u, v]| {
        let corners = [[0.0, 0.0], [1.0, 1.0]].map(|[s, t]| heights.slope(u, v, s, t).map(f32::abs));
        let most = |axis: usize| corners[0][axis].max(corners[1][axis]);
        f32::max(steepest, most(0).hypot(most(1)))
    })
}

/// Root mean square of the bound over that of F of direct light, `direct`, over pairs below 75°: the most that ε grows if
/// light reflected twice or more is left out.
pub(in super::super) fn relative_bound(
    bound: &ReflectionBound,
    direct: &super::PatchReflectance,
    directions: &TableDirections,
) -> f64 {
    let w = &directions.vectors;
    let most = super::PatchReflectance::from_fn(1, w.len(), |_, c, i, o| bound.between(w[i], w[o])[c]);
    error_below_75(direct.patch_count(), directions, |patch, channel, k| {
        [most.channel(0, channel)[k], direct.channel(patch, channel)[k]]
    })
}
