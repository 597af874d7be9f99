//! One action, run: its inputs loaded, its artifact kept, its cost measured.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::Sender;
use std::sync::{Arc, OnceLock};

use rayon::{ThreadPool, ThreadPoolBuilder};

use super::action::{Failure, Made, Need, Output, Record, Step};
use super::artifact::Artifact;
use super::clock::{StageClock, peak_bytes};
use super::graph::ActionId;
use super::key::Digest;
use super::record::StageSeconds;
use super::schedule::Publish;
use super::store::Store;

/// What a worker is to do.
pub(super) struct Task<S> {
    pub(super) id: ActionId,
    pub(super) step: Arc<S>,
    pub(super) key: Digest,
    /// What the action needs, with the artifacts that are in memory.
    pub(super) needs: Vec<Need>,
    /// The record of an earlier build, where a goal has one.
    pub(super) found: Option<Record>,
    /// Whether the remote store is asked.
    pub(super) looks_far: bool,
    /// Whether the result is published.
    pub(super) is_goal: bool,
    /// Whether all threads work on it.
    pub(super) is_wide: bool,
}

/// What workers say.
pub(super) enum Message {
    /// A part of the work begins.
    Stage(ActionId, &'static str),
    /// An action has come to an end; artifacts of its needs that were loaded for it, by their number.
    Ended(ActionId, Ending, Vec<(usize, Arc<Artifact>)>),
}

/// How an action ended.
pub(super) enum Ending {
    /// An earlier build had made it.
    Found(Record),
    /// It has run.
    Made(Record, Arc<Artifact>),
    /// The artifact of the need of this number cannot be had.
    Missing(usize),
    /// It could not be done.
    Failed(Failure),
}

/// The pool of all threads, made when the first action wants it.
#[derive(Debug)]
pub(super) struct WidePool {
    threads: usize,
    pool: OnceLock<ThreadPool>,
}

impl WidePool {
    pub(super) fn new(threads: usize) -> Self {
        Self { threads, pool: OnceLock::new() }
    }

    fn get(&self) -> &ThreadPool {
        let pool = || ThreadPoolBuilder::new().num_threads(self.threads).build();
        self.pool.get_or_init(|| pool().expect("the system starts threads"))
    }
}

/// Makes the calling thread a pool of its own: what it computes in parallel, it computes alone, without a change of
/// threads. The pool lasts as long as the thread.
pub(super) fn narrow_pool() -> ThreadPool {
    ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().expect("a worker has no pool before")
}

/// A worker: where it computes, what it reads and writes, whom it tells.
pub(super) struct Worker<'w> {
    pub(super) wide: &'w WidePool,
    pub(super) store: &'w Store,
    pub(super) publish: &'w Publish<'w>,
    pub(super) messages: Sender<Message>,
}

impl Worker<'_> {
    /// Does a task, and says how it ended.
    pub(super) fn work<S: Step + Send>(&self, mut task: Task<S>) {
        let mut loaded = Vec::new();
        let ending = self.end(&mut task, &mut loaded);
        // The scheduler is gone where it has given up; then nobody wants to know.
        let _ = self.messages.send(Message::Ended(task.id, ending, loaded));
    }

    fn end<S: Step + Send>(&self, task: &mut Task<S>, loaded: &mut Vec<(usize, Arc<Artifact>)>) -> Ending {
        let found = task.found.take().or_else(|| task.looks_far.then(|| self.store.record_far(task.key))?);
        if let Some(record) = found {
            if !task.is_goal {
                return Ending::Found(record);
            }
            if let Some(artifact) = self.store.artifact(&record) {
                return match (self.publish)(task.id, &artifact) {
                    Ok(()) => Ending::Found(record),
                    Err(text) => Ending::Failed(Failure::Refused(text)),
                };
            }
        }
        if let Err(missing) = self.load(task, loaded) {
            return Ending::Missing(missing);
        }
        let (made, clock) = match self.compute(task) {
            Ok(computed) => computed,
            Err(failure) => return Ending::Failed(failure),
        };
        let (record, artifact) = self.keep(task, made, &clock);
        if task.is_goal
            && let Err(text) = (self.publish)(task.id, &artifact)
        {
            return Ending::Failed(Failure::Refused(text));
        }
        Ending::Made(record, artifact)
    }

    /// Loads the artifacts that the step takes and that are not in memory; the number of one that cannot be had.
    fn load<S: Step>(&self, task: &mut Task<S>, loaded: &mut Vec<(usize, Arc<Artifact>)>) -> Result<(), usize> {
        let records: Vec<Arc<Record>> = task.needs.iter().map(|need| Arc::clone(&need.record)).collect();
        for (number, need) in task.needs.iter_mut().enumerate() {
            if !task.step.loads(number, &records) {
                need.artifact = None;
            } else if need.artifact.is_none() {
                let artifact = Arc::new(self.store.artifact(&need.record).ok_or(number)?);
                loaded.push((number, Arc::clone(&artifact)));
                need.artifact = Some(artifact);
            }
        }
        Ok(())
    }

    /// Runs the step in its pool: that of all threads, or that of the worker's own.
    fn compute<S: Step + Send>(&self, task: &Task<S>) -> Result<(Made, StageClock), Failure> {
        let (step, needs, id) = (&*task.step, &task.needs, task.id);
        let messages = self.messages.clone();
        let work = move || {
            let mut clock = StageClock::default();
            let made = step.run(needs, &mut |stage| {
                clock.begin(stage);
                let _ = messages.send(Message::Stage(id, stage));
            });
            clock.end();
            (made, clock)
        };
        let work = || if task.is_wide { self.wide.get().install(work) } else { work() };
        // What a step leaves behind when it panics is dropped here, and seen by nobody.
        match catch_unwind(AssertUnwindSafe(work)) {
            Ok((made, clock)) => Ok((made?, clock)),
            Err(_) => Err(Failure::Refused(format!("stage `{}` has panicked: a bug of farfield", step.stage()))),
        }
    }

    /// Keeps what was made, and what is known of it.
    fn keep<S: Step>(&self, task: &Task<S>, made: Made, clock: &StageClock) -> (Record, Arc<Artifact>) {
        let files = made.artifact.encode();
        let cost = |&(stage, cpu_seconds): &(&'static str, f64)| StageSeconds { stage: stage.into(), cpu_seconds };
        let record = Record {
            key: task.key,
            outputs: files.iter().map(|(name, bytes)| Output::of(name, bytes)).collect(),
            facts: made.facts,
            cost: clock.stages().iter().map(cost).collect(),
            peak_bytes: peak_bytes(),
        };
        self.store.keep(&record, &files, task.step.is_shared());
        (record, Arc::new(made.artifact))
    }
}
