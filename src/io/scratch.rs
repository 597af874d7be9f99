//! A temporary folder that is gone when its owner is, however its owner ends.
//!
//! A folder `PREFIXprocess-number.tmp` is claimed by a lock on the file of the same name in `.lock`. The system lets go of
//! a lock when a process dies, so what nobody holds is an orphan, whoever left it and however long ago.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// How many names are tried before a claim is given up.
const MAX_TRIES: usize = 100;

/// A claimed temporary folder.
#[derive(Debug)]
pub struct Scratch {
    folder: PathBuf,
    lock: PathBuf,
    /// Held for its lock.
    _held: File,
}

impl Scratch {
    /// A new empty folder in `parent`, whose name begins with `prefix`.
    pub fn claim(parent: &Path, prefix: &str) -> io::Result<Self> {
        static NUMBER: AtomicU64 = AtomicU64::new(0);
        for _ in 0..MAX_TRIES {
            let number = NUMBER.fetch_add(1, Ordering::Relaxed);
            let stem = format!("{prefix}{}-{number}", std::process::id());
            let [lock, folder] = ["lock", "tmp"].map(|kind| parent.join(format!("{stem}.{kind}")));
            let held = match File::create_new(&lock) {
                Ok(file) => file,
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                Err(error) => return Err(error),
            };
            // A collector that came in between has taken the lock, or has deleted the file: then another name.
            if held.try_lock().is_err() || !lock.exists() {
                continue;
            }
            let scratch = Self { folder, lock, _held: held };
            match fs::create_dir(&scratch.folder) {
                Ok(()) => return Ok(scratch),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => continue,
                Err(error) => return Err(error),
            }
        }
        Err(io::Error::new(io::ErrorKind::AlreadyExists, "every temporary name is taken"))
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What cannot be removed is an orphan, and collected later.
        let _ = fs::remove_dir_all(&self.folder);
        let _ = fs::remove_file(&self.lock);
    }
}

/// Removes what others have left in `parent` under names that begin with `prefix` or, where that is empty, under any;
/// how many folders.
pub fn collect_orphans(parent: &Path, prefix: &str) -> usize {
    let names = fs::read_dir(parent).into_iter().flatten().flatten().map(|entry| entry.file_name());
    let mut stems: Vec<String> = names.filter_map(|name| stem_of(&name.to_string_lossy(), prefix)).collect();
    stems.sort();
    stems.dedup();
    stems.iter().filter(|stem| collect(parent, stem)).count()
}

/// How many temporary folders lie in `parent`, claimed or not.
pub fn count(parent: &Path) -> usize {
    let names = fs::read_dir(parent).into_iter().flatten().flatten().map(|entry| entry.file_name());
    names.filter(|name| name.to_string_lossy().ends_with(".tmp")).count()
}

/// The name without its ending, if it is one of ours.
fn stem_of(name: &str, prefix: &str) -> Option<String> {
    let stem = name.strip_suffix(".tmp").or_else(|| name.strip_suffix(".lock"))?;
    let claim = stem.strip_prefix(prefix)?.rsplit('.').next()?;
    let (process, number) = claim.split_once('-')?;
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    (is_number(process) && is_number(number)).then(|| stem.into())
}

/// Removes one folder with its lock if nobody holds it; whether it did.
fn collect(parent: &Path, stem: &str) -> bool {
    let [lock, folder] = ["lock", "tmp"].map(|kind| parent.join(format!("{stem}.{kind}")));
    let held = File::open(&lock);
    if held.as_ref().is_ok_and(|file| file.try_lock().is_err()) {
        return false;
    }
    let had_folder = fs::remove_dir_all(&folder).is_ok();
    let _ = fs::remove_file(&lock);
    had_folder
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_owner_leaves_nothing_and_nobody_takes_what_is_his() {
        let root = tempfile::tempdir().unwrap();
        let scratch = Scratch::claim(root.path(), ".bark.").unwrap();
        fs::write(scratch.folder().join("half"), "ha").unwrap();
        assert_eq!(collect_orphans(root.path(), ""), 0);
        assert!(scratch.folder().join("half").exists());
        drop(scratch);
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 0);
    }

    #[test]
    fn what_a_dead_process_left_is_collected_whatever_its_age() {
        let root = tempfile::tempdir().unwrap();
        let dead = |name: &str| root.path().join(name);
        fs::create_dir(dead(".bark.12-0.tmp")).unwrap();
        fs::write(dead(".bark.12-0.lock"), "").unwrap();
        fs::create_dir(dead(".cloth.13-5.tmp")).unwrap(); // its lock is gone already
        fs::create_dir(dead("mine.tmp")).unwrap();
        assert_eq!(collect_orphans(root.path(), ".bark."), 1);
        assert_eq!(collect_orphans(root.path(), ""), 1);
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1, "a stranger's folder stays");
    }
}
