//! `init`, `build`, `inspect`: what they write and what they say.

use crate::project::{Project, surface, waves};

#[test]
fn a_new_project_builds_at_once_and_can_be_inspected() {
    let project = Project::empty();
    let init = project.run(&["init", "weave"]);
    assert_eq!((init.code, init.stderr.as_str()), (0, ""));
    assert_eq!(init.stdout, "made weave/farfield.toml; build it with `farfield build -m weave/farfield.toml`\n");

    let build = project.run(&["build", "-m", "weave/farfield.toml"]);
    assert_eq!(build.code, 0, "{build:?}");
    assert!(build.stdout.starts_with("name   level  factor  cells    lobes  M"), "{}", build.stdout);
    assert!(build.stdout.contains("\ntwill  1      8       32 × 32"), "{}", build.stdout);
    assert!(build.stderr.starts_with("twill: level 1 of 1\n"), "{}", build.stderr);

    let inspect = project.run(&["inspect", "lod/twill"]);
    assert_eq!((inspect.code, inspect.stderr.as_str()), (0, ""));
    for part in ["surface      ", "256 × 256 texels, BLAKE3 ", ": all as published", "heights ", "CPU seconds  "] {
        assert!(inspect.stdout.contains(part), "{part}: {}", inspect.stdout);
    }
    let json = project.run(&["inspect", "lod/twill/asset.json", "--json"]).stdout;
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["levels"][0]["cells"], serde_json::json!([32, 32]));
    assert!(json["levels"][0]["stages"].is_array());
}

#[test]
fn init_overwrites_nothing() {
    let project = Project::empty();
    project.write("twill.png", b"mine");
    let said = project.run(&["init"]);
    assert_eq!(said.code, 1);
    assert_eq!(said.stderr, "error: `./twill.png`: is already there; wanted a folder without it\n");
    assert_eq!(project.tree(""), [("twill.png".to_string(), b"mine".to_vec())]);
}

#[test]
fn a_dry_run_writes_nothing() {
    let project = Project::waves();
    let before = project.tree("");
    let said = project.run(&["build", "--dry-run"]);
    assert_eq!((said.code, said.stderr.as_str()), (0, ""));
    assert_eq!(
        said.stdout,
        "waves level 1: factor 4, auto lobes, M 2, N 7, rank 1: waves.png -> lod/waves/asset.json\n\
         waves level 2: factor 8, auto lobes, M 2, N 7, rank 1: waves.png -> lod/waves/asset.json\n"
    );
    assert_eq!(project.tree(""), before);
}

#[test]
fn json_is_one_object_a_level_and_equals_the_records() {
    let project = Project::waves();
    let said = project.run(&["build", "--json", "-q"]);
    assert_eq!((said.code, said.stderr.as_str()), (0, ""));
    let lines: Vec<serde_json::Value> = said.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 2);
    assert_eq!(lines[1]["cells"], serde_json::json!([6, 4]));
    assert_eq!(std::fs::read_to_string(project.path().join("lod/build.jsonl")).unwrap(), said.stdout);
}

#[test]
fn one_failed_surface_does_not_stop_its_neighbours() {
    let project = Project::waves();
    let manifest = surface("a_missing", "missing.png") + &surface("waves", "waves.png");
    project.write("farfield.toml", manifest.as_bytes());
    let said = project.run(&["build", "-q"]);
    assert_eq!(said.code, 1);
    let message = "error: surface `a_missing`: `missing.png`: cannot be read: no such file or directory\n";
    assert_eq!(said.stderr, message);
    assert!(said.stdout.contains("\nwaves  2      8"), "{}", said.stdout);
    assert!(!project.path().join("lod/a_missing").exists());
}

#[test]
fn names_choose_surfaces_and_unknown_ones_are_explained() {
    let project = Project::waves();
    project.write("farfield.toml", (surface("waves", "waves.png") + &surface("bark", "waves.png")).as_bytes());
    let said = project.run(&["build", "bark", "-q"]);
    assert_eq!(said.code, 0);
    assert!(!project.path().join("lod/waves").exists());
    let said = project.run(&["build", "wave", "gravel"]);
    assert_eq!(said.code, 2);
    assert_eq!(
        said.stderr,
        "error: `farfield.toml` has no surface `wave`; did you mean `waves`?\n\
         error: `farfield.toml` has no surface `gravel`; it has `bark`, `waves`\n"
    );
}

