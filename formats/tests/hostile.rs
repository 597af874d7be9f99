//! Files that lie: each is an error, none a panic.

mod sample;

use farfield_formats::asset::DOCUMENT;
use farfield_formats::{Error, SurfaceAsset};
use sample::Sample;
use std::collections::BTreeMap;

type Files = BTreeMap<String, Vec<u8>>;

fn decode(files: &Files) -> Result<SurfaceAsset, Error> {
    SurfaceAsset::decode(&mut |path| Ok(files[path].clone()))
}

fn payload_names(files: &Files) -> Vec<String> {
    files.keys().filter(|name| *name != DOCUMENT).cloned().collect()
}

/// The files with one payload replaced and its digest made to match: what a liar publishes.
fn republished(files: &Files, name: &str, bytes: Vec<u8>) -> Files {
    let [old, new] = [&files[name], &bytes].map(|bytes| blake3::hash(bytes).to_hex());
    let document = String::from_utf8(files[DOCUMENT].clone()).unwrap();
    assert!(document.contains(old.as_str()));
    let mut lying = files.clone();
    lying.insert(DOCUMENT.into(), document.replace(old.as_str(), &new).into_bytes());
    lying.insert(name.into(), bytes);
    lying
}

/// The files with `from` in `asset.json` replaced by `to`.
fn edited(files: &Files, from: &str, to: &str) -> Files {
    let document = String::from_utf8(files[DOCUMENT].clone()).unwrap();
    assert!(document.contains(from), "{from} is not in {document}");
    let mut lying = files.clone();
    lying.insert(DOCUMENT.into(), document.replacen(from, to, 1).into_bytes());
    lying
}

fn expect_refusal(files: &Files, words: &str) {
    let message = decode(files).expect_err(words).to_string();
    assert!(message.contains(words), "wanted `{words}` in: {message}");
    assert!(!message.contains('\n'), "one line: {message}");
}

#[test]
fn every_truncation_is_an_error() {
    let files = Sample::SMALL.asset().encode().unwrap();
    for (name, bytes) in &files {
        for length in 0..bytes.len() {
            let mut short = files.clone();
            short.get_mut(name).unwrap().truncate(length);
            assert!(decode(&short).is_err(), "`{name}` cut to {length} bytes");
        }
    }
}

#[test]
fn every_truncation_with_a_matching_digest_is_an_error() {
    let files = Sample::SMALL.asset().encode().unwrap();
    for name in payload_names(&files) {
        for length in 0..files[&name].len() {
            let short = republished(&files, &name, files[&name][..length].to_vec());
            let error = decode(&short).expect_err("cut short");
            assert!(matches!(error, Error::Malformed { .. }), "`{name}` cut to {length} bytes: {error}");
        }
    }
}

#[test]
fn every_changed_byte_of_a_payload_is_detected() {
    let files = Sample::SMALL.asset().encode().unwrap();
    for name in payload_names(&files) {
        for place in 0..files[&name].len() {
            let mut changed = files.clone();
            changed.get_mut(&name).unwrap()[place] ^= 1 << (place % 8);
            let error = decode(&changed).expect_err("a byte was changed");
            assert!(matches!(error, Error::Digest { .. }), "`{name}` byte {place}: {error}");
        }
    }
}

#[test]
fn no_changed_byte_with_a_matching_digest_panics() {
    let files = Sample::SMALL.asset().encode().unwrap();
    let mut refused = 0;
    for name in payload_names(&files) {
        for place in 0..files[&name].len() {
            for mask in [0x01, 0x80, 0xFF] {
                let mut bytes = files[&name].clone();
                bytes[place] ^= mask;
                refused += usize::from(decode(&republished(&files, &name, bytes)).is_err());
            }
            let mut bytes = files[&name].clone();
            bytes[place] = 0xFF;
            refused += usize::from(decode(&republished(&files, &name, bytes)).is_err());
        }
    }
    assert!(refused > 1000, "{refused} refused");
}

#[test]
fn no_changed_byte_of_the_document_panics() {
    let files = Sample::SMALL.asset().encode().unwrap();
    let mut refused = 0;
    for place in 0..files[DOCUMENT].len() {
        for byte in [b'0', b'9', b'-', b'"', b'}', b',', b'e', b'/', 0, 0xFF] {
            let mut changed = files.clone();
            changed.get_mut(DOCUMENT).unwrap()[place] = byte;
            let asset = SurfaceAsset::decode(&mut |path| {
                changed
                    .get(path)
                    .cloned()
                    .ok_or(Error::Io { path: path.into(), source: std::io::ErrorKind::NotFound.into() })
            });
            refused += usize::from(asset.is_err());
        }
    }
    assert!(refused > 1000, "{refused} refused");
}

