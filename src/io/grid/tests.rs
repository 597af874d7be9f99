//! Every kind of grid with known voxels: what is read is what was written, and what is damaged is refused in one line.

use std::io::Cursor;

use exr::prelude::f16;
use tiff::encoder::compression::DeflateLevel;
use tiff::encoder::{Compression, TiffEncoder, colortype};

use super::*;

const SIZE: [usize; 3] = [5, 4, 3];

fn numbers(channels: usize) -> impl Iterator<Item = usize> {
    0..SIZE.iter().product::<usize>() * channels
}

fn vol(encoding: u32, channels: u32, data: &[u8]) -> Vec<u8> {
    let words = [encoding, 5, 4, 3, channels];
    let header = words.iter().flat_map(|word| word.to_le_bytes());
    let bounds = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0f32].into_iter().flat_map(f32::to_le_bytes);
    b"VOL\x03".iter().copied().chain(header).chain(bounds).chain(data.iter().copied()).collect()
}

fn read(bytes: Vec<u8>, layout: Option<&RawLayout>, channels: &[usize]) -> Result<Grid, Error> {
    decode_grid(&SourceFile::from_bytes("cloth", bytes), layout, channels)
}

fn refusal(bytes: Vec<u8>, layout: Option<&RawLayout>, channels: &[usize]) -> String {
    let line = read(bytes, layout, channels).expect_err("a damaged file").to_string();
    assert!(line.starts_with("`cloth`: ") && !line.contains('\n'), "{line}");
    line
}

fn tiff_page<C: colortype::ColorType>(pages: &[&[C::Inner]], deflate: bool, size: [u32; 2]) -> Vec<u8>
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let mut bytes = Cursor::new(Vec::new());
    let compression = if deflate { Compression::Deflate(DeflateLevel::Best) } else { Compression::Uncompressed };
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap().with_compression(compression);
    for page in pages {
        encoder.write_image::<C>(size[0], size[1], page).unwrap();
    }
    bytes.into_inner()
}

#[test]
fn the_four_encodings_of_vol_are_read() {
    let floats: Vec<f32> = numbers(6).map(|i| i as f32 * 0.37 - 20.0).collect();
    let grid = read(vol(1, 6, &floats.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()), None, &[6]).unwrap();
    assert_eq!((grid.size, grid.channels, grid.largest_code), (SIZE, 6, None));
    assert_eq!(grid.values, floats);

    let halves: Vec<f16> = floats[..60].iter().map(|&v| f16::from_f32(v)).collect();
    let grid = read(vol(2, 1, &halves.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()), None, &[1]).unwrap();
    assert!(grid.values.iter().zip(&halves).all(|(value, half)| *value == half.to_f32()));

    let codes: Vec<u8> = numbers(3).map(|i| (i * 7) as u8).collect();
    let grid = read(vol(3, 3, &codes), None, &[1, 3]).unwrap();
    assert_eq!(grid.largest_code, Some(255.0));
    assert!(grid.into_fractions().iter().zip(&codes).all(|(value, &code)| *value == f32::from(code) / 255.0));

    let angles: Vec<u8> = numbers(2).map(|i| (i * 4 + 3) as u8).collect();
    let grid = read(vol(4, 3, &angles), None, &[3]).unwrap();
    assert_eq!((grid.channels, grid.values.len()), (3, 180));
    for (pair, direction) in angles.chunks(2).zip(grid.values.chunks(3)) {
        let [theta, phi] = [std::f64::consts::PI, std::f64::consts::TAU].map(|turn| turn / 255.0);
        let [theta, phi] = [theta * f64::from(pair[0]), phi * f64::from(pair[1])];
        let wanted = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        assert!((0..3).all(|k| (f64::from(direction[k]) - wanted[k]).abs() < 1e-6), "{pair:?}");
    }
    assert_eq!(read(vol(4, 2, &angles), None, &[3]).unwrap(), grid);
}

