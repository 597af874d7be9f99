//! The error of a level as its reader sees it (design 4.9).

use formats::asset::{LevelError, SurfaceLevel};
use formats::{BaseBrdf, Boundary};

use crate::prefilter::surface::FineSurface;

/// What a level decoded from its own bytes is measured against.
#[derive(Clone, Copy, Debug)]
pub struct Reference<'a> {
    /// The surface at full resolution.
    pub fine: &'a FineSurface,
    /// The base BRDF as the asset holds it.
    pub bsdf: &'a BaseBrdf,
    /// Metres covered by the map.
    pub size: [f64; 2],
    /// What lies beyond the map's rim.
    pub boundary: Boundary,
    /// ε below 75° of the fit at its own nodes, known from the fit.
    pub on_node: f64,
    /// Seed of the random triples.
    pub seed: u64,
}

/// The measured error of `level`, the level as decoded from the asset's bytes.
///
/// The seam of the measurement by exact ray casts: `None` means that nothing was measured.
pub fn measure(_reference: &Reference<'_>, _level: &SurfaceLevel) -> Option<LevelError> {
    None
}