#[test]
fn lying_headers_are_refused() {
    let files = Sample::SMALL.asset().encode().unwrap();
    let name = payload_names(&files).into_iter().find(|name| name.contains("lobe0")).unwrap();
    let set = |place: usize, bytes: &[u8]| {
        let mut lying = files[&name].clone();
        lying[place..place + bytes.len()].copy_from_slice(bytes);
        republished(&files, &name, lying)
    };
    const MOST: [u8; 8] = [0xFF; 8];
    for (place, bytes, words) in [
        (0, &MOST[..1], "header: wanted a KTX2 header"),
        (12, &100u32.to_le_bytes(), "format in the header: wanted 97, found 100"),
        (12, &0u32.to_le_bytes(), "format in the header"),
        (16, &4u32.to_le_bytes(), "type size in the header"),
        (20, &4u32.to_le_bytes(), "width in the header: wanted 3, found 4"),
        (20, &MOST[..4], "width in the header"),
        (24, &MOST[..4], "height in the header"),
        (28, &1u32.to_le_bytes(), "depth in the header"),
        (32, &1u32.to_le_bytes(), "layers in the header"),
        (36, &6u32.to_le_bytes(), "faces in the header"),
        (40, &MOST[..4], "levels in the header"),
        (44, &0u32.to_le_bytes(), "supercompression scheme in the header: wanted 2, found 0"),
        (48, &MOST[..4], "data format descriptor at byte 4294967295"),
        (52, &MOST[..4], "data format descriptor"),
        (56, &MOST[..4], "key-value data"),
        (60, &MOST[..4], "key-value data"),
        (80, &MOST, "level data at byte 18446744073709551615"),
        (88, &MOST, "level data"),
        (96, &MOST, "uncompressed length of the level: wanted 48 bytes"),
    ] {
        expect_refusal(&set(place, bytes), words);
    }
}

#[test]
fn frames_of_another_length_are_refused() {
    let files = Sample::SMALL.asset().encode().unwrap();
    let name = payload_names(&files).into_iter().find(|name| name.contains("lobe0")).unwrap();
    let data_offset = u64::from_le_bytes(files[&name][80..88].try_into().unwrap()) as usize;
    let with_data = |data: &[u8]| {
        let mut lying = files[&name][..data_offset].to_vec();
        lying[88..96].copy_from_slice(&(data.len() as u64).to_le_bytes());
        lying.extend(data);
        republished(&files, &name, lying)
    };
    let frame = |length: usize| zstd::bulk::compress(&vec![0; length], 1).unwrap();
    assert!(decode(&with_data(&frame(48))).is_ok());
    expect_refusal(&with_data(&frame(47)), "wanted 48 bytes in one frame, found 47 bytes");
    expect_refusal(&with_data(&frame(49)), "wanted 48 bytes in one frame, found more");
    expect_refusal(&with_data(&[frame(48), vec![0]].concat()), "found 1 bytes after it");
    expect_refusal(&with_data(&[frame(24), frame(24)].concat()), "found 24 bytes");
    expect_refusal(&with_data(b""), "wanted 48 bytes in one frame");
    // Magic, no single segment, window descriptor 8·(log₂ − 10), one raw block: a window of 128 MiB for 48 bytes.
    let windowed =
        |log: u8| [&[0x28, 0xB5, 0x2F, 0xFD, 0x00, (log - 10) << 3, 0x81, 0x01, 0x00], &[0; 48][..]].concat();
    assert!(decode(&with_data(&windowed(24))).is_ok());
    expect_refusal(&with_data(&windowed(27)), "wanted 48 bytes in one frame, found Frame requires too much memory");
}

