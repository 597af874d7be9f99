//! Volumes: what a manifest entry describes, read from its files; media as levels of an asset, and back.

pub mod encode;
pub mod input;
mod shapes;
pub mod stage;
#[cfg(test)]
mod tests;

use std::path::Path;

use super::VolumeSpec;
pub use input::{VolumeAlbedo, VolumeInput, VolumeInputError, read};

/// Why `spec` is not built: what is wrong with its files, or that this version stops there.
pub(super) fn refusal(spec: &VolumeSpec, folder: &Path) -> String {
    match read(spec, folder) {
        Err(error) => error.to_string(),
        Ok(input) => {
            let [x, y, z] = input.size;
            let occupied = input.occupied();
            format!(
                "volumes are not built in this version; its files are sound: {x} × {y} × {z} voxels, {occupied} occupied"
            )
        }
    }
}
