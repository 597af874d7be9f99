//! Killed, crowded, starved and damaged builds: what they leave, and what the next build makes of it.

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use farfield::math::rng::Stream;

use crate::project::{Project, Said, said, surface, waves};
use crate::workshop::{Surface, build, built, project, ran};

/// Assets of a project as a build leaves them that nothing disturbs.
type Tree = Vec<(String, Vec<u8>)>;

/// Eight surfaces of two maps: much to publish for what there is to compute.
fn crowd() -> Project {
    let project = Project::empty();
    project.write("a.png", &waves(48, 32));
    project.write("b.png", &waves(32, 32));
    let one = |i: usize| surface(&format!("s{i}"), ["a.png", "b.png"][i % 2]).replace("[4, 8]", "[8]");
    project.write("farfield.toml", (0..8).map(one).collect::<String>().as_bytes());
    project
}

/// The assets alone: records of what builds cost are no part of them.
fn assets(project: &Project, out: &str) -> Tree {
    project.tree(out).into_iter().filter(|(name, _)| name != "build.jsonl").collect()
}

fn undisturbed() -> Tree {
    let project = crowd();
    build(&project, &[]);
    assets(&project, "lod")
}

/// How long a build takes here and now.
fn build_time() -> Duration {
    let (project, start) = (crowd(), Instant::now());
    build(&project, &[]);
    start.elapsed()
}