#[test]
fn values_out_of_range_are_refused_by_the_reader() {
    let files = Sample { additive: Some(3), ..Sample::SMALL }.asset().encode().unwrap();
    let payload = |role: &str, texel: &[u8]| {
        let name = payload_names(&files).into_iter().find(|name| name.contains(role)).unwrap();
        let front = &files[&name];
        let data_offset = u64::from_le_bytes(front[80..88].try_into().unwrap()) as usize;
        let plain_length = u64::from_le_bytes(front[96..104].try_into().unwrap()) as usize;
        let mut plain = vec![0; plain_length];
        plain[plain_length - texel.len()..].copy_from_slice(texel);
        let data = zstd::bulk::compress(&plain, 1).unwrap();
        let mut lying = front[..data_offset].to_vec();
        lying[88..96].copy_from_slice(&(data.len() as u64).to_le_bytes());
        lying.extend(data);
        republished(&files, &name, lying)
    };
    let texel = |values: [f32; 4]| values.map(|v| half::f16::from_f32(v).to_le_bytes()).concat();
    assert!(decode(&payload("lobe0", &texel([1.0, 0.0, 20.0, 1.0]))).is_ok());
    for (role, texel) in [
        ("heights", f32::NAN.to_le_bytes().to_vec()),
        ("heights", f32::INFINITY.to_le_bytes().to_vec()),
        ("lobe0", texel([f32::NAN, 0.0, 0.0, 1.0])),
        ("lobe0", texel([1.01, 0.0, 0.0, 1.0])),
        ("lobe0", texel([0.0, 0.0, -0.5, 1.0])),
        ("lobe0", texel([0.0, 0.0, 21.0, 1.0])),
        ("lobe1", texel([0.0, 0.0, 0.0, -1.0])),
        ("base_color", texel([f32::INFINITY, 0.0, 0.0, 1.0])),
        ("spatial1", texel([0.0, f32::NAN, 0.0, 1.0])),
        ("angular0", texel([0.0, 0.0, 6.1e4, 1.0])),
        ("additive_spatial", texel([0.0, -0.1, 0.0, 1.0])),
        ("additive_angular", texel([0.0, 0.0, f32::NAN, 1.0])),
    ] {
        expect_refusal(&payload(role, &texel), "texel");
    }
}

#[test]
fn absurd_documents_are_refused() {
    let files = Sample::SMALL.asset().encode().unwrap();
    let name = &payload_names(&files)[0];
    for (from, to, words) in [
        ("\"farfield\"", "\"nearfield\"", "`format`: wanted farfield, found nearfield"),
        ("\"version\": 1", "\"version\": 2", "`version`: wanted 1, found 2"),
        ("\"surface\"", "\"volume\"", "`kind`: wanted surface, found volume"),
        ("\"direct\"", "\"moonlit\"", "unknown variant `moonlit`"),
        ("\"repeat\"", "\"mirror\"", "unknown variant `mirror`"),
        ("0.01,", "0.0,", "`size`[0] in metres"),
        ("0.01,", "1e999,", "number out of range"),
        ("\"width\": 131", "\"width\": 0", "`source.width`"),
        ("\"width\": 131", "\"width\": 4294967295", "`source.width`"),
        ("\"N\": 2", "\"N\": 64", "`N`: wanted 1 to 63, found 64"),
        ("\"N\": 2", "\"N\": 0", "`N`"),
        ("\"N\": 2", "\"N\": 18446744073709551615", "`N`"),
        ("\"N\": 2", "\"N\": -1", "invalid value"),
        ("\"N\": 2", "\"N\": 3", "width in the header: wanted 9, found 4"),
        ("\"lobes\": 2", "\"lobes\": 1000000000", "`lobes`: wanted 1 to 8"),
        ("\"lobes\": 2", "\"lobes\": 3", "wanted one `lobe2`, found none"),
        ("\"lobes\": 2", "\"lobes\": 1", "found `lobe1`"),
        ("\"rank\": 2", "\"rank\": 1000000000", "`rank`: wanted 1 to 8"),
        ("\"cells\": [\n        3,", "\"cells\": [\n        1000000000,", "`cells`: wanted 1 to 16384"),
        ("\"M\": [\n        2,", "\"M\": [\n        4,", "`M`: wanted 1 to 3, found 4"),
        ("\"role\": \"lobe1\"", "\"role\": \"lobe0\"", "wanted one `lobe0`, found two"),
        ("\"role\": \"lobe1\"", "\"role\": \"sheen\"", "found `sheen`"),
        ("\"alpha\": 0.3", "\"alpha\": 0.0", "`bsdf.specular.alpha`"),
        ("\"diffuse\": [\n      0.2", "\"diffuse\": [\n      1e38", "`bsdf.diffuse`"),
        (name, "../secret.ktx2", "a plain file name"),
        (name, "/etc/secret.ktx2", "a plain file name"),
        (name, "a\\\\b.ktx2", "a plain file name"),
        (name, "c:b.ktx2", "a plain file name"),
        (name, ".ktx2", "a plain file name"),
        (name, "asset.json", "a plain file name"),
        (name, "", "a plain file name"),
    ] {
        expect_refusal(&edited(&files, from, to), words);
    }
    let files = Sample { additive: Some(3), ..Sample::SMALL }.asset().encode().unwrap();
    for (from, to, words) in [
        ("\"N\": 3", "\"N\": 64", "`additive.N`: wanted 1 to 63, found 64"),
        ("\"N\": 3", "\"N\": 4", "width in the header: wanted 16, found 9"),
        ("\"additive\"", "\"subtractive\"", "found `additive_spatial`"),
    ] {
        expect_refusal(&edited(&files, from, to), words);
    }
}

