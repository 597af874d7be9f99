//! Volumes in the store: when one is compiled, and when it is not.

use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use crate::project::Project;
use crate::workshop::{build, copy, ran};

/// Voxels of the slab.
const SIZE: [u32; 3] = [6, 5, 4];

/// A `.vol` file of [`SIZE`] with `channels` bytes a voxel.
fn vol(channels: u32, code: u8) -> Vec<u8> {
    let words = [3].into_iter().chain(SIZE).chain([channels]).flat_map(u32::to_le_bytes);
    let data = vec![code; (channels * SIZE.iter().product::<u32>()) as usize];
    b"VOL\x03".iter().copied().chain(words).chain([0; 24]).chain(data).collect()
}

/// A slab of two levels, with this target.
fn manifest(error: &str) -> String {
    format!(
        "[volume.slab]\ndensity = {{ file = \"d.vol\", scale = 300 }}\nalbedo = [0.9, 0.5, 0.1]\nvoxel = 1e-3\n\
         sggx = {{ fibre = \"f.vol\", along = 0.4 }}\nlevels = [2, 4]\nrepeat = [true, true, false]\nerror = {error}\n"
    )
}

/// A project of the slab alone.
pub(crate) fn project(error: &str) -> Project {
    let project = Project::empty();
    project.write("d.vol", &vol(1, 255));
    project.write("f.vol", &vol(3, 64));
    project.write("farfield.toml", manifest(error).as_bytes());
    project
}

/// A slab that has been built once; all come from one build.
fn built() -> Project {
    static FIRST: std::sync::OnceLock<Project> = std::sync::OnceLock::new();
    let first = FIRST.get_or_init(|| {
        let project = project("1");
        assert_eq!(ran(&build(&project, &[])), ["volume"]);
        project
    });
    let project = Project::empty();
    copy(first.path(), project.path());
    project
}

/// Edits the manifest.
fn edit(project: &Project, from: &str, to: &str) {
    let text = std::fs::read_to_string(project.path().join("farfield.toml")).unwrap();
    assert!(text.contains(from));
    project.write("farfield.toml", text.replace(from, to).as_bytes());
}

/// Why the slab was compiled; empty where it was not.
fn reasons(project: &Project, arguments: &[&str]) -> String {
    let said = project.run(&[&["build", "-q", "--explain"], arguments].concat());
    assert_eq!(said.code, 0, "{said:?}");
    said.stdout.lines().find_map(|line| line.strip_prefix("slab: volume: ")).unwrap_or_default().into()
}

/// The stored artifacts.
fn artifacts(project: &Project) -> Vec<PathBuf> {
    let shards = std::fs::read_dir(project.path().join(".farfield/artifacts")).unwrap();
    let files = shards.flat_map(|shard| std::fs::read_dir(shard.unwrap().path()).unwrap());
    files.map(|file| file.unwrap().path()).collect()
}

#[test]
fn a_volume_that_is_current_runs_nothing_and_is_shown_as_when_it_was_built() {
    let project = project("1");
    let first = project.run(&["build"]);
    let tree = project.tree("lod");
    let second = project.run(&["build"]);
    assert!(first.stderr.ends_with("1 built, 0 up to date; 1 actions ran\n"), "{first:?}");
    assert_eq!(second.stderr, "0 built, 1 up to date; 0 actions ran\n");
    assert!(second.stdout.contains("\nslab  2      2 × 1 × 1  "), "{second:?}");
    assert_eq!(second.stdout, first.stdout, "what was measured and what it cost is kept");
    let said = build(&project, &[]);
    assert!(ran(&said).is_empty() && said.stdout.lines().count() == 2, "{said:?}");
    assert!(project.run(&["build", "-q", "--explain"]).stdout.starts_with("slab: nothing ran\n"));
    assert_eq!(project.tree("lod"), tree);
}

#[test]
fn a_touched_file_a_comment_and_another_place_of_the_file_run_nothing() {
    let project = built();
    let file = std::fs::File::options().append(true).open(project.path().join("d.vol")).unwrap();
    file.set_modified(SystemTime::now() + Duration::from_secs(5)).unwrap();
    assert_eq!(reasons(&project, &[]), "");
    edit(&project, "levels = [2, 4]", "# two\nlevels = [2, 4]");
    std::fs::rename(project.path().join("f.vol"), project.path().join("fibres.vol")).unwrap();
    edit(&project, "f.vol", "fibres.vol");
    assert_eq!(reasons(&project, &[]), "");
}