fn spawn(project: &Project, arguments: &[&str]) -> Child {
    let mut command = project.command(&[&["build", "-q"], arguments].concat());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Every asset that is published is whole, whatever else lies about.
fn assert_whole_assets(project: &Project, out: &str) {
    for entry in std::fs::read_dir(project.path().join(out)).into_iter().flatten().flatten() {
        // What begins with a dot is on its way, and the next build's to remove.
        let (folder, is_staged) = (entry.path(), entry.file_name().as_encoded_bytes().starts_with(b"."));
        if !is_staged && folder.join("asset.json").exists() {
            formats::asset::SurfaceAsset::files(&folder).unwrap();
        }
    }
}

/// Kills builds at random moments, `count` of them, each in the state that the last one left.
fn check_kills(count: u64) {
    let (wanted, longest) = (undisturbed(), 1.3 * build_time().as_secs_f64());
    let project = crowd();
    let stream = Stream::new(count, 99);
    let [mut killed, mut finished] = [0; 2];
    for kill in 0..count {
        let mut child = spawn(&project, &[]);
        // Between a millisecond and a third more than a whole build takes, as often in one octave as in another: much
        // happens in the first moments.
        let seconds = longest * (1e-3 / longest).powf(f64::from(stream.uniform(kill)));
        std::thread::sleep(Duration::from_secs_f64(seconds));
        child.kill().unwrap();
        let is_killed = child.wait().unwrap().code().is_none();
        assert_whole_assets(&project, "lod");
        if is_killed {
            killed += 1;
            continue;
        }
        // It had come to its end: another one starts from nothing.
        finished += 1;
        assert_eq!(assets(&project, "lod"), wanted);
        std::fs::remove_dir_all(project.path().join("lod")).unwrap();
        std::fs::remove_dir_all(project.path().join(".farfield")).unwrap();
    }
    println!("{killed} builds were killed, {finished} came to their end before");
    build(&project, &[]);
    assert_eq!(assets(&project, "lod"), wanted);
    assert_eq!(project.run(&["cache", "gc"]).code, 0);
    assert_eq!(json(&project.run(&["cache", "stats", "--json"]))["orphans"], 0);
    assert_eq!(project.run(&["cache", "verify"]).code, 0);
}

fn json(said: &Said) -> serde_json::Value {
    serde_json::from_str(&said.stdout).unwrap()
}

#[test]
fn killed_builds_leave_nothing_that_a_later_one_would_show() {
    check_kills(8);
}

#[test]
#[ignore = "60 s of CPU: 200 kills"]
fn two_hundred_killed_builds_leave_nothing_that_a_later_one_would_show() {
    check_kills(200);
}

#[test]
fn a_killed_build_goes_on_where_it_was() {
    let project = project(&Surface::PLAIN);
    let mut child = spawn(&project, &[]);
    let record =
        |project: &Project| std::fs::read_dir(project.path().join(".farfield/records")).map_or(0, Iterator::count);
    while record(&project) < 6 && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let ran = ran(&build(&project, &[]));
    assert!(!ran.contains(&"heights".to_string()), "{ran:?}");
    assert!(ran.len() < 15, "{ran:?}");
}

#[test]
fn two_builds_on_one_cache_and_one_folder_give_what_one_gives() {
    let wanted = undisturbed();
    let project = crowd();
    let children = [spawn(&project, &[]), spawn(&project, &[])];
    for child in children {
        let said = said(child.wait_with_output().unwrap());
        assert_eq!((said.code, said.stderr.as_str()), (0, ""), "{said:?}");
    }
    assert_eq!(assets(&project, "lod"), wanted);
    assert_eq!(project.run(&["cache", "verify"]).code, 0);
    assert_eq!(project.run(&["cache", "gc"]).code, 0);
    assert_eq!(json(&project.run(&["cache", "stats", "--json"]))["orphans"], 0);
}

#[test]
fn a_cache_that_cannot_be_written_to_is_read() {
    let project = built();
    let before = project.tree("lod/waves");
    // A file in the place of the folder that is written in: nothing can be, whoever asks.
    let tmp = project.path().join(".farfield/tmp");
    std::fs::remove_dir_all(&tmp).unwrap();
    std::fs::write(&tmp, "").unwrap();
    let cache = project.tree(".farfield");
    let said = project.run(&["build", "-q", "--explain", "--json", "--out", "other"]);
    assert_eq!((said.code, ran(&said)), (0, vec![]), "{said:?}");
    assert!(said.stderr.contains("`.farfield`: cannot be written to"), "{said:?}");
    assert_eq!(project.tree("other/waves"), before);
    // Neither does what has to be computed need the cache.
    let said = project.run(&["build", "-q", "--force", "--out", "third"]);
    assert_eq!(said.code, 0, "{said:?}");
    assert_eq!(project.tree("third/waves"), before);
    assert_eq!(project.tree(".farfield"), cache);
}

/// Runs `farfield build` in a shell where no file may be longer than `kilobytes`, as on a disk with so much left.
#[cfg(unix)]
fn build_with_little_room(project: &Project, kilobytes: usize) -> Said {
    let script = format!("trap '' XFSZ; ulimit -f {kilobytes}; exec \"$0\" build -q");
    let mut command = Command::new("bash");
    command.args(["-c", &script, env!("CARGO_BIN_EXE_farfield")]).current_dir(project.path());
    said(command.output().unwrap())
}

#[cfg(unix)]
#[test]
fn without_room_for_the_cache_assets_are_built_and_without_room_for_assets_none_is_half_there() {
    let project = project(&Surface { levels: "[8]", ..Surface::PLAIN });
    // Heights take 6 KiB, F 16 KiB; no file of the asset is as long.
    let crowded = build_with_little_room(&project, 6);
    assert_eq!(crowded.code, 0, "{crowded:?}");
    assert!(crowded.stderr.contains("`.farfield`: cannot be written to any more"), "{crowded:?}");
    let wanted = project.tree("lod/waves");
    assert_eq!(project.run(&["cache", "verify"]).code, 0);
    let fresh = crate::workshop::project(&Surface { levels: "[8]", ..Surface::PLAIN });
    build(&fresh, &[]);
    assert_eq!(fresh.tree("lod/waves"), wanted);
    std::fs::remove_dir_all(project.path().join("lod")).unwrap();
    let full = build_with_little_room(&project, 1);
    assert_eq!(full.code, 1, "{full:?}");
    assert!(full.stderr.contains("cannot be written: "), "{full:?}");
    assert!(!project.path().join("lod/waves/asset.json").exists());
    build(&project, &[]);
    assert_eq!(project.tree("lod/waves"), wanted);
}

#[cfg(target_os = "linux")]
#[test]
#[ignore = "15 s; needs `unshare` to mount a small disk of its own"]
fn on_a_full_disk_no_asset_is_torn_and_room_makes_the_build_go_on() {
    let wanted = undisturbed();
    let project = crowd();
    let disk = project.path().join("disk");
    std::fs::create_dir(&disk).unwrap();
    // Builds on a disk of so many KiB, each larger than the last; what is there after each is copied out and looked at.
    for size in [40, 80, 160, 320, 640] {
        let script = format!(
            "mount -t tmpfs -o size={size}k tmpfs disk && (\"$0\" build -q --out disk/lod --cache disk/cache; \
             echo $? > code{size}; cp -r disk/lod after{size}; \"$0\" cache verify --cache disk/cache)"
        );
        let mut command = Command::new("unshare");
        command.args(["--map-root-user", "--mount", "sh", "-c", &script, env!("CARGO_BIN_EXE_farfield")]);
        let said = said(command.current_dir(project.path()).output().unwrap());
        assert!(said.stderr.contains("o space left on device"), "{size}: {said:?}");
        assert_eq!(said.code, 0, "what the cache holds is whole: {said:?}");
        assert_whole_assets(&project, &format!("after{size}"));
        for (name, bytes) in
            assets(&project, &format!("after{size}")).iter().filter(|(name, _)| name.ends_with(".json"))
        {
            assert!(wanted.contains(&(name.clone(), bytes.clone())), "{size}: {name}");
        }
    }
    build(&project, &[]);
    assert_eq!(assets(&project, "lod"), wanted);
}

#[test]
fn a_map_that_is_edited_while_it_is_read_is_built_as_it_is_in_the_end() {
    let project = project(&Surface { levels: "[8]", ..Surface::PLAIN });
    let [one, two] = [waves(48, 32), waves(64, 32)];
    let mut child = spawn(&project, &[]);
    // The map changes ten times a second or so until the build is over.
    let mut edits = 0;
    while child.try_wait().unwrap().is_none() {
        let next = project.write("next.png", if edits % 2 == 0 { &two } else { &one });
        std::fs::rename(next, project.path().join("waves.png")).unwrap();
        edits += 1;
        std::thread::sleep(Duration::from_millis(if edits < 40 { 1 } else { 100 }));
    }
    let said = said(child.wait_with_output().unwrap());
    let refused = "error: surface `waves`: its files are edited again and again while they are read\n";
    assert!(said.code == 0 || said.stderr == refused, "{said:?}");
    // Whatever was built carries the digest of the bytes that it was built from.
    for map in [&one, &two] {
        project.write("waves.png", map);
        build(&project, &[]);
        let alone = crate::workshop::project(&Surface { levels: "[8]", ..Surface::PLAIN });
        alone.write("waves.png", map);
        build(&alone, &[]);
        assert_eq!(project.tree("lod/waves"), alone.tree("lod/waves"));
    }
}

/// Every file below `folder`.
fn files(folder: &Path) -> Vec<std::path::PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        match entry.path() {
            path if path.is_dir() => found.extend(files(&path)),
            path => found.push(path),
        }
    }
    found.sort();
    found
}