#[test]
fn deep_and_long_documents_are_refused() {
    let mut files = Sample::SMALL.asset().encode().unwrap();
    for text in ["[".repeat(100_000), "{\"a\":".repeat(100_000), " ".repeat((1 << 20) + 1)] {
        files.insert(DOCUMENT.into(), text.into_bytes());
        assert!(decode(&files).is_err());
    }
}

#[test]
fn what_the_format_cannot_hold_is_refused_by_the_writer() {
    let refusal = |change: &dyn Fn(&mut SurfaceAsset)| {
        let mut asset = Sample { additive: Some(3), ..Sample::SMALL }.asset();
        change(&mut asset);
        asset.encode().expect_err("the asset was damaged").to_string()
    };
    for (message, words) in [
        (refusal(&|a| a.levels[0].heights[4] = f32::NAN), "level 1, heights[4]: wanted a finite height"),
        (refusal(&|a| a.levels[0].angular[1][3][2] = 6.1e4), "level 1, angular1[3]: wanted finite values"),
        (refusal(&|a| a.levels[0].angular[0][3][2] = f32::NAN), "level 1, angular0[3]"),
        (refusal(&|a| a.levels[0].spatial[0][1][0] = -6.1e4), "level 1, spatial0[1]"),
        (refusal(&|a| a.levels[0].base_color.as_mut().unwrap()[5][1] = f32::INFINITY), "level 1, base_color[5]"),
        (refusal(&|a| a.levels[0].lobes[0][2].kappa = f32::NAN), "level 1, lobe0[2]: wanted a lobe κ"),
        (refusal(&|a| a.levels[0].lobes[0][2].kappa = 1e9), "level 1, lobe0[2]: wanted a lobe κ"),
        (refusal(&|a| a.levels[0].lobes[0][2].kappa = -0.5), "level 1, lobe0[2]: wanted a lobe κ"),
        (refusal(&|a| a.levels[0].lobes[0][2].weight = -1e-3), "level 1, lobe0[2]: wanted a lobe weight"),
        (refusal(&|a| a.levels[0].lobes[0][2].weight = f32::NAN), "level 1, lobe0[2]: wanted a lobe weight"),
        (refusal(&|a| a.levels[0].lobes[0][2].mean = [0.0; 3]), "level 1, lobe0[2]: wanted a lobe mean"),
        (refusal(&|a| a.levels[0].lobes[0][2].mean[0] = f32::NAN), "level 1, lobe0[2]: wanted a lobe mean"),
        (refusal(&|a| a.levels[0].heights.push(0.0)), "level 1, heights: wanted 6 values, found 7 values"),
        (refusal(&|a| a.levels[0].lobes[1].truncate(5)), "level 1, lobe1: wanted 6 values, found 5 values"),
        (refusal(&|a| a.levels[0].angular.truncate(1)), "level 1, rank of S"),
        (
            refusal(&|a| a.levels[0].additive.as_mut().unwrap().angular[7][0] = -0.1),
            "level 1, additive_angular[7]: wanted",
        ),
        (
            refusal(&|a| a.levels[0].additive.as_mut().unwrap().spatial.truncate(1)),
            "level 1, additive_spatial: wanted 2",
        ),
        (refusal(&|a| a.levels[0].additive.as_mut().unwrap().directions = 64), "level 1, additive_angular"),
        (refusal(&|a| a.levels[0].skipped_interreflection = Some(f64::NAN)), "level 1, `skipped_interreflection`"),
        (refusal(&|a| a.levels[0].cells = [usize::MAX; 2]), "level 1, heights"),
        (refusal(&|a| a.levels[0].lobes.clear()), "level 1, `lobes`"),
        (refusal(&|a| a.levels.push(a.levels[0].clone())), "`index` of a level: wanted 2 to"),
        (refusal(&|a| a.size[0] = f64::NAN), "`size`[0]"),
        (refusal(&|a| a.source.digest.clear()), "`source.digest`"),
        (refusal(&|a| a.levels[0].error.as_mut().unwrap().bias.value = f64::NAN), "level 1, `bias`"),
        (refusal(&|a| a.settings = "x".repeat(1 << 20).into()), "settings, versions and levels"),
    ] {
        assert!(message.contains(words), "wanted `{words}` in: {message}");
    }
}
