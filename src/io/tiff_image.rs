//! TIFF: 8- and 16-bit integers and 32-bit floats, in strips or tiles.

use std::io::Cursor;

use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;

use super::raster::{
    Choice, MAX_TEXELS, Raster, Transfer, channel_names, checked_size, expect_bytes, planes, unit_u8, unit_u16,
};
use super::{Error, SourceFile};

/// LZW, the strongest of the compressions read, makes at most 3840 bytes from 12 bits.
const MAX_EXPANSION: u64 = 2560;

/// The most voxels of a stack, for messages.
const MOST_VOXELS: &str = "at most 134217728 (512³); crop or downsample the volume";

/// What is read, for messages.
const WANTED: &str = "8- or 16-bit unsigned integers or 32-bit floats, 1 to 4 interleaved channels";

/// Decodes the chosen channels of the first page.
pub(super) fn decode(file: &SourceFile, choice: Choice<'_>) -> Result<Raster, Error> {
    open(file)?.page(choice, MAX_TEXELS)
}

/// The pages of a file, in order.
pub(super) struct Pages<'a> {
    file: &'a SourceFile,
    decoder: Decoder<Cursor<&'a [u8]>>,
    is_first: bool,
}

/// Opens a file at its first page.
pub(super) fn open(file: &SourceFile) -> Result<Pages<'_>, Error> {
    let damaged = |e: tiff::TiffError| Error::damaged(file.name(), "TIFF", e);
    let mut limits = Limits::default();
    // A chunk may be the whole image: four floats a texel.
    limits.decoding_buffer_size = usize::try_from(MAX_TEXELS * 16).unwrap_or(usize::MAX);
    limits.intermediate_buffer_size = limits.decoding_buffer_size;
    limits.ifd_value_size = file.bytes().len();
    let decoder = Decoder::new(Cursor::new(file.bytes())).map_err(damaged)?.with_limits(limits);
    Ok(Pages { file, decoder, is_first: true })
}

impl Pages<'_> {
    /// The grey channel of the next page, of at most `most` texels; `None` after the last.
    pub(super) fn next_grey(&mut self, most: u64) -> Result<Option<Raster>, Error> {
        if !self.is_first {
            if !self.decoder.more_images() {
                return Ok(None);
            }
            self.decoder.next_image().map_err(|e| Error::damaged(self.file.name(), "TIFF", e))?;
        }
        self.is_first = false;
        self.page(Choice::One(None), most).map(Some)
    }

    /// The chosen channels of the page that the decoder stands at.
    fn page(&mut self, choice: Choice<'_>, most: u64) -> Result<Raster, Error> {
        let (file, decoder) = (self.file, &mut self.decoder);
        let damaged = |e: tiff::TiffError| Error::damaged(file.name(), "TIFF", e);
        let (width, height) = decoder.dimensions().map_err(damaged)?;
        let size = checked_size(file.name(), width.into(), height.into())?;
        if u64::from(width) * u64::from(height) > most {
            let found = "more voxels in its pages than a volume may have".into();
            return Err(Error::Unsupported { file: file.name().into(), found, wanted: MOST_VOXELS });
        }
        let (samples, bits) = layout(file, decoder)?;
        let plain = decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(damaged)?.unwrap_or(1) == 1;
        let raw = u64::from(width) * u64::from(height) * samples as u64 * u64::from(bits) / 8;
        expect_bytes(file, size, if plain { raw } else { raw / MAX_EXPANSION })?;
        let chosen = choice.pick(file.name(), &channel_names(samples))?;

        let mut image = vec![vec![0.0; size[0] * size[1]]; chosen.len()];
        let mut integer = true;
        for place in chunk_places(decoder, size) {
            let chunk = decoder.read_chunk(place.index).map_err(damaged)?;
            integer = !matches!(chunk, DecodingResult::F32(_));
            let parts = chunk_planes(file, &chunk, samples, &chosen)?;
            for (plane, part) in image.iter_mut().zip(&parts) {
                copy_rows(plane, size[0], &place, part);
            }
        }
        let transfer = if integer { Transfer::Srgb } else { Transfer::Linear };
        Ok(Raster { width: size[0], height: size[1], bits: integer.then_some(bits), transfer, planes: image })
    }
}

/// Samples a texel and bits a sample, if these are read.
fn layout(file: &SourceFile, decoder: &mut Decoder<Cursor<&[u8]>>) -> Result<(usize, u8), Error> {
    let damaged = |e: tiff::TiffError| Error::damaged(file.name(), "TIFF", e);
    let color = decoder.colortype().map_err(damaged)?;
    let planar = decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).map_err(damaged)?.unwrap_or(1) == 2;
    let found = match color {
        ColorType::Gray(bits) => (1, bits),
        ColorType::GrayA(bits) => (2, bits),
        ColorType::RGB(bits) => (3, bits),
        ColorType::RGBA(bits) => (4, bits),
        _ => (0, 0),
    };
    match found {
        (samples @ 1..=4, bits @ (8 | 16 | 32)) if samples == 1 || !planar => Ok((samples, bits)),
        _ => {
            let planar = if planar { " in separate planes" } else { "" };
            Err(Error::Unsupported { file: file.name().into(), found: format!("{color:?}{planar}"), wanted: WANTED })
        }
    }
}

/// A strip or tile and the texels that it covers.
struct ChunkPlace {
    index: u32,
    origin: [usize; 2],
    size: [usize; 2],
}

/// All strips or tiles of the image, in order.
fn chunk_places(decoder: &Decoder<Cursor<&[u8]>>, size: [usize; 2]) -> Vec<ChunkPlace> {
    let (w, h) = decoder.chunk_dimensions();
    let chunk = [(w as usize).max(1), (h as usize).max(1)];
    let across = size[0].div_ceil(chunk[0]);
    let count = across * size[1].div_ceil(chunk[1]);
    let place = |i: usize| {
        let origin = [i % across * chunk[0], i / across * chunk[1]];
        let size = [chunk[0].min(size[0] - origin[0]), chunk[1].min(size[1] - origin[1])];
        Some(ChunkPlace { index: u32::try_from(i).ok()?, origin, size })
    };
    (0..count).map_while(place).collect()
}

/// The chosen channels of a decoded chunk.
fn chunk_planes(
    file: &SourceFile,
    chunk: &DecodingResult,
    samples: usize,
    chosen: &[usize],
) -> Result<Vec<Vec<f32>>, Error> {
    match chunk {
        DecodingResult::U8(codes) => Ok(planes(codes, samples, chosen, unit_u8)),
        DecodingResult::U16(codes) => Ok(planes(codes, samples, chosen, unit_u16)),
        DecodingResult::F32(values) => Ok(planes(values, samples, chosen, |v| v)),
        _ => Err(Error::Unsupported {
            file: file.name().into(),
            found: "signed, 32-bit integer or half samples".into(),
            wanted: WANTED,
        }),
    }
}

/// Copies the rows of a chunk to their place.
fn copy_rows(plane: &mut [f32], width: usize, place: &ChunkPlace, part: &[f32]) {
    for (row, values) in part.chunks_exact(place.size[0]).take(place.size[1]).enumerate() {
        let start = (place.origin[1] + row) * width + place.origin[0];
        plane[start..start + place.size[0]].copy_from_slice(values);
    }
}
