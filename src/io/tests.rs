//! Every kind of image with known texels: what is read is what was written.

use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder,
    WritableImage, f16,
};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use tiff::encoder::{TiffEncoder, colortype};

use super::SourceFile;
use super::color::decode_color;
use super::heights::{RawHeights, decode_heights, encode_png16};

const SIZE: [usize; 2] = [70, 50];

fn heights(bytes: Vec<u8>, channel: Option<&str>) -> RawHeights {
    let raw = decode_heights(&SourceFile::from_bytes("map", bytes), channel).unwrap();
    assert_eq!([raw.width, raw.height], SIZE);
    raw
}

fn texels() -> impl Iterator<Item = usize> {
    0..SIZE[0] * SIZE[1]
}

fn png(bytes: &[u8], kind: ExtendedColorType, size: [usize; 2]) -> Vec<u8> {
    let mut out = Vec::new();
    PngEncoder::new(&mut out).write_image(bytes, size[0] as u32, size[1] as u32, kind).unwrap();
    out
}

fn exr(samples: FlatSamples, blocks: Blocks, compression: Compression) -> Vec<u8> {
    let other = AnyChannel::new("A", FlatSamples::F16(vec![f16::ONE; SIZE[0] * SIZE[1]]));
    let channels = AnyChannels::sort([AnyChannel::new("Y", samples), other].into_iter().collect());
    let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
    let layer = Layer::new((SIZE[0], SIZE[1]), LayerAttributes::default(), encoding, channels);
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

fn tiff<C: colortype::ColorType>(samples: &[C::Inner]) -> Vec<u8>
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    let mut image = encoder.new_image::<C>(SIZE[0] as u32, SIZE[1] as u32).unwrap();
    image.rows_per_strip(7).unwrap();
    image.write_data(samples).unwrap();
    bytes.into_inner()
}

#[test]
fn png_codes_become_fractions_of_the_largest() {
    let codes: Vec<u16> = texels().map(|i| (i * 17) as u16).collect();
    let raw = heights(encode_png16(&codes, SIZE[0] as u32, SIZE[1] as u32), None);
    assert_eq!(raw.bits, Some(16));
    assert!(raw.values.iter().zip(&codes).all(|(value, &code)| *value == f32::from(code) / 65535.0));
    let rgba: Vec<u8> = texels().flat_map(|i| [0, 1, 2, 3].map(|c| (i * 4 + c) as u8)).collect();
    for (c, name) in ["R", "G", "B", "A"].into_iter().enumerate() {
        let raw = heights(png(&rgba, ExtendedColorType::Rgba8, SIZE), Some(name));
        assert_eq!(raw.bits, Some(8));
        assert!(raw.values.iter().enumerate().all(|(i, value)| *value == f32::from((i * 4 + c) as u8) / 255.0));
    }
}

#[test]
fn exr_samples_of_every_type_and_layout_are_read_as_stored() {
    let values: Vec<f32> = texels().map(|i| i as f32 * 0.5 - 100.0).collect();
    let halves = values.iter().map(|v| f16::from_f32(*v)).collect();
    let tiles = Blocks::Tiles((16, 24).into());
    for (blocks, compression) in [
        (Blocks::ScanLines, Compression::Uncompressed),
        (Blocks::ScanLines, Compression::ZIP16),
        (Blocks::ScanLines, Compression::PIZ),
        (tiles, Compression::Uncompressed),
        (tiles, Compression::ZIP1),
        (tiles, Compression::RLE),
    ] {
        let floats = heights(exr(FlatSamples::F32(values.clone()), blocks, compression), None);
        assert_eq!((floats.bits, &floats.values), (None, &values), "{blocks:?} {compression:?}");
    }
    let half = heights(exr(FlatSamples::F16(halves), tiles, Compression::ZIP16), Some("Y"));
    assert!(half.values.iter().zip(&values).all(|(a, b)| *a == f16::from_f32(*b).to_f32()));
    let codes = texels().map(|i| i as u32 * 1_000_003).collect();
    let codes = heights(exr(FlatSamples::U32(codes), Blocks::ScanLines, Compression::ZIP1), Some("Y"));
    assert_eq!(codes.bits, Some(32));
    assert!((codes.values[100] - 100_000_300.0 / 4_294_967_295.0).abs() < 1e-8);
    let alpha = heights(exr(FlatSamples::F32(values), tiles, Compression::ZIP1), Some("A"));
    assert!(alpha.values.iter().all(|v| *v == 1.0));
}

#[test]
fn tiff_strips_of_integers_and_floats_are_put_together() {
    let bytes: Vec<u8> = texels().map(|i| (i % 251) as u8).collect();
    let raw = heights(tiff::<colortype::Gray8>(&bytes), None);
    assert_eq!((raw.bits, raw.values[300]), (Some(8), 49.0 / 255.0));
    let codes: Vec<u16> = texels().map(|i| (i * 17) as u16).collect();
    let raw = heights(tiff::<colortype::Gray16>(&codes), None);
    assert!(raw.bits == Some(16) && raw.values.iter().zip(&codes).all(|(v, &c)| *v == f32::from(c) / 65535.0));
    let floats: Vec<f32> = texels().map(|i| i as f32 * 0.1).collect();
    let raw = heights(tiff::<colortype::Gray32Float>(&floats), None);
    assert_eq!((raw.bits, raw.values), (None, floats));
    let colors: Vec<u8> = bytes.iter().flat_map(|&b| [b, b / 2, 0]).collect();
    assert_eq!(heights(tiff::<colortype::RGB8>(&colors), Some("G")).values[300], 24.0 / 255.0);
}

#[test]
fn a_colour_map_of_another_size_is_averaged_in_linear_light() {
    let checker: Vec<u8> = (0..16).flat_map(|i| if (i + i / 4) % 2 == 0 { [255; 3] } else { [0; 3] }).collect();
    let file = SourceFile::from_bytes("colour", png(&checker, ExtendedColorType::Rgb8, [4, 4]));
    for rgb in decode_color(&file, [2, 2]).unwrap() {
        assert!(rgb.iter().all(|v| (v - 0.5).abs() < 1e-6), "half of the light, not half of the code");
    }
    let grey = SourceFile::from_bytes("grey", png(&[188; 6], ExtendedColorType::L8, [3, 2]));
    let linear = decode_color(&grey, [5, 7]).unwrap();
    assert_eq!(linear.len(), 35);
    assert!(linear.iter().flatten().all(|v| (v - 0.502_886).abs() < 1e-4));
}
