//! f_c without T and S: what the normal distribution alone gives.

use formats::asset::SurfaceAsset;

/// The asset with a scaling of 1 and no additive term.
pub(super) fn without_scaling(asset: &SurfaceAsset) -> SurfaceAsset {
    let mut asset = asset.clone();
    for level in &mut asset.levels {
        level.additive = None;
        level.spatial.truncate(1);
        level.angular.truncate(1);
        level.spatial.iter_mut().chain(&mut level.angular).flatten().for_each(|value| *value = [1.0; 3]);
    }
    asset
}
