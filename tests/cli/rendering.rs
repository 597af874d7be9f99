//! `farfield render` and `farfield verify`: images, reports, and scenes that make no sense.

use super::project::{Project, surface, waves};

/// A project with the surface `waves` and the scene `shelf`, its asset built.
fn built() -> Project {
    let project = project(&scene("[0.1, 0.2, 0.1]"));
    let said = project.run(&["build", "-q"]);
    assert_eq!(said.code, 0, "{}", said.stderr);
    project
}

fn project(scene: &str) -> Project {
    let project = Project::empty();
    project.write("waves.png", &waves(48, 32));
    project.write("farfield.toml", (surface("waves", "waves.png") + scene).as_bytes());
    project
}

fn scene(position: &str) -> String {
    format!(
        "\n[scene.shelf]\ncamera = {{ position = {position}, target = [0, 0, 0], fov = 30 }}\nfilm = {{ width = 12, height = 8 }}\n\
         lights = [ {{ type = \"directional\", direction = [0.3, 1, 0.2], irradiance = [3, 3, 3] }} ]\n\
         objects = [ {{ mesh = \"plane\", surface = \"waves\", tiling = [20, 30] }} ]\n"
    )
}

const RENDER: [&str; 5] = ["render", "shelf", "--spp", "16", "-o"];

fn render(project: &Project, file: &str, more: &[&str]) -> super::project::Said {
    project.run(&[&RENDER[..], &[file], more].concat())
}

#[test]
fn every_model_draws_an_image_and_a_preview() {
    let project = built();
    let mut images = Vec::new();
    for model in ["farfield", "full", "naive", "lobes", "leadr"] {
        let file = format!("{model}.exr");
        let said = render(&project, &file, &["--model", model, "--png"]);
        assert_eq!(said.code, 0, "{}", said.stderr);
        assert!(said.stdout.starts_with(&format!("{file}: 12 × 8, 16 samples a pixel, ")), "{}", said.stdout);
        let bytes = std::fs::read(project.path().join(&file)).unwrap();
        assert_eq!(bytes[..4], [0x76, 0x2f, 0x31, 0x01]);
        assert!(project.path().join(format!("{model}.png")).exists());
        images.push(bytes);
    }
    images.sort();
    images.dedup();
    assert_eq!(images.len(), 5, "every model looks different");
}

#[test]
fn an_image_depends_on_its_seed_and_not_on_threads() {
    let project = built();
    for (file, more) in [("a.exr", ["--jobs", "1"]), ("b.exr", ["--jobs", "3"]), ("c.exr", ["--seed", "5"])] {
        assert_eq!(render(&project, file, &more).code, 0);
    }
    let [a, b, c] = ["a.exr", "b.exr", "c.exr"].map(|file| std::fs::read(project.path().join(file)).unwrap());
    assert!(a == b && a != c);
}

#[test]
fn a_time_is_kept_to() {
    let project = built();
    let said = project.run(&["render", "shelf", "--time", "0.5", "-o", "t.exr"]);
    assert_eq!(said.code, 0, "{}", said.stderr);
    let seconds: f64 = said.stdout.split(", ").last().unwrap().split(' ').next().unwrap().parse().unwrap();
    assert!((0.2..1.5).contains(&seconds), "{}", said.stdout);
}

#[test]
fn the_original_needs_no_asset_and_a_missing_one_is_named() {
    let project = project(&scene("[0.1, 0.2, 0.1]"));
    assert_eq!(render(&project, "full.exr", &["--model", "full"]).code, 0);
    let said = render(&project, "a.exr", &[]);
    assert_eq!(said.code, 1);
    assert_eq!(
        said.stderr,
        "error: `lod/waves/asset.json`: is not there; wanted the asset of `waves`: `farfield build waves`\n"
    );
    assert!(!project.path().join("a.exr").exists());
}

#[test]
fn a_camera_inside_of_the_surface_is_refused() {
    let project = project(&scene("[0.0, -0.001, 0.001]"));
    let said = render(&project, "a.exr", &["--model", "full"]);
    assert_eq!(said.code, 2);
    assert_eq!(said.stderr, "error: scene `shelf`: the camera is inside the surface; wanted a `position` above it\n");
}

