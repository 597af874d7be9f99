//! Bare arrays: numbers one after the other, described in the manifest.

use exr::prelude::f16;

use super::{Grid, checked_size, expect_length};
use crate::io::{Error, SourceFile};

/// What a bare array holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawLayout {
    /// Voxels along x, y and z.
    pub size: [u64; 3],
    /// Type of a number.
    pub sample: SampleType,
    /// Axes from the fastest to the slowest, 0 being x: `[0, 1, 2]` has x fastest.
    pub order: [usize; 3],
    /// Whether the most significant byte comes first.
    pub is_big_endian: bool,
}

/// Type of a stored number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleType {
    /// Unsigned, 8 bits.
    U8,
    /// Unsigned, 16 bits.
    U16,
    /// Signed, 16 bits.
    I16,
    /// Half float.
    F16,
    /// Single float.
    F32,
}

impl SampleType {
    /// All, with their names in a manifest.
    pub const NAMES: [(&'static str, Self); 5] =
        [("u8", Self::U8), ("u16", Self::U16), ("i16", Self::I16), ("f16", Self::F16), ("f32", Self::F32)];

    /// Bytes of a number.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::I16 | Self::F16 => 2,
            Self::F32 => 4,
        }
    }

    /// The largest code of integers.
    pub(super) fn largest_code(self) -> Option<f32> {
        match self {
            Self::U8 => Some(255.0),
            Self::U16 => Some(65535.0),
            Self::I16 => Some(32767.0),
            Self::F16 | Self::F32 => None,
        }
    }
}

/// Decodes the array with as many numbers a voxel as its length says, which must be one of `channels`.
pub(super) fn decode(file: &SourceFile, layout: &RawLayout, channels: &[usize]) -> Result<Grid, Error> {
    let size = checked_size(file, layout.size)?;
    let voxels: usize = size.iter().product();
    let bytes = layout.sample.bytes();
    let found = file.bytes().len();
    let fits = channels.iter().find(|&&channels| voxels * channels * bytes == found);
    let channels = *fits.unwrap_or(&channels[0]);
    expect_length(file, size, channels * bytes, found)?;
    let values = samples(file.bytes(), layout.sample, layout.is_big_endian);
    let values = if layout.order == [0, 1, 2] { values } else { reordered(&values, size, channels, layout.order) };
    Ok(Grid { size, channels, values, largest_code: layout.sample.largest_code() })
}

/// The numbers of an array, codes as they are.
pub(super) fn samples(data: &[u8], sample: SampleType, is_big_endian: bool) -> Vec<f32> {
    let pair = |b: &[u8]| if is_big_endian { [b[1], b[0]] } else { [b[0], b[1]] };
    let pairs = data.chunks_exact(2).map(pair);
    match sample {
        SampleType::U8 => data.iter().map(|&code| f32::from(code)).collect(),
        SampleType::U16 => pairs.map(|b| f32::from(u16::from_le_bytes(b))).collect(),
        SampleType::I16 => pairs.map(|b| f32::from(i16::from_le_bytes(b))).collect(),
        SampleType::F16 => pairs.map(|b| f16::from_le_bytes(b).to_f32()).collect(),
        SampleType::F32 => data
            .chunks_exact(4)
            .map(|b| match is_big_endian {
                true => f32::from_be_bytes([b[0], b[1], b[2], b[3]]),
                false => f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
            })
            .collect(),
    }
}

/// `[z][y][x][channel]` of values whose axes run in another order.
fn reordered(values: &[f32], size: [usize; 3], channels: usize, order: [usize; 3]) -> Vec<f32> {
    let mut strides = [0; 3];
    let mut stride = channels;
    for axis in order {
        strides[axis] = stride;
        stride *= size[axis];
    }
    let mut sorted = Vec::with_capacity(values.len());
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                let at = z * strides[2] + y * strides[1] + x * strides[0];
                sorted.extend_from_slice(&values[at..at + channels]);
            }
        }
    }
    sorted
}