#[test]
fn bare_arrays_are_read_in_any_order_type_and_endianness() {
    let layout = RawLayout { size: [5, 4, 3], sample: SampleType::F32, order: [0, 1, 2], is_big_endian: false };
    let value = |x: usize, y: usize, z: usize, c: usize| (x + 10 * y + 100 * z + 1000 * c) as f32;
    let straight: Vec<f32> = numbers(3).map(|i| value(i / 3 % 5, i / 15 % 4, i / 60, i % 3)).collect();
    for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        let mut bytes = Vec::new();
        for slow in 0..SIZE[order[2]] {
            for middle in 0..SIZE[order[1]] {
                for fast in 0..SIZE[order[0]] {
                    let mut at = [0; 3];
                    (at[order[0]], at[order[1]], at[order[2]]) = (fast, middle, slow);
                    (0..3).for_each(|c| bytes.extend(value(at[0], at[1], at[2], c).to_be_bytes()));
                }
            }
        }
        let grid = read(bytes, Some(&RawLayout { order, is_big_endian: true, ..layout }), &[1, 3]).unwrap();
        assert_eq!((grid.channels, &grid.values), (3, &straight), "{order:?}");
    }
    let codes: Vec<i16> = numbers(1).map(|i| (i as i16 - 30) * 1000).collect();
    for (is_big_endian, bytes) in [
        (true, codes.iter().flat_map(|v| v.to_be_bytes()).collect::<Vec<u8>>()),
        (false, codes.iter().flat_map(|v| v.to_le_bytes()).collect()),
    ] {
        let layout = RawLayout { sample: SampleType::I16, is_big_endian, ..layout };
        let grid = read(bytes.clone(), Some(&layout), &[1]).unwrap();
        assert!(grid.values.iter().zip(&codes).all(|(value, &code)| *value == f32::from(code)));
        let unsigned = read(bytes, Some(&RawLayout { sample: SampleType::U16, ..layout }), &[1]).unwrap();
        assert!(unsigned.values.iter().zip(&codes).all(|(value, &code)| *value == f32::from(code as u16)));
    }
}

#[test]
fn stacks_are_read_page_by_page_in_stored_codes() {
    let bytes: Vec<u8> = numbers(1).map(|i| (i * 4) as u8).collect();
    let words: Vec<u16> = numbers(1).map(|i| (i * 1091) as u16).collect();
    let floats: Vec<f32> = numbers(1).map(|i| i as f32 * 0.5 - 3.0).collect();
    for deflate in [false, true] {
        let pages: Vec<&[u8]> = bytes.chunks(20).collect();
        let grid = read(tiff_page::<colortype::Gray8>(&pages, deflate, [5, 4]), None, &[1]).unwrap();
        assert_eq!((grid.size, grid.largest_code), (SIZE, Some(255.0)));
        assert!(grid.values.iter().zip(&bytes).all(|(value, &code)| *value == f32::from(code)));
        let pages: Vec<&[u16]> = words.chunks(20).collect();
        let grid = read(tiff_page::<colortype::Gray16>(&pages, deflate, [5, 4]), None, &[1]).unwrap();
        assert!(grid.largest_code == Some(65535.0));
        assert!(grid.values.iter().zip(&words).all(|(value, &code)| *value == f32::from(code)));
    }
    let pages: Vec<&[f32]> = floats.chunks(20).collect();
    let grid = read(tiff_page::<colortype::Gray32Float>(&pages, false, [5, 4]), None, &[1]).unwrap();
    assert_eq!((grid.values, grid.largest_code), (floats, None));
}