#[test]
fn a_build_says_what_it_did_and_where_its_cache_is() {
    let project = Project::waves();
    let said = project.run(&["build", "--cache", "c"]);
    assert_eq!(said.code, 0);
    assert_eq!(said.stderr, "waves: level 1 of 2\nwaves: level 2 of 2\n1 built, 0 up to date; 17 actions ran\n");
    assert!(project.path().join("c/records").is_dir() && !project.path().join(".farfield").exists());
    let said = project.run(&["build", "--cache", "c"]);
    assert_eq!((said.code, said.stderr.as_str()), (0, "0 built, 1 up to date; 0 actions ran\n"));
    let said = project.run(&["build", "--cache", "c", "--force"]);
    assert!(said.stderr.ends_with("1 built, 0 up to date; 17 actions ran\n"), "{said:?}");
}

#[test]
fn a_senseless_command_line_is_code_2() {
    let project = Project::empty();
    for arguments in
        [&["biuld"][..], &["build", "--error", "2"], &["build", "--jobs", "0"], &["build", "-v", "-q"], &[]]
    {
        let said = project.run(arguments);
        assert_eq!(said.code, 2, "{arguments:?}");
        assert_eq!(said.stdout, "");
    }
    assert_eq!(project.run(&["--version"]).stdout, concat!("farfield ", env!("CARGO_PKG_VERSION"), "\n"));
}

#[test]
fn an_asset_that_was_changed_or_is_not_there_is_code_1() {
    let project = Project::waves();
    project.run(&["build", "-q"]);
    let payload = project.tree("lod/waves").into_iter().find(|(name, _)| name.contains("heights")).unwrap();
    let mut bytes = payload.1;
    *bytes.last_mut().unwrap() ^= 1;
    project.write(&format!("lod/waves/{}", payload.0), &bytes);
    let said = project.run(&["inspect", "lod/waves"]);
    assert_eq!(said.code, 1);
    let start = format!("error: lod/waves: `{}`: the file was changed after it was written", payload.0);
    assert!(said.stderr.starts_with(&start), "{}", said.stderr);
    let said = project.run(&["inspect", "nowhere"]);
    assert_eq!(said.code, 1);
    assert_eq!(
        said.stderr,
        "error: `nowhere/asset.json`: cannot be read: no such file or directory; wanted the folder of an asset, as in \
         `lod/NAME`\n"
    );
}

#[test]
fn an_output_folder_that_cannot_be_written_is_one_line_and_no_trace() {
    let project = Project::waves();
    project.write("file", b"mine");
    let before = project.tree("");
    let said = project.run(&["build", "--out", "file/lod"]);
    assert_eq!((said.code, said.stdout.as_str()), (1, ""));
    assert_eq!(said.stderr, "error: `file/lod`: cannot be written: not a directory\n");
    assert_eq!(project.tree(""), before);
}

#[test]
fn an_asset_folder_that_is_a_file_fails_and_stays() {
    let project = Project::waves();
    std::fs::create_dir(project.path().join("lod")).unwrap();
    project.write("lod/waves", b"mine");
    let said = project.run(&["build", "-q"]);
    assert_eq!(said.code, 1);
    assert_eq!(said.stderr, "error: surface `waves`: `lod/waves`: cannot be created: file exists\n");
    assert_eq!(project.tree("lod"), [("waves".to_string(), b"mine".to_vec())]);
}

#[test]
fn a_changed_surface_replaces_its_asset_and_leaves_no_old_payload() {
    let project = Project::waves();
    project.run(&["build", "-q"]);
    let first = project.tree("lod/waves");
    project.write("waves.png", &waves(40, 24));
    assert_eq!(project.run(&["build", "-q"]).code, 0);
    let second = project.tree("lod/waves");
    assert_eq!(first.len(), second.len());
    let heights = |tree: &[(String, Vec<u8>)]| tree.iter().find(|f| f.0.contains("heights")).unwrap().0.clone();
    assert_ne!(heights(&first), heights(&second));
    assert_eq!(project.run(&["inspect", "lod/waves"]).code, 0);
}
