//! What is written comes back, equal but for the rounding that the format states.

mod sample;

use farfield_formats::asset::{Alternative, DOCUMENT, quantised, quantised_lobe};
use farfield_formats::{Boundary, Error, SurfaceAsset};
use sample::{Random, Sample};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

fn decode(files: &BTreeMap<String, Vec<u8>>) -> Result<SurfaceAsset, Error> {
    SurfaceAsset::decode(&mut |path| Ok(files[path].clone()))
}

fn variants() -> [Sample; 6] {
    [
        Sample::SMALL,
        Sample::ROOMY,
        Sample { boundary: Boundary::Clamp, has_color: false, rank: 1, ..Sample::ROOMY },
        Sample { is_specular: false, cells: [1, 5], lobes: 1, patches: [1, 1], directions: 1, ..Sample::SMALL },
        Sample { lobes: 8, rank: 3, directions: 3, ..Sample::SMALL },
        Sample { additive: Some(3), ..Sample::SMALL },
    ]
}

#[test]
fn assets_come_back_as_their_stated_rounding() {
    for sample in variants() {
        let mut asset = sample.asset();
        for level in &mut asset.levels {
            let other = Alternative { patches: level.patches, directions: 7, rank: 1, error: 0.125, bytes: 19216 };
            level.alternatives = vec![other];
        }
        let mut wanted = asset.clone();
        for level in &mut wanted.levels {
            level.lobes.iter_mut().flatten().for_each(|lobe| *lobe = quantised_lobe(lobe));
            level.base_color.iter_mut().flatten().for_each(|rgb| *rgb = quantised(*rgb));
            level.spatial.iter_mut().flatten().for_each(|rgb| *rgb = quantised(*rgb));
            level.angular.iter_mut().flatten().for_each(|rgb| *rgb = quantised(*rgb));
            if let Some(term) = &mut level.additive {
                term.spatial.iter_mut().chain(&mut term.angular).for_each(|rgb| *rgb = quantised(*rgb));
            }
        }
        assert_eq!(decode(&asset.encode().unwrap()).unwrap(), wanted);
    }
}

#[test]
fn a_decoded_asset_encodes_to_the_same_bytes() {
    for sample in variants() {
        let files = sample.asset().encode().unwrap();
        assert_eq!(decode(&files).unwrap().encode().unwrap(), files);
    }
}

#[test]
fn the_first_version_still_decodes() {
    // Written by `sample_assets` when version 1 was new; only these bytes, not the writer, are promised to stay.
    let asset = SurfaceAsset::read(Path::new("tests/data/v1")).unwrap();
    let files = Sample::ROOMY.asset().encode().unwrap();
    assert_eq!(asset, decode(&files).unwrap());
}

#[test]
fn the_same_asset_gives_the_same_bytes() {
    for sample in variants() {
        assert_eq!(sample.asset().encode().unwrap(), sample.asset().encode().unwrap());
    }
}

#[test]
fn rounding_stays_within_half_floats() {
    // Half floats carry 11 bits: half an ulp is 2^-11 of the value.
    const HALF_ULP: f32 = 1.0 / 2048.0;
    let sample = Sample { lobes: 8, cells: [32, 32], ..Sample::SMALL };
    for lobe in sample.asset().levels[0].lobes.iter().flatten() {
        let rounded = quantised_lobe(lobe);
        assert!((rounded.weight - lobe.weight).abs() <= HALF_ULP * lobe.weight);
        let [was, is] = [lobe.kappa, rounded.kappa].map(|kappa| f64::from(kappa).ln_1p());
        assert!((is - was).abs() <= f64::from(HALF_ULP) * was + 1e-6, "κ {} became {}", lobe.kappa, rounded.kappa);
        let turned: f32 = (0..3).map(|k| (rounded.mean[k] - lobe.mean[k]).powi(2)).sum::<f32>().sqrt();
        // Two coordinates, each off by half an ulp of at most 1/2, stretched at most √3·√2 by the map.
        assert!(turned <= 2.5 * 0.5 * HALF_ULP * 2f32.sqrt(), "mean turned by {turned}");
    }
}

#[test]
fn numbers_of_the_document_come_back_to_the_last_bit() {
    let mut random = Random(3);
    for _ in 0..200 {
        let mut asset = Sample::SMALL.asset();
        asset.levels.clear();
        asset.size = [f64::from(random.unit()) + 1e-9, f64::from(random.unit()) / 3.0 + 1e-9];
        asset.bsdf.diffuse = [random.unit() / 3.0, random.unit() / 7.0, random.unit()];
        asset.settings = serde_json::json!({ "x": f64::from(random.unit()).sin() });
        assert_eq!(decode(&asset.encode().unwrap()).unwrap(), asset);
    }
}