#[test]
fn damaged_files_are_one_line() {
    let good = vol(3, 1, &[7; 60]);
    for length in 1..good.len() {
        refusal(good[..length].to_vec(), None, &[1]);
    }
    let changed = |at: usize, bytes: &[u8]| {
        let mut lying = good.clone();
        lying[at..at + bytes.len()].copy_from_slice(bytes);
        refusal(lying, None, &[1])
    };
    let longer = [&good[..], &[0]].concat();
    let nan =
        vol(1, 1, &numbers(1).flat_map(|i| if i == 33 { f32::NAN } else { 1.0 }.to_le_bytes()).collect::<Vec<_>>());
    for (line, words) in [
        (refusal(Vec::new(), None, &[1]), "is empty (0 bytes); wanted a Mitsuba `.vol` file"),
        (refusal(b"VOLUME".to_vec(), None, &[1]), "truncated or damaged VOL: 6 bytes; a header has 48"),
        (refusal(b"P5 8 8 255".to_vec(), None, &[1]), "begins with `P5 8 8 2`; wanted a Mitsuba `.vol` file"),
        (refusal(good[..107].to_vec(), None, &[1]), "5 × 4 × 3 voxels of 1 bytes take 60 bytes; the file has 59"),
        (refusal(longer, None, &[1]), "take 60 bytes; the file has 61"),
        (refusal(good.clone(), None, &[3, 6]), "holds 1 numbers a voxel; wanted 3 or 6"),
        (changed(3, &[2]), "holds version 2 of the format; wanted version 3"),
        (changed(4, &[9]), "holds encoding 9; wanted encoding 1 (float32)"),
        (changed(8, &[0]), "has 0 × 4 × 3 voxels; wanted 1 to 134217728 (512³)"),
        (changed(8, &[255; 12]), "has 4294967295 × 4294967295 × 4294967295 voxels"),
        (changed(20, &[255; 4]), "4294967295 channels; wanted 1 to 9"),
        (changed(4, &[4]), "quantised directions with 1 channels"),
        (refusal(nan, None, &[1]), "voxel (3, 2, 1) is NaN; wanted finite values only"),
    ] {
        assert!(line.contains(words), "wanted `{words}` in: {line}");
    }
    let layout = RawLayout { size: [5, 4, 3], sample: SampleType::U16, order: [0, 1, 2], is_big_endian: false };
    let line = refusal(vec![0; 119], Some(&layout), &[1]);
    assert!(line.ends_with("5 × 4 × 3 voxels of 2 bytes take 120 bytes; the file has 119"), "{line}");
    let line = refusal(vec![0; 119], Some(&RawLayout { size: [1 << 40; 3], ..layout }), &[1]);
    assert!(line.contains("1099511627776 × 1099511627776 × 1099511627776 voxels"), "{line}");
}

#[test]
fn damaged_stacks_are_one_line() {
    let bytes: Vec<u8> = numbers(1).map(|i| (i * 4) as u8).collect();
    let pages: Vec<&[u8]> = bytes.chunks(20).collect();
    for deflate in [false, true] {
        let good = tiff_page::<colortype::Gray8>(&pages, deflate, [5, 4]);
        for length in 8..good.len() {
            // Pages come before their directory, so a stack that is cut anywhere is not a shorter stack.
            refusal(good[..length].to_vec(), None, &[1]);
        }
        for place in 8..good.len() {
            for mask in [1, 0x80, 0xFF] {
                let mut bytes = good.clone();
                bytes[place] ^= mask;
                let _ = read(bytes, None, &[1]); // no panic, whatever it says
            }
        }
    }
    let unlike = [tiff_page::<colortype::Gray8>(&[&[0; 20]], false, [5, 4]), Vec::new()].concat();
    assert_eq!(read(unlike, None, &[1]).unwrap().size, [5, 4, 1], "one page is a slice");
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut bytes).unwrap();
    encoder.write_image::<colortype::Gray8>(5, 4, &[0; 20]).unwrap();
    encoder.write_image::<colortype::Gray8>(4, 5, &[0; 20]).unwrap();
    let line = refusal(bytes.into_inner(), None, &[1]);
    assert!(
        line.ends_with("holds a page 2 of 4 × 5 texels unlike the first; wanted pages of one size and type"),
        "{line}"
    );
    let rgb = tiff_page::<colortype::RGB8>(&[&[0; 60]], false, [5, 4]);
    assert!(refusal(rgb, None, &[1]).contains("holds pages with the channels R, G, B; wanted one grey channel"));
}
