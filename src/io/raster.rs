//! Decoding an image of any kind into planes of floats: the one door behind `heights` and `color`.

use super::{Error, SourceFile, exr_image, jpeg_image, png_image, tiff_image};

/// The longest admissible side of an image.
pub(super) const MAX_SIDE: u64 = 16384;

/// The largest admissible image: 16384².
pub const MAX_TEXELS: u64 = MAX_SIDE * MAX_SIDE;

/// The kinds of image that are read, for messages.
const KINDS: &str = "an EXR, PNG, TIFF or JPEG image";

/// What the stored numbers of an image mean for light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Transfer {
    /// Floats are linear.
    Linear,
    /// Integers are sRGB where they are colours.
    Srgb,
}

/// The chosen channels of an image.
#[derive(Clone, Debug)]
pub(super) struct Raster {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Bits of a stored code; `None` for floats.
    pub(super) bits: Option<u8>,
    pub(super) transfer: Transfer,
    /// `[channel][v][u]`: codes divided by 2^bits − 1, floats as stored.
    pub(super) planes: Vec<Vec<f32>>,
}

/// Which channels of an image are wanted.
#[derive(Clone, Copy, Debug)]
pub(super) enum Choice<'a> {
    /// One channel; `None` or `Y` also takes the only one that there is.
    One(Option<&'a str>),
    /// `R`, `G` and `B`, or a single grey channel.
    Color,
}

impl Choice<'_> {
    /// Indices into `names` of the chosen channels.
    pub(super) fn pick(self, file: &str, names: &[String]) -> Result<Vec<usize>, Error> {
        let find = |name: &str| names.iter().position(|n| n == name);
        let missing = |wanted: Option<&str>| Error::Channel {
            file: file.into(),
            wanted: wanted.map(Into::into),
            found: names.to_vec(),
        };
        match self {
            Self::One(None | Some("Y")) if names.len() == 1 => Ok(vec![0]),
            Self::One(wanted) => find(wanted.unwrap_or("Y")).map(|i| vec![i]).ok_or_else(|| missing(wanted)),
            Self::Color if names.len() == 1 => Ok(vec![0]),
            Self::Color => match (find("R"), find("G"), find("B"), find("Y")) {
                (Some(r), Some(g), Some(b), _) => Ok(vec![r, g, b]),
                (.., Some(y)) => Ok(vec![y]),
                _ => Err(missing(Some("R"))),
            },
        }
    }
}

/// Decodes the chosen channels of `file`, whose kind its first bytes tell.
pub(super) fn decode(file: &SourceFile, choice: Choice<'_>) -> Result<Raster, Error> {
    let bytes = file.bytes();
    match bytes {
        [] => Err(Error::Empty { file: file.name().into(), wanted: KINDS }),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr_image::decode(file, choice),
        [0x89, b'P', b'N', b'G', ..] => png_image::decode(file, choice),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => tiff_image::decode(file, choice),
        [0xff, 0xd8, 0xff, ..] => jpeg_image::decode(file, choice),
        _ => Err(Error::UnknownFormat { file: file.name().into(), found: first_bytes(bytes), wanted: KINDS }),
    }
}

/// The first bytes as text where they are text, else in hexadecimal.
pub(super) fn first_bytes(bytes: &[u8]) -> String {
    let start = &bytes[..bytes.len().min(8)];
    if start.iter().all(|b| b.is_ascii_graphic() || *b == b' ') {
        format!("`{}`", String::from_utf8_lossy(start))
    } else {
        format!("the bytes {}", start.iter().map(|b| format!("{b:02x}")).collect::<Vec<_>>().join(" "))
    }
}

/// `width × height` as `usize`, if admissible.
pub(super) fn checked_size(file: &str, width: u64, height: u64) -> Result<[usize; 2], Error> {
    let admissible = [width, height].iter().all(|side| (1..=MAX_SIDE).contains(side));
    match (usize::try_from(width), usize::try_from(height)) {
        (Ok(w), Ok(h)) if admissible => Ok([w, h]),
        _ => Err(Error::Size { file: file.into(), width, height }),
    }
}

/// Fails where `file` has fewer than `wanted` bytes, the least that its format needs for the claimed size.
pub(super) fn expect_bytes(file: &SourceFile, size: [usize; 2], wanted: u64) -> Result<(), Error> {
    let found = file.bytes().len() as u64;
    if found >= wanted {
        return Ok(());
    }
    let [width, height] = size.map(|n| n as u64);
    Err(Error::TooShort { file: file.name().into(), width, height, found, wanted })
}

/// Channel names of an image of 1 to 4 interleaved samples.
pub(super) fn channel_names(samples: usize) -> Vec<String> {
    let names: &[&str] = match samples {
        1 => &["Y"],
        2 => &["Y", "A"],
        3 => &["R", "G", "B"],
        _ => &["R", "G", "B", "A"],
    };
    names.iter().map(|&name| name.into()).collect()
}

/// The chosen planes of interleaved samples, each through `value`.
pub(super) fn planes<T: Copy>(
    samples: &[T],
    count: usize,
    chosen: &[usize],
    value: impl Fn(T) -> f32,
) -> Vec<Vec<f32>> {
    chosen.iter().map(|&channel| samples.iter().skip(channel).step_by(count).map(|&s| value(s)).collect()).collect()
}

/// A code of 8 bits as a fraction of the largest.
pub(super) fn unit_u8(code: u8) -> f32 {
    f32::from(code) / 255.0
}

/// A code of 16 bits as a fraction of the largest.
pub(super) fn unit_u16(code: u16) -> f32 {
    f32::from(code) / 65535.0
}

/// Fails at the first value that is not finite.
pub(super) fn expect_finite(file: &str, width: usize, values: &[f32]) -> Result<(), Error> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(i) => Err(Error::NotFinite { file: file.into(), texel: [i % width, i / width], value: values[i] }),
    }
}
