//! One table as one KTX2 file: 2D or 3D, one level, one of the formats of [`TexelFormat`], Zstandard supercompressed.
//!
//! The writer gives the same bytes for the same values; the reader takes exactly what its caller expects and nothing else.

use crate::Error;
use half::f16;
use ktx2::{Format, Header, Index, LevelIndex, SupercompressionScheme};
use std::io::Read;

/// Measured by `examples/encode_cost.rs`: a smooth S of 225² texels takes 91, 73, 66 kB at levels 3, 12, 19, and the
/// whole level with 128² cells of 6 lobes 0.02, 0.09, 0.5 s to encode. Assets are written once and read often.
const ZSTD_LEVEL: i32 = 12;

/// Base-2 logarithm of the largest Zstandard window that a file may ask for (16 MiB); level 19 asks for 8 MiB.
const MAX_WINDOW_LOG: u32 = 24;

/// Where the data format descriptor starts: after the header and the index of one level.
const DESCRIPTOR_OFFSET: u32 = (Header::LENGTH + LevelIndex::LENGTH) as u32;

/// Length, key, NUL, value, NUL; 4 + 18 bytes and padding to a multiple of 4. No version: it would change the bytes.
const KEY_VALUES: &[u8; 24] = b"\x13\0\0\0KTXwriter\0farfield\0\0";

/// Values of one table: x fastest, then y, then z.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Texels {
    /// R32_SFLOAT.
    Single(Vec<f32>),
    /// R16G16B16A16_SFLOAT.
    Half(Vec<[f16; 4]>),
    /// R16_SFLOAT.
    HalfSingle(Vec<f16>),
    /// R8_UNORM.
    Byte(Vec<u8>),
    /// R8G8B8A8_UNORM.
    Bytes(Vec<[u8; 4]>),
    /// R32_UINT.
    Index(Vec<u32>),
}

/// What the texels of a table are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum TexelFormat {
    /// R32_SFLOAT, 4 bytes.
    Single,
    /// R16G16B16A16_SFLOAT, 8 bytes.
    Half,
    /// R16_SFLOAT, 2 bytes.
    HalfSingle,
    /// R8_UNORM, 1 byte.
    Byte,
    /// R8G8B8A8_UNORM, 4 bytes.
    Bytes,
    /// R32_UINT, 4 bytes.
    Index,
}

/// Columns, rows and slices of a table; 0 slices are a 2D image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Extent([usize; 3]);

impl From<[usize; 2]> for Extent {
    fn from([columns, rows]: [usize; 2]) -> Self {
        Self([columns, rows, 0])
    }
}

impl From<[usize; 3]> for Extent {
    fn from(size: [usize; 3]) -> Self {
        debug_assert!(size[2] > 0, "a 3D texture has a slice");
        Self(size)
    }
}

impl TexelFormat {
    fn vk_format(self) -> Format {
        match self {
            Self::Single => Format::R32_SFLOAT,
            Self::Half => Format::R16G16B16A16_SFLOAT,
            Self::HalfSingle => Format::R16_SFLOAT,
            Self::Byte => Format::R8_UNORM,
            Self::Bytes => Format::R8G8B8A8_UNORM,
            Self::Index => Format::R32_UINT,
        }
    }

    fn channels(self) -> u32 {
        match self {
            Self::Half | Self::Bytes => 4,
            Self::Single | Self::HalfSingle | Self::Byte | Self::Index => 1,
        }
    }

    fn bytes_per_channel(self) -> u32 {
        match self {
            Self::Single | Self::Index => 4,
            Self::Half | Self::HalfSingle => 2,
            Self::Byte | Self::Bytes => 1,
        }
    }

    fn bytes_per_texel(self) -> usize {
        (self.channels() * self.bytes_per_channel()) as usize
    }

    fn byte_length(self, Extent([columns, rows, slices]): Extent) -> usize {
        columns * rows * slices.max(1) * self.bytes_per_texel()
    }

    /// Qualifiers of a channel in the data format descriptor, and the values that are its lower and upper bound.
    fn sample(self) -> (u32, [u32; 2]) {
        const SIGNED_FLOAT: u32 = 0xC0;
        match self {
            Self::Single | Self::Half | Self::HalfSingle => (SIGNED_FLOAT, [(-1.0f32).to_bits(), 1.0f32.to_bits()]),
            Self::Byte | Self::Bytes => (0, [0, 255]),
            Self::Index => (0, [0, 1]),
        }
    }