#[test]
fn an_asset_with_interreflection_is_shown_by_direct_light_and_the_original_by_all() {
    let project = project(&scene("[0.1, 0.2, 0.1]"));
    let manifest = surface("waves", "waves.png") + "light = \"baked\"\n" + &scene("[0.1, 0.2, 0.1]");
    project.write("farfield.toml", manifest.as_bytes());
    assert_eq!(project.run(&["build", "-q"]).code, 0);
    assert!(project.run(&["inspect", "lod/waves", "--json"]).stdout.contains("\"light\":\"baked\""));
    let same = |model: &str, integrator: &str| {
        assert_eq!(render(&project, "default.exr", &["--model", model]).code, 0);
        let said = render(&project, "chosen.exr", &["--model", model, "--integrator", integrator]);
        let [a, b] = ["default.exr", "chosen.exr"].map(|file| std::fs::read(project.path().join(file)).unwrap());
        (a == b, said.stderr)
    };
    assert_eq!(same("farfield", "direct"), (true, String::new()));
    assert_eq!(same("full", "path"), (true, String::new()));
    let (equal, warning) = same("farfield", "path");
    assert!(!equal);
    assert_eq!(
        warning,
        "warning: `--integrator path` does not fit the `light` of the asset; wanted `direct`, the default\n"
    );
}

#[test]
fn a_level_that_is_not_there_is_refused() {
    let project = built();
    let said = render(&project, "a.exr", &["--lod", "3"]);
    assert_eq!((said.code, said.stderr.as_str()), (2, "error: `--lod` is 3; wanted 1 to 2, the levels there are\n"));
}

#[test]
fn damaged_assets_are_one_clear_line() {
    type Damage = fn(&mut Vec<u8>);
    let damages: [(&str, Damage); 2] = [
        ("truncated", |bytes| bytes.truncate(bytes.len() / 2)),
        ("tampered with", |bytes| *bytes.last_mut().unwrap() ^= 1),
    ];
    for (what, damage) in damages {
        let project = built();
        let (name, mut bytes) =
            project.tree("lod/waves").into_iter().find(|(name, _)| name.starts_with("level1.angular0")).unwrap();
        damage(&mut bytes);
        project.write(&format!("lod/waves/{name}"), &bytes);
        for arguments in [&["render", "shelf", "-o", "a.exr"][..], &["verify", "--size", "16", "--spp", "4"]] {
            let said = project.run(arguments);
            assert_eq!(said.code, 1, "{what}: {}", said.stderr);
            let line = said.stderr.lines().last().unwrap();
            assert!(line.contains("lod/waves") && line.contains("level1.angular0"), "{what}: {line}");
            assert_eq!(said.stderr.lines().filter(|line| line.starts_with("error")).count(), 1, "{}", said.stderr);
        }
        assert!(!project.path().join("a.exr").exists() && !project.path().join("report/report.html").exists());
    }
}

/// `report.json` without what depends on the machine.
fn figures(project: &Project, folder: &str) -> serde_json::Value {
    fn strip(value: &mut serde_json::Value) {
        match value {
            serde_json::Value::Object(map) => {
                map.remove("timing");
                map.values_mut().for_each(strip);
            }
            serde_json::Value::Array(items) => items.iter_mut().for_each(strip),
            _ => {}
        }
    }
    let text = std::fs::read(project.path().join(folder).join("report.json")).unwrap();
    let mut value = serde_json::from_slice(&text).unwrap();
    strip(&mut value);
    value
}

#[test]
fn a_verification_says_the_same_on_any_number_of_threads() {
    let project = built();
    for (folder, jobs) in [("one", "1"), ("three", "3")] {
        let arguments = ["verify", "--size", "16", "--spp", "4", "--level", "1", "--jobs", jobs, "--report", folder];
        let said = project.run(&arguments);
        assert_eq!(said.code, 0, "{}", said.stderr);
        assert!(said.stdout.ends_with(&format!("report: {folder}/report.html\n")), "{}", said.stdout);
        let page = std::fs::read_to_string(project.path().join(folder).join("report.html")).unwrap();
        assert!(
            page.contains("data:image/png;base64,") && !page.contains("src=\"http") && !page.contains("href=\"http")
        );
    }
    let [one, three] = ["one", "three"].map(|folder| figures(&project, folder));
    assert_eq!(one, three);
    let cases = one["assets"][0]["levels"][0]["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 9);
    assert!(cases.iter().all(|case| case["models"].as_array().unwrap().len() == 4));
}

#[test]
fn an_asset_of_another_height_map_is_not_verified() {
    let project = built();
    project.write("waves.png", &waves(48, 40));
    let said = project.run(&["verify", "--size", "16", "--spp", "4"]);
    assert_eq!(said.code, 1);
    let expected = "was built from another height map than `waves.png` is now; wanted `farfield build waves` first";
    assert!(said.stderr.contains(expected), "{}", said.stderr);
}
