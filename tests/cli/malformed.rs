//! Files that are not what they should be: one line, exit code 1, nothing written, little memory.

use std::io::Cursor;

use exr::prelude::*;

use crate::project::{Project, Said, said, surface, wave_codes, waves};

/// Address space for a run, in KiB: far above what a small map takes, far below what the headers below claim.
const MEMORY_KIB: u32 = 3 << 20;

/// Builds with `file` as the height map, under a limit of memory, and gives what is said.
fn build_with(name: &str, bytes: &[u8], keys: &str) -> Said {
    let project = Project::empty();
    project.write(name, bytes);
    project.write("farfield.toml", (surface("bark", name) + keys).as_bytes());
    let mut shell = std::process::Command::new("sh");
    let script = format!("ulimit -v {MEMORY_KIB}; exec \"$0\" build -q --jobs 2");
    shell.args(["-c", &script, env!("CARGO_BIN_EXE_farfield")]).current_dir(project.path());
    let said = said(shell.output().unwrap());
    if said.code != 0 {
        assert_eq!(project.tree("").len(), 2, "nothing is written");
    }
    said
}

/// Expects one whole line.
fn expect_refusal(name: &str, bytes: &[u8], keys: &str, wanted: &str) {
    let said = build_with(name, bytes, keys);
    assert_eq!(said.stderr, format!("error: surface `bark`: `{name}`: {wanted}\n"));
    assert_eq!((said.code, said.stdout.as_str()), (1, ""));
}

/// Expects one line that begins so.
fn expect_refusal_like(name: &str, bytes: &[u8], wanted: &str) {
    let said = build_with(name, bytes, "");
    assert!(said.stderr.starts_with(&format!("error: surface `bark`: `{name}`: {wanted}")), "{name}: {said:?}");
    assert_eq!(said.stderr.lines().count(), 1, "{said:?}");
    assert_eq!((said.code, said.stdout.as_str()), (1, ""));
}

/// A float EXR of 8 × 6 texels with one channel and the value of each texel.
fn exr_bytes(channel: &str, value: impl Fn(usize, usize) -> f32) -> Vec<u8> {
    let samples: Vec<f32> = (0..48).map(|i| value(i % 8, i / 8)).collect();
    let channel = AnyChannel::new(channel, FlatSamples::F32(samples));
    let encoding = Encoding { line_order: LineOrder::Increasing, ..Encoding::UNCOMPRESSED };
    let layer =
        Layer::new((8, 6), LayerAttributes::default(), encoding, AnyChannels::sort(std::iter::once(channel).collect()));
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer).write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

/// A 16-bit grey TIFF of 48 × 32 texels.
fn tiff_bytes() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap();
    encoder.write_image::<tiff::encoder::colortype::Gray16>(48, 32, &wave_codes(48, 32)).unwrap();
    bytes.into_inner()
}

/// An 8-bit grey JPEG of 48 × 32 texels.
fn jpeg_bytes() -> Vec<u8> {
    let codes: Vec<u8> = wave_codes(48, 32).iter().map(|code| (code >> 8) as u8).collect();
    let mut bytes = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new(&mut bytes);
    image::ImageEncoder::write_image(encoder, &codes, 48, 32, image::ExtendedColorType::L8).unwrap();
    bytes
}

#[test]
fn every_kind_of_image_builds() {
    let wave = |u: usize, v: usize| (u as f32).sin() + (v as f32).cos();
    for (name, bytes) in [
        ("bark.exr", exr_bytes("Y", wave)),
        ("bark.tif", tiff_bytes()),
        ("bark.jpg", jpeg_bytes()),
        ("bark.png", waves(48, 32)),
        ("misnamed.jpg", waves(48, 32)),
    ] {
        let said = build_with(name, &bytes, "");
        assert_eq!(said.code, 0, "{name}: {said:?}");
    }
}

#[test]
fn what_is_no_image_is_named_by_its_first_bytes() {
    let wanted = "an EXR, PNG, TIFF or JPEG image";
    expect_refusal("bark.png", b"", "", &format!("is empty (0 bytes); wanted {wanted}"));
    expect_refusal("bark.png", b"<html>  <body>", "", &format!("begins with `<html>  `; wanted {wanted}"));
    expect_refusal("bark.exr", &[0, 1, 2, 3], "", &format!("begins with the bytes 00 01 02 03; wanted {wanted}"));
}

#[test]
fn a_folder_in_place_of_a_file_is_one_line() {
    let project = Project::empty();
    std::fs::create_dir(project.path().join("maps")).unwrap();
    project.write("farfield.toml", surface("bark", "maps").as_bytes());
    let said = project.run(&["build", "-q"]);
    let wanted = "error: surface `bark`: `maps`: is a directory; wanted a file\n";
    assert_eq!((said.code, said.stderr.as_str()), (1, wanted));
}

#[test]
fn a_missing_channel_lists_those_that_exist() {
    expect_refusal("bark.png", &waves(8, 8), "channel = \"G\"", "channel `G` not found; the file has `Y`");
    expect_refusal(
        "bark.exr",
        &exr_bytes("depth.Z", |_, _| 0.0),
        "channel = \"Z\"",
        "channel `Z` not found; the file has `depth.Z`",
    );
    let mut colour = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut colour);
    image::ImageEncoder::write_image(encoder, &[0; 12], 2, 2, image::ExtendedColorType::Rgb8).unwrap();
    expect_refusal("bark.png", &colour, "", "has the channels `R`, `G`, `B`; wanted one of them as `channel`");
}

