//! One step of a build as a pure function: inputs and settings to an artifact.

use std::sync::Arc;

use super::artifact::Artifact;
use super::key::{Digest, Walk};
use super::record::{LevelRecord, StageSeconds};
use super::volume::VolumeRecord;
use serde::{Deserialize, Serialize};

/// What an action does. No step needs anything but itself and the results of the actions it needs: it looks at no clock,
/// no environment, and at no file but one whose digest it visits.
pub trait Step: Sync {
    /// Name of the stage, as in `lobes`.
    fn stage(&self) -> &'static str;

    /// Raised when the stage writes other bytes for the same inputs and settings.
    fn version(&self) -> u32;

    /// Visits all settings and inputs that the artifact depends on; `needs` are the results of the needed actions.
    fn walk(&self, needs: &[Arc<Record>], walk: &mut Walk);

    /// The most bytes that [`Self::run`] holds at once, its artifact included, its inputs not.
    fn working_bytes(&self, needs: &[Arc<Record>]) -> u64;

    /// Computes the artifact; `on_stage` hears of the parts of the work as they begin.
    fn run(&self, needs: &[Need], on_stage: &mut dyn FnMut(&'static str)) -> Result<Made, Failure>;

    /// Whether [`Self::run`] takes more than the record of the need of this number.
    fn loads(&self, _need: usize, _needs: &[Arc<Record>]) -> bool {
        true
    }

    /// Whether others than this machine may want the artifact: what is had from an input faster than from a network is
    /// not shared.
    fn is_shared(&self) -> bool {
        true
    }
}

/// The result of a needed action.
#[derive(Clone, Debug)]
pub struct Need {
    /// What is known about it.
    pub record: Arc<Record>,
    /// What it made, where the step loads it.
    pub artifact: Option<Arc<Artifact>>,
}

/// What a step made.
#[derive(Debug)]
pub struct Made {
    /// The artifact.
    pub artifact: Artifact,
    /// What others want to know of it without loading it.
    pub facts: Facts,
}

impl From<Artifact> for Made {
    fn from(artifact: Artifact) -> Self {
        Self { artifact, facts: Facts::default() }
    }
}

/// Why a step made nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The input or a setting is at fault: one line.
    Refused(String),
    /// A file is no longer what its digest says: it was edited while the build ran.
    InputChanged,
}

/// What is known of a finished action: enough for the keys of those that need it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The action's key, so that a record is of use to no other.
    pub key: Digest,
    /// The artifact as stored: one file, or the files of an asset.
    pub outputs: Vec<Output>,
    /// What is known without loading it.
    pub facts: Facts,
    /// What making it cost. No output depends on it.
    pub cost: Vec<StageSeconds>,
    /// The most bytes that the process had held by then.
    pub peak_bytes: u64,
}

/// A stored file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Output {
    /// File name in an asset; empty for an artifact that is one file.
    pub name: String,
    /// Digest of its bytes.
    pub digest: Digest,
    /// Their number.
    pub bytes: u64,
}

impl Output {
    /// The file `name` that holds `bytes`.
    pub fn of(name: &str, bytes: &[u8]) -> Self {
        Self { name: name.into(), digest: Digest::of(bytes), bytes: bytes.len() as u64 }
    }
}

impl Record {
    /// What stands for the content in the keys of other actions.
    pub fn digest(&self) -> Digest {
        match self.outputs.as_slice() {
            [only] => only.digest,
            several => {
                let mut walk = Walk::new("outputs", 1);
                several.iter().for_each(|output| walk.input(&output.name, output.digest));
                walk.key()
            }
        }
    }

    /// Bytes of all outputs.
    pub fn bytes(&self) -> u64 {
        self.outputs.iter().map(|output| output.bytes).sum()
    }
}

/// Small results that travel with a record.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Facts {
    /// Texels of a map along u and v.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[usize; 2]>,
    /// What the user should know, one line each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// The levels of a surface's asset.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub levels: Vec<LevelRecord>,
    /// The levels of a volume's asset.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub volume_levels: Vec<VolumeRecord>,
}
