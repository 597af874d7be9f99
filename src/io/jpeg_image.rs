//! JPEG: 8 bit, grey or colour.

use std::io::Cursor;

use image::codecs::jpeg::JpegDecoder;
use image::{ColorType, ImageDecoder, Limits};

use super::raster::{Choice, Raster, Transfer, channel_names, checked_size, expect_bytes, planes, unit_u8};
use super::{Error, SourceFile};

/// A block of 8 × 8 texels takes at least one bit.
const MAX_TEXELS_PER_BYTE: u64 = 8 * 64;

/// Decodes the chosen channels.
pub(super) fn decode(file: &SourceFile, choice: Choice<'_>) -> Result<Raster, Error> {
    let damaged = |e: image::ImageError| Error::damaged(file.name(), "JPEG", e);
    // The decoder fills in grey for what is missing, so the end is looked for here.
    if !reaches_end_of_image(file.bytes()) {
        return Err(Error::damaged(file.name(), "JPEG", "no end-of-image marker"));
    }
    let mut decoder = JpegDecoder::new(Cursor::new(file.bytes())).map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (u64::from(width), u64::from(height));
    let size = checked_size(file.name(), width, height)?;
    expect_bytes(file, size, width * height / MAX_TEXELS_PER_BYTE)?;
    decoder.set_limits(Limits::no_limits()).map_err(damaged)?;
    let names = channel_names(if decoder.color_type() == ColorType::L8 { 1 } else { 3 });
    let chosen = choice.pick(file.name(), &names)?;
    let mut bytes = vec![0; usize::try_from(decoder.total_bytes()).unwrap_or(usize::MAX)];
    decoder.read_image(&mut bytes).map_err(damaged)?;
    let planes = planes(&bytes, names.len(), &chosen, unit_u8);
    Ok(Raster { width: size[0], height: size[1], bits: Some(8), transfer: Transfer::Srgb, planes })
}

/// Whether the marker segments and the entropy-coded data lead to an end-of-image marker (FF D9).
///
/// Thumbnails inside of a segment have one of their own, so segments are skipped by their lengths. In coded data FF is
/// followed by 00, by FF, or by a marker.
fn reaches_end_of_image(bytes: &[u8]) -> bool {
    let mut at = 2;
    while let Some(&[first, second]) = bytes.get(at..at + 2).and_then(|pair| pair.first_chunk()) {
        at += match [first, second] {
            [0xff, 0xd9] => return true,
            // Stuffed bytes, padding and restarts, or coded data.
            [0xff, 0x00 | 0x01 | 0xd0..=0xd8] => 2,
            [0xff, 0xff] => 1,
            [0xff, _] => match bytes.get(at + 2..at + 4) {
                Some(&[high, low]) => 2 + usize::from(u16::from_be_bytes([high, low])),
                _ => return false,
            },
            _ => 1,
        };
    }
    false
}

#[cfg(test)]
mod tests {
    use super::reaches_end_of_image;

    #[test]
    fn an_end_marker_inside_of_a_segment_is_not_the_end() {
        let thumbnail = [0xff, 0xd8, 0xff, 0xe1, 0, 6, 0xff, 0xd9, 1, 2];
        assert!(!reaches_end_of_image(&thumbnail));
        assert!(reaches_end_of_image(&[thumbnail.as_slice(), &[0xff, 0xda, 0, 2, 7, 0xff, 0, 0xff, 0xd9]].concat()));
    }
}
