//! LEADR mapping (Dupuy et al. 2013): averaged heights, one off-centre Beckmann lobe a cell with Smith shadowing.

use super::Reflects;
use crate::geometry::HeightField;
use crate::prefilter::surface::baselines::leadr::slope_moments;
use crate::prefilter::surface::baselines::naive::average_heights;
use crate::prefilter::surface::{FineSurface, cell_colors};

/// A level of `cells`.
pub(super) fn level(fine: &FineSurface, cells: [usize; 2]) -> (HeightField, Reflects) {
    let color = fine.color.as_ref().map(|color| cell_colors(color, fine.heights.size(), cells));
    let moments = slope_moments(&fine.heights, cells);
    (average_heights(&fine.heights, cells), Reflects::Leadr { brdf: fine.brdf, color, moments })
}
