//! Volume files that lie: each is an error, none a panic.

mod sample_volume;

use farfield_formats::asset::DOCUMENT;
use farfield_formats::volume::VolumeAsset;
use farfield_formats::{Error, SurfaceAsset};
use sample_volume::Sample;
use std::collections::BTreeMap;

type Files = BTreeMap<String, Vec<u8>>;

fn decode(files: &Files) -> Result<VolumeAsset, Error> {
    VolumeAsset::decode(&mut |path| {
        let missing = || Error::Io { path: path.into(), source: std::io::ErrorKind::NotFound.into() };
        files.get(path).cloned().ok_or_else(missing)
    })
}

fn payload_names(files: &Files) -> Vec<String> {
    files.keys().filter(|name| *name != DOCUMENT).cloned().collect()
}

/// The files with one payload replaced and its digest made to match: what a liar publishes.
fn republished(files: &Files, name: &str, bytes: Vec<u8>) -> Files {
    let [old, new] = [&files[name], &bytes].map(|bytes| blake3::hash(bytes).to_hex());
    let mut lying = edited(files, old.as_str(), &new);
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

/// The files with the texels of a role changed.
fn with_texels(files: &Files, role: &str, change: impl Fn(&mut [u8])) -> Files {
    let name = payload_names(files).into_iter().find(|name| name.contains(role)).unwrap();
    let front = &files[&name];
    let word = |at: usize| u64::from_le_bytes(front[at..at + 8].try_into().unwrap()) as usize;
    let [offset, length, plain_length] = [word(80), word(88), word(96)];
    let mut plain = zstd::bulk::decompress(&front[offset..offset + length], plain_length).unwrap();
    change(&mut plain);
    let data = zstd::bulk::compress(&plain, 1).unwrap();
    let mut lying = front[..offset].to_vec();
    lying[88..96].copy_from_slice(&(data.len() as u64).to_le_bytes());
    lying.extend(data);
    republished(files, &name, lying)
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
fn no_changed_byte_panics() {
    let files = Sample::SMALL.asset().encode().unwrap();
    let mut refused = 0;
    for name in payload_names(&files) {
        for place in 0..files[&name].len() {
            for mask in [0x01, 0x80, 0xFF] {
                let mut bytes = files[&name].clone();
                bytes[place] ^= mask;
                refused += usize::from(decode(&republished(&files, &name, bytes)).is_err());
            }
        }
    }
    for place in 0..files[DOCUMENT].len() {
        for byte in [b'0', b'9', b'-', b'"', b'}', b',', b'e', b'/', 0, 0xFF] {
            let mut changed = files.clone();
            changed.get_mut(DOCUMENT).unwrap()[place] = byte;
            refused += usize::from(decode(&changed).is_err());
        }
    }
    assert!(refused > 2000, "{refused} refused");
}

#[test]
fn values_out_of_range_are_refused_by_the_reader() {
    let files = Sample::SMALL.asset().encode().unwrap();
    let first = decode(&files).unwrap().levels[0].occupied[0] as usize;
    let [x, y, z] = [first % 5, first / 5 % 4, first / 20];
    let texel = (z * 8 + y) * 8 + x;
    let empty = if texel == 0 { 1 } else { 0 };
    let half = |value: f32| half::f16::from_f32(value).to_le_bytes();
    let density = |at: usize, value: f32| {
        with_texels(&files, "density", |plain| plain[2 * at..2 * at + 2].copy_from_slice(&half(value)))
    };
    assert!(decode(&density(texel, 0.5)).is_ok());
    expect_refusal(&density(texel, 32800.0), "wanted a density from 0 to 32768, found 32800");
    expect_refusal(&density(texel, -0.5), "wanted a density from 0 to 32768");
    expect_refusal(&density(texel, f32::NAN), "wanted a density from 0 to 32768, found NaN");
    expect_refusal(&density(texel, f32::INFINITY), "wanted a density from 0 to 32768");
    expect_refusal(&density(texel, 0.0), "occupied voxels, found");
    if decode(&files).unwrap().levels[0].occupied.get(1) != Some(&1) || empty == 0 {
        expect_refusal(&density(empty, 0.5), "occupied voxels, found");
    }
    let blank = |files: &Files, role: &str| with_texels(files, role, |plain| plain[4 * texel..4 * texel + 3].fill(0));
    expect_refusal(&blank(&blank(&files, "shape0"), "shape1"), "wanted flakes in an occupied voxel, found none");
    for slot in [0u32, 2, u32::MAX] {
        let lying = with_texels(&files, "bricks", |plain| plain.copy_from_slice(&slot.to_le_bytes()));
        expect_refusal(&lying, if slot == 0 { "texels: wanted 1 bricks" } else { "texel 0: wanted 0 or 1" });
    }
    let roomy = Sample::ROOMY.asset().encode().unwrap();
    expect_refusal(&with_texels(&roomy, "bricks", |plain| plain.swap(0, 4)), "texel 0: wanted 0 or 1, found 2");
}

#[test]
fn absurd_documents_are_refused() {
    let files = Sample::SMALL.asset().encode().unwrap();
    let name = &payload_names(&files)[0];
    for (from, to, words) in [
        ("\"farfield\"", "\"nearfield\"", "`format`: wanted farfield, found nearfield"),
        ("\"version\": 1", "\"version\": 2", "`version`: wanted 1, found 2"),
        ("\"volume\"", "\"surface\"", "`kind`: wanted volume, found surface"),
        ("0.00001", "0.0", "`voxel`[0] in metres"),
        ("\"size\": [\n        5", "\"size\": [\n        2049", "`size`: wanted 1 to 2048, found 2049"),
        ("\"size\": [\n        5", "\"size\": [\n        0", "`size`: wanted 1 to 2048, found 0"),
        ("\"size\": [\n        5", "\"size\": [\n        9", "level 1, `bricks`"),
        ("\"bricks\": 1", "\"bricks\": 1000000000", "`bricks`: wanted 0 to 1"),
        ("\"bricks\": 1", "\"bricks\": 0", "`occupied`: wanted 0 to 0"),
        ("\"atlas\": [\n        1", "\"atlas\": [\n        2", "`atlas`: wanted [1, 1, 1] for 1 bricks"),
        ("\"lobes\": 2,\n      \"files\"", "\"lobes\": 9,\n      \"files\"", "`lobes`: wanted 1 to 8, found 9"),
        ("\"lobes\": 2,\n      \"files\"", "\"lobes\": 1,\n      \"files\"", "`albedo`: wanted 1 to 1, found 2"),
        ("\"role\": \"shape1\"", "\"role\": \"shape0\"", "wanted one `shape0`, found two"),
        ("\"role\": \"shear1\"", "\"role\": \"sheen\"", "found `sheen`"),
        (name, "../secret.ktx2", "a plain file name"),
    ] {
        if from.contains("0.00001") {
            let document = String::from_utf8(files[DOCUMENT].clone()).unwrap();
            let spelled = if document.contains("0.00001") { "0.00001" } else { "1e-5" };
            expect_refusal(&edited(&files, spelled, to), words);
            continue;
        }
        if words == "level 1, `bricks`" {
            // Nine columns are two bricks, of which one is stored: that is no lie yet, but the index is another size.
            expect_refusal(&edited(&files, from, to), "width in the header: wanted 2, found 1");
            continue;
        }
        expect_refusal(&edited(&files, from, to), words);
    }
    let error = SurfaceAsset::decode(&mut |path| Ok(files[path].clone())).unwrap_err().to_string();
    assert!(error.contains("`kind`: wanted surface, found volume"), "{error}");
}

#[test]
fn what_the_format_cannot_hold_is_refused_by_the_writer() {
    let refusal = |change: &dyn Fn(&mut VolumeAsset)| {
        let mut asset = Sample::SMALL.asset();
        change(&mut asset);
        asset.encode().expect_err("the asset was damaged").to_string()
    };
    for (message, words) in [
        (refusal(&|a| a.levels[0].density[4] = f32::NAN), "level 1, density[4]: wanted a finite density"),
        (refusal(&|a| a.levels[0].density[4] = f32::INFINITY), "level 1, density[4]"),
        (refusal(&|a| a.levels[0].density[4] = 0.0), "level 1, density[4]"),
        (refusal(&|a| a.levels[0].density[4] = -1.0), "level 1, density[4]"),
        (refusal(&|a| a.levels[0].lobes[0][2].albedo[1] = 1.01), "level 1, lobe 0[2]: wanted an albedo"),
        (refusal(&|a| a.levels[0].lobes[0][2].albedo[1] = f32::NAN), "level 1, lobe 0[2]: wanted an albedo"),
        (refusal(&|a| a.levels[0].lobes[1][2].area = f32::NAN), "level 1, lobe 1[2]: wanted an area fraction"),
        (refusal(&|a| a.levels[0].lobes[1][2].area += 0.5), "level 1, lobe"),
        (refusal(&|a| a.levels[0].lobes.iter_mut().for_each(|l| l[3].area = 0.0)), "level 1, lobes[3]: wanted area"),
        (refusal(&|a| a.levels[0].density.push(1.0)), "level 1, density: wanted"),
        (refusal(&|a| a.levels[0].lobes[1].truncate(3)), "level 1, lobe 1: wanted"),
        (refusal(&|a| a.levels[0].lobes.clear()), "level 1, `lobes`: wanted 1 to 8, found 0"),
        (refusal(&|a| a.levels[0].occupied.swap(0, 1)), "level 1, occupied[1]: wanted rising indices"),
        (refusal(&|a| *a.levels[0].occupied.last_mut().unwrap() = 60), "wanted rising indices less than 60, found 60"),
        (refusal(&|a| a.levels[0].size = [usize::MAX; 3]), "level 1, product of `size`"),
        (refusal(&|a| a.levels.push(a.levels[0].clone())), "`index` of a level: wanted 2 to"),
        (refusal(&|a| a.voxel[2] = f64::NAN), "`voxel`[2]"),
        (refusal(&|a| a.source.digest.clear()), "`source.digest`"),
        (refusal(&|a| a.levels[0].error.get_mut("bias").unwrap().value = f64::NAN), "level 1, `bias`"),
    ] {
        assert!(message.contains(words), "wanted `{words}` in: {message}");
    }
}

#[test]
fn densities_far_below_the_largest_are_empty() {
    let mut asset = Sample::SMALL.asset();
    let count = asset.levels[0].occupied.len();
    asset.levels[0].density[0] = 1e-30;
    asset.levels[0].density[1] = 1e6;
    let found = decode(&asset.encode().unwrap()).unwrap();
    assert_eq!(found.levels[0].occupied.len(), count - 1);
}