    /// The basic data format descriptor, with its leading total length.
    fn descriptor(self) -> Vec<u8> {
        const ALPHA: u32 = 15;
        let block_size = 24 + 16 * self.channels();
        let mut words = vec![
            4 + block_size,
            0,                             // Khronos, basic
            2 | (block_size << 16),        // version 1.3
            0x0001_0101,                   // RGBSDA, BT.709, linear, straight alpha
            0,                             // blocks of one texel
            self.bytes_per_texel() as u32, // bytes of plane 0
            0,
        ];
        let bits = 8 * self.bytes_per_channel();
        let (qualifiers, bounds) = self.sample();
        for channel in 0..self.channels() {
            let id = if channel == 3 { ALPHA } else { channel };
            words.extend([(bits * channel) | ((bits - 1) << 16) | ((qualifiers | id) << 24), 0]);
            words.extend(bounds);
        }
        words.iter().flat_map(|word| word.to_le_bytes()).collect()
    }
}

impl Texels {
    fn format(&self) -> TexelFormat {
        match self {
            Self::Single(_) => TexelFormat::Single,
            Self::Half(_) => TexelFormat::Half,
            Self::HalfSingle(_) => TexelFormat::HalfSingle,
            Self::Byte(_) => TexelFormat::Byte,
            Self::Bytes(_) => TexelFormat::Bytes,
            Self::Index(_) => TexelFormat::Index,
        }
    }

