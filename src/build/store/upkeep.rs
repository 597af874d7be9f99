//! What is in a store, what is wrong with it, and how it stays within a size.

use std::collections::BTreeSet;
use std::fs::{self, DirEntry, Metadata};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::Store;
use super::local::{Found, parse_record};
use crate::build::action::Record;
use crate::build::key::Digest;
use crate::io::scratch;

/// Of the limit, this much is left by an eviction: the next builds have room before there is another.
const AFTER_EVICTION: f64 = 0.9;

/// The contents of a store.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Records of actions.
    pub records: u64,
    /// Their bytes.
    pub record_bytes: u64,
    /// Artifacts.
    pub artifacts: u64,
    /// Their bytes.
    pub artifact_bytes: u64,
    /// Artifacts that no record names, and temporary folders that nobody holds.
    pub orphans: u64,
}

/// What an upkeep removed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Removed {
    /// Temporary folders of dead processes, artifacts that no record names, records whose artifacts are gone.
    pub orphans: u64,
    /// Artifacts that were used longest ago.
    pub evicted: u64,
    /// Bytes of both.
    pub bytes: u64,
}

/// A file that is not what its name says.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Damage {
    /// The file.
    pub path: PathBuf,
    /// Whether it could be removed.
    pub is_removed: bool,
}

/// A file of the store.
struct Entry {
    path: PathBuf,
    name: Option<Digest>,
    bytes: u64,
    used: SystemTime,
}

impl Store {
    /// What is in the store.
    pub fn stats(&self) -> Stats {
        let (records, artifacts) = (self.entries("records"), self.entries("artifacts"));
        let bytes = |entries: &[Entry]| entries.iter().map(|entry| entry.bytes).sum();
        let named = self.named(&records);
        let unnamed = artifacts.iter().filter(|entry| entry.name.is_none_or(|name| !named.contains(&name))).count();
        // one temporary folder is our own
        let tmp = scratch::count(&self.local.path("tmp")).saturating_sub(usize::from(self.local.is_writable()));
        Stats {
            records: records.len() as u64,
            record_bytes: bytes(&records),
            artifacts: artifacts.len() as u64,
            artifact_bytes: bytes(&artifacts),
            orphans: (unnamed + tmp) as u64,
        }
    }

    /// Removes orphans, then what was used longest ago until the store is within `limit` bytes.
    ///
    /// Another build that works meanwhile loses at most a result that it makes again.
    pub fn collect(&self, limit: u64) -> Removed {
        let mut removed =
            Removed { orphans: scratch::collect_orphans(&self.local.path("tmp"), "") as u64, ..Removed::default() };
        let records = self.entries("records");
        let named = self.named(&records);
        let (mut artifacts, unnamed): (Vec<Entry>, Vec<Entry>) = self
            .entries("artifacts")
            .into_iter()
            .partition(|entry| entry.name.is_some_and(|name| named.contains(&name)));
        for entry in &unnamed {
            removed.orphans += remove(entry, &mut removed.bytes);
        }
        let mut total: u64 = records.iter().chain(&artifacts).map(|entry| entry.bytes).sum();
        if total > limit {
            artifacts.sort_by(|a, b| (a.used, &a.path).cmp(&(b.used, &b.path)));
            for entry in &artifacts {
                if total as f64 <= limit as f64 * AFTER_EVICTION {
                    break;
                }
                removed.evicted += remove(entry, &mut removed.bytes);
                total = total.saturating_sub(entry.bytes);
            }
        }
        // A record without its artifacts is of no use, but that of an asset: it tells that what is published is current.
        for entry in &records {
            let dangles = |record: Record| {
                record.facts.levels.is_empty() && record.outputs.iter().any(|output| !self.local.has_artifact(output))
            };
            if self.parsed(entry).is_some_and(dangles) {
                removed.orphans += remove(entry, &mut removed.bytes);
            }
        }
        removed
    }

    /// [`Self::collect`], where the store is larger than `limit`.
    pub fn collect_beyond(&self, limit: u64) {
        let bytes: u64 =
            ["records", "artifacts"].iter().flat_map(|kind| self.entries(kind)).map(|entry| entry.bytes).sum();
        if bytes > limit {
            self.collect(limit);
        }
    }

    /// Reads everything; what is not what its name says is removed, so that the next build makes it again.
    pub fn verify(&self) -> Vec<Damage> {
        let mut damages = Vec::new();
        for (kind, is_record) in [("records", true), ("artifacts", false)] {
            for entry in self.entries(kind) {
                let is_whole = entry.name.zip(fs::read(&entry.path).ok()).is_some_and(|(name, bytes)| {
                    if is_record { parse_record(&bytes, name) != Found::Damaged } else { Digest::of(&bytes) == name }
                });
                if !is_whole {
                    let is_removed = fs::remove_file(&entry.path).is_ok();
                    damages.push(Damage { path: entry.path, is_removed });
                }
            }
        }
        damages.sort();
        damages
    }

    /// Every record that is here.
    pub fn records(&self) -> Vec<Record> {
        self.entries("records").iter().filter_map(|entry| self.parsed(entry)).collect()
    }

    /// All digests that a record names.
    fn named(&self, records: &[Entry]) -> BTreeSet<Digest> {
        let outputs = records.iter().filter_map(|entry| self.parsed(entry)).flat_map(|record| record.outputs);
        outputs.map(|output| output.digest).collect()
    }

    fn parsed(&self, entry: &Entry) -> Option<Record> {
        match parse_record(&fs::read(&entry.path).ok()?, entry.name?) {
            Found::Whole(record) => Some(record),
            _ => None,
        }
    }

    /// All files of `kind`, by path.
    fn entries(&self, kind: &str) -> Vec<Entry> {
        let mut entries: Vec<Entry> =
            folder(&self.local.path(kind)).flat_map(|shard| folder(&shard.path())).filter_map(entry).collect();
        entries.sort_by(|a, b| a.path.cmp(&b.path));
        entries
    }
}

fn folder(path: &Path) -> impl Iterator<Item = DirEntry> + use<> {
    fs::read_dir(path).into_iter().flatten().flatten()
}

fn entry(found: DirEntry) -> Option<Entry> {
    let metadata = found.metadata().ok().filter(Metadata::is_file)?;
    let name = Digest::from_hex(&found.file_name().to_string_lossy());
    Some(Entry {
        path: found.path(),
        name,
        bytes: metadata.len(),
        used: metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH),
    })
}

/// Removes a file; 1 if it did.
fn remove(entry: &Entry, bytes: &mut u64) -> u64 {
    let is_removed = fs::remove_file(&entry.path).is_ok();
    *bytes += if is_removed { entry.bytes } else { 0 };
    u64::from(is_removed)
}
