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

/// The unit normal of the base plane under a slope `tilt`.
#[inline(always)]
pub(super) fn base_normal([x, y]: [f32; 2]) -> [f32; 3] {
    let scale = 1.0 / (x * x + y * y + 1.0).sqrt();
    [-x * scale, -y * scale, scale]
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell_brdf::exp_neg;
    use crate::lookup::direction_of;

    const TILTS: [[f32; 2]; 4] = [[0.3, 0.0], [-0.2, 0.5], [1.0, 0.0], [0.8, 0.8]];

    /// Lobes that lean up to 37°, so that all their normals point up.
    fn cases() -> impl Iterator<Item = ([f32; 3], f32, [f32; 2])> {
        let means = [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.36, 0.48, 0.8]];
        means
            .into_iter()
            .flat_map(|mean| [40.0, 400.0].map(|kappa| (mean, kappa)))
            .flat_map(|(mean, kappa)| TILTS.map(|tilt| (mean, kappa, tilt)))
    }

    /// Area Σ a|An| and its vector Σ a An, of which the former is longer, from the facets of a lobe of unit area.
    fn sheared_facets(mean: [f32; 3], kappa: f32, tilt: [f32; 2]) -> (f64, [f64; 3]) {
        const N: usize = 400;
        let (mut total, mut area, mut vector) = (0.0, 0.0, [0.0; 3]);
        for k in 0..N * N {
            let n = direction_of([k % N, k / N].map(|i| (i as f32 + 0.5) / N as f32));
            let density = f64::from(exp_neg(kappa * (dot(mean, n) - 1.0).min(0.0)));
            let sheared = [n[0] - tilt[0] * n[2], n[1] - tilt[1] * n[2], n[2]];
            total += density;
            area += density * f64::from(dot(sheared, sheared).sqrt());
            (0..3).for_each(|c| vector[c] += density * f64::from(sheared[c]));
        }
        (area / total, vector.map(|c| c / total))
    }

    #[test]
    fn sheared_lobes_have_the_moments_of_sheared_facets() {
        for (mean, kappa, tilt) in cases() {
            let (area, vector) = sheared_facets(mean, kappa, tilt);
            let (weight, lobe) = lobe((1.0, LobeKernel::new(mean, kappa)), tilt);
            let length = vector.iter().map(|c| c * c).sum::<f64>().sqrt();
            let cosine: f64 = (0..3).map(|c| vector[c] / length * f64::from(lobe.mean()[c])).sum();
            // 1 − r = 1/κ for these; the sheared lobe is an ellipse, whose κ is the harmonic mean of two
            let exact = 1.0 / (1.0 - length / area);
            println!(
                "{mean:?} κ {kappa} tilt {tilt:?}: area {area:.4} {weight:.4}, cos {cosine:.5}, κ {exact:.1} {:.1}",
                lobe.kappa()
            );
            assert!((f64::from(weight) / area - 1.0).abs() < 0.01);
            assert!((1.0 - cosine) * f64::from(kappa) < 0.02, "{cosine}");
            assert!((exact / f64::from(lobe.kappa())).ln().abs() < 0.25, "{exact} {}", lobe.kappa());
        }
    }

    #[test]
    fn what_a_tilted_lobe_shows_is_what_the_flat_one_shows_to_the_straightened_direction() {
        let mut worst = 0.0f32;
        for (mean, kappa, tilt) in cases() {
            let flat = LobeKernel::new(mean, kappa);
            let (weight, leaning) = lobe((1.0, flat), tilt);
            for w in (0..400).map(|k| direction_of([k % 20, k / 20].map(|i| (i as f32 + 0.5) / 20.0))) {
                let sheared = w[2] - tilt[0] * w[0] - tilt[1] * w[1];
                if sheared > 0.0 {
                    let growth = (w[0] * w[0] + w[1] * w[1] + sheared * sheared).sqrt();
                    let exact = growth * flat.facing(straighten(w, tilt)).mean;
                    worst = worst.max((weight * leaning.facing(w).mean - exact).abs());
                }
            }
        }
        println!("worst {worst}");
        assert!(worst < 0.03, "{worst} of an area of 1");
    }
}
