//! Volumes: what `build` says to them, and what `inspect` shows.

use std::path::Path;

use crate::project::Project;

/// The sample volume of the format's tests.
fn sample() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/tests/data/volume_v1")
}

/// A `.vol` file of 4 × 3 × 2 voxels of bytes.
fn vol(channels: u32, data: &[u8]) -> Vec<u8> {
    let words = [3, 4, 3, 2, channels].into_iter().flat_map(u32::to_le_bytes);
    b"VOL\x03".iter().copied().chain(words).chain([0; 24]).chain(data.iter().copied()).collect()
}

const CLOTH: &str = "[volume.cloth]\ndensity = { file = \"d.vol\", scale = 1e4 }\nalbedo = [0.9, 0.8, 0.7]\n\
                     sggx = { from = \"structure-tensor\", along = 0.1 }\nvoxel = 1e-4\nlevels = [2, 4]\n";

#[test]
fn a_volume_asset_is_shown_and_its_hashes_are_checked() {
    let project = Project::empty();
    let said = project.run(&["inspect", sample().to_str().unwrap()]);
    assert_eq!((said.code, said.stderr.as_str()), (0, ""));
    for part in [
        "volume     cloth\n",
        "m, repeats along xy\n",
        "147 × 87 × 75 voxels, BLAKE3 0123",
        "files, ",
        "level 1    factor 4 × 4 × 3.987, 37 × 22 × 19 voxels, ",
        "voxels by number of lobes: ",
        " 1/m, mean ",
        " an occupied voxel: albedo ",
        "bias -1.20 ± 0.10 %",
        "fit      {\"objective\":0.5}",
    ] {
        assert!(said.stdout.contains(part), "{part}: {}", said.stdout);
    }
    let json = project.run(&["inspect", sample().join("asset.json").to_str().unwrap(), "--json"]).stdout;
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&json["kind"], &json["levels"][0]["size"]), (&"volume".into(), &serde_json::json!([37, 22, 19])));

    std::fs::create_dir(project.path().join("copy")).unwrap();
    for entry in std::fs::read_dir(sample()).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let mut bytes = std::fs::read(sample().join(&name)).unwrap();
        if name.contains("shear1") {
            *bytes.last_mut().unwrap() ^= 1;
        }
        project.write(&format!("copy/{name}"), &bytes);
    }
    let said = project.run(&["inspect", "copy"]);
    assert_eq!((said.code, said.stdout.as_str()), (1, ""));
    assert!(said.stderr.contains("the file was changed after it was written"), "{}", said.stderr);
}

#[test]
fn a_build_of_a_volume_is_refused_in_one_line_and_its_neighbours_are_built() {
    let project = Project::waves();
    let manifest = std::fs::read_to_string(project.path().join("farfield.toml")).unwrap();
    project.write("farfield.toml", (CLOTH.to_string() + &manifest).as_bytes());
    project.write("d.vol", &vol(1, &[9; 24]));
    let said = project.run(&["build", "cloth"]);
    assert_eq!((said.code, said.stdout.lines().count()), (1, 0), "{said:?}");
    assert_eq!(
        said.stderr,
        "error: volume `cloth`: volumes are not built in this version; its files are sound: 4 × 3 × 2 voxels, 24 occupied\n"
    );
    project.write("d.vol", &vol(1, &[9; 23]));
    let said = project.run(&["build", "cloth"]);
    let wanted = "error: volume `cloth`: `d.vol`: 4 × 3 × 2 voxels of 1 bytes take 24 bytes; the file has 23\n";
    assert_eq!((said.code, said.stderr.as_str()), (1, wanted));
    let said = project.run(&["build", "waves", "-q"]);
    assert_eq!((said.code, said.stderr.as_str()), (0, ""));
    let said = project.run(&["build", "--dry-run", "cloth"]);
    assert_eq!(
        said.stdout,
        "cloth level 1: factor 2, auto lobes: d.vol -> lod/cloth/asset.json\n\
         cloth level 2: factor 4, auto lobes: d.vol -> lod/cloth/asset.json\n"
    );
    let said = project.run(&["build", "clothe"]);
    assert_eq!(
        (said.code, said.stderr.as_str()),
        (2, "error: `farfield.toml` has no surface or volume `clothe`; did you mean `cloth`?\n")
    );
}
