//! What was made before, by the key of the action that made it.
//!
//! A [`Store`] is a folder (`local`) and, if the user has one, an object store that several machines share
//! (`remote`). It holds records, which say what an action made and what is known of it, and artifacts by their digest.
//! Nothing read from it is believed before its digest is checked; what is damaged or missing is no error: the action
//! runs again. Failures to write cost time later and nothing now. All of these are [`Store::notices`].

mod local;
mod remote;
mod upkeep;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use super::action::{Output, Record};
use super::artifact::Artifact;
use super::key::Digest;
use local::{Found, Local};
pub use remote::{Remote, RemoteError};
pub use upkeep::{Damage, Removed, Stats};

/// Records and artifacts of earlier builds.
#[derive(Debug)]
pub struct Store {
    local: Arc<Local>,
    remote: Option<Arc<Remote>>,
    uploads: Mutex<Option<Uploads>>,
    notices: Mutex<Vec<String>>,
    differing: AtomicUsize,
}

/// The thread that copies new results to the remote store.
#[derive(Debug)]
struct Uploads {
    queue: Sender<Record>,
    thread: JoinHandle<()>,
}

impl Store {
    /// The store in the folder `root`, made if it is not there, with a remote one behind it.
    pub fn open(root: &Path, remote: Option<Remote>) -> Self {
        let (local, error) = Local::open(root);
        let notice = error.map(|error| {
            format!("`{}`: cannot be written to, so results of this build are not kept: {error}", root.display())
        });
        let (local, remote) = (Arc::new(local), remote.map(Arc::new));
        let uploads = remote.as_ref().filter(|_| local.is_writable()).map(|remote| Uploads::start(&local, remote));
        let notices = Mutex::new(notice.into_iter().collect());
        Self { local, remote, uploads: Mutex::new(uploads), notices, differing: AtomicUsize::new(0) }
    }

    /// The store in the folder `root` as it is, which need not be there; nothing is written to it.
    pub fn open_to_read(root: &Path) -> Self {
        let local = Arc::new(Local::open_to_read(root));
        Self {
            local,
            remote: None,
            uploads: Mutex::default(),
            notices: Mutex::default(),
            differing: AtomicUsize::new(0),
        }
    }

    /// Whether looking further than [`Self::record_nearby`] may find more.
    pub fn has_remote(&self) -> bool {
        self.remote.is_some()
    }

    /// Whether what is kept can be had again: not where the store is read-only, or full.
    pub fn keeps_results(&self) -> bool {
        self.local.is_writable()
    }

    /// The record of `key` on this machine.
    pub fn record_nearby(&self, key: Digest) -> Option<Record> {
        match self.local.record(key) {
            Found::Whole(record) => Some(record),
            Found::Nothing => None,
            Found::Damaged => {
                self.notice(format!("record {} in the cache is damaged; its action is looked up anew", key.short()));
                None
            }
        }
    }

    /// The record of `key` in the remote store, kept here from now on.
    pub fn record_far(&self, key: Digest) -> Option<Record> {
        let remote = self.remote.as_ref()?;
        let bytes = self.heard(remote.get(&local::record_path(key), MAX_RECORD))?;
        match local::parse_record(&bytes, key) {
            Found::Whole(record) => {
                self.written(self.local.put_record(&record));
                Some(record)
            }
            Found::Nothing => None,
            Found::Damaged => {
                remote.distrust(&local::record_path(key));
                self.notice(format!("record {} in the remote store is damaged; it is not used", key.short()));
                None
            }
        }
    }

    /// The files of `record` with their names, every one as its digest says; `None` where one cannot be had.
    pub fn files(&self, record: &Record) -> Option<Vec<(String, Vec<u8>)>> {
        let file = |output: &Output| Some((output.name.clone(), self.bytes(output)?));
        let files: Option<Vec<_>> = record.outputs.iter().map(file).collect();
        if let (None, Some(remote)) = (&files, &self.remote) {
            // Those after the first bad one were not looked at: all of them are written anew.
            record.outputs.iter().for_each(|output| remote.distrust(&local::artifact_path(output.digest)));
        }
        files
    }

    /// The artifact of `record`; `None` where it cannot be had.
    pub fn artifact(&self, record: &Record) -> Option<Artifact> {
        Artifact::decode(self.files(record)?)
    }

    fn bytes(&self, output: &Output) -> Option<Vec<u8>> {
        match self.local.artifact(output) {
            Found::Whole(bytes) => return Some(bytes),
            Found::Nothing => {}
            Found::Damaged => {
                self.notice(format!("artifact {} in the cache is damaged; it is made again", output.digest.short()));
            }
        }
        let remote = self.remote.as_ref()?;
        let path = local::artifact_path(output.digest);
        let bytes = self.heard(remote.get(&path, output.bytes))?;
        if Digest::of(&bytes) != output.digest {
            remote.distrust(&path);
            let short = output.digest.short();
            self.notice(format!("artifact {short} in the remote store is not what its name says; it is not used"));
            return None;
        }
        self.written(self.local.put_artifact(output, &bytes));
        Some(bytes)
    }

