//! Plain averages: density and albedo by \[WU19\] (3.6), S by (3.5), no weights.

use crate::medium::Medium;
use crate::prefilter::volume::Prototypes;
use crate::prefilter::volume::coarsen::coarsen;

/// The level of `fine` with a lobe a prototype; one prototype gives the published baseline.
pub fn level(fine: &Medium, factor: f64, prototypes: &Prototypes) -> Medium {
    coarsen(fine, factor, &prototypes.shapes, |_| 1.0)
}
