//! What runs again after a change, and what does not.

use std::collections::BTreeSet;
use std::time::{Duration, Instant, SystemTime};

use crate::project::{Project, surface, wave_codes, waves};
use crate::workshop::{GLOSSY, Surface, build, built, project, ran, stages, stripes};
use farfield::io::heights::encode_png16;

const COLORED: Surface = Surface { color: Some("color.png"), ..Surface::PLAIN };

fn set(names: &[&str]) -> BTreeSet<String> {
    names.iter().map(|name| name.to_string()).collect()
}

#[test]
fn nothing_runs_where_nothing_changed() {
    let project = built();
    let before = project.tree("lod");
    for _ in 0..2 {
        assert_eq!(ran(&build(&project, &[])), Vec::<String>::new());
    }
    assert_eq!(project.tree("lod"), before);
}

#[test]
fn a_touched_file_a_comment_and_another_order_of_keys_run_nothing() {
    let project = built();
    let map = std::fs::File::options().append(true).open(project.path().join("waves.png")).unwrap();
    map.set_modified(SystemTime::now() + Duration::from_secs(5)).unwrap();
    assert_eq!(ran(&build(&project, &[])), Vec::<String>::new());
    let manifest = COLORED.manifest();
    let (title, keys) = manifest.split_once('\n').unwrap();
    let mut keys: Vec<&str> = keys.lines().collect();
    keys.reverse();
    let manifest = format!("# the sea\n{title} # waves\n\n{}\n", keys.join("\n"));
    project.write("farfield.toml", manifest.as_bytes());
    assert_eq!(ran(&build(&project, &[])), Vec::<String>::new());
}

#[test]
fn a_new_name_runs_what_writes_it() {
    let project = built();
    project.write("farfield.toml", Surface { name: "sea", ..COLORED }.manifest().as_bytes());
    assert_eq!(ran(&build(&project, &[])), ["asset"]);
    let [old, new] = ["waves", "sea"].map(|name| project.tree(&format!("lod/{name}")));
    assert_eq!(old.len(), new.len());
    // Payloads are the same; asset.json holds the name.
    assert_eq!(old.iter().zip(&new).filter(|(a, b)| a != b).count(), 1);
}

#[test]
fn another_target_runs_what_writes_it() {
    let project = built();
    project.write("farfield.toml", Surface { error: "0.02", ..COLORED }.manifest().as_bytes());
    assert_eq!(ran(&build(&project, &[])), ["asset"]);
}

#[test]
fn another_bsdf_runs_neither_decoding_nor_heights_nor_lobes() {
    let project = built();
    project.write("farfield.toml", Surface { bsdf: GLOSSY, ..COLORED }.manifest().as_bytes());
    let said = build(&project, &[]);
    assert_eq!(stages(&said), set(&["fine", "smooth", "coarse", "fit", "measure", "asset"]));
    // Both levels have 2 × 2 patches, so F of the fine surface is the same for both.
    assert_eq!(ran(&said).iter().filter(|action| action.ends_with("fine")).count(), 1);
}

#[test]
fn another_colour_runs_what_depends_on_it() {
    let project = built();
    project.write("color.png", &stripes([40, 120, 200]));
    let stages = stages(&build(&project, &[]));
    assert_eq!(stages, set(&["colors", "tint", "fine", "smooth", "coarse", "fit", "measure", "asset"]));
}

#[test]
fn a_map_with_the_same_heights_in_other_bytes_is_decoded_and_no_more() {
    let project = built();
    // The same codes under a header that says as much in other bytes: a text chunk.
    let mut bytes = encode_png16(&wave_codes(48, 32), 48, 32);
    let chunk = [&[0, 0, 0, 8][..], b"tEXtNote\0sea", &0x080a_de30_u32.to_be_bytes()].concat();
    let end = bytes.len() - 12;
    bytes.splice(end..end, chunk);
    project.write("waves.png", &bytes);
    assert_eq!(ran(&build(&project, &[])), ["heights", "asset"]);
}

#[test]
fn a_level_more_runs_that_level() {
    let project = built();
    project.write("farfield.toml", Surface { levels: "[2, 4, 8]", ..COLORED }.manifest().as_bytes());
    let of_other_levels = |action: &String| action.starts_with("level 2") || action.starts_with("level 3");
    let ran = ran(&build(&project, &[]));
    assert!(!ran.iter().any(of_other_levels) && ran.contains(&"level 1 lobes".to_string()), "{ran:?}");
}

