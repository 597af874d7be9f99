//! An interrupted build leaves whole assets or none.

#![cfg(unix)]

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::project::{Project, said, surface, waves};

#[test]
fn an_interruption_leaves_nothing_half_written() {
    let project = Project::empty();
    project.write("waves.png", &waves(256, 256));
    let manifest: String = (0..400).map(|i| surface(&format!("s{i:03}"), "waves.png")).collect();
    project.write("farfield.toml", manifest.as_bytes());
    for wanted in [1, 5] {
        let out = format!("lod{wanted}");
        let mut command = project.command(&["build", "-q", "--out", &out]);
        let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let start = Instant::now();
        let published = |i: usize| project.path().join(format!("{out}/s{i:03}/asset.json")).exists();
        while !published(wanted - 1) && start.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        let said = said(child.wait_with_output().unwrap());
        assert_eq!(said.code, 130, "{said:?}");
        assert_eq!(said.stderr, "error: interrupted; what was published before is whole\n");
        assert_only_whole_assets(&project, &out);
    }
}

/// Every folder of `out` is an asset whose hashes are right, and nothing else is there but the records.
fn assert_only_whole_assets(project: &Project, out: &str) {
    let mut count = 0;
    for entry in std::fs::read_dir(project.path().join(out)).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if name != "build.jsonl" {
            assert_eq!(project.run(&["inspect", &format!("{out}/{name}")]).code, 0, "{name}");
            count += 1;
        }
    }
    assert!((1..400).contains(&count), "{count} assets");
}