#[test]
fn values_that_are_not_finite_name_their_texel() {
    for (value, shown) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (f32::NEG_INFINITY, "-inf")] {
        let bytes = exr_bytes("Y", |u, v| if (u, v) == (5, 3) { value } else { 0.0 });
        expect_refusal("bark.exr", &bytes, "", &format!("texel (5, 3) is {shown}; wanted finite values only"));
    }
}

#[test]
fn every_truncation_is_one_line() {
    let wave = |u: usize, v: usize| (u as f32).sin() + (v as f32).cos();
    for (name, bytes) in [
        ("bark.exr", exr_bytes("Y", wave)),
        ("bark.png", waves(48, 32)),
        ("bark.tif", tiff_bytes()),
        ("bark.jpg", jpeg_bytes()),
    ] {
        let n = bytes.len();
        for length in [8, 20, 40, n / 4, n / 2, n * 3 / 4, n - 20] {
            expect_refusal_like(name, &bytes[..length], "");
        }
    }
}

#[test]
fn headers_that_claim_too_much_are_refused_before_memory_is_taken() {
    let png = |width: u32, height: u32| {
        let mut bytes = waves(48, 32);
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes[20..24].copy_from_slice(&height.to_be_bytes());
        let sum = crc32(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&sum.to_be_bytes());
        bytes
    };
    let too_many = "texels; wanted 1 to 16384 a side; crop or downsample the map";
    let claim = format!("the header claims 1000000 × 1000000 {too_many}");
    expect_refusal("bark.png", &png(1_000_000, 1_000_000), "", &claim);
    expect_refusal("bark.png", &png(16385, 2), "", &format!("the header claims 16385 × 2 {too_many}"));
    expect_refusal_like("bark.png", &png(0, 5), "the header claims 0 × 5 texels");
    expect_refusal_like("bark.png", &png(16384, 16384), "the header claims 16384 × 16384 texels, which take at least");
    expect_refusal_like("bark.png", &png(48, 33), "truncated or damaged PNG: ");

    let exr = |width: i32, height: i32| {
        let mut bytes = exr_bytes("Y", |_, _| 0.0);
        // The data window is four integers after its name, its type and its length.
        let name = b"dataWindow\0box2i\0\x10\0\0\0";
        let at = bytes.windows(name.len()).position(|window| window == name).unwrap() + name.len();
        bytes[at + 8..at + 12].copy_from_slice(&(width - 1).to_le_bytes());
        bytes[at + 12..at + 16].copy_from_slice(&(height - 1).to_le_bytes());
        // One chunk a line.
        let name = b"chunkCount\0int\0\x04\0\0\0";
        let at = bytes.windows(name.len()).position(|window| window == name).unwrap() + name.len();
        bytes[at..at + 4].copy_from_slice(&height.to_le_bytes());
        bytes
    };
    expect_refusal_like("bark.exr", &exr(i32::MAX, 2), "");
    expect_refusal_like("bark.exr", &exr(100_000, 100_000), "the header claims 100000 × 100000 texels");
    expect_refusal_like("bark.exr", &exr(16384, 16384), "the header claims 16384 × 16384 texels, which take at least");

    let mut jpeg = jpeg_bytes();
    let frame = jpeg.windows(2).position(|marker| marker == [0xff, 0xc0]).unwrap();
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0x3f, 0xff, 0x3f, 0xff]);
    expect_refusal_like("bark.jpg", &jpeg, "the header claims 16383 × 16383 texels, which take at least");

    let mut tiff = tiff_bytes();
    let entry = [0x00, 0x01, 4, 0, 1, 0, 0, 0, 48, 0]; // ImageWidth, one LONG
    let at = tiff.windows(10).position(|bytes| bytes == entry).unwrap() + 8;
    tiff[at..at + 4].copy_from_slice(&16384_u32.to_le_bytes());
    expect_refusal_like("bark.tif", &tiff, "the header claims 16384 × 32 texels, which take at least");
}

/// CRC-32 of a PNG chunk.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
    };
    !bytes.iter().fold(u32::MAX, step)
}

#[test]
fn a_byte_changed_anywhere_neither_panics_nor_hangs() {
    for (name, bytes) in
        [("bark.exr", exr_bytes("Y", |u, _| u as f32)), ("bark.tif", tiff_bytes()), ("bark.jpg", jpeg_bytes())]
    {
        for at in (0..bytes.len().min(600)).step_by(7) {
            let mut changed = bytes.clone();
            changed[at] ^= 0xff;
            let file = farfield::io::SourceFile::from_bytes(name, changed);
            let _ = farfield::io::heights::decode_heights(&file, None);
        }
    }
}

#[test]
fn scenes_nested_too_deep_or_too_long_are_refused() {
    let project = Project::empty();
    for lights in ["[".repeat(200_000), "[{a=".repeat(100_000), format!("[{}]", "{},".repeat(50_000))] {
        let manifest = surface("bark", "bark.png") + "[scene.shop]\nlights = " + &lights;
        project.write("farfield.toml", manifest.as_bytes());
        let said = project.run(&["build"]);
        assert_eq!((said.code, said.stdout.as_str()), (2, ""));
        assert!(said.stderr.lines().all(|line| line.starts_with("error: farfield.toml:")));
        assert!(said.stderr.lines().count() < 100, "{}", said.stderr);
    }
}
