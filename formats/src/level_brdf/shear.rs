//! A level over a tilted base: the tile rides on a large-scale displacement z = L(x, y) + h(x, y).
//!
//! Where L has the slope g the sum is the tile's surface sheared by (x, y, z) → (x, y, z + g·(x, y)). A segment that
//! clears the one surface clears the other, sheared alike, so what is shadowed is found at the direction that the
//! shear leads to ω, w̃ = (ω_x, ω_y, ω_z − g·ω_xy), made unit: [`straighten`].
//!
//! Normals go by the inverse transpose, n → A n = (n_x − g_x n_z, n_y − g_y n_z, n_z). A facet of area a has the base
//! area a n_z, which the shear keeps, as it keeps (A n)_z = n_z; so its area becomes a |A n|. It shows ω the area
//! a (A n)·ω = a n·w̃: what a flat tile shows to w̃/|w̃|, times |w̃| whatever the facet. Hence P_c, A_c and the visible
//! areas of both surfaces scale by |w̃| alone. In F each facet keeps one factor 1/|A n| beside |w̃_i||w̃_o|, and for a
//! Lambertian base nothing else: the fine and the coarse surface lose the same, and T · S, looked up at the
//! straightened directions, is their ratio still. For a glossy base it is so as far as T · S does not depend on f.

use crate::cell_brdf::{LobeKernel, MIN_FACING, dot};

/// The direction over the flat tile that the shear of slope `tilt` leads to `w`: w̃/|w̃|, base frame.
#[inline(always)]
pub(super) fn straighten(w: [f32; 3], tilt: [f32; 2]) -> [f32; 3] {
    if tilt == [0.0; 2] {
        return w;
    }
    let sheared = [w[0], w[1], w[2] - tilt[0] * w[0] - tilt[1] * w[1]];
    let scale = 1.0 / dot(sheared, sheared).sqrt();
    sheared.map(|c| c * scale)
}

/// The lobe (weight, kernel) of the tilted surface.
///
/// n → A n/|A n| has the determinant det A/|A n|³ = 1/|A n|³ on the sphere. About μ solid angles shrink by that, and a
/// von Mises-Fisher lobe has the solid angle 2π/κ: μ′ = Aμ/|Aμ|, κ′ = κ|Aμ|³ (the lobe's ellipse taken as a circle of
/// equal area). The weight w′ keeps the base area, w′ P′(z) = w P(z); a lobe without any keeps the area of its facets,
/// w′ = w|Aμ|, which is the same for a narrow lobe.
pub(super) fn lobe((weight, kernel): (f32, LobeKernel), tilt: [f32; 2]) -> (f32, LobeKernel) {
    let mean = kernel.mean();
    let sheared = [mean[0] - tilt[0] * mean[2], mean[1] - tilt[1] * mean[2], mean[2]];
    let length = dot(sheared, sheared).sqrt();
    let tilted = LobeKernel::new(sheared.map(|c| c / length), kernel.kappa() * length.powi(3));
    let up = [0.0, 0.0, 1.0];
    let [before, after] = [kernel, tilted].map(|kernel| kernel.facing(up).mean);
    let growth = if after > MIN_FACING { before / after } else { length };
    (weight * growth, tilted)
}