    /// Keeps what an action made: its files, then the record that names them. `is_shared` offers it to other machines.
    ///
    /// What was kept under the same key must be the same: a difference is counted, and told of.
    pub fn keep(&self, record: &Record, files: &[(String, Vec<u8>)], is_shared: bool) {
        if let Found::Whole(old) = self.local.record(record.key)
            && old.outputs != record.outputs
        {
            self.differing.fetch_add(1, Ordering::Relaxed);
            let short = record.key.short();
            self.notice(format!("action {short} gave other bytes than before for the same inputs: a bug of farfield"));
        }
        let kept = record
            .outputs
            .iter()
            .zip(files)
            .try_for_each(|(output, (_, bytes))| self.local.put_artifact(output, bytes))
            .and_then(|()| self.local.put_record(record));
        self.written(kept);
        if let Some(uploads) = self.uploads().as_ref().filter(|_| is_shared && self.local.is_writable()) {
            let _ = uploads.queue.send(record.clone());
        }
    }

    /// Notes that what `record` names is still of use, though nobody reads it.
    pub fn touch(&self, record: &Record) {
        record
            .outputs
            .iter()
            .for_each(|output| self.local.touch(&self.local.path(&local::artifact_path(output.digest))));
    }

    /// Keeps something of a build that no result depends on; a failure costs no more than that.
    pub fn keep_note(&self, name: &str, bytes: &[u8]) {
        self.written(self.local.put(name, bytes));
    }

    /// What was kept under this name.
    pub fn note(&self, name: &str) -> Option<Vec<u8>> {
        std::fs::read(self.local.path(name)).ok()
    }

    /// Whether anything was written since it was opened.
    pub fn was_written(&self) -> bool {
        self.local.was_written()
    }

    /// How many actions gave other bytes than before.
    pub fn differing(&self) -> usize {
        self.differing.load(Ordering::Relaxed)
    }

    /// Waits until everything is copied that is to be shared.
    pub fn finish(&self) {
        if let Some(Uploads { queue, thread }) = self.uploads().take() {
            drop(queue);
            let _ = thread.join();
        }
        if let Some(remote) = &self.remote {
            remote.take_complaints().into_iter().for_each(|text| self.notice(text));
        }
    }

    /// What the user should know since this was last asked, one line each.
    pub fn notices(&self) -> Vec<String> {
        if let Some(remote) = &self.remote {
            remote.take_complaints().into_iter().for_each(|text| self.notice(text));
        }
        std::mem::take(&mut self.notices.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn notice(&self, text: String) {
        self.notices.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    }

    fn uploads(&self) -> std::sync::MutexGuard<'_, Option<Uploads>> {
        self.uploads.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A failure to write is said once: the store takes nothing more after it.
    fn written(&self, done: std::io::Result<()>) {
        if let Err(error) = done {
            let root = self.local.root().display();
            self.notice(format!("`{root}`: cannot be written to any more, so further results are not kept: {error}"));
        }
    }

    /// What a remote store answered; its failures are complaints that it keeps itself.
    fn heard(&self, answer: Result<Option<Vec<u8>>, RemoteError>) -> Option<Vec<u8>> {
        answer.ok().flatten()
    }
}

impl Drop for Store {
    fn drop(&mut self) {
        self.finish();
    }
}

/// The longest record that is fetched: those of assets have a kilobyte a level and file.
const MAX_RECORD: u64 = (1 << 20) - 1;

impl Uploads {
    fn start(local: &Arc<Local>, remote: &Arc<Remote>) -> Self {
        let (queue, records) = channel::<Record>();
        let (local, remote) = (Arc::clone(local), Arc::clone(remote));
        let thread = std::thread::spawn(move || {
            let mut sent = BTreeSet::new();
            for record in records {
                // A failure has been noted by the remote; artifacts go first, so that no record names what is not there.
                let _ = upload(&local, &remote, &record, &mut sent);
            }
        });
        Self { queue, thread }
    }
}

/// Copies a record with its artifacts.
fn upload(local: &Local, remote: &Remote, record: &Record, sent: &mut BTreeSet<Digest>) -> Result<(), RemoteError> {
    for output in &record.outputs {
        if sent.contains(&output.digest) {
            continue;
        }
        // Evicted or damaged in the meantime: then there is nothing to share.
        let Found::Whole(bytes) = local.artifact(output) else { return Ok(()) };
        remote.put(&local::artifact_path(output.digest), &bytes)?;
        sent.insert(output.digest);
    }
    remote.put(&local::record_path(record.key), &local::record_bytes(record))
}
