//! Which action runs when: as soon as what it needs is there, in the graph's order, within threads and memory.
//!
//! An action is first looked up by its key, then run. Small ones run side by side, a thread each; large ones, and those
//! that are alone, get all threads. The budget of memory counts the artifacts that are kept for dependents and what the
//! running actions say they need; the next action in order waits until it fits, and no later one overtakes it.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

use super::action::{Failure, Step};
use super::artifact::Artifact;
use super::explain::Why;
use super::graph::{ActionId, Graph, State};
use super::key::Digest;
use super::store::Store;
use super::worker::{Ending, Message, Task, WidePool, Worker, narrow_pool};

/// What a build may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Threads that compute.
    pub threads: usize,
    /// Bytes of the whole process.
    pub memory: u64,
}

/// Puts the artifact of a goal in its place; the error is one line.
pub type Publish<'p> = dyn Fn(ActionId, &Artifact) -> Result<(), String> + Sync + 'p;

/// Bytes of the process before anything is computed: code, stacks, what the allocator keeps.
const BASE_BYTES: u64 = 48 << 20;

/// An action that needs this much gets all threads: two of its kind would need twice the memory for the same time.
const WIDE_BYTES: u64 = 64 << 20;

/// What happens while a graph runs.
#[derive(Debug)]
pub enum Happening {
    /// An action begins to run.
    Begins(ActionId),
    /// A part of its work begins.
    Stage(ActionId, &'static str),
    /// An action is finished: it has run, or an earlier build had made it.
    Finished(ActionId),
    /// An action could not be done; all others of its asset are given up.
    Failed(ActionId, Failure),
    /// Something the user should know.
    Notice(String),
}

/// Runs all actions of `graph`; with `is_forced`, without looking up what earlier builds have made. `publish` gets the
/// results of goals.
pub fn run<S: Step + Send>(
    graph: &mut Graph<S>,
    store: &Store,
    limits: Limits,
    is_forced: bool,
    publish: &Publish<'_>,
    on_event: &mut dyn FnMut(&Graph<S>, Happening),
) {
    let threads = limits.threads.max(1);
    let wide = WidePool::new(threads);
    let (tasks, queue) = channel::<Task<S>>();
    let (messages, inbox) = channel::<Message>();
    let queue = Mutex::new(queue);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let worker = Worker { wide: &wide, store, publish, messages: messages.clone() };
            let queue = &queue;
            scope.spawn(move || {
                let _alone = narrow_pool();
                // The lock is held while waiting: one worker waits for a task, the others for the lock.
                let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).recv();
                while let Ok(task) = next() {
                    worker.work(task);
                }
            });
        }
        let scheduler = Scheduler {
            graph,
            store,
            limits: Limits { threads, ..limits },
            is_forced,
            tasks,
            inbox,
            on_event,
            ready: BTreeSet::new(),
            parked: HashMap::new(),
            running: HashMap::new(),
            made: HashSet::new(),
            resident: 0,
            was_too_large: false,
        };
        // The scheduler's end closes the queue, and that ends the workers.
        scheduler.run();
    });
}

/// A running action.
struct Running {
    reserved: u64,
    is_wide: bool,
    key: Digest,
}

struct Scheduler<'s, S> {
    graph: &'s mut Graph<S>,
    store: &'s Store,
    limits: Limits,
    is_forced: bool,
    tasks: Sender<Task<S>>,
    inbox: Receiver<Message>,
    on_event: &'s mut dyn FnMut(&Graph<S>, Happening),
    /// Actions whose needs are finished, in order.
    ready: BTreeSet<ActionId>,
    /// Actions that wait for one with the same key.
    parked: HashMap<Digest, Vec<ActionId>>,
    running: HashMap<ActionId, Running>,
    /// Keys of what has run in this build: once is enough, even when it is forced.
    made: HashSet<Digest>,
    /// Bytes of the artifacts in memory.
    resident: u64,
    was_too_large: bool,
}

