//! What a build cost and reached, a level a line: `OUT/build.jsonl`. Never part of an asset.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use formats::asset::LevelError;
use serde::{Deserialize, Serialize};

use crate::io::publish::Publisher;
use crate::io::{Error, SourceFile};

/// Name of the file in the output folder.
pub const RECORDS: &str = "build.jsonl";

/// One built level.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LevelRecord {
    /// Surface.
    pub name: String,
    /// Number of the level, from 1.
    pub level: u32,
    /// Source texels a cell along u and v.
    pub factor: [f64; 2],
    /// Cells along u and v.
    pub cells: [usize; 2],
    /// Most lobes of a cell.
    pub lobes: usize,
    /// Patches of T along u and v.
    #[serde(rename = "M")]
    pub patches: [usize; 2],
    /// Direction cells of S per axis.
    #[serde(rename = "N")]
    pub directions: usize,
    /// Terms of the scaling.
    pub rank: usize,
    /// ε below 75° of the fit at its own nodes.
    pub on_node: f64,
    /// Measured error, if it was measured.
    pub error: Option<LevelError>,
    /// ε below 75° that was aimed at.
    pub target: f64,
    /// CPU seconds by stage, in order.
    pub stages: Vec<StageSeconds>,
    /// Bytes by part.
    pub bytes: BTreeMap<String, u64>,
    /// The most bytes that the process had held by the end of the level.
    pub peak_bytes: u64,
    /// BLAKE3 of the `asset.json` that the level belongs to, 64 hex digits.
    pub asset: String,
}

/// CPU seconds of one stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageSeconds {
    /// The stage.
    pub stage: String,
    /// CPU seconds of all threads.
    pub cpu_seconds: f64,
}

impl LevelRecord {
    /// The record as one line of JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("numbers and strings are JSON")
    }

    /// Whether the measured error is above its target.
    pub fn missed(&self) -> bool {
        self.error.is_some_and(|error| error.below_75.value > self.target)
    }
}

/// The records in `out`; none where there is no such file, and lines of other making are passed over.
pub fn read(out: &Path) -> Vec<LevelRecord> {
    let Ok(file) = SourceFile::read(&out.join(RECORDS)) else { return Vec::new() };
    parse(file.bytes())
}

fn parse(bytes: &[u8]) -> Vec<LevelRecord> {
    String::from_utf8_lossy(bytes).lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

/// Makes the records of the surfaces in `new` the only ones of their names in `out`; those of other surfaces stay.
pub fn replace(out: &Path, new: &[LevelRecord], publisher: &Publisher) -> Result<(), Error> {
    let names: BTreeSet<&str> = new.iter().map(|record| record.name.as_str()).collect();
    publisher.update(&out.join(RECORDS), |old| {
        let mut records = parse(old.unwrap_or_default());
        let of_new = |record: &LevelRecord| names.contains(record.name.as_str());
        // Nothing is rewritten that is only in another order.
        let current: Vec<&LevelRecord> = records.iter().filter(|record| of_new(record)).collect();
        if current.len() == new.len() && new.iter().all(|record| current.contains(&record)) {
            return None;
        }
        records.retain(|record| !of_new(record));
        records.extend_from_slice(new);
        Some(records.iter().map(|record| record.to_json() + "\n").collect::<String>().into_bytes())
    })
}
