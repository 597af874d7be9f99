//! Averaged heights and colours with the base BRDF untouched.

use super::Reflects;
use crate::geometry::HeightField;
use crate::prefilter::surface::baselines::naive::average_heights;
use crate::prefilter::surface::{FineSurface, cell_colors};

/// A level of `cells`.
pub(super) fn level(fine: &FineSurface, cells: [usize; 2]) -> (HeightField, Reflects) {
    let color = fine.color.as_ref().map(|color| cell_colors(color, fine.heights.size(), cells));
    (average_heights(&fine.heights, cells), Reflects::Base { brdf: fine.brdf, color })
}
