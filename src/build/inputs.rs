//! Digests of files, found once: a file whose size, times and inode are those of last time is not read again.
//!
//! A file that was changed within `GRAIN` before it was hashed may be changed again without a trace in its times, so
//! its digest is not remembered: what git calls racily clean. Times are those that the system keeps; the change time,
//! which no program sets, is among them where there is one.

use std::collections::BTreeMap;
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};

use super::key::Digest;
use super::store::Store;
use crate::io::{Error, SourceFile};

/// Name of the file in the cache's folder.
const FILE: &str = "inputs";

/// The coarsest times of a file system in use: FAT counts in two seconds.
const GRAIN: Duration = Duration::from_secs(2);

/// Digests by path.
#[derive(Debug)]
pub struct InputDigests {
    known: Mutex<Known>,
}

#[derive(Debug, Default)]
struct Known {
    entries: BTreeMap<PathBuf, Entry>,
    is_changed: bool,
}

/// A file as it was when it was hashed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Entry {
    stamp: Stamp,
    digest: Digest,
}

/// What the system says of a file; nanoseconds since 1970.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Stamp {
    bytes: u64,
    modified: u64,
    changed: u64,
    inode: u64,
}

impl InputDigests {
    /// What `store` remembers; nothing, where that is not exactly as it was written.
    pub fn open(store: &Store) -> Self {
        let entries = store.note(FILE).and_then(|bytes| parse(&bytes)).unwrap_or_default();
        Self { known: Mutex::new(Known { entries, is_changed: false }) }
    }

    /// BLAKE3 of the file at `path`.
    pub fn digest(&self, path: &Path) -> Result<Digest, Error> {
        let name = std::path::absolute(path).unwrap_or_else(|_| path.into());
        let before = stamp(path);
        if let Some(entry) = self.known().entries.get(&name).filter(|entry| Some(entry.stamp) == before) {
            return Ok(entry.digest);
        }
        let start = SystemTime::now();
        let digest: Digest = SourceFile::digest(path)?.into();
        let mut known = self.known();
        // The file that was hashed is the one that was looked at, before and after, and has been still for a while.
        match before.filter(|before| stamp(path) == Some(*before) && before.is_settled(start)) {
            Some(stamp) => {
                known.entries.insert(name, Entry { stamp, digest });
                known.is_changed = true;
            }
            None => known.is_changed |= known.entries.remove(&name).is_some(),
        }
        Ok(digest)
    }

    /// Forgets a file whose content was found to be another.
    pub fn forget(&self, path: &Path) {
        let name = std::path::absolute(path).unwrap_or_else(|_| path.into());
        let mut known = self.known();
        known.is_changed |= known.entries.remove(&name).is_some();
    }

    /// Remembers what was found, if anything was. A failure costs hashing next time.
    pub fn save(&self, store: &Store) {
        let mut known = self.known();
        if std::mem::take(&mut known.is_changed) {
            known.entries.retain(|path, _| path.exists());
            // A path that is no text cannot be written as JSON, and is hashed every time.
            let entries: Vec<_> = known.entries.iter().filter(|(path, _)| path.to_str().is_some()).collect();
            let json = serde_json::to_vec(&entries).expect("text and numbers are JSON");
            let bytes = [Digest::of(&json).to_string().as_bytes(), b"\n", &json].concat();
            store.keep_note(FILE, &bytes);
        }
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Stamp {
    /// Whether a change after `at` would show in the times.
    fn is_settled(&self, at: SystemTime) -> bool {
        let at = nanoseconds(at).saturating_sub(GRAIN.as_nanos() as u64);
        self.modified < at && self.changed < at
    }
}

/// The entries in `bytes`, whose first line is the digest of the rest.
fn parse(bytes: &[u8]) -> Option<BTreeMap<PathBuf, Entry>> {
    let (digest, json) = bytes.split_at_checked(65)?;
    let digest = Digest::from_hex(std::str::from_utf8(&digest[..64]).ok()?)?;
    let entries: Vec<(PathBuf, Entry)> = serde_json::from_slice(json).ok().filter(|_| Digest::of(json) == digest)?;
    Some(entries.into_iter().collect())
}

fn nanoseconds(time: SystemTime) -> u64 {
    time.duration_since(UNIX_EPOCH).map_or(0, |since| u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
}

fn stamp(path: &Path) -> Option<Stamp> {
    let metadata = std::fs::metadata(path).ok()?;
    let [changed, inode] = kept_by_the_system(&metadata);
    Some(Stamp { bytes: metadata.len(), modified: nanoseconds(metadata.modified().ok()?), changed, inode })
}

#[cfg(unix)]
fn kept_by_the_system(metadata: &Metadata) -> [u64; 2] {
    use std::os::unix::fs::MetadataExt;
    [(metadata.ctime() * 1_000_000_000 + metadata.ctime_nsec()) as u64, metadata.ino()]
}

#[cfg(not(unix))]
fn kept_by_the_system(_: &Metadata) -> [u64; 2] {
    [0; 2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{self, File};

    /// A file that was last changed at `age` before now, as far as its modification time tells.
    fn aged(path: &Path, bytes: &[u8], age: u64) {
        fs::write(path, bytes).unwrap();
        File::open(path).unwrap().set_modified(SystemTime::now() - Duration::from_secs(age)).unwrap();
    }

    #[test]
    fn a_file_that_was_just_changed_is_read_again() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("bark.png");
        let digests = InputDigests::open(&Store::open(root.path(), None));
        // Same size, same modification time, changed twice within the grain of the change time.
        for content in [b"one", b"two"] {
            aged(&path, content, 3600);
            assert_eq!(digests.digest(&path).unwrap(), Digest::of(content));
        }
        assert!(digests.known().entries.is_empty());
    }

    #[test]
    fn what_is_remembered_is_believed_only_as_it_was_written() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("bark.png");
        aged(&path, b"bark", 0);
        let stamp = stamp(&path).unwrap();
        assert!(!stamp.is_settled(SystemTime::now()) && stamp.is_settled(SystemTime::now() + 2 * GRAIN));
        let store = Store::open(root.path(), None);
        let digests = InputDigests::open(&store);
        let entry = Entry { stamp, digest: Digest::of(b"not read") };
        digests.known().entries.insert(path.clone(), entry);
        digests.known().is_changed = true;
        digests.save(&store);
        let again = InputDigests::open(&store);
        assert_eq!(again.digest(&path).unwrap(), Digest::of(b"not read"), "the file was not read");
        let mut bytes = fs::read(root.path().join(FILE)).unwrap();
        let at = bytes.len() - 20;
        bytes[at] ^= 1;
        fs::write(root.path().join(FILE), bytes).unwrap();
        assert_eq!(InputDigests::open(&store).digest(&path).unwrap(), Digest::of(b"bark"));
    }
}
