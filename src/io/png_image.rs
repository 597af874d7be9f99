//! PNG: 8 and 16 bit, grey or colour, with or without alpha.

use std::io::Cursor;

use image::codecs::png::PngDecoder;
use image::{ColorType, ExtendedColorType, ImageDecoder, Limits};

use super::raster::{Choice, Raster, Transfer, channel_names, checked_size, expect_bytes, planes, unit_u8, unit_u16};
use super::{Error, SourceFile};

/// Deflate makes at most 1032 bytes from one.
const MAX_EXPANSION: u64 = 1032;

/// What ancillary chunks (profiles, text) may take: they are of no use here.
const MAX_CHUNK_BYTES: u64 = 64 << 20;

/// Decodes the chosen channels.
pub(super) fn decode(file: &SourceFile, choice: Choice<'_>) -> Result<Raster, Error> {
    let damaged = |e: image::ImageError| Error::damaged(file.name(), "PNG", e);
    let [width, height, bits] = header(file)?;
    let size = checked_size(file.name(), width, height)?;
    // One byte a row for the filter; the fewest channels that there can be.
    expect_bytes(file, size, ((width * bits).div_ceil(8) + 1) * height / MAX_EXPANSION)?;

    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MAX_CHUNK_BYTES.max(width * 32));
    let decoder = PngDecoder::with_limits(Cursor::new(file.bytes()), limits).map_err(damaged)?;
    let color = decoder.color_type();
    let names = channel_names(usize::from(color.channel_count()));
    let chosen = choice.pick(file.name(), &names)?;
    let bits = match decoder.original_color_type() {
        ExtendedColorType::L1 => 1,
        ExtendedColorType::L2 => 2,
        ExtendedColorType::L4 => 4,
        _ if is_16_bit(color) => 16,
        _ => 8,
    };
    let mut bytes = vec![0; usize::try_from(decoder.total_bytes()).unwrap_or(usize::MAX)];
    decoder.read_image(&mut bytes).map_err(damaged)?;
    let planes = if is_16_bit(color) {
        let (codes, _) = bytes.as_chunks::<2>();
        planes(codes, names.len(), &chosen, |code| unit_u16(u16::from_ne_bytes(code)))
    } else {
        planes(&bytes, names.len(), &chosen, unit_u8)
    };
    Ok(Raster { width: size[0], height: size[1], bits: Some(bits), transfer: Transfer::Srgb, planes })
}

/// Whether a sample takes 16 bits.
fn is_16_bit(color: ColorType) -> bool {
    matches!(color, ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16)
}

/// Width, height and bits a sample from the header chunk, which comes first.
fn header(file: &SourceFile) -> Result<[u64; 3], Error> {
    let bytes = file.bytes();
    let word = |at: usize| bytes.get(at..at + 4)?.try_into().ok().map(u32::from_be_bytes).map(u64::from);
    match (bytes.get(12..16), word(16), word(20), bytes.get(24)) {
        (Some(b"IHDR"), Some(width), Some(height), Some(&bits)) => Ok([width, height, u64::from(bits)]),
        _ => Err(Error::damaged(file.name(), "PNG", "no complete header chunk")),
    }
}