#[test]
fn another_rank_runs_the_fit_and_what_follows() {
    let project = built();
    project.write("farfield.toml", Surface { rank: 2, ..COLORED }.manifest().as_bytes());
    let stages = stages(&build(&project, &[]));
    // Sizes of tables are given as they are; a second rank that is dropped leaves the fit as it was.
    assert!(stages.is_subset(&set(&["choose", "fit", "measure", "asset"])) && stages.contains("fit"), "{stages:?}");
}

#[test]
fn explanations_name_the_setting_with_both_values_and_the_input() {
    let project = built();
    project.write("farfield.toml", Surface { rank: 2, ..COLORED }.manifest().as_bytes());
    project.write("color.png", &stripes([40, 120, 200]));
    let said = project.run(&["build", "-q", "--explain"]);
    let line = |action: &str| {
        let start = format!("waves: {action}: ");
        said.stdout.lines().find_map(|line| line.strip_prefix(&start)).unwrap_or_default().to_string()
    };
    assert_eq!(line("level 1 choose"), "`rank` changed: 1 -> 2", "{said:?}");
    assert!(line("level 1 fit").contains("input `sizes` changed: "), "{said:?}");
    assert!(line("colors").starts_with("input `colour map` changed: "), "{said:?}");
    assert!(line("level 1 fine").starts_with("input `colors` changed: "), "{said:?}");
    let asset = line("asset");
    assert!(asset.contains("input `colour map` changed: ") && asset.contains("; `rank` changed: 1 -> 2"), "{asset}");
}

#[test]
fn a_dry_run_explains_what_it_would_do_and_writes_nothing() {
    let project = built();
    assert!(project.run(&["build", "--dry-run", "--explain"]).stdout.ends_with("\nwaves: up to date\n"));
    project.write("farfield.toml", Surface { rank: 2, ..COLORED }.manifest().as_bytes());
    let before = project.tree("");
    let said = project.run(&["build", "--dry-run", "--explain"]);
    assert!(said.stdout.ends_with("\nwaves: would be built: `rank` changed: 1 -> 2\n"), "{said:?}");
    assert_eq!(project.tree(""), before);
}

#[test]
fn force_runs_everything_and_changes_no_byte() {
    let project = built();
    let before = project.tree("lod/waves");
    let all = [
        "heights",
        "colors",
        "downsample",
        "lobes",
        "tint",
        "choose",
        "fine",
        "smooth",
        "coarse",
        "fit",
        "measure",
        "asset",
    ];
    assert_eq!(stages(&build(&project, &["--force"])), set(&all));
    assert_eq!(project.tree("lod/waves"), before);
}

#[test]
fn an_asset_that_was_removed_or_changed_is_published_again_without_running_anything() {
    let project = built();
    let before = project.tree("lod/waves");
    std::fs::remove_file(project.path().join("lod/waves/asset.json")).unwrap();
    assert_eq!(ran(&build(&project, &[])), Vec::<String>::new());
    assert_eq!(project.tree("lod/waves"), before);
    let payload = format!("lod/waves/{}", before[1].0);
    project.write(&payload, b"not a texture");
    assert_eq!(ran(&build(&project, &[])), Vec::<String>::new());
    assert_eq!(project.tree("lod/waves"), before);
}

#[test]
fn warnings_and_strictness_outlive_the_build_that_found_them() {
    let project = project(&Surface { error: "1e-6", levels: "[8]", ..Surface::PLAIN });
    let first = project.run(&["build", "-q", "--strict"]);
    assert!(first.code == 1 && first.stderr.contains("wanted 0.00 %"), "{first:?}");
    let second = project.run(&["build", "-q", "--strict"]);
    assert_eq!((second.code, second.stdout, second.stderr), (first.code, first.stdout, first.stderr));
}

/// 1000 surfaces that share a map, so that building them is quick; what is current is looked at surface by surface.
fn a_thousand() -> Project {
    let project = Project::empty();
    project.write("waves.png", &waves(48, 32));
    let names = (0..1000).map(|i| surface(&format!("s{i:04}"), "waves.png"));
    project.write("farfield.toml", names.collect::<String>().as_bytes());
    project
}

#[test]
#[ignore = "40 s, of which 10 of CPU: publishes 1000 assets"]
fn a_thousand_surfaces_that_are_current_take_less_than_a_second() {
    let project = a_thousand();
    build(&project, &[]);
    // The files are no longer young: their digests are remembered from now on.
    std::thread::sleep(Duration::from_secs(3));
    build(&project, &[]);
    let best = (0..3).map(|_| {
        let start = Instant::now();
        let said = build(&project, &[]);
        assert_eq!(ran(&said), Vec::<String>::new());
        start.elapsed()
    });
    let best = best.min().unwrap();
    println!("no-op build of 1000 surfaces: {best:?}");
    assert!(best < Duration::from_secs(1), "{best:?}");
}
