//! Small volumes on disk, read as a manifest describes them.

use std::fs;
use std::path::Path;

use tempfile::TempDir;

use super::run::{compile_volume, is_read_from};
use super::*;
use crate::build::action::Failure;
use crate::build::inputs::InputDigests;
use crate::build::key::Digest;
use crate::build::{Manifest, Store, VolumeSpec};
use formats::symmetric::Eigen;

/// A `.vol` file of 3 × 2 × 2 voxels.
fn vol(encoding: u32, channels: u32, data: &[u8]) -> Vec<u8> {
    let words = [encoding, 3, 2, 2, channels].into_iter().flat_map(u32::to_le_bytes);
    b"VOL\x03".iter().copied().chain(words).chain([0; 24]).chain(data.iter().copied()).collect()
}

fn floats(values: impl IntoIterator<Item = f32>) -> Vec<u8> {
    values.into_iter().flat_map(f32::to_le_bytes).collect()
}

/// A folder with densities 0, 1, 2, … 11 of 255 in `d.vol` and directions along x in `f.vol`.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: Vec<u8>| fs::write(folder.path().join(name), bytes).unwrap();
    put("d.vol", vol(3, 1, &(0..12).collect::<Vec<u8>>()));
    put("f.vol", vol(1, 3, &floats((0..12).flat_map(|_| [2.0, 0.0, 0.0]))));
    folder
}

/// The volume of a manifest with these lines.
fn spec(density: &str, albedo: &str, sggx: &str) -> VolumeSpec {
    let text = format!(
        "[volume.cloth]\ndensity = {density}\nalbedo = {albedo}\nsggx = {sggx}\nvoxel = 1e-3\nlevels = [2]\n\
         optimizer = \"none\"\n"
    );
    Manifest::parse(&text).unwrap().volumes.remove(0)
}

/// The same, with its files in `folder`.
fn input(folder: &Path, density: &str, albedo: &str, sggx: &str) -> Result<VolumeInput, String> {
    read(&spec(density, albedo, sggx), folder)
        .map_err(|error| error.to_string().replace(&format!("{}/", folder.display()), ""))
}

const GREY: &str = "[0.5, 0.5, 0.5]";
const FIBRE: &str = "{ fibre = \"f.vol\", along = 0.5 }";

#[test]
fn codes_become_densities_by_window_or_as_fractions() {
    let folder = folder();
    let plain = input(folder.path(), "{ file = \"d.vol\", scale = 510 }", GREY, FIBRE).unwrap();
    assert_eq!((plain.size, plain.occupied()), ([3, 2, 2], 11));
    assert!(plain.density.iter().enumerate().all(|(i, density)| (density - 2.0 * i as f32).abs() < 1e-5));
    let windowed = |window: &str| {
        let density = format!("{{ file = \"d.vol\", window = {window}, scale = 100 }}");
        input(folder.path(), &density, GREY, FIBRE).unwrap().density
    };
    let wanted = [0.0, 0.0, 0.0, 0.0, 0.0, 25.0, 50.0, 75.0, 100.0, 100.0, 100.0, 100.0];
    assert_eq!(windowed("[4, 8]"), wanted);
    assert_eq!(windowed("[8, 4]"), wanted.map(|density| 100.0 - density), "what is dark may be dense");
    let empty = input(folder.path(), "{ file = \"d.vol\", window = [100, 200] }", GREY, FIBRE).unwrap();
    assert_eq!(empty.warnings, ["no voxel has a density; check `window` and `scale`"]);
}

#[test]
fn fibres_show_what_the_manifest_says_lengthwise() {
    let folder = folder();
    let codes = vol(3, 1, &(0..12).map(|i| 20 * i).collect::<Vec<u8>>());
    fs::write(folder.path().join("a.vol"), codes).unwrap();
    for (sggx, lengthwise) in [
        (FIBRE, None),
        ("{ fibre = \"f.vol\", along = \"a.vol\" }", Some(2)),
        ("{ fibre = \"f.vol\", eigenvalue = \"a.vol\" }", Some(1)),
    ] {
        let found = input(folder.path(), "\"d.vol\"", GREY, sggx).unwrap();
        assert_eq!(found.shapes[0], [0.0; 6], "empty voxels have none");
        for (i, s) in found.shapes.iter().enumerate().skip(1) {
            let wanted = lengthwise.map_or(0.25, |power| (20.0 * i as f32 / 255.0).powi(power));
            let off = [s[0] - wanted, s[1] - 1.0, s[2] - 1.0, s[3], s[4], s[5]];
            assert!(off.iter().all(|value| value.abs() < 1e-6), "{sggx} {i}: {s:?}");
        }
        assert!(found.warnings.is_empty());
    }
}

