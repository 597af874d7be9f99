//! The prefiltered levels, read through `formats` like any renderer's.

use formats::Boundary;
use formats::asset::SurfaceAsset;

use super::{ModelLevel, Reflects, mean_factor};
use crate::geometry::{self, HeightField};

/// All levels of `asset`.
pub(super) fn levels(asset: &SurfaceAsset) -> Vec<ModelLevel> {
    let boundary = match asset.boundary {
        Boundary::Repeat => geometry::Boundary::Repeat,
        Boundary::Clamp => geometry::Boundary::Clamp,
    };
    let source = [asset.source.width, asset.source.height].map(|n| n as usize);
    let level = |(place, level): (usize, &formats::asset::SurfaceLevel)| {
        let spacing = [0, 1].map(|k| (asset.size[k] / level.cells[k] as f64) as f32);
        ModelLevel {
            index: level.index,
            factor: mean_factor(source, level.cells),
            heights: HeightField::new(level.heights.clone(), level.cells, spacing, boundary),
            reflects: Reflects::Prefiltered { place },
        }
    };
    asset.levels.iter().enumerate().map(level).collect()
}
