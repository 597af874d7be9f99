//! Environment maps: equirectangular radiance, from OpenEXR or Radiance HDR.

use std::io::Cursor;

use image::codecs::hdr::HdrDecoder;
use image::{ImageDecoder, ImageError};

use super::raster::{Choice, checked_size, decode, expect_bytes, expect_finite, first_bytes};
use super::{Error, SourceFile};

/// The kinds of image that are read, for messages.
const KINDS: &str = "an EXR or Radiance HDR image";

/// The fewest bytes of a scan line of a Radiance image: a pixel and a run of it.
const MIN_LINE_BYTES: u64 = 8;

/// The directions of light around a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Texels along the azimuth.
    pub width: usize,
    /// Texels from the top to the bottom, half as many within one.
    pub height: usize,
    /// Linear RGB radiance, `[v][u]`, finite and at least 0; row 0 is the top.
    pub texels: Vec<[f32; 3]>,
    /// Values that were below 0 and are 0 here: lossy compression leaves tiny ones, a map with large ones is no light.
    pub negative_count: usize,
}

/// Decodes an environment map: `R`, `G` and `B` or one grey channel of an EXR image, or a Radiance HDR image.
///
/// A Radiance header may state an exposure that its values were multiplied by; like most readers this one leaves it
/// alone, as it leaves all light to the scale of the scene.
pub fn decode_environment(file: &SourceFile) -> Result<Environment, Error> {
    let ([width, height], mut texels) = match file.bytes() {
        [] => return Err(Error::Empty { file: file.name().into(), wanted: KINDS }),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr_texels(file)?,
        bytes if bytes.starts_with(b"#?RADIANCE") || bytes.starts_with(b"#?RGBE") => hdr_texels(file)?,
        bytes => {
            let found = first_bytes(bytes);
            return Err(Error::UnknownFormat { file: file.name().into(), found, wanted: KINDS });
        }
    };
    let mut negative_count = 0;
    for value in texels.as_flattened_mut().iter_mut().filter(|value| **value < 0.0) {
        *value = 0.0;
        negative_count += 1;
    }
    Ok(Environment { width, height, texels, negative_count })
}

/// Size and texels of an EXR image.
fn exr_texels(file: &SourceFile) -> Result<([usize; 2], Vec<[f32; 3]>), Error> {
    let raster = decode(file, Choice::Color)?;
    expect_aspect(file, [raster.width, raster.height])?;
    raster.planes.iter().try_for_each(|plane| expect_finite(file.name(), raster.width, plane))?;
    let (r, g, b) = match raster.planes.as_slice() {
        [r, g, b] => (r, g, b),
        [y, ..] => (y, y, y),
        [] => unreachable!("at least one channel was chosen"),
    };
    let texels = r.iter().zip(g).zip(b).map(|((&r, &g), &b)| [r, g, b]).collect();
    Ok(([raster.width, raster.height], texels))
}

/// Size and texels of a Radiance HDR image, which has no code for a number that is not finite.
fn hdr_texels(file: &SourceFile) -> Result<([usize; 2], Vec<[f32; 3]>), Error> {
    let damaged = |e: ImageError| Error::damaged(file.name(), "HDR", e);
    // Not strict: headers of many programs break rules that do not touch the pixels.
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(file.bytes())).map_err(damaged)?;
    let (width, height) = decoder.dimensions();
    let size = checked_size(file.name(), width.into(), height.into())?;
    expect_aspect(file, size)?;
    expect_bytes(file, size, u64::from(height) * MIN_LINE_BYTES)?;
    let mut bytes = vec![0; size[0] * size[1] * 12];
    decoder.read_image(&mut bytes).map_err(damaged)?;
    let values = |texel: &[u8; 12]| std::array::from_fn(|c| f32_at(texel, c));
    Ok((size, bytes.as_chunks::<12>().0.iter().map(values).collect()))
}

/// Number `c` of a texel's three, in the machine's order.
fn f32_at(texel: &[u8; 12], c: usize) -> f32 {
    f32::from_ne_bytes(std::array::from_fn(|k| texel[4 * c + k]))
}

