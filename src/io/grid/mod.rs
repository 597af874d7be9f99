//! Grids of voxels: density, albedo, directions and matrices of a volume.
//!
//! Three kinds of file: Mitsuba's `.vol` and TIFF stacks, told apart by their first bytes, and bare arrays, which a
//! [`RawLayout`] describes. Whatever the file's order, a [`Grid`] is `[z][y][x][channel]`.

mod raw;
mod stack;
#[cfg(test)]
mod tests;
mod vol;

pub use raw::{RawLayout, SampleType};

use super::raster::first_bytes;
use super::{Error, SourceFile};

/// The most voxels of a grid: 512³.
pub const MAX_VOXELS: u64 = 1 << 27;

/// The kinds of file that are read, for messages.
const KINDS: &str = "a Mitsuba `.vol` file, a TIFF stack, or a bare array with its `size` and `type`";

/// Numbers on a regular grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// Numbers a voxel.
    pub channels: usize,
    /// `[z][y][x][channel]`, finite: floats as stored, integers as their codes, quantised directions as unit vectors.
    pub values: Vec<f32>,
    /// The largest code of integers; `None` for floats.
    pub largest_code: Option<f32>,
}

impl Grid {
    /// Codes as fractions of the largest; floats as they are.
    pub fn into_fractions(mut self) -> Vec<f32> {
        if let Some(largest) = self.largest_code {
            self.values.iter_mut().for_each(|value| *value /= largest);
        }
        self.values
    }

    /// Voxels of the grid.
    pub fn voxels(&self) -> usize {
        self.size.iter().product()
    }
}

/// Decodes a grid that has one of these numbers of channels; bare arrays have no header and need `layout`.
pub fn decode_grid(file: &SourceFile, layout: Option<&RawLayout>, channels: &[usize]) -> Result<Grid, Error> {
    let grid = match (layout, file.bytes()) {
        (Some(layout), _) => raw::decode(file, layout, channels)?,
        (None, []) => return Err(Error::Empty { file: file.name().into(), wanted: KINDS }),
        (None, [b'V', b'O', b'L', ..]) => vol::decode(file)?,
        (None, [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..]) => stack::decode(file)?,
        (None, bytes) => {
            return Err(Error::UnknownFormat { file: file.name().into(), found: first_bytes(bytes), wanted: KINDS });
        }
    };
    if !channels.contains(&grid.channels) {
        let found = format!("{} numbers a voxel", grid.channels);
        let wanted = channels.iter().map(usize::to_string).collect::<Vec<_>>().join(" or ");
        return Err(Error::GridKind { file: file.name().into(), found, wanted });
    }
    match grid.values.iter().position(|value| !value.is_finite()) {
        None => Ok(grid),
        Some(at) => {
            let voxel = voxel_of(at / grid.channels, grid.size);
            Err(Error::VoxelNotFinite { file: file.name().into(), voxel, value: grid.values[at] })
        }
    }
}

/// x, y, z of a voxel's index.
pub(crate) fn voxel_of(index: usize, [nx, ny, _]: [usize; 3]) -> [usize; 3] {
    [index % nx, index / nx % ny, index / nx / ny]
}

/// Voxels along x, y and z, if admissible.
fn checked_size(file: &SourceFile, size: [u64; 3]) -> Result<[usize; 3], Error> {
    let voxels = size.iter().try_fold(1u64, |product, &n| product.checked_mul(n));
    match voxels {
        Some(1..=MAX_VOXELS) => Ok(size.map(|n| n as usize)),
        _ => Err(Error::GridSize { file: file.name().into(), size }),
    }
}

/// Fails unless the `found` bytes after the header are as many as the size and `bytes_per_voxel` ask for.
fn expect_length(file: &SourceFile, size: [usize; 3], bytes_per_voxel: usize, found: usize) -> Result<(), Error> {
    let wanted = size.iter().map(|&n| n as u64).product::<u64>() * bytes_per_voxel as u64;
    if found as u64 == wanted {
        return Ok(());
    }
    Err(Error::GridLength { file: file.name().into(), size, bytes_per_voxel, found: found as u64, wanted })
}
