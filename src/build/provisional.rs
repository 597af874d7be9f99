//! Stands in for `prefilter::surface::compile` until that is here: coarse heights, one flat lobe, T = S = 1.

use crate::prefilter::surface::downsample::downsample;
use crate::prefilter::surface::{CoarseLevel, FineSurface, LevelSettings, VmfLobe};

/// A level with the right shape and the coarse heights.
pub(super) fn compile(
    fine: &FineSurface,
    settings: &LevelSettings,
    on_stage: &mut dyn FnMut(&'static str),
) -> CoarseLevel {
    on_stage("downsample");
    let heights = downsample(&fine.heights, settings.factor);
    let cells = heights.size();
    let flat = VmfLobe { mean: [0.0, 0.0, 1.0], kappa: 100.0, weight: 1.0 };
    let patches = cells.map(|n| n.min(settings.patches));
    let pairs = settings.directions.pow(4);
    on_stage("fit");
    CoarseLevel {
        lobes: vec![vec![flat; cells[0] * cells[1]]],
        base_color: fine.color.as_ref().map(|_| vec![[1.0; 3]; cells[0] * cells[1]]),
        heights,
        patches,
        spatial: vec![vec![[1.0; 3]; patches[0] * patches[1]]; settings.rank],
        directions: settings.directions,
        angular: vec![vec![[1.0; 3]; pairs]; settings.rank],
        on_node: 0.0,
        warnings: Vec::new(),
    }
}