fn flip(path: &Path) {
    let mut bytes = std::fs::read(path).unwrap();
    let at = bytes.len() / 2;
    bytes[at] ^= 1;
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn one_flipped_byte_in_any_stored_file_is_found_said_and_mended() {
    let project = built();
    let before = project.tree("lod/waves");
    let cache = project.path().join(".farfield");
    let stored: Vec<_> = ["records", "artifacts"].iter().flat_map(|kind| files(&cache.join(kind))).collect();
    assert!(stored.len() > 40, "{}", stored.len());
    for path in &stored {
        let whole = std::fs::read(path).unwrap();
        flip(path);
        let said = project.run(&["cache", "verify"]);
        assert_eq!(said.code, 1, "{}", path.display());
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(said.stderr.contains(name) && said.stdout.ends_with(", 1 are not\n"), "{said:?}");
        assert!(!path.exists());
        std::fs::write(path, whole).unwrap();
    }
    assert_eq!(project.run(&["cache", "verify"]).code, 0);
    // Without `verify`, all damaged at once: what is read is found, said and made again.
    stored.iter().for_each(|path| flip(path));
    std::fs::remove_dir_all(project.path().join("lod")).unwrap();
    let said = build(&project, &[]);
    assert!(said.stderr.contains("is damaged"), "{said:?}");
    assert_eq!(project.tree("lod/waves"), before);
    assert_eq!(project.run(&["cache", "verify"]).code, 1, "what was not read is still damaged");
    assert_eq!(project.run(&["cache", "verify"]).code, 0);
}

#[test]
fn a_damaged_artifact_is_made_again_and_nothing_else() {
    let project = built();
    // Of all that `measure` of level 1 reads, F of the fine surface is not among it: only `fit` is.
    let artifacts = files(&project.path().join(".farfield/artifacts"));
    // The only files that begin with the tag of T and S.
    let fits: Vec<_> = artifacts.iter().filter(|path| std::fs::read(path).unwrap()[0] == b't').collect();
    assert_eq!(fits.len(), 2);
    fits.iter().for_each(|path| flip(path));
    project.write(
        "farfield.toml",
        Surface { name: "sea", color: Some("color.png"), ..Surface::PLAIN }.manifest().as_bytes(),
    );
    let mut ran = ran(&build(&project, &[]));
    ran.sort();
    assert_eq!(ran, ["asset", "level 1 fit", "level 2 fit"]);
    assert_eq!(project.run(&["cache", "verify"]).code, 0);
}