#[test]
fn a_changed_setting_and_a_changed_file_are_told_and_what_was_before_is_kept() {
    let project = built();
    let before = project.tree("lod/slab");
    assert!(project.run(&["build", "--dry-run", "--explain"]).stdout.ends_with("\nslab: up to date\n"));
    edit(&project, "[2, 4]", "[2]");
    let said = project.run(&["build", "--dry-run", "--explain"]);
    assert!(said.stdout.ends_with("\nslab: would be built: `levels` changed: [2, 4] -> [2]\n"), "{said:?}");
    assert_eq!(reasons(&project, &[]), "`levels` changed: [2, 4] -> [2]");
    assert_eq!(reasons(&project, &[]), "");
    project.write("f.vol", &vol(3, 192));
    let why = reasons(&project, &[]);
    assert!(why.starts_with("input `fibre` changed: ") && !why.contains(';'), "{why}");
    // Back to what was built first.
    project.write("f.vol", &vol(3, 64));
    edit(&project, "[2]", "[2, 4]");
    assert_eq!(reasons(&project, &[]), "");
    assert_eq!(project.tree("lod/slab"), before);
}

#[test]
fn an_asset_that_was_removed_or_changed_is_published_again() {
    let project = built();
    let before = project.tree("lod/slab");
    std::fs::remove_dir_all(project.path().join("lod/slab")).unwrap();
    let said = project.run(&["build", "--dry-run", "--explain"]);
    assert!(said.stdout.ends_with("\nslab: would be built: `lod/slab` is not as it was published\n"), "{said:?}");
    assert_eq!(project.run(&["build"]).stderr, "1 built, 0 up to date; 0 actions ran\n");
    assert_eq!(project.tree("lod/slab"), before);
    project.write(&format!("lod/slab/{}", before[1].0), b"not a texture");
    assert_eq!(reasons(&project, &[]), "");
    assert_eq!(project.tree("lod/slab"), before);
}

#[test]
fn a_flipped_bit_in_the_store_is_repaired() {
    let project = built();
    let (before, files) = (project.tree("lod/slab"), artifacts(&project));
    assert!(files.len() > 4, "{files:?}");
    for file in files.iter().step_by(4) {
        let whole = std::fs::read(file).unwrap();
        let mut bytes = whole.clone();
        let at = bytes.len() / 2;
        bytes[at] ^= 1;
        std::fs::write(file, bytes).unwrap();
        std::fs::remove_dir_all(project.path().join("lod")).unwrap();
        assert_eq!(reasons(&project, &[]), "its stored result was damaged or evicted");
        assert_eq!(project.tree("lod/slab"), before);
        assert_eq!(std::fs::read(file).unwrap(), whole);
    }
    assert_eq!(project.run(&["cache", "verify"]).code, 0);
}

#[test]
fn force_runs_everything_and_changes_no_byte() {
    let project = built();
    let before = project.tree("lod/slab");
    assert_eq!(reasons(&project, &["--force"]), "`--force`");
    assert_eq!(project.tree("lod/slab"), before);
    let said = project.run(&["cache", "verify", "--rerun"]);
    assert!(said.code == 0 && said.stdout.ends_with("1 actions ran, 0 gave other bytes than before\n"), "{said:?}");
}

#[test]
fn warnings_and_strictness_outlive_the_build_that_found_them() {
    let project = project("1e-6");
    let first = project.run(&["build", "-q", "--strict"]);
    assert!(first.code == 1 && first.stderr.contains("of image means; wanted 0.00 %"), "{first:?}");
    let second = project.run(&["build", "-q", "--strict"]);
    assert_eq!((second.code, second.stdout, second.stderr), (first.code, first.stdout, first.stderr));
}

#[test]
fn a_volume_that_fails_leaves_the_old_one() {
    let project = built();
    let before = project.tree("lod/slab");
    project.write("d.vol", &vol(1, 255)[..60]);
    let said = project.run(&["build", "-q"]);
    assert!(said.code == 1 && said.stderr.starts_with("error: volume `slab`: `d.vol`: "), "{said:?}");
    std::fs::remove_file(project.path().join("d.vol")).unwrap();
    let said = project.run(&["build", "-q"]);
    assert!(said.code == 1 && said.stderr.starts_with("error: volume `slab`: `d.vol`: cannot be read"), "{said:?}");
    assert_eq!(project.tree("lod/slab"), before);
}
