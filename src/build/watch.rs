//! Waiting until a file of a project changes.
//!
//! The system's notices only wake us up: what counts is how the files look ([`Looks`]). So it does not matter how an
//! editor writes, whether a file is gone for a while, or whether a notice got lost; where there are none, looking every
//! other second does.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant, SystemTime};

use notify::{RecommendedWatcher, RecursiveMode, Watcher as _};

/// How long files must look the same before a change counts as complete.
const QUIET: Duration = Duration::from_millis(150);

/// How long a file that has vanished may stay away before that counts as its new look: editors move files about.
const ABSENCE: Duration = Duration::from_millis(1000);

/// How often files are looked at without a notice.
const LOOK_EVERY: Duration = Duration::from_secs(2);

/// How files look from outside: size and times, none where there is no file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Looks(Vec<Option<(u64, SystemTime)>>);

impl Looks {
    /// How these files look now.
    pub fn of(files: &[PathBuf]) -> Self {
        let look = |file: &PathBuf| {
            let metadata = std::fs::metadata(file).ok()?;
            Some((metadata.len(), metadata.modified().ok()?))
        };
        Self(files.iter().map(look).collect())
    }

    /// Whether a file is gone that was there in `before`.
    fn lacks(&self, before: &Self) -> bool {
        self.0.iter().zip(&before.0).any(|(now, before)| now.is_none() && before.is_some())
    }

    /// The looks of two lists of files after each other.
    pub fn and(mut self, others: Self) -> Self {
        self.0.extend(others.0);
        self
    }
}

/// Wakes up when something happens in the folders of files.
#[derive(Debug)]
pub struct Watcher {
    system: Option<RecommendedWatcher>,
    notices: Receiver<()>,
    folders: BTreeSet<PathBuf>,
}

impl Default for Watcher {
    fn default() -> Self {
        let (sender, notices) = channel();
        let tell = move |_: notify::Result<notify::Event>| {
            // Nobody listens any more at the end of the program.
            let _ = sender.send(());
        };
        Self { system: notify::recommended_watcher(tell).ok(), notices, folders: BTreeSet::new() }
    }
}

impl Watcher {
    /// Returns when `files` look other than `before`, and have looked the same for a moment.
    pub fn wait(&mut self, files: &[PathBuf], before: &Looks) {
        self.follow(files);
        let mut now = Looks::of(files);
        while now == *before {
            let _woken_or_not = self.notices.recv_timeout(LOOK_EVERY);
            now = Looks::of(files);
        }
        let [start, mut changed] = [Instant::now(); 2];
        while changed.elapsed() < QUIET || now.lacks(before) && start.elapsed() < ABSENCE {
            std::thread::sleep(QUIET / 5);
            let next = Looks::of(files);
            if next != now {
                (now, changed) = (next, Instant::now());
            }
        }
        while self.notices.try_recv().is_ok() {}
    }

    /// Asks for notices from the folders of `files`, and from no others. A folder is asked for each time: one that was
    /// removed and made again is another to the system.
    fn follow(&mut self, files: &[PathBuf]) {
        let Some(system) = &mut self.system else { return };
        let folder = |file: &PathBuf| match file.parent() {
            Some(folder) if folder != Path::new("") => folder.to_owned(),
            _ => PathBuf::from("."),
        };
        let folders: BTreeSet<PathBuf> = files.iter().map(folder).collect();
        for gone in self.folders.difference(&folders) {
            let _ = system.unwatch(gone);
        }
        for folder in &folders {
            // Where this fails, looking every other second remains.
            let _ = system.watch(folder, RecursiveMode::NonRecursive);
        }
        self.folders = folders;
    }
}