#[test]
fn matrices_are_checked_scaled_and_clamped() {
    let folder = folder();
    // xx yy zz xy xz yz: the first is of an empty voxel, the second too large, the third too flat, the others as they are.
    let mut matrices = vec![[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]; 12];
    matrices[0] = [f32::MAX, -1.0, 0.0, 0.0, 0.0, 0.0];
    matrices[1] = [4.0, 2.5, 2.5, 0.0, 0.0, 1.5];
    matrices[2] = [1.0, 1e-7, 0.0, 0.0, 0.0, 0.0];
    let write = |matrices: &[[f32; 6]]| {
        fs::write(folder.path().join("s.vol"), vol(1, 6, &floats(matrices.iter().flatten().copied()))).unwrap();
    };
    write(&matrices);
    let found = input(folder.path(), "{ file = \"d.vol\", scale = 255 }", GREY, "{ file = \"s.vol\" }").unwrap();
    assert_eq!(found.density[..4], [0.0, 2.0, 2.0, 3.0], "√4 went to the density");
    let close = |s: [f32; 6], wanted: [f32; 6]| (0..6).all(|k| (s[k] - wanted[k]).abs() < 1e-6);
    assert!(close(found.shapes[1], [1.0, 0.625, 0.625, 0.0, 0.0, 0.375]), "{:?}", found.shapes[1]);
    assert!(close(found.shapes[2], [1.0, 1e-4, 1e-4, 0.0, 0.0, 0.0]), "{:?}", found.shapes[2]);
    assert_eq!(found.shapes[3], matrices[3]);
    assert_eq!(found.warnings, ["1 voxels have eigenvalues of S under 1e-4, which are raised to it"]);
    for s in &found.shapes[1..] {
        let [largest, _, least] = Eigen::of(s.map(f64::from)).values;
        assert!(least > 0.99e-4 && largest < 1.000_001);
    }

    matrices[5] = [1.0, 0.5, 0.5, 0.8, 0.0, 0.0];
    write(&matrices);
    let line = input(folder.path(), "\"d.vol\"", GREY, "{ file = \"s.vol\" }").unwrap_err();
    assert!(line.starts_with("`s.vol`: voxel (2, 1, 0) has a matrix with the eigenvalue -8.8"), "{line}");

    // Nine numbers, row by row, of which one is not like its mirror image.
    let mut whole = vec![[1.0, 0.1, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0, 0.5]; 12];
    let write = |whole: &[[f32; 9]]| {
        fs::write(folder.path().join("s.vol"), vol(1, 9, &floats(whole.iter().flatten().copied()))).unwrap();
    };
    write(&whole);
    let found = input(folder.path(), "\"d.vol\"", GREY, "{ file = \"s.vol\" }").unwrap();
    let scaled = [1.0, 1.0, 0.5, 0.1, 0.0, 0.0].map(|value| value / 1.1);
    assert!(close(found.shapes[7], scaled), "{:?}", found.shapes[7]);
    whole[7][3] = -0.1;
    write(&whole);
    let line = input(folder.path(), "\"d.vol\"", GREY, "{ file = \"s.vol\" }").unwrap_err();
    assert!(
        line.contains("voxel (1, 0, 1) has the matrix [1.0, 0.1,") && line.ends_with("wanted a symmetric one"),
        "{line}"
    );
}

#[test]
fn the_structure_tensor_reads_the_stored_values() {
    let folder = tempfile::tempdir().unwrap();
    // Stripes along y: dense where x is odd in pairs.
    let size = [16, 16, 16];
    let codes: Vec<u8> = (0..4096).map(|i| if i % 4 < 2 { 200 } else { 20 } + (i / 256 % 4 / 2 * 50) as u8).collect();
    fs::write(folder.path().join("ct.raw"), codes).unwrap();
    let density = "{ file = \"ct.raw\", size = [16, 16, 16], type = \"u8\", window = [100, 200], scale = 1e3 }";
    let sggx = "{ from = \"structure-tensor\", sigma = 0.7, rho = 2, along = 0.2 }";
    let found = input(folder.path(), density, GREY, sggx).unwrap();
    assert_eq!((found.size, found.occupied()), (size, 2048));
    for (s, density) in found.shapes.iter().zip(&found.density) {
        assert!(if *density > 0.0 { (s[1] - 0.04).abs() < 1e-3 && s[0] > 0.99 } else { *s == [0.0; 6] }, "{s:?}");
    }
}