/// Fails unless the image is twice as wide as high, within a texel.
fn expect_aspect(file: &SourceFile, [width, height]: [usize; 2]) -> Result<(), Error> {
    if width.abs_diff(2 * height) <= 1 {
        return Ok(());
    }
    Err(Error::Unsupported {
        file: file.name().into(),
        found: format!("{width} × {height} texels"),
        wanted: "an equirectangular environment map, twice as wide as high",
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use image::codecs::hdr::HdrEncoder;
    use image::{ExtendedColorType, ImageEncoder};

    use super::*;
    use crate::io::color::decode_color;
    use crate::io::exr_writer::{ExrImage, encode_exr};
    use crate::io::heights::decode_heights;

    /// An EXR file of `size` whose channel c has `value` (texel index, c).
    fn exr(names: &[&str], size: [usize; 2], value: impl Fn(usize, usize) -> f32) -> SourceFile {
        let plane = |c: usize| (0..size[0] * size[1]).map(|i| value(i, c)).collect();
        let channels = names.iter().enumerate().map(|(c, name)| (name.to_string(), plane(c))).collect();
        SourceFile::from_bytes("sky.exr", encode_exr(&ExrImage { size, channels, attributes: BTreeMap::new() }))
    }

    /// A Radiance file of 16 × 8 texels with the value 2^(i mod 9 − 4) in red, which its codes hold exactly.
    fn hdr() -> Vec<u8> {
        let texels: Vec<u8> =
            (0..128).flat_map(|i| [2f32.powi(i % 9 - 4), 0.0, 0.125].map(f32::to_ne_bytes)).flatten().collect();
        let mut bytes = Vec::new();
        HdrEncoder::new(&mut bytes).write_image(&texels, 16, 8, ExtendedColorType::Rgb32F).unwrap();
        bytes
    }

    /// The line that refuses these bytes.
    fn refusal(bytes: &[u8]) -> String {
        decode_environment(&SourceFile::from_bytes("sky", bytes.to_vec())).unwrap_err().to_string()
    }

    #[test]
    fn exr_environments_are_read_as_stored_without_what_is_below_zero() {
        let colour = decode_environment(&exr(&["R", "G", "B"], [8, 4], |i, c| i as f32 - 1.5 * c as f32)).unwrap();
        assert_eq!((colour.width, colour.height, colour.texels[9]), (8, 4, [9.0, 7.5, 6.0]));
        // Below 0: green of texels 0 and 1, blue of 0, 1 and 2.
        assert_eq!((colour.negative_count, colour.texels[2]), (5, [2.0, 0.5, 0.0]));
        let grey = decode_environment(&exr(&["Y"], [5, 2], |i, _| i as f32)).unwrap();
        assert_eq!((grey.texels[7], grey.negative_count), ([7.0; 3], 0));
    }

    #[test]
    fn radiance_environments_are_read_under_both_names() {
        let bytes = hdr();
        let named_rgbe = [b"#?RGBE\n".as_slice(), &bytes[b"#?RADIANCE\n".len()..]].concat();
        for bytes in [bytes, named_rgbe] {
            let sky = decode_environment(&SourceFile::from_bytes("sky.hdr", bytes)).unwrap();
            assert_eq!((sky.width, sky.height, sky.texels.len()), (16, 8, 128));
            for (i, texel) in sky.texels.iter().enumerate() {
                assert_eq!(texel[0], 2f32.powi(i as i32 % 9 - 4));
                // An exponent is shared: a code is 1/256 to 1/128 of the largest channel.
                assert!((texel[2] - 0.125).abs() <= texel[0].max(0.125) / 128.0);
            }
        }
    }

    #[test]
    fn the_fixture_is_a_sky_with_a_bright_lamp() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/environments/studio.exr");
        let sky = decode_environment(&SourceFile::read(path.as_ref()).unwrap()).unwrap();
        assert_eq!([sky.width, sky.height], [1024, 512]);
        let values = sky.texels.as_flattened();
        // As its origin states: the largest value 118.375, the mean 0.2561 (of values before those below 0 were cut).
        assert_eq!(values.iter().copied().fold(0.0, f32::max), 118.375);
        let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
        assert!((mean - 0.256_111).abs() < 1e-5, "{mean}");
        assert!(sky.negative_count > 0);
    }

    #[test]
    fn what_is_no_environment_is_one_line() {
        assert_eq!(refusal(b""), "`sky`: is empty (0 bytes); wanted an EXR or Radiance HDR image");
        assert_eq!(
            refusal(b"\x89PNG"),
            "`sky`: begins with the bytes 89 50 4e 47; wanted an EXR or Radiance HDR image"
        );
        let square = "`sky`: holds 8 × 8 texels; wanted an equirectangular environment map, twice as wide as high";
        assert_eq!(refusal(exr(&["Y"], [8, 8], |_, _| 1.0).bytes()), square);
        let infinite = exr(&["R", "G", "B"], [8, 4], |i, c| if (i, c) == (13, 1) { f32::INFINITY } else { 1.0 });
        assert_eq!(refusal(infinite.bytes()), "`sky`: texel (5, 1) is inf; wanted finite values only");
        assert!(refusal(exr(&["depth", "B"], [8, 4], |_, _| 1.0).bytes()).contains("channel `R` not found"));
    }

    #[test]
    fn headers_that_claim_too_much_are_refused_before_memory_is_taken() {
        let header = |size: &str| format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n").into_bytes();
        for (size, wanted) in [
            ("-Y 500000 +X 1000000", "the header claims 1000000 × 500000 texels; wanted 1 to 16384 a side"),
            ("-Y 4294967295 +X 4294967295", "truncated or damaged HDR: "),
            ("-Y 99999999999 +X 4", "truncated or damaged HDR: "),
            ("-Y 0 +X 0", "the header claims 0 × 0 texels"),
            (
                "-Y 8192 +X 16384",
                "the header claims 16384 × 8192 texels, which take at least 65536 bytes; the file has ",
            ),
            ("+X 16 -Y 8", "truncated or damaged HDR: "),
            ("-Y 8 +X", "truncated or damaged HDR: "),
        ] {
            let line = refusal(&header(size));
            assert!(line.strip_prefix("`sky`: ").unwrap().starts_with(wanted), "{size}: {line}");
            assert_eq!(line.lines().count(), 1);
        }
        let xyz = String::from_utf8(header("-Y 8 +X 16")).unwrap().replace("rgbe", "xyze");
        assert!(refusal(xyz.as_bytes()).contains("damaged HDR"));
    }

    #[test]
    fn every_truncation_is_one_line_and_no_changed_byte_panics() {
        for bytes in [hdr(), exr(&["R", "G", "B"], [16, 8], |i, _| (i as f32).sin()).bytes().to_vec()] {
            for length in (1..bytes.len()).step_by(3) {
                let line = refusal(&bytes[..length]);
                assert!(line.starts_with("`sky`: ") && line.lines().count() == 1, "{line}");
            }
            for at in (0..bytes.len()).step_by(3) {
                let mut changed = bytes.clone();
                changed[at] ^= 0xff;
                if let Ok(sky) = decode_environment(&SourceFile::from_bytes("sky", changed)) {
                    assert!(sky.texels.as_flattened().iter().all(|v| v.is_finite() && *v >= 0.0));
                }
            }
        }
    }

    #[test]
    fn a_radiance_image_is_neither_a_height_nor_a_colour_map() {
        let file = SourceFile::from_bytes("bark.hdr", hdr());
        let wanted = "`bark.hdr`: begins with `#?RADIAN`; wanted an EXR, PNG, TIFF or JPEG image";
        assert_eq!(decode_heights(&file, None).unwrap_err().to_string(), wanted);
        assert_eq!(decode_color(&file, [4, 2]).unwrap_err().to_string(), wanted);
    }
}