impl<S: Step + Send> Scheduler<'_, S> {
    fn run(mut self) {
        for id in self.graph.ids() {
            self.advance(id);
        }
        loop {
            self.start_what_fits();
            self.tell_notices();
            if self.running.is_empty() && self.ready.is_empty() {
                return;
            }
            match self.inbox.recv() {
                Ok(message) => self.hear(message),
                Err(_) => return,
            }
        }
    }

    /// The one place where a waiting action becomes ready.
    fn advance(&mut self, id: ActionId) {
        if self.graph.state(id) == State::Wanted && self.graph.has_needs(id) {
            self.graph.node_mut(id).state = State::Ready;
            self.ready.insert(id);
        }
    }

    /// Looks up or starts ready actions in order, as long as there is room.
    fn start_what_fits(&mut self) {
        while let Some(id) = self.ready.first().copied() {
            if self.graph.state(id) != State::Ready || !self.graph.has_needs(id) {
                // Failed with its asset, or what it needs is being made again.
                self.ready.remove(&id);
                self.withdraw(id);
                continue;
            }
            let key = self.graph.key(id);
            if self.running.values().any(|running| running.key == key) {
                self.ready.remove(&id);
                self.parked.entry(key).or_default().push(id);
                continue;
            }
            let takes_stored = (!self.is_forced || self.made.contains(&key)) && self.graph.node(id).why.is_none();
            let found = if takes_stored { self.store.record_nearby(key) } else { None };
            if let Some(record) = found.as_ref().filter(|_| !self.graph.node(id).is_goal) {
                self.ready.remove(&id);
                self.finish(id, State::Cached, record.clone(), None);
                continue;
            }
            if !self.start(id, key, found, takes_stored) {
                return;
            }
        }
    }

    /// Starts an action if there is room for it; whether it did.
    fn start(&mut self, id: ActionId, key: Digest, found: Option<super::action::Record>, takes_stored: bool) -> bool {
        let records = self.graph.need_records(id);
        let node = self.graph.node(id);
        let absent = node.needs.iter().zip(&records).enumerate().filter(|(number, (need, _))| {
            self.graph.node(**need).artifact.is_none() && node.step.loads(*number, &records)
        });
        let wanted = node.step.working_bytes(&records) + absent.map(|(_, (_, record))| record.bytes()).sum::<u64>();
        let is_alone = self.running.is_empty();
        let is_wide = self.limits.threads == 1 || wanted >= WIDE_BYTES || is_alone && self.ready.len() == 1;
        let has_threads = match is_wide {
            true => is_alone,
            false => self.running.len() < self.limits.threads && !self.running.values().any(|running| running.is_wide),
        };
        if !has_threads || !self.has_memory(id, wanted) {
            return false;
        }
        self.ready.remove(&id);
        self.running.insert(id, Running { reserved: wanted, is_wide, key });
        let needs = self.graph.needs_of(id);
        let node = self.graph.node_mut(id);
        node.state = State::Running;
        if self.is_forced {
            node.why = Some(Why::Forced);
        }
        let (step, is_goal) = (Arc::clone(&node.step), node.is_goal);
        let looks_far = takes_stored && found.is_none() && self.store.has_remote();
        let task = Task { id, step, key, needs, found, looks_far, is_goal, is_wide };
        (self.on_event)(self.graph, Happening::Begins(id));
        self.tasks.send(task).expect("workers live as long as the queue");
        true
    }

    /// Whether `wanted` more bytes fit. What runs alone runs anyway, after everything has made room that can.
    fn has_memory(&mut self, id: ActionId, wanted: u64) -> bool {
        let reserved: u64 = self.running.values().map(|running| running.reserved).sum();
        let is_within = |resident: u64| BASE_BYTES + reserved + resident + wanted <= self.limits.memory;
        if is_within(self.resident) {
            return true;
        }
        if !self.running.is_empty() {
            return false;
        }
        self.unload_for(id);
        if BASE_BYTES + self.resident + wanted > self.limits.memory && !std::mem::replace(&mut self.was_too_large, true)
        {
            let [wanted, limit] =
                [BASE_BYTES + self.resident + wanted, self.limits.memory].map(|bytes| bytes.div_ceil(1 << 20));
            let stage = self.graph.node(id).step.stage();
            let text = format!(
                "stage `{stage}` needs about {wanted} MiB, more than the {limit} MiB of `--memory`; it runs alone"
            );
            (self.on_event)(self.graph, Happening::Notice(text));
        }
        true
    }

    /// Drops the artifacts that `id` does not need, if the store keeps them: what is not kept would be made again and again.
    fn unload_for(&mut self, id: ActionId) {
        if !self.store.keeps_results() {
            return;
        }
        let needs = self.graph.node(id).needs.clone();
        for other in self.graph.ids().filter(|other| !needs.contains(other)) {
            self.unload(other);
        }
    }

    fn hear(&mut self, message: Message) {
        match message {
            Message::Stage(id, stage) => (self.on_event)(self.graph, Happening::Stage(id, stage)),
            Message::Ended(id, ending, loaded) => {
                let running = self.running.remove(&id);
                let parked = running.and_then(|running| self.parked.remove(&running.key));
                self.ready.extend(parked.into_iter().flatten());
                if self.graph.state(id) == State::Failed {
                    return; // given up with its asset
                }
                for (number, artifact) in loaded {
                    let need = self.graph.node(id).needs[number];
                    self.load(need, artifact);
                }
                match ending {
                    Ending::Found(record) => self.finish(id, State::Cached, record, None),
                    Ending::Made(record, artifact) => {
                        self.made.insert(record.key);
                        self.finish(id, State::Done, record, Some(artifact));
                    }
                    Ending::Missing(number) => self.make_again(id, number),
                    Ending::Failed(failure) => self.give_up(id, failure),
                }
            }
        }
    }

    /// An action is finished: those that waited for it go on, and what nobody needs any more is dropped.
    fn finish(&mut self, id: ActionId, state: State, record: super::action::Record, artifact: Option<Arc<Artifact>>) {
        let node = self.graph.node_mut(id);
        node.state = state;
        node.record = Some(Arc::new(record));
        if let Some(artifact) = artifact.filter(|_| !node.dependents.is_empty()) {
            self.load(id, artifact);
        }
        (self.on_event)(self.graph, Happening::Finished(id));
        self.unload_needs(id);
        for dependent in self.graph.node(id).dependents.clone() {
            self.advance(dependent);
        }
    }

    /// The artifact of a need cannot be had: it is made again, and `id` waits for it.
    fn make_again(&mut self, id: ActionId, number: usize) {
        let need = self.graph.node(id).needs[number];
        self.withdraw_running(id);
        let node = self.graph.node_mut(need);
        if node.state.is_finished() {
            node.state = State::Wanted;
            node.why = Some(Why::Lost);
            self.advance(need);
        }
        self.advance(id);
    }

    fn withdraw_running(&mut self, id: ActionId) {
        let node = self.graph.node_mut(id);
        (node.state, node.key) = (State::Wanted, None);
    }

    /// A ready action whose needs are no longer there waits again; its key may change with them.
    fn withdraw(&mut self, id: ActionId) {
        if self.graph.state(id) == State::Ready {
            self.withdraw_running(id);
        }
    }

    /// An action failed: with it all of its asset.
    fn give_up(&mut self, id: ActionId, failure: Failure) {
        let asset = self.graph.node(id).place.asset;
        for other in self.graph.ids() {
            let node = self.graph.node_mut(other);
            if node.place.asset == asset {
                node.state = State::Failed;
                self.ready.remove(&other);
                self.unload(other);
            }
        }
        (self.on_event)(self.graph, Happening::Failed(id, failure));
    }

    fn load(&mut self, id: ActionId, artifact: Arc<Artifact>) {
        if self.graph.node(id).artifact.is_none() {
            self.graph.node_mut(id).artifact = Some(artifact);
            self.resident += self.graph.resident_bytes(id);
        }
    }

    fn unload(&mut self, id: ActionId) {
        self.resident -= self.graph.resident_bytes(id);
        self.graph.node_mut(id).artifact = None;
    }

    /// Drops the artifacts of an action's needs that wait for nobody else.
    fn unload_needs(&mut self, id: ActionId) {
        for need in self.graph.node(id).needs.clone() {
            let is_over = |dependent: &ActionId| {
                let state = self.graph.state(*dependent);
                state.is_finished() || state == State::Failed
            };
            if self.graph.node(need).dependents.iter().all(is_over) {
                self.unload(need);
            }
        }
    }

    fn tell_notices(&mut self) {
        for text in self.store.notices() {
            (self.on_event)(self.graph, Happening::Notice(text));
        }
    }
}
