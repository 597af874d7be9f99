//! Height maps: one channel of an image, and its numbers as design section 11 reads them.

use std::io::Cursor;

use image::{ExtendedColorType, ImageEncoder};

use super::raster::{Choice, decode, expect_finite};
use super::{Error, SourceFile};

/// The samples of a height map before they have a unit.
#[derive(Clone, Debug, PartialEq)]
pub struct RawHeights {
    /// Codes divided by 2^bits − 1, floats as stored; `[v][u]`, finite.
    pub values: Vec<f32>,
    /// Samples along u.
    pub width: usize,
    /// Samples along v, which runs down.
    pub height: usize,
    /// Bits of a stored code; `None` for floats.
    pub bits: Option<u8>,
}

/// Decodes a height map from a channel of `file`: the named one, `Y`, or the only one that there is.
pub fn decode_heights(file: &SourceFile, channel: Option<&str>) -> Result<RawHeights, Error> {
    let raster = decode(file, Choice::One(channel))?;
    let [values] = <[Vec<f32>; 1]>::try_from(raster.planes).expect("one channel was chosen");
    expect_finite(file.name(), raster.width, &values)?;
    Ok(RawHeights { values, width: raster.width, height: raster.height, bits: raster.bits })
}

/// The bytes of a 16-bit grey PNG with these codes, `[v][u]`.
///
/// # Panics
/// If there are not `width · height` codes.
pub fn encode_png16(codes: &[u16], width: u32, height: u32) -> Vec<u8> {
    assert_eq!(codes.len() as u64, u64::from(width) * u64::from(height), "one code a texel");
    let bytes: Vec<u8> = codes.iter().flat_map(|code| code.to_ne_bytes()).collect();
    let mut out = Cursor::new(Vec::new());
    image::codecs::png::PngEncoder::new(&mut out)
        .write_image(&bytes, width, height, ExtendedColorType::L16)
        .expect("writing to memory cannot fail");
    out.into_inner()
}
