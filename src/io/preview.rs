//! A picture to look at: linear radiance as an sRGB image of 8 bits.

use std::io::Cursor;

use image::{ExtendedColorType, ImageEncoder};

use super::color::srgb_from_linear;

/// The bytes of an 8-bit sRGB PNG of linear radiance, `[v][u]`, brightened by `exposure` stops (factors of 2).
///
/// A screen shows 0 to 1: what is brighter than 1 after exposure becomes the largest code, channel by channel, what is
/// negative or no number becomes 0. A preview hides such values by its nature; the EXR beside it keeps them.
///
/// # Panics
/// If there are not `width · height` pixels.
pub fn encode_png(rgb: &[[f32; 3]], width: u32, height: u32, exposure: f32) -> Vec<u8> {
    assert_eq!(rgb.len() as u64, u64::from(width) * u64::from(height), "one colour a pixel");
    let scale = exposure.exp2();
    let codes: Vec<u8> = rgb.as_flattened().iter().map(|value| code(value * scale)).collect();
    let mut out = Cursor::new(Vec::new());
    image::codecs::png::PngEncoder::new(&mut out)
        .write_image(&codes, width, height, ExtendedColorType::Rgb8)
        .expect("writing to memory cannot fail");
    out.into_inner()
}

/// The nearest sRGB code of a linear value; the cast truncates 0 to 255.5, and takes NaN to 0.
fn code(value: f32) -> u8 {
    (srgb_from_linear(value.clamp(0.0, 1.0)) * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::SourceFile;
    use crate::io::color::decode_color;

    #[test]
    fn a_preview_reads_back_within_half_a_code() {
        let rgb: Vec<[f32; 3]> = (0..35).map(|i| [i as f32 / 34.0, 0.5, (i % 5) as f32 / 4.0]).collect();
        let dimmed: Vec<[f32; 3]> = rgb.iter().map(|rgb| rgb.map(|v| v * 0.25)).collect();
        let bytes = encode_png(&dimmed, 7, 5, 2.0);
        assert_eq!(bytes, encode_png(&rgb, 7, 5, 0.0));
        let read = decode_color(&SourceFile::from_bytes("preview", bytes), [7, 5]).unwrap();
        for (read, wanted) in read.as_flattened().iter().zip(rgb.as_flattened()) {
            // The slope of the curve is at most 2.275 (at white).
            assert!((read - wanted).abs() <= 2.275 * 0.5 / 255.0 + 1e-6, "{read}, wanted {wanted}");
        }
    }

    #[test]
    fn what_a_screen_cannot_show_becomes_black_or_full() {
        assert_eq!([-1.0, 0.0, f32::NAN, 1.0, 7.0, f32::INFINITY].map(code), [0, 0, 0, 255, 255, 255]);
        // Code 128 stands for 0.215 861 of linear light.
        assert_eq!([0.2150, 0.215_861, 0.2167].map(code), [128; 3]);
    }
}