#[test]
fn payload_names_carry_role_and_digest() {
    let files = Sample::SMALL.asset().encode().unwrap();
    for (name, bytes) in files.iter().filter(|(name, _)| *name != DOCUMENT) {
        let parts: Vec<_> = name.split('.').collect();
        assert_eq!([parts[0], parts[3]], ["level1", "ktx2"], "{name}");
        assert_eq!(parts[2], &blake3::hash(bytes).to_hex()[..16]);
    }
    let roles: Vec<_> = files.keys().map(|name| name.split('.').nth(1).unwrap()).collect();
    let wanted = ["json", "angular0", "angular1", "base_color", "heights", "lobe0", "lobe1", "spatial0", "spatial1"];
    assert_eq!(roles, wanted);
}

#[test]
fn payloads_are_ktx2_files_to_the_ktx2_crate() {
    let files = Sample::SMALL.asset().encode().unwrap();
    for (name, bytes) in files.iter().filter(|(name, _)| *name != DOCUMENT) {
        let reader = ktx2::Reader::new(bytes).unwrap();
        let format = reader.header().format.unwrap();
        let is_heights = name.contains("heights");
        let wanted = if is_heights { ktx2::Format::R32_SFLOAT } else { ktx2::Format::R16G16B16A16_SFLOAT };
        assert_eq!(format, wanted);
        let (descriptor, type_size) = ktx2::dfd::Basic::from_format(format).unwrap();
        assert_eq!(reader.basic_dfd(), Some(&descriptor));
        assert_eq!(reader.header().type_size, type_size);
        assert_eq!(reader.key_value_data().collect::<Vec<_>>(), [("KTXwriter", &b"farfield\0"[..])]);
        let level = reader.levels().next().unwrap();
        assert_eq!(level.data.len() + 104, bytes.len() - descriptor.serialized_length() - 12 - 24);
    }
}

/// An empty folder under the system's temporary one.
fn scratch(name: &str) -> PathBuf {
    let dir = std::env::temp_dir().join(format!("farfield-formats-{}-{name}", std::process::id()));
    let _ = fs::remove_dir_all(&dir);
    fs::create_dir_all(&dir).unwrap();
    dir
}

fn publish(dir: &Path, files: &BTreeMap<String, Vec<u8>>) {
    files.iter().for_each(|(name, bytes)| fs::write(dir.join(name), bytes).unwrap());
}

#[test]
fn folders_are_read_and_listed() {
    let dir = scratch("listed");
    let files = Sample::SMALL.asset().encode().unwrap();
    publish(&dir, &files);
    assert_eq!(SurfaceAsset::read(&dir).unwrap(), decode(&files).unwrap());
    let listed = SurfaceAsset::files(&dir).unwrap();
    assert_eq!(listed.len(), files.len() - 1);
    for file in &listed {
        assert_eq!(files[&file.path].len() as u64, file.bytes);
        assert_eq!(blake3::hash(&files[&file.path]).to_hex().as_str(), file.digest);
    }
    assert_eq!(listed[0].role, "heights");
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn a_new_asset_beside_the_old_one_is_published_by_its_document() {
    let dir = scratch("published");
    let [old, new] = [7, 8].map(|seed| Sample { seed, ..Sample::SMALL }.asset().encode().unwrap());
    publish(&dir, &old);
    let payloads = new.iter().filter(|(name, _)| *name != DOCUMENT);
    publish(&dir, &payloads.map(|(name, bytes)| (name.clone(), bytes.clone())).collect());
    assert_eq!(SurfaceAsset::read(&dir).unwrap(), decode(&old).unwrap(), "payloads alone change nothing");
    fs::write(dir.join(DOCUMENT), &new[DOCUMENT]).unwrap();
    assert_eq!(SurfaceAsset::read(&dir).unwrap(), decode(&new).unwrap());
    fs::remove_dir_all(dir).unwrap();
}

#[test]
fn unreadable_folders_are_one_line_that_names_the_file() {
    let dir = scratch("unreadable");
    let files = Sample::SMALL.asset().encode().unwrap();
    let message = |dir: &Path| SurfaceAsset::read(dir).unwrap_err().to_string();
    assert!(message(&dir.join("none")).contains("asset.json"));
    publish(&dir, &files);
    let name = files.keys().find(|name| name.contains("lobe1")).unwrap();
    fs::remove_file(dir.join(name)).unwrap();
    assert!(message(&dir).contains(name), "{}", message(&dir));
    fs::create_dir(dir.join(name)).unwrap();
    assert!(message(&dir).ends_with("kind of file: wanted a plain file, found a directory"), "{}", message(&dir));
    fs::remove_dir(dir.join(name)).unwrap();
    let long = [&files[name][..], &vec![0; 1 << 20]].concat();
    fs::write(dir.join(name), long).unwrap();
    assert!(message(&dir).contains("length: wanted at most"), "{}", message(&dir));
    assert!(!message(&dir).contains('\n'));
    fs::remove_dir_all(dir).unwrap();
}
