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
use super::fit::{Factors, fit_scaling, full_table, mean_square};
use super::interreflection::Interreflection;
use super::reflectance::{PatchReflectance, TableDirections};
use super::stored_spatial;
use crate::geometry::HeightField;
use crate::material::Brdf;

/// The additive term of a level, before it is quantised.
#[derive(Clone, Debug)]
pub struct AdditiveTerm {
    /// Direction cells of E per axis (N_a).
    pub directions: usize,
    /// T_a, `[patch]`, RGB; read bilinearly.
    pub spatial: Vec<[f32; 3]>,
    /// E, `[wo][wi]`, N_a² × N_a² directions, RGB, 1/sr.
    pub angular: Vec<[f32; 3]>,
}

/// A term, and how well it fits.
pub(super) struct FittedTerm {
    pub(super) term: AdditiveTerm,
    /// Root mean square of what is missed of F at the nodes below 75°, and of F.
    pub(super) missed: f64,
    pub(super) total: f64,
}

/// Direction cells of E per axis that a base needs.
///
/// Error of E between its nodes, in % of F (twill 8×, diffuse 0.5, GGX 0.3, GGX 0.1; V-groove diffuse 0.5): with 5 0.25,
/// 2.9, 5.5; 1.2. With 7 0.17, 1.8, 3.7; 0.7. With 9 0.15, 1.2, 2.8; 0.6. With 11 0.12, 1.2, 2.5; 0.5. With 15 0.06, 0.9,
/// 2.0; 0.4.
pub fn directions_of(brdf: &Brdf) -> usize {
    match brdf.specular {
        None => 7,
        Some(conductor) if conductor.alpha >= 0.2 => 9,
        Some(_) => 11,
    }
}

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
    let Factors { spatial, angular, on_node } = fit_scaling(&light.reflectance, &base, directions, 1);
    let total = mean_square(&light.reflectance, directions).sqrt();
    let [spatial] = <[_; 1]>::try_from(stored_spatial(&spatial, patches, heights.boundary())).expect("one factor");
    let term =
        AdditiveTerm { directions: directions.resolution, spatial, angular: full_table(&angular[0], directions.len()) };
    FittedTerm { term, missed: on_node * total, total }
}
