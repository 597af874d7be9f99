//! The surface at full resolution: the reference.

use super::{ModelLevel, Reflects};
use crate::prefilter::surface::FineSurface;

/// The one level that the original is.
pub(super) fn level(fine: &FineSurface) -> ModelLevel {
    let reflects = Reflects::Base { brdf: fine.brdf, color: fine.color.clone() };
    ModelLevel { index: 0, factor: 1.0, heights: fine.heights.clone(), reflects }
}
