//! Putting files in their place so that no reader, and no later run, ever meets half of them.
//!
//! Files are written into a temporary folder beside their place, flushed, and renamed; the file that names the others
//! comes last. One [`Publisher`] serialises this, so that an interruption falls before a publication or after it; a lock
//! on the folder serialises it among processes.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::Error;
use super::scratch::{Scratch, collect_orphans};

/// The right to publish.
#[derive(Debug, Default)]
pub struct Publisher {
    busy: Mutex<()>,
}

impl Publisher {
    /// Waits for a publication under way; none begins while the guard lives.
    pub fn halt(&self) -> MutexGuard<'_, ()> {
        // A publication that panicked has removed its temporary folder as it unwound.
        self.busy.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes `folder` hold `files`, with `last` put in place after all others: until then the old set is valid.
    ///
    /// Afterwards, files of the folder that `stale` names and that are not among `files` are deleted.
    pub fn folder(
        &self,
        folder: &Path,
        files: &BTreeMap<String, Vec<u8>>,
        last: &str,
        stale: impl Fn(&str) -> bool,
    ) -> Result<(), Error> {
        let _busy = self.halt();
        let parent = folder.parent().unwrap_or(Path::new("."));
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        fs::create_dir_all(folder).map_err(|cause| unwritable(folder, "created", cause))?;
        let temporary = temporary(parent, &name)?;
        for (file, bytes) in files {
            write_flushed(&temporary.folder().join(file), bytes)?;
        }
        let _turn = Turn::wait(folder);
        let order = files.keys().filter(|file| *file != last).map(String::as_str);
        for file in order {
            rename(&temporary.folder().join(file), &folder.join(file))?;
        }
        flush_folder(folder);
        rename(&temporary.folder().join(last), &folder.join(last))?;
        flush_folder(folder);
        remove_stale(folder, |file| stale(file) && !files.contains_key(file));
        Ok(())
    }

    /// Whether something can be published in `folder`, which need not be there yet; leaves no trace.
    pub fn probe(&self, folder: &Path) -> Result<(), Error> {
        let _busy = self.halt();
        let mut existing = folder;
        while existing.symlink_metadata().is_err() {
            existing = match existing.parent() {
                Some(parent) if parent != Path::new("") => parent,
                _ => Path::new("."),
            };
        }
        temporary(existing, "probe").map(drop).map_err(|error| match error {
            Error::System { cause, .. } => unwritable(folder, "written", cause),
            other => other,
        })
    }

    /// Replaces the file at `path` by `bytes`.
    pub fn file(&self, path: &Path, bytes: &[u8]) -> Result<(), Error> {
        self.update(path, |_| Some(bytes.into()))
    }

    /// Replaces the file at `path` by what `change` makes of it; nothing where that gives nothing, or what is there.
    ///
    /// No other publisher, of this process or another, comes between reading and writing.
    pub fn update(&self, path: &Path, change: impl FnOnce(Option<&[u8]>) -> Option<Vec<u8>>) -> Result<(), Error> {
        let _busy = self.halt();
        let parent = path.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(|cause| unwritable(parent, "created", cause))?;
        let _turn = Turn::wait(parent);
        let old = fs::read(path).ok();
        let Some(new) = change(old.as_deref()).filter(|new| Some(new) != old.as_ref()) else { return Ok(()) };
        let temporary = temporary(parent, &path.file_name().unwrap_or_default().to_string_lossy())?;
        let written = temporary.folder().join("new");
        write_flushed(&written, &new)?;
        rename(&written, path)?;
        flush_folder(parent);
        Ok(())
    }

    /// Removes what dead processes left in `folder`, the parent of published folders.
    pub fn sweep(&self, folder: &Path) {
        let _busy = self.halt();
        collect_orphans(folder, "."); // ours begin with a dot
    }
}

/// A temporary folder for `name` in `parent`, after what dead processes left for it is gone.
fn temporary(parent: &Path, name: &str) -> Result<Scratch, Error> {
    let prefix = format!(".{name}.");
    collect_orphans(parent, &prefix);
    Scratch::claim(parent, &prefix).map_err(|cause| unwritable(&parent.join(format!("{prefix}tmp")), "created", cause))
}

/// Keeps other processes from publishing in `folder` while it lives, where the system lets a folder be locked.
struct Turn(Option<File>);

impl Turn {
    fn wait(folder: &Path) -> Self {
        Self(File::open(folder).ok().filter(|folder| folder.lock().is_ok()))
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        if let Some(folder) = &self.0 {
            let _ = folder.unlock();
        }
    }
}

/// Writes a new file and waits until it is on the disk.
fn write_flushed(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let write = || -> std::io::Result<()> {
        let mut file = File::create_new(path)?;
        file.write_all(bytes)?;
        file.sync_all()
    };
    write().map_err(|cause| unwritable(path, "written", cause))
}

/// Renames, replacing what is there.
fn rename(from: &Path, to: &Path) -> Result<(), Error> {
    fs::rename(from, to).map_err(|cause| unwritable(to, "replaced", cause))
}

/// Makes renames in a folder last; file systems that cannot do it have nothing to lose.
fn flush_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}

/// Deletes the files of a folder that are no longer named by anything.
fn remove_stale(folder: &Path, stale: impl Fn(&str) -> bool) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if stale(&entry.file_name().to_string_lossy()) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// The error of a path that cannot be written.
fn unwritable(path: &Path, action: &'static str, cause: std::io::Error) -> Error {
    Error::system(&path.display().to_string(), action, cause)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    fn files(names: &[&str]) -> BTreeMap<String, Vec<u8>> {
        names.iter().map(|name| (name.to_string(), name.as_bytes().to_vec())).collect()
    }

    #[test]
    fn a_second_publication_replaces_the_first_and_leaves_strangers_alone() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("bark");
        let publisher = Publisher::default();
        let stale = |name: &str| name.ends_with(".ktx2");
        publisher.folder(&folder, &files(&["a.ktx2", "asset.json"]), "asset.json", stale).unwrap();
        fs::write(folder.join("notes.txt"), "mine").unwrap();
        publisher.folder(&folder, &files(&["b.ktx2", "asset.json"]), "asset.json", stale).unwrap();
        assert_eq!(names(&folder), ["asset.json", "b.ktx2", "notes.txt"]);
        assert_eq!(names(root.path()), ["bark"]);
    }

    #[test]
    fn a_failed_publication_leaves_the_old_set() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("bark");
        let publisher = Publisher::default();
        fs::create_dir_all(folder.join("b.ktx2")).unwrap(); // a folder stands in a payload's place
        fs::write(folder.join("asset.json"), "old").unwrap();
        publisher.folder(&folder, &files(&["b.ktx2", "asset.json"]), "asset.json", |_| false).unwrap_err();
        assert_eq!(fs::read(folder.join("asset.json")).unwrap(), b"old");
        assert_eq!(names(root.path()), ["bark"]);
    }
}
