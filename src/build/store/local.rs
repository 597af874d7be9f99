//! Records and artifacts as files of one folder.
//!
//! ```text
//! ROOT/records/ab/KEY           checksum, then a [`Record`] as JSON
//! ROOT/artifacts/ab/DIGEST      the bytes that have this digest
//! ROOT/tmp/                     what is being written; claimed by locks
//! ```
//!
//! A file is written in `tmp` and renamed into its place, so that no reader meets half of it. Nothing is flushed, for
//! nothing is trusted: whatever is read is held against its digest, and what a power cut has torn is made again.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, SystemTime};

use crate::build::action::{Output, Record};
use crate::build::key::Digest;
use crate::io::scratch::{Scratch, collect_orphans};

/// How long a file counts as just used: the order of use is known to the hour, and a build that reads writes little.
const USE_GRAIN: Duration = Duration::from_secs(3600);

/// What was found under a name.
#[derive(Debug, PartialEq)]
pub(super) enum Found<T> {
    /// The thing itself.
    Whole(T),
    /// Nothing.
    Nothing,
    /// Something else than what the name says; it has been removed where that was possible.
    Damaged,
}

/// A store in a folder.
#[derive(Debug)]
pub(super) struct Local {
    root: PathBuf,
    /// Where files are written; `None` where nothing can be.
    scratch: Option<Scratch>,
    /// Cleared when the disk is full or the permission is gone.
    is_writable: AtomicBool,
    /// Files written, which numbers them.
    written: AtomicU64,
}

impl Local {
    /// The store in `root`, made if it is not there; why it cannot be written to, if so.
    pub(super) fn open(root: &Path) -> (Self, Option<io::Error>) {
        let tmp = root.join("tmp");
        let claim = || -> io::Result<Scratch> {
            fs::create_dir_all(&tmp)?;
            collect_orphans(&tmp, "");
            Scratch::claim(&tmp, "")
        };
        let (scratch, error) = match claim() {
            Ok(scratch) => (Some(scratch), None),
            Err(error) => (None, Some(error)),
        };
        let is_writable = AtomicBool::new(scratch.is_some());
        (Self { root: root.into(), scratch, is_writable, written: AtomicU64::new(0) }, error)
    }

    /// The store in `root` as it is; nothing is written to it.
    pub(super) fn open_to_read(root: &Path) -> Self {
        Self { root: root.into(), scratch: None, is_writable: AtomicBool::new(false), written: AtomicU64::new(0) }
    }

    /// The folder.
    pub(super) fn root(&self) -> &Path {
        &self.root
    }

    /// Whether anything was written since it was opened.
    pub(super) fn was_written(&self) -> bool {
        self.written.load(Ordering::Relaxed) > 0
    }

    /// Whether it takes files.
    pub(super) fn is_writable(&self) -> bool {
        self.is_writable.load(Ordering::Relaxed)
    }

    /// The record of `key`.
    pub(super) fn record(&self, key: Digest) -> Found<Record> {
        let path = self.path(&record_path(key));
        let Ok(bytes) = fs::read(&path) else { return Found::Nothing };
        match parse_record(&bytes, key) {
            Found::Damaged => {
                let _ = fs::remove_file(&path);
                Found::Damaged
            }
            found => {
                self.touch(&path);
                found
            }
        }
    }

    /// The bytes of `output`.
    pub(super) fn artifact(&self, output: &Output) -> Found<Vec<u8>> {
        let path = self.path(&artifact_path(output.digest));
        let Ok(bytes) = fs::read(&path) else { return Found::Nothing };
        if Digest::of(&bytes) != output.digest {
            let _ = fs::remove_file(&path);
            return Found::Damaged;
        }
        self.touch(&path);
        Found::Whole(bytes)
    }

    /// Whether there is a file for `output`, of the right length.
    pub(super) fn has_artifact(&self, output: &Output) -> bool {
        fs::metadata(self.path(&artifact_path(output.digest))).is_ok_and(|metadata| metadata.len() == output.bytes)
    }

    /// Keeps the bytes of an artifact.
    pub(super) fn put_artifact(&self, output: &Output, bytes: &[u8]) -> io::Result<()> {
        if self.has_artifact(output) {
            return Ok(());
        }
        self.put(&artifact_path(output.digest), bytes)
    }

    /// Keeps a record.
    pub(super) fn put_record(&self, record: &Record) -> io::Result<()> {
        self.put(&record_path(record.key), &record_bytes(record))
    }

    /// Puts `bytes` at `path`, whole or not at all.
    pub(super) fn put(&self, path: &str, bytes: &[u8]) -> io::Result<()> {
        let Some(scratch) = self.scratch.as_ref().filter(|_| self.is_writable()) else { return Ok(()) };
        let number = self.written.fetch_add(1, Ordering::Relaxed);
        if number == 0 {
            self.keep_out_of_repositories();
        }
        let written = scratch.folder().join(number.to_string());
        let place = self.path(path);
        let renamed = || match fs::rename(&written, &place) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                fs::create_dir_all(place.parent().unwrap_or(&self.root))?;
                fs::rename(&written, &place)
            }
            done => done,
        };
        let put = fs::write(&written, bytes).and_then(|()| renamed());
        if put.is_err() {
            let _ = fs::remove_file(&written);
            self.is_writable.store(false, Ordering::Relaxed);
        }
        put
    }

    /// A cache is nobody's source. Where this fails, the first file of the store fails too, and is told of.
    fn keep_out_of_repositories(&self) {
        let ignored = self.path(".gitignore");
        if !ignored.exists() {
            let _ = fs::write(ignored, "*\n");
        }
    }

    /// The file of a name within the store.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Notes that a file was used: what was used last is evicted last.
    pub(super) fn touch(&self, path: &Path) {
        let now = SystemTime::now();
        let is_old = |at: SystemTime| now.duration_since(at).is_ok_and(|age| age > USE_GRAIN);
        let Ok(modified) = fs::metadata(path).and_then(|metadata| metadata.modified()) else { return };
        if self.is_writable() && is_old(modified) {
            let _ = File::open(path).and_then(|file| file.set_modified(now));
        }
    }
}

/// Where the record of `key` stands, in a folder or a bucket.
pub(super) fn record_path(key: Digest) -> String {
    let key = key.to_string();
    format!("records/{}/{key}", &key[..2])
}

/// Where the bytes with this digest stand.
pub(super) fn artifact_path(digest: Digest) -> String {
    let digest = digest.to_string();
    format!("artifacts/{}/{digest}", &digest[..2])
}

/// A record as it is stored: the digest of the rest on a line, then JSON.
pub(super) fn record_bytes(record: &Record) -> Vec<u8> {
    let json = serde_json::to_vec(record).expect("a record is JSON");
    [Digest::of(&json).to_string().as_bytes(), b"\n", &json].concat()
}

/// The record of `key` in `bytes`; one that another version of the program wrote is none.
pub(super) fn parse_record(bytes: &[u8], key: Digest) -> Found<Record> {
    let digest = bytes.get(..64).and_then(|hex| std::str::from_utf8(hex).ok()).and_then(Digest::from_hex);
    match (digest, bytes.get(65..)) {
        (Some(digest), Some(json)) if bytes[64] == b'\n' && Digest::of(json) == digest => {
            match serde_json::from_slice::<Record>(json) {
                Ok(record) if record.key == key => Found::Whole(record),
                Ok(_) => Found::Damaged,
                Err(_) => Found::Nothing,
            }
        }
        _ => Found::Damaged,
    }
}
