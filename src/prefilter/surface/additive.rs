//! Interreflection as an additive term: T_a(x)·E(ωi, ωo), a BRDF of the base plane.
//!
//! Light that a relief reflects within itself leaves it where no light came in: a shadowed wall shows the light of the
//! one that faces it. A factor of f_c cannot make that, and no BRDF of the coarse surface can where none of its points
//! sees both directions (V-grooves at 8×: 2.3 % of F). So interreflection is what the *base plane* reflects: lit with
//! its own cosine, not shadowed by the relief, seen wherever the relief is seen. Its
//!
//! ```text
//! F = T_a(x)·E(ωi, ωo) · ½ (⟨ωg, ωi⟩ A(x; ωo) + ⟨ωg, ωo⟩ A(x; ωi))
//! ```
//!
//! with A the area that the patch of the coarse surface shows is fitted to F of light reflected twice or more. Over a
//! whole map that repeats, A(ω) is ⟨ωg, ω⟩, and the term is reciprocal. E is smooth: few directions do.

use super::coarse::shown_areas;
use super::fit::{fit_scaling, full_table};
use super::interreflection::Interreflection;
use super::reflectance::{PatchReflectance, TableDirections, pair};
use crate::geometry::HeightField;
use formats::lookup::angular_taps;

/// The additive term of a level, before it is quantised.
#[derive(Clone, Debug, PartialEq)]
pub struct AdditiveTerm {
    /// Direction cells of E per axis (N_a).
    pub directions: usize,
    /// T_a, `[patch]`, RGB; read bilinearly.
    pub spatial: Vec<[f32; 3]>,
    /// E, `[wo][wi]`, N_a² × N_a² directions, RGB, 1/sr.
    pub angular: Vec<[f32; 3]>,
}

/// A term, and what it is to stand for.
pub(super) struct FittedTerm {
    pub(super) term: AdditiveTerm,
    /// F of the term and of the light at the term's own nodes.
    stands_for: [PatchReflectance; 2],
}

/// Direction cells of E per axis.
///
/// Error of E between its nodes, in % of F (twill 8×, diffuse 0.5, GGX 0.3, GGX 0.1; V-groove diffuse 0.5): with 5 0.25,
/// 2.9, 5.5; 1.2. With 7 0.17, 1.8, 3.7; 0.7. With 9 0.15, 1.2, 2.8; 0.6. With 11 0.12, 1.2, 2.5; 0.5. With 15 0.06, 0.9,
/// 2.0; 0.4, at twice the time of the paths. Beyond the outermost nodes (80° with 11, 75° with 7) E is held, and with 7 a
/// white level is up to 10 % too bright there.
pub(super) const DIRECTIONS: usize = 11;

/// The term that stands for `light` on the coarse surface `heights`.
pub(super) fn fit_additive(
    light: &Interreflection,
    heights: &HeightField,
    patches: [usize; 2],
    directions: &TableDirections,
) -> FittedTerm {
    let areas = shown_areas(heights, patches, directions);
    let cosine = |k: usize| directions.vectors[k][2];
    let base = PatchReflectance::from_fn(areas.len(), directions.len(), |patch, _, i, o| {
        0.5 * (cosine(i) * areas[patch][o] + cosine(o) * areas[patch][i])
    });
    let mut factors = fit_scaling(&light.reflectance, &base, directions, 1);
    let of_term = PatchReflectance::from_fn(areas.len(), directions.len(), |patch, channel, i, o| {
        let k = pair(i, o);
        factors.spatial[0][patch][channel] * factors.angular[0][k][channel] * base.channel(patch, channel)[k]
    });
    let [spatial] = <[_; 1]>::try_from(factors.stored_spatial(&base, patches, heights.boundary())).expect("one factor");
    let angular = full_table(&factors.angular[0], directions.len());
    let term = AdditiveTerm { directions: directions.resolution, spatial, angular };
    FittedTerm { term, stands_for: [of_term, light.reflectance.clone()] }
}

impl FittedTerm {
    /// F of the term and of the light on other directions: interpolated as the renderer does, over the base's cosines.
    pub(super) fn resampled(&self, from: &TableDirections, to: &TableDirections) -> [PatchReflectance; 2] {
        self.stands_for.each_ref().map(|f| resample(f, from, to))
    }
}

/// F over the base plane's cosines, interpolated to other directions.
fn resample(f: &PatchReflectance, from: &TableDirections, to: &TableDirections) -> PatchReflectance {
    let n = from.len();
    let taps: Vec<_> = to.vectors.iter().map(|&w| angular_taps(w, from.resolution)).collect();
    let per_cosines = |patch: usize, channel: usize| -> Vec<f32> {
        let table = f.channel(patch, channel);
        let value = |i: usize, o: usize| table[pair(i.max(o), i.min(o))] / (from.vectors[i][2] * from.vectors[o][2]);
        let nodes = (0..n * n).map(|k| value(k / n, k % n)).collect::<Vec<f32>>();
        // one direction of the pair after the other
        let rows = taps.iter().flat_map(|taps| {
            let nodes = &nodes;
            (0..n).map(move |o| taps.iter().map(|&(i, weight)| weight * nodes[i * n + o]).sum::<f32>())
        });
        rows.collect()
    };
    let rows: Vec<Vec<f32>> = (0..3 * f.patch_count()).map(|k| per_cosines(k / 3, k % 3)).collect();
    PatchReflectance::from_fn(f.patch_count(), to.len(), |patch, channel, i, o| {
        let row = &rows[3 * patch + channel][i * n..][..n];
        let value: f32 = taps[o].iter().map(|&(o, weight)| weight * row[o]).sum();
        value * to.vectors[i][2] * to.vectors[o][2]
    })
}
