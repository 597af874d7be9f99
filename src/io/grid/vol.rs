//! Mitsuba's `.vol`, version 3: a header of 48 bytes, little-endian, and one array.

use std::f32::consts::{PI, TAU};

use super::raw::{SampleType, samples};
use super::{Grid, checked_size, expect_length};
use crate::io::{Error, SourceFile};

/// Magic, version, encoding, size, channels, bounding box.
const HEADER: usize = 48;

/// Code of a quantised angle that is a half turn (θ) or a whole one (φ).
const ANGLE_CODES: f32 = 255.0;

/// Decodes the array; the bounding box is not used: a manifest gives the voxel's size.
pub(super) fn decode(file: &SourceFile) -> Result<Grid, Error> {
    let damaged = |found: String| Error::damaged(file.name(), "VOL", found);
    let Some((header, data)) = file.bytes().split_at_checked(HEADER) else {
        return Err(damaged(format!("{} bytes; a header has {HEADER}", file.bytes().len())));
    };
    let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    if header[3] != 3 {
        let found = format!("version {} of the format", header[3]);
        return Err(Error::Unsupported { file: file.name().into(), found, wanted: "version 3" });
    }
    let (encoding, channels) = (word(4), word(20));
    let size = checked_size(file, [word(8), word(12), word(16)].map(u64::from))?;
    if encoding == 4 {
        // Writers differ in what they call the channels of two bytes that stand for three numbers.
        if !(2..=3).contains(&channels) {
            return Err(damaged(format!("quantised directions with {channels} channels; wanted 2 or 3")));
        }
        expect_length(file, size, 2, data.len())?;
        return Ok(Grid { size, channels: 3, values: directions(data), largest_code: None });
    }
    let sample = match encoding {
        1 => SampleType::F32,
        2 => SampleType::F16,
        3 => SampleType::U8,
        _ => {
            let wanted = "encoding 1 (float32), 2 (float16), 3 (uint8) or 4 (quantised directions)";
            return Err(Error::Unsupported { file: file.name().into(), found: format!("encoding {encoding}"), wanted });
        }
    };
    if !(1..=MAX_CHANNELS).contains(&channels) {
        return Err(damaged(format!("{channels} channels; wanted 1 to {MAX_CHANNELS}")));
    }
    let channels = channels as usize;
    expect_length(file, size, channels * sample.bytes(), data.len())?;
    Ok(Grid { size, channels, values: samples(data, sample, false), largest_code: sample.largest_code() })
}

/// Most numbers a voxel: those of a matrix.
const MAX_CHANNELS: u32 = 9;

/// Unit vectors of pairs of bytes: θ = π·code/255 from +z, φ = 2π·code/255 from +x.
fn directions(data: &[u8]) -> Vec<f32> {
    let angles = |turn: f32| -> Vec<[f32; 2]> {
        (0..=255u8).map(|code| f32::from(code) / ANGLE_CODES * turn).map(|a| [a.sin(), a.cos()]).collect()
    };
    let (thetas, phis) = (angles(PI), angles(TAU));
    let direction = |pair: &[u8]| {
        let ([sin_theta, cos_theta], [sin_phi, cos_phi]) = (thetas[usize::from(pair[0])], phis[usize::from(pair[1])]);
        [sin_theta * cos_phi, sin_theta * sin_phi, cos_theta]
    };
    data.chunks_exact(2).flat_map(direction).collect()
}
