//! The scheduler with made-up actions: what it costs, what it keeps to, what it does when results get lost.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use farfield::build::action::{Failure, Made, Need, Record, Step};
use farfield::build::artifact::Artifact;
use farfield::build::graph::{ActionId, Graph, Place, State};
use farfield::build::key::Walk;
use farfield::build::schedule::{Happening, run};
use farfield::build::{Limits, Store};

/// An action that makes a file of its number, and watches the sum of what runs with it.
struct Trial<'t> {
    number: usize,
    bytes: u64,
    pause: Duration,
    now: &'t AtomicU64,
    most: &'t AtomicU64,
    fails: bool,
}

impl Step for Trial<'_> {
    fn stage(&self) -> &'static str {
        "trial"
    }

    fn version(&self) -> u32 {
        1
    }

    fn walk(&self, needs: &[Arc<Record>], walk: &mut Walk) {
        walk.setting("number", self.number);
        needs.iter().for_each(|need| walk.input("need", need.digest()));
    }

    fn working_bytes(&self, _: &[Arc<Record>]) -> u64 {
        self.bytes
    }

    fn run(&self, _: &[Need], _: &mut dyn FnMut(&'static str)) -> Result<Made, Failure> {
        let now = self.now.fetch_add(self.bytes, Ordering::SeqCst) + self.bytes;
        self.most.fetch_max(now, Ordering::SeqCst);
        std::thread::sleep(self.pause);
        self.now.fetch_sub(self.bytes, Ordering::SeqCst);
        if self.fails {
            return Err(Failure::Refused("as asked".into()));
        }
        let bytes = self.number.to_le_bytes().to_vec();
        Ok(Artifact::Files(BTreeMap::from([("number".to_string(), bytes)])).into())
    }
}

/// Counts of what runs at once.
#[derive(Default)]
struct Counts {
    now: AtomicU64,
    most: AtomicU64,
}

impl Counts {
    fn trial(&self, number: usize, bytes: u64, pause: Duration) -> Trial<'_> {
        Trial { number, bytes, pause, now: &self.now, most: &self.most, fails: false }
    }
}

fn place(asset: usize) -> Place {
    Place { asset, level: 0 }
}

/// Chains of ten actions each, as assets have them; 1000 chains.
fn chains(counts: &Counts, actions: usize) -> Graph<Trial<'_>> {
    let mut graph = Graph::default();
    let mut last: Option<ActionId> = None;
    for number in 0..actions {
        let needs = last.filter(|_| number % 10 != 0).into_iter().collect();
        last = Some(graph.push(counts.trial(number, 1 << 10, Duration::ZERO), place(number / 10), needs));
    }
    graph
}

fn all(graph: &mut Graph<Trial<'_>>, store: &Store, limits: Limits) -> BTreeMap<ActionId, Failure> {
    let mut failed = BTreeMap::new();
    run(graph, store, limits, false, &|_, _| Ok(()), &mut |_, happening| {
        if let Happening::Failed(id, failure) = happening {
            failed.insert(id, failure);
        }
    });
    failed
}

const LIMITS: Limits = Limits { threads: 2, memory: 8 << 30 };

#[test]
fn ten_thousand_actions_are_looked_up_and_scheduled_in_under_50_microseconds_each() {
    const ACTIONS: usize = 10_000;
    let folder = tempfile::tempdir().unwrap();
    let counts = Counts::default();
    // A store that takes nothing: what is measured is the scheduler, not the disk.
    let nothing = Store::open_to_read(folder.path());
    let start = cpu_time::ProcessTime::now();
    let mut graph = chains(&counts, ACTIONS);
    assert!(all(&mut graph, &nothing, LIMITS).is_empty());
    let scheduled = start.elapsed();
    let start = Instant::now();
    let store = Store::open(folder.path(), None);
    all(&mut chains(&counts, ACTIONS), &store, LIMITS);
    let kept = start.elapsed();
    let start = cpu_time::ProcessTime::now();
    let mut graph = chains(&counts, ACTIONS);
    all(&mut graph, &store, LIMITS);
    let found = start.elapsed();
    let each = |time: Duration| time.as_secs_f64() * 1e6 / ACTIONS as f64;
    println!(
        "microseconds an action: {:.1} of CPU to schedule, {:.1} of CPU to find, {:.1} to schedule and keep",
        each(scheduled),
        each(found),
        each(kept)
    );
    assert!(each(scheduled) < 50.0 && each(found) < 50.0);
}

#[test]
fn what_runs_at_once_stays_within_the_memory() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), None);
    let counts = Counts::default();
    let mut graph = Graph::default();
    // 20 MiB, 30 MiB and 40 MiB; a budget of 100 MiB of which 48 are the process itself.
    for number in 0..60 {
        let bytes = [20, 30, 40][number % 3] << 20;
        graph.push(counts.trial(number, bytes, Duration::from_millis(2)), place(number), vec![]);
    }
    let limits = Limits { threads: 8, memory: 100 << 20 };
    assert!(all(&mut graph, &store, limits).is_empty());
    let most = counts.most.load(Ordering::SeqCst);
    assert!((41 << 20..=52 << 20).contains(&most), "{most}");
}

#[test]
fn an_action_larger_than_the_memory_runs_alone_and_is_told_of() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), None);
    let counts = Counts::default();
    let mut graph = Graph::default();
    for number in 0..10 {
        let bytes = if number == 4 { 500 << 20 } else { 10 << 20 };
        graph.push(counts.trial(number, bytes, Duration::from_millis(2)), place(number), vec![]);
    }
    let mut notices = Vec::new();
    let limits = Limits { threads: 4, memory: 100 << 20 };
    run(&mut graph, &store, limits, false, &|_, _| Ok(()), &mut |_, happening| {
        if let Happening::Notice(text) = happening {
            notices.push(text);
        }
    });
    assert_eq!(counts.most.load(Ordering::SeqCst), 500 << 20);
    assert_eq!(notices, ["stage `trial` needs about 548 MiB, more than the 100 MiB of `--memory`; it runs alone"]);
}

#[test]
fn a_failure_gives_up_its_asset_and_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), None);
    let counts = Counts::default();
    let mut graph = Graph::default();
    let mut ids = Vec::new();
    for number in 0..30 {
        let needs = ids.last().copied().filter(|_| number % 3 != 0).into_iter().collect();
        let trial = Trial { fails: number == 13, ..counts.trial(number, 1, Duration::ZERO) };
        ids.push(graph.push(trial, place(number / 3), needs));
    }
    let failed = all(&mut graph, &store, LIMITS);
    assert_eq!(failed.into_iter().collect::<Vec<_>>(), [(ids[13], Failure::Refused("as asked".into()))]);
    let states = ids.iter().map(|id| graph.state(*id));
    for (number, state) in states.enumerate() {
        let wanted = if number / 3 == 4 { State::Failed } else { State::Done };
        assert_eq!(state, wanted, "{number}");
    }
}

#[test]
fn actions_with_the_same_key_run_once() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path(), None);
    let counts = Counts::default();
    let mut graph = Graph::default();
    for asset in 0..20 {
        graph.push(counts.trial(7, 1, Duration::from_millis(1)), place(asset), vec![]);
    }
    let done = AtomicUsize::new(0);
    run(&mut graph, &store, Limits { threads: 8, ..LIMITS }, true, &|_, _| Ok(()), &mut |graph, happening| {
        if let Happening::Finished(id) = happening {
            done.fetch_add(usize::from(graph.state(id) == State::Done), Ordering::SeqCst);
        }
    });
    assert_eq!(done.into_inner(), 1);
}