#[test]
fn albedos_of_occupied_voxels_are_checked() {
    let folder = folder();
    let put = |values: Vec<f32>| {
        let channels = values.len() as u32 / 12;
        fs::write(folder.path().join("a.vol"), vol(1, channels, &floats(values))).unwrap();
        input(folder.path(), "\"d.vol\"", "\"a.vol\"", FIBRE)
    };
    let mut values: Vec<f32> = (0..36).map(|i| i as f32 / 36.0).collect();
    values[1] = 7.0; // of an empty voxel
    let found = put(values.clone()).unwrap();
    assert_eq!(found.albedo.at(4), [12.0 / 36.0, 13.0 / 36.0, 14.0 / 36.0]);
    values[13] = 1.5;
    let line = put(values).unwrap_err();
    assert!(
        line.starts_with("`a.vol`: voxel (1, 1, 0) has the albedo [0.33") && line.ends_with("wanted 0 to 1"),
        "{line}"
    );
    assert_eq!(put(vec![0.25; 12]).unwrap().albedo.at(3), [0.25; 3]);
}

#[test]
fn what_does_not_fit_is_one_line() {
    let folder = folder();
    let put = |name: &str, bytes: Vec<u8>| fs::write(folder.path().join(name), bytes).unwrap();
    let mut wide = vol(1, 3, &floats((0..24).flat_map(|_| [1.0, 0.0, 0.0])));
    wide[16] = 4;
    put("wide.vol", wide);
    put("below.vol", vol(1, 1, &floats((0..12).map(|i| 3.0 - i as f32))));
    put("colour.vol", vol(3, 3, &[9; 36]));
    put("still.vol", vol(1, 3, &floats((0..36).map(|_| 0.0))));
    for (density, sggx, words) in [
        (
            "\"d.vol\"",
            "{ fibre = \"wide.vol\", along = 1 }",
            "`wide.vol`: has 3 × 2 × 4 voxels; wanted 3 × 2 × 2, those of",
        ),
        ("\"below.vol\"", FIBRE, "`below.vol`: voxel (1, 1, 0) has the density -1 1/m; wanted 0 to 1e12"),
        ("\"colour.vol\"", FIBRE, "`colour.vol`: holds 3 numbers a voxel; wanted 1"),
        ("\"none.vol\"", FIBRE, "`none.vol`: cannot be read: no such file"),
        ("{ file = \"d.vol\", size = [3, 2, 2], type = \"u8\" }", FIBRE, "take 12 bytes; the file has 60"),
    ] {
        let line = input(folder.path(), density, GREY, sggx).unwrap_err();
        assert!(line.contains(words) && !line.contains('\n'), "wanted `{words}` in: {line}");
    }
    let found = input(folder.path(), "\"d.vol\"", GREY, "{ fibre = \"still.vol\", along = 0.1 }").unwrap();
    assert_eq!(found.warnings, ["11 voxels have the fibre direction 0; they are taken as isotropic"]);
}

#[test]
fn what_is_hashed_is_what_is_read() {
    let folder = folder();
    let put = |name: &str, bytes: Vec<u8>| fs::write(folder.path().join(name), bytes).unwrap();
    put("a.vol", vol(3, 3, &[90; 36]));
    put("s.vol", vol(3, 1, &[60; 12]));
    put("m.vol", vol(1, 6, &floats((0..12).flat_map(|_| [1.0, 0.5, 0.5, 0.0, 0.0, 0.0]))));
    let digests = InputDigests::open(&Store::open_to_read(folder.path()));
    for (sggx, count) in [
        ("{ file = \"m.vol\" }", 3),
        (FIBRE, 3),
        ("{ fibre = \"f.vol\", along = \"s.vol\" }", 4),
        ("{ from = \"structure-tensor\", along = 0.1 }", 2),
        ("{ from = \"structure-tensor\", eigenvalue = \"s.vol\" }", 3),
    ] {
        let spec = spec("\"d.vol\"", "\"a.vol\"", sggx);
        let files = files_of(&spec, folder.path(), &digests).unwrap();
        let input = read(&spec, folder.path()).unwrap();
        assert!(files.len() == count && is_read_from(&input, &files), "{sggx}: {files:?}");
        assert!(compile_volume(&spec, folder.path(), &files, &mut |_| ()).is_ok());
        for key in files.keys() {
            let mut old = files.clone();
            old.insert(key, Digest::of(b"before it was edited"));
            let made = compile_volume(&spec, folder.path(), &old, &mut |_| ());
            assert_eq!(made.err(), Some(Failure::InputChanged), "{sggx}: {key}");
        }
    }
}
