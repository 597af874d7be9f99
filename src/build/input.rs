//! The fine surface that a manifest entry describes, read from its files.

use std::path::Path;

use super::encode::Sources;
use super::key::Digest;
use super::{SurfaceSpec, condition};
use crate::geometry::HeightField;
use crate::io::color::decode_color;
use crate::io::heights::decode_heights;
use crate::io::{Error, SourceFile};
use crate::prefilter::surface::FineSurface;

/// A fine surface with the provenance of its files.
#[derive(Clone, Debug)]
pub struct Input {
    /// What is prefiltered.
    pub fine: FineSurface,
    /// BLAKE3 of the height map's bytes.
    pub height_digest: Digest,
    /// BLAKE3 of the colour map's bytes.
    pub color_digest: Option<Digest>,
    /// What the user should know about the maps, one line each.
    pub warnings: Vec<String>,
}

impl Input {
    /// What an asset says of it.
    pub fn sources(&self) -> Sources {
        Sources { height: self.height_digest, size: self.fine.heights.size(), color: self.color_digest }
    }
}

/// Reads the files of `spec`, whose paths are relative to `folder`.
pub(crate) fn read(spec: &SurfaceSpec, folder: &Path) -> Result<Input, InputError> {
    let file = SourceFile::read(&folder.join(&spec.height))?;
    let height_digest = Digest::of(file.bytes());
    let (heights, warnings) = heights(spec, file)?;
    let (color, color_digest) = match &spec.color {
        None => (None, None),
        Some(path) => {
            let file = SourceFile::read(&folder.join(path))?;
            (Some(decode_color(&file, heights.size())?), Some(Digest::of(file.bytes())))
        }
    };
    Ok(Input { fine: FineSurface { heights, brdf: spec.brdf, color }, height_digest, color_digest, warnings })
}

/// The heights of `spec` in metres from the bytes of its map, and what is to be said about them.
pub(super) fn heights(spec: &SurfaceSpec, file: SourceFile) -> Result<(HeightField, Vec<String>), InputError> {
    let mut raw = decode_heights(&file, spec.channel.as_deref())?;
    drop(file);
    let warnings = condition::warnings(&raw, spec.boundary, spec.dequantize);
    if spec.dequantize {
        let bits = raw.bits.ok_or_else(|| InputError::NotCodes { file: spec.height.clone() })?;
        condition::dequantize(&mut raw, bits, spec.boundary);
    }
    if spec.detrend {
        condition::detrend(&mut raw);
    }
    let size = [raw.width, raw.height];
    let spacing = [spec.size[0] / size[0] as f64, spec.size[1] / size[1] as f64].map(|metres| metres as f32);
    let sign = if spec.invert { -1.0 } else { 1.0 };
    for value in &mut raw.values {
        *value = (spec.offset + sign * spec.amplitude * f64::from(*value)) as f32;
    }
    if let Some(i) = raw.values.iter().position(|metres| !metres.is_finite()) {
        let texel = [i % size[0], i / size[0]];
        return Err(InputError::Overflow { file: spec.height.clone(), texel });
    }
    Ok((HeightField::new(raw.values, size, spacing, spec.boundary), warnings))
}

/// Why a fine surface could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum InputError {
    /// A file is not what it should be.
    #[error("{0}")]
    File(#[from] Error),
    /// `dequantize` of floats.
    #[error("`{file}`: holds floats, which have no steps; wanted integers for `dequantize`, or leave it out")]
    NotCodes {
        /// The height map.
        file: String,
    },
    /// A height beyond single precision.
    #[error("`{file}`: the height of texel ({}, {}) overflows; wanted a smaller `amplitude`", texel[0], texel[1])]
    Overflow {
        /// The height map.
        file: String,
        /// Column and row.
        texel: [usize; 2],
    },
}
