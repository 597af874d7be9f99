//! `farfield watch`: what it builds, and when.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use crate::project::{Project, waves};
use crate::workshop::{Surface, project};

/// A running `farfield watch`, and the lines of its stderr.
struct Watch {
    child: Child,
    lines: Receiver<String>,
}

impl Watch {
    fn start(project: &Project) -> Self {
        let mut command: Command = project.command(&["watch"]);
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        let (sender, lines) = channel();
        std::thread::spawn(move || stderr.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
        Self { child, lines }
    }

    /// What is said until it waits again.
    fn next_build(&self) -> Vec<String> {
        let mut said = Vec::new();
        loop {
            let line = self.lines.recv_timeout(Duration::from_secs(60)).expect("a line within a minute");
            if line.starts_with("watching: ") {
                return said;
            }
            said.push(line);
        }
    }

    fn says_nothing_for(&self, time: Duration) -> bool {
        self.lines.recv_timeout(time).is_err()
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

fn ends_with(said: &[String], end: &str) {
    assert!(said.last().is_some_and(|line| line.starts_with(end)), "{said:?}");
}

#[test]
fn changes_are_built_once_however_they_are_written() {
    let project = project(&Surface { levels: "[8]", ..Surface::PLAIN });
    let watch = Watch::start(&project);
    ends_with(&watch.next_build(), "1 built, 0 up to date; 10 actions ran");
    // In place, in many small writes: one build.
    let manifest = Surface { levels: "[8]", rank: 2, ..Surface::PLAIN }.manifest();
    for end in (0..manifest.len()).step_by(manifest.len() / 5).skip(1).chain([manifest.len()]) {
        project.write("farfield.toml", &manifest.as_bytes()[..end]);
        std::thread::sleep(Duration::from_millis(10));
    }
    ends_with(&watch.next_build(), "1 built, 0 up to date; ");
    // By rename, as most editors do.
    let next = project.write("next.png", &waves(32, 32));
    std::fs::rename(next, project.path().join("waves.png")).unwrap();
    ends_with(&watch.next_build(), "1 built, 0 up to date; 10 actions ran");
    // Moved away, then written anew: one build.
    std::fs::rename(project.path().join("waves.png"), project.path().join("waves.png~")).unwrap();
    std::thread::sleep(Duration::from_millis(300));
    project.write("waves.png", &waves(48, 32));
    ends_with(&watch.next_build(), "1 built, 0 up to date; ");
    assert!(watch.says_nothing_for(Duration::from_secs(3)), "what a build writes wakes nobody");
}

#[test]
fn files_that_vanish_and_manifests_with_mistakes_end_nothing() {
    let project = project(&Surface { levels: "[8]", ..Surface::PLAIN });
    let watch = Watch::start(&project);
    watch.next_build();
    std::fs::remove_file(project.path().join("waves.png")).unwrap();
    let said = watch.next_build();
    assert!(said[0].starts_with("error: surface `waves`: `waves.png`: cannot be read"), "{said:?}");
    let manifest = Surface { levels: "[8]", ..Surface::PLAIN }.manifest();
    project.write("farfield.toml", manifest.replace("rank", "rnak").as_bytes());
    let said = watch.next_build();
    assert!(said[0].contains("unknown key `rnak`"), "{said:?}");
    project.write("waves.png", &waves(48, 32));
    project.write("farfield.toml", manifest.as_bytes());
    ends_with(&watch.next_build(), "0 built, 1 up to date; 0 actions ran");
}

#[test]
fn the_files_of_a_volume_are_watched() {
    let project = crate::volumes::project("1");
    let watch = Watch::start(&project);
    ends_with(&watch.next_build(), "1 built, 0 up to date; 1 actions ran");
    for file in ["d.vol", "f.vol"] {
        let mut bytes = std::fs::read(project.path().join(file)).unwrap();
        *bytes.last_mut().unwrap() -= 1;
        project.write(file, &bytes);
        ends_with(&watch.next_build(), "1 built, 0 up to date; 1 actions ran");
    }
}