    fn to_bytes(&self) -> Vec<u8> {
        match self {
            Self::Single(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::Half(values) => values.iter().flatten().flat_map(|value| value.to_le_bytes()).collect(),
            Self::HalfSingle(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::Byte(values) => values.clone(),
            Self::Bytes(values) => values.as_flattened().to_vec(),
            Self::Index(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
        }
    }

    fn from_bytes(bytes: Vec<u8>, format: TexelFormat) -> Self {
        let half = |at: &[u8]| f16::from_le_bytes([at[0], at[1]]);
        let word = |at: &[u8]| [at[0], at[1], at[2], at[3]];
        match format {
            TexelFormat::Single => Self::Single(bytes.chunks_exact(4).map(|b| f32::from_le_bytes(word(b))).collect()),
            TexelFormat::Half => Self::Half(
                bytes.chunks_exact(8).map(|b| [half(b), half(&b[2..]), half(&b[4..]), half(&b[6..])]).collect(),
            ),
            TexelFormat::HalfSingle => Self::HalfSingle(bytes.chunks_exact(2).map(half).collect()),
            TexelFormat::Byte => Self::Byte(bytes),
            TexelFormat::Bytes => Self::Bytes(bytes.chunks_exact(4).map(word).collect()),
            TexelFormat::Index => Self::Index(bytes.chunks_exact(4).map(|b| u32::from_le_bytes(word(b))).collect()),
        }
    }
}

/// The bytes of a KTX2 file of this size.
pub(crate) fn write(texels: &Texels, size: impl Into<Extent>) -> Vec<u8> {
    let size = size.into();
    let format = texels.format();
    let plain = texels.to_bytes();
    debug_assert_eq!(plain.len(), format.byte_length(size), "as many texels as the size says");
    let data = zstd::bulk::compress(&plain, ZSTD_LEVEL).expect("compressing into memory with a valid level");
    let descriptor = format.descriptor();
    let key_values_offset = DESCRIPTOR_OFFSET + descriptor.len() as u32;
    let data_offset = u64::from(key_values_offset) + KEY_VALUES.len() as u64;
    let header = Header {
        format: Some(format.vk_format()),
        type_size: format.bytes_per_channel(),
        pixel_width: size.0[0] as u32,
        pixel_height: size.0[1] as u32,
        pixel_depth: size.0[2] as u32,
        layer_count: 0,
        face_count: 1,
        level_count: 1,
        supercompression_scheme: Some(SupercompressionScheme::Zstandard),
        index: Index {
            dfd_byte_offset: DESCRIPTOR_OFFSET,
            dfd_byte_length: descriptor.len() as u32,
            kvd_byte_offset: key_values_offset,
            kvd_byte_length: KEY_VALUES.len() as u32,
            sgd_byte_offset: 0,
            sgd_byte_length: 0,
        },
    };
    let level = LevelIndex {
        byte_offset: data_offset,
        byte_length: data.len() as u64,
        uncompressed_byte_length: plain.len() as u64,
    };
    [&header.as_bytes()[..], &level.as_bytes(), &descriptor, KEY_VALUES, &data].concat()
}

/// Most bytes that a file with this content can have; a longer one is refused unread.
pub(crate) fn max_file_length(format: TexelFormat, size: impl Into<Extent>) -> u64 {
    /// Header, descriptor and room for key-values that another writer may add.
    const FRONT: u64 = 64 * 1024;
    // Zstandard never grows data by more than 1/256 and a few bytes.
    let plain = format.byte_length(size.into()) as u64;
    FRONT + plain + plain / 256 + 1024
}

/// The texels of the KTX2 file `bytes`, which must have exactly this format and size.
///
/// Memory grows with what is really decompressed and ends at the expected size, whatever the file claims. The `ktx2`
/// crate reads header and level index; its `Reader` is not used since a descriptor byte of 255 makes it panic.
pub(crate) fn read(path: &str, bytes: &[u8], format: TexelFormat, size: impl Into<Extent>) -> Result<Texels, Error> {
    let size = size.into();
    let fail = |place: &str, wanted: String, found: String| Error::malformed(path, place, wanted, found);
    let front = bytes.get(..Header::LENGTH + LevelIndex::LENGTH).ok_or_else(|| {
        fail("header", format!("{} bytes", Header::LENGTH + LevelIndex::LENGTH), format!("{} bytes", bytes.len()))
    })?;
    let (header, index) = front.split_at(Header::LENGTH);
    let header = Header::from_bytes(header.try_into().expect("split at the header's length"))
        .map_err(|error| fail("header", "a KTX2 header".into(), error.to_string()))?;
    let level = LevelIndex::from_bytes(index.try_into().expect("the rest is one level's index"));
    check_header(path, &header, format, size)?;

    let plain_length = format.byte_length(size);
    if level.uncompressed_byte_length != plain_length as u64 {
        let found = format!("{} bytes", level.uncompressed_byte_length);
        return Err(fail("uncompressed length of the level", format!("{plain_length} bytes"), found));
    }
    let section = |place: &str, offset: u64, length: u64| {
        let end = offset.checked_add(length).filter(|&end| end <= bytes.len() as u64);
        let end = end.ok_or_else(|| {
            let found = format!("{} bytes", (bytes.len() as u64).saturating_sub(offset));
            fail(&format!("{place} at byte {offset}"), format!("{length} bytes"), found)
        })?;
        Ok(&bytes[offset as usize..end as usize])
    };
    section("data format descriptor", header.index.dfd_byte_offset.into(), header.index.dfd_byte_length.into())?;
    section("key-value data", header.index.kvd_byte_offset.into(), header.index.kvd_byte_length.into())?;
    let data = section("level data", level.byte_offset, level.byte_length)?;
    let plain = decompress(data, plain_length).map_err(|found| {
        fail(&format!("level data at byte {}", level.byte_offset), format!("{plain_length} bytes in one frame"), found)
    })?;
    Ok(Texels::from_bytes(plain, format))
}

fn check_header(path: &str, header: &Header, format: TexelFormat, Extent(size): Extent) -> Result<(), Error> {
    let checks = [
        ("format", format.vk_format().value(), header.format.map_or(0, |found| found.value())),
        ("type size", format.bytes_per_channel(), header.type_size),
        ("width", size[0] as u32, header.pixel_width),
        ("height", size[1] as u32, header.pixel_height),
        ("depth", size[2] as u32, header.pixel_depth),
        ("layers", 0, header.layer_count),
        ("faces", 1, header.face_count),
        ("levels", 1, header.level_count),
        (
            "supercompression scheme",
            SupercompressionScheme::Zstandard.value(),
            header.supercompression_scheme.map_or(0, |found| found.value()),
        ),
    ];
    match checks.into_iter().find(|(_, wanted, found)| wanted != found) {
        Some((place, wanted, found)) => Err(Error::malformed(path, format!("{place} in the header"), wanted, found)),
        None => Ok(()),
    }
}

/// The one Zstandard frame in `data`, which must hold exactly `length` bytes; the error says what was found.
fn decompress(data: &[u8], length: usize) -> Result<Vec<u8>, String> {
    let words = |error: std::io::Error| error.to_string();
    let mut decoder = zstd::stream::read::Decoder::with_buffer(data).map_err(words)?.single_frame();
    decoder.window_log_max(MAX_WINDOW_LOG).map_err(words)?;
    let mut plain = Vec::new();
    // One byte more than wanted: enough to see that there is more, and to reach the frame's end.
    (&mut decoder).take(length as u64 + 1).read_to_end(&mut plain).map_err(words)?;
    let rest = decoder.finish().len();
    match plain.len() {
        found if found < length => Err(format!("{found} bytes")),
        found if found > length => Err("more".into()),
        _ if rest > 0 => Err(format!("{rest} bytes after it")),
        _ => Ok(plain),
    }
}
