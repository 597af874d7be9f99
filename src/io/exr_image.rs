//! OpenEXR: half, float and unsigned samples of any channel, scan lines or tiles, single part.

use std::collections::BTreeSet;
use std::io::Cursor;

use exr::block::UncompressedBlock;
use exr::block::reader::ChunksReader;
use exr::compression::Compression;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::f16;

use super::raster::{Choice, Raster, Transfer, checked_size, expect_bytes};
use super::{Error, SourceFile};

/// Deflate makes at most 1032 bytes from one.
const MAX_ZIP_EXPANSION: u64 = 1032;

/// A block must hold at least its own header.
const MIN_CHUNK_BYTES: u64 = 8 + 8;

/// The largest tile or block of lines that is decoded at once: a 4096² tile of four floats.
const MAX_BLOCK_BYTES: usize = 256 << 20;

/// Decodes the chosen channels of the full-resolution level.
pub(super) fn decode(file: &SourceFile, choice: Choice<'_>) -> Result<Raster, Error> {
    let damaged = |e: exr::error::Error| Error::damaged(file.name(), "EXR", e);
    let reader = exr::block::read(Cursor::new(file.bytes()), false).map_err(damaged)?;
    let header = single_part(file, reader.headers())?.clone();
    let size = [header.layer_size.0, header.layer_size.1];
    let size = checked_size(file.name(), size[0] as u64, size[1] as u64)?;
    expect_bytes(file, size, least_bytes(&header))?;
    let names: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    let chosen = choice.pick(file.name(), &names)?;
    check_layout(file, &header, &chosen)?;

    let mut planes = vec![vec![0.0; size[0] * size[1]]; chosen.len()];
    let mut seen = BTreeSet::new();
    let chunks =
        reader.filter_chunks(false, |_, _, block| block.level.0 == 0 && block.level.1 == 0).map_err(damaged)?;
    let mut blocks = chunks.sequential_decompressor(false);
    while let Some(block) = blocks.decompress_next_block() {
        let block = block.map_err(damaged)?;
        let place = block.index;
        copy_lines(&block, &header, &chosen, &mut planes).map_err(damaged)?;
        seen.insert((place.pixel_position.0, place.pixel_position.1, place.pixel_size.0 * place.pixel_size.1));
    }
    // An offset table may name one block twice and another never.
    let covered: usize = seen.iter().map(|&(_, _, area)| area).sum();
    if covered != size[0] * size[1] {
        let found = format!("its blocks cover {covered} of {} texels", size[0] * size[1]);
        return Err(Error::damaged(file.name(), "EXR", found));
    }
    let all_codes = chosen.iter().all(|&c| header.channels.list[c].sample_type == SampleType::U32);
    let bits = all_codes.then_some(32);
    Ok(Raster { width: size[0], height: size[1], bits, transfer: Transfer::Linear, planes })
}

/// The only header, if there is one, and of flat pixels.
fn single_part<'a>(file: &SourceFile, headers: &'a [Header]) -> Result<&'a Header, Error> {
    let unsupported = |found: String| Error::Unsupported {
        file: file.name().into(),
        found,
        wanted: "a single-part EXR of flat pixels",
    };
    match headers {
        [header] if header.deep => Err(unsupported("deep pixels".into())),
        [header] => Ok(header),
        _ => Err(unsupported(format!("{} parts", headers.len()))),
    }
}

/// The fewest bytes that a file with this header can have.
fn least_bytes(header: &Header) -> u64 {
    let pixels = header.total_pixel_bytes() as u64;
    let chunks = header.chunk_count as u64 * MIN_CHUNK_BYTES;
    match header.compression {
        Compression::Uncompressed => pixels + chunks,
        Compression::ZIP1 | Compression::ZIP16 => chunks + pixels / MAX_ZIP_EXPANSION,
        _ => chunks,
    }
}

/// Refuses blocks too large to decode, and chosen channels beside subsampled ones.
fn check_layout(file: &SourceFile, header: &Header, chosen: &[usize]) -> Result<(), Error> {
    let unsupported = |found: String, wanted| Error::Unsupported { file: file.name().into(), found, wanted };
    let block = header.max_block_pixel_size();
    let texels = block.0.min(header.layer_size.0).saturating_mul(block.1.min(header.layer_size.1));
    let bytes = texels.saturating_mul(header.channels.bytes_per_pixel);
    if bytes > MAX_BLOCK_BYTES {
        let found = format!("blocks of {bytes} bytes");
        return Err(unsupported(found, "at most 268435456 bytes a block; store it in scan lines or smaller tiles"));
    }
    match header.channels.list.iter().find(|c| c.sampling.0 != 1 || c.sampling.1 != 1) {
        Some(channel) if !chosen.is_empty() => {
            Err(unsupported(format!("the subsampled channel `{}`", channel.name), "one sample a texel"))
        }
        _ => Ok(()),
    }
}

/// Copies the chosen channels of a block to their planes.
fn copy_lines(
    block: &UncompressedBlock,
    header: &Header,
    chosen: &[usize],
    planes: &mut [Vec<f32>],
) -> Result<(), exr::error::Error> {
    let width = header.layer_size.0;
    for line in block.lines(&header.channels) {
        let Some(plane) = chosen.iter().position(|&c| c == line.location.channel) else { continue };
        let start = line.location.position.1 * width + line.location.position.0;
        let target = &mut planes[plane][start..start + line.location.sample_count];
        match header.channels.list[line.location.channel].sample_type {
            SampleType::F32 => line.read_samples_into_slice(target)?,
            SampleType::F16 => {
                for (value, sample) in target.iter_mut().zip(line.read_samples::<f16>()) {
                    *value = sample?.to_f32();
                }
            }
            SampleType::U32 => {
                for (value, sample) in target.iter_mut().zip(line.read_samples::<u32>()) {
                    *value = unit_u32(sample?);
                }
            }
        }
    }
    Ok(())
}

/// A code of 32 bits as a fraction of the largest.
fn unit_u32(code: u32) -> f32 {
    (f64::from(code) / f64::from(u32::MAX)) as f32
}
