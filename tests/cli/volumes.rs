//! Volumes: what `build` says to them, and what `inspect` shows.

use std::path::Path;

use farfield::build::Manifest;
use farfield::build::volume::encode::{volume_asset, volume_level};
use farfield::build::volume::read;
use farfield::io::SourceFile;
use farfield::io::heights::decode_heights;

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
fn a_volume_that_cannot_be_read_is_one_line_and_its_neighbours_are_built() {
    let project = Project::waves();
    let manifest = std::fs::read_to_string(project.path().join("farfield.toml")).unwrap();
    project.write("farfield.toml", (CLOTH.to_string() + &manifest).as_bytes());
    project.write("d.vol", &vol(1, &[9; 23]));
    let said = project.run(&["build", "-q"]);
    let wanted = "error: volume `cloth`: `d.vol`: 4 × 3 × 2 voxels of 1 bytes take 24 bytes; the file has 23\n";
    assert_eq!((said.code, said.stderr.as_str()), (1, wanted));
    assert!(project.path().join("lod/waves/asset.json").exists() && !project.path().join("lod/cloth").exists());
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

/// A project with a slab of isotropic flakes, 6 × 5 × 4 voxels, and the scene `shop` that shows it from above.
fn slab() -> Project {
    let project = Project::empty();
    let words = [3u32, 6, 5, 4, 1].into_iter().flat_map(u32::to_le_bytes);
    let header: Vec<u8> = b"VOL\x03".iter().copied().chain(words).chain([0; 24]).collect();
    project.write("d.vol", &[&header[..], &[255; 120]].concat());
    let mut fibres = header.clone();
    (fibres[4], fibres[20]) = (4, 3);
    project.write("f.vol", &[&fibres[..], &[64; 240]].concat());
    let manifest = "[volume.slab]\ndensity = { file = \"d.vol\", scale = 300 }\nalbedo = [0.9, 0.5, 0.1]\nvoxel = 1e-3\n\
                    sggx = { fibre = \"f.vol\", along = 0.4 }\nlevels = [2]\nrepeat = [true, true, false]\n\
                    [scene.shop]\ncamera = { position = [0, 0.05, 0.02], target = [0, 0, 0], fov = 5 }\n\
                    film = { width = 16, height = 12 }\nobjects = [{ volume = \"slab\" }]\n\
                    lights = [{ type = \"constant\", radiance = [1, 1, 1] }]\n";
    project.write("farfield.toml", manifest.as_bytes());
    project
}

/// Mean of a channel of an image.
fn mean(project: &Project, file: &str, channel: &str) -> f64 {
    let source = SourceFile::read(&project.path().join(file)).unwrap();
    let raw = decode_heights(&source, Some(channel)).unwrap();
    raw.values.iter().map(|&value| f64::from(value)).sum::<f64>() / raw.values.len() as f64
}

#[test]
fn a_scene_shows_a_volume_and_its_asset_looks_the_same_at_full_resolution() {
    let project = slab();
    let render =
        |file: &str, more: &[&str]| project.run(&[&["render", "shop", "--spp", "64", "-o", file], more].concat());
    let said = render("full.exr", &["--model", "full"]);
    assert_eq!((said.code, said.stderr.as_str()), (0, ""));
    assert!(said.stdout.starts_with("full.exr: 16 × 12, 64 samples a pixel, "), "{}", said.stdout);

    let said = render("none.exr", &[]);
    let wanted = "error: `lod/slab/asset.json`: is not there; wanted the asset of `slab`: `farfield build slab`\n";
    assert_eq!((said.code, said.stderr.as_str()), (1, wanted));
    let said = render("naive.exr", &["--model", "naive"]);
    let wanted = "error: scene `shop`: shows a volume, which has no model `naive`; wanted `farfield` or `full`\n";
    assert_eq!((said.code, said.stderr.as_str()), (2, wanted));

    let text = std::fs::read_to_string(project.path().join("farfield.toml")).unwrap();
    let spec = Manifest::parse(&text).unwrap().volumes.remove(0);
    let input = read(&spec, project.path()).unwrap();
    let level = volume_level(1, input.size, &input.medium());
    std::fs::create_dir_all(project.path().join("lod/slab")).unwrap();
    for (name, bytes) in volume_asset(&spec, &input, vec![level]).encode().unwrap() {
        project.write(&format!("lod/slab/{name}"), &bytes);
    }
    let said = render("asset.exr", &[]);
    assert_eq!((said.code, said.stderr.as_str()), (0, ""));
    for channel in ["R", "G", "B"] {
        let [full, asset] = ["full.exr", "asset.exr"].map(|file| mean(&project, file, channel));
        // The same random numbers; S and density rounded to 0.3 %.
        assert!(full > 0.05 && (asset / full - 1.0).abs() < 0.01, "{channel}: {full} {asset}");
    }
    let said = render("two.exr", &["--lod", "2"]);
    assert_eq!((said.code, said.stderr.as_str()), (2, "error: `--lod` is 2; wanted 1 to 1, the levels there are\n"));
}

#[test]
fn a_volume_is_built_shown_and_drawn() {
    let project = slab();
    let text = std::fs::read_to_string(project.path().join("farfield.toml")).unwrap();
    project.write("farfield.toml", text.replace("levels = [2]", "levels = [2, 4]\nerror = 1").as_bytes());
    let said = project.run(&["build"]);
    assert_eq!(said.code, 0, "{}", said.stderr);
    assert!(said.stdout.starts_with("name  level  voxels     occupied  lobes  averages"), "{}", said.stdout);
    assert!(said.stdout.contains("\nslab  1      3 × 3 × 2  18        1      "), "{}", said.stdout);
    let first = project.tree("lod/slab");
    assert_eq!(project.run(&["build", "--jobs", "1", "--force", "-q"]).code, 0);
    assert_eq!(project.tree("lod/slab"), first, "the same bytes on any number of threads");
    let json = project.run(&["inspect", "lod/slab", "--json"]).stdout;
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["levels"][1]["size"], serde_json::json!([2, 1, 1]));
    assert!(json["levels"][0]["fit"]["validation"].is_array(), "{json}");
    let lines = project.run(&["build", "--json", "-q"]).stdout;
    let lines: Vec<serde_json::Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!((lines.len(), &lines[1]["size"]), (2, &json["levels"][1]["size"]));
    for (file, model, lod) in
        [("full.exr", "full", "auto"), ("one.exr", "farfield", "1"), ("auto.exr", "farfield", "auto")]
    {
        let said = project.run(&["render", "shop", "--spp", "64", "--model", model, "--lod", lod, "-o", file]);
        assert_eq!((said.code, said.stderr.as_str()), (0, ""));
    }
    // A slab of the same flakes everywhere is the same slab at every level, up to the noise of the image and of the fit.
    let [full, one] = ["full.exr", "one.exr"].map(|file| mean(&project, file, "R"));
    assert!((one / full - 1.0).abs() < 0.05, "{full} {one}");
}
