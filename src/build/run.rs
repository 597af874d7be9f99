//! The build itself: what is current stays, what an earlier build has made is published, the rest goes through the graph.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use formats::asset::DOCUMENT;
use rayon::prelude::*;

use super::action::{Failure, Record, Step};
use super::artifact::Artifact;
use super::explain::{self, Fields};
use super::graph::{ActionId, Graph, State};
use super::inputs::InputDigests;
use super::key::Walk;
use super::record::{self, LevelRecord};
use super::schedule::{self, Happening, Limits};
use super::store::{Remote, Store};
use super::surface::{self, SurfaceFiles, SurfaceStep};
use super::volume::{self, VolumeRecord, Volumes, Way};
use super::{Plan, SurfaceSpec, encode};
use crate::io::publish::Publisher;

/// How often an asset is tried whose files are edited while they are read.
pub(super) const ROUNDS: usize = 3;

/// What is said of one after that.
pub(super) const RESTLESS: &str = "its files are edited again and again while they are read";

/// Where a build reads and writes, and what it may use.
#[derive(Debug)]
pub struct Request {
    /// Folder of the assets.
    pub out: PathBuf,
    /// Folder of the cache.
    pub cache: PathBuf,
    /// Bytes that the cache is kept within.
    pub cache_limit: u64,
    /// A store behind the cache.
    pub remote: Option<Remote>,
    /// Threads and memory.
    pub limits: Limits,
    /// Whether everything runs, whatever is stored.
    pub is_forced: bool,
}

/// What happens during a build, for whoever watches.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// A stage begins.
    Stage {
        /// Surface.
        name: &'a str,
        /// Number of the level, from 1; 0 before the first.
        level: usize,
        /// Levels of the surface.
        levels: usize,
        /// What is done.
        stage: &'static str,
    },
    /// So many actions of all are finished.
    Progress {
        /// Finished.
        done: usize,
        /// All that are known.
        total: usize,
    },
    /// An action has run.
    Ran {
        /// Surface or volume.
        name: &'a str,
        /// The action, as in `level 2 fine`.
        action: &'a str,
        /// Why, one reason each.
        reasons: &'a [String],
    },
    /// Something the user should know about a result that is usable.
    Warning {
        /// Surface.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
    /// Something the user should know about the cache.
    Notice {
        /// One line.
        text: &'a str,
    },
    /// A surface is published.
    Built {
        /// Surface.
        name: &'a str,
        /// Its levels.
        records: &'a [LevelRecord],
        /// Actions that ran for it.
        ran: usize,
    },
    /// Something the user should know about a volume that is usable.
    VolumeWarning {
        /// Volume.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
    /// A volume is published.
    VolumeBuilt {
        /// Volume.
        name: &'a str,
        /// Its levels.
        records: &'a [VolumeRecord],
        /// Actions that ran for it: 1, or none.
        ran: usize,
    },
    /// A volume could not be built.
    VolumeFailed {
        /// Volume.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
    /// A surface could not be built.
    Failed {
        /// Surface.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
}

/// How a build ended.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// All levels of the surfaces that are now as the manifest wants them, in its order.
    pub records: Vec<LevelRecord>,
    /// Surfaces and volumes that were so before.
    pub current: usize,
    /// Surfaces and volumes that were built or fetched.
    pub built: usize,
    /// Actions that ran.
    pub ran: usize,
    /// All levels of the volumes that are now as the manifest wants them.
    pub volumes: Vec<VolumeRecord>,
    /// Surfaces and volumes that could not be built.
    pub failed: usize,
    /// Levels above their target.
    pub missed: usize,
    /// Actions that gave other bytes than an earlier build.
    pub differing: usize,
}

/// Builds all surfaces and volumes of `plan`. One that fails does not stop the others.
pub fn build(
    plan: &Plan,
    request: Request,
    publisher: &Publisher,
    on_event: &mut (dyn FnMut(Event<'_>) + Send),
) -> Outcome {
    let Request { out, cache, cache_limit, remote, limits, is_forced } = request;
    publisher.sweep(&out);
    let store = Store::open(&cache, remote);
    let digests = InputDigests::open(&store);
    let mut build = Build {
        plan,
        out: &out,
        store: &store,
        digests: &digests,
        publisher,
        limits,
        is_forced,
        records: vec![Vec::new(); plan.surfaces.len()],
        outcome: Outcome::default(),
    };
    build.run(on_event);
    let Build { records, mut outcome, .. } = build;
    outcome.records = records.into_iter().flatten().collect();
    outcome.missed = outcome.records.iter().filter(|record| record.missed()).count();
    if !outcome.records.is_empty()
        && let Err(error) = record::replace(&out, &outcome.records, publisher)
    {
        on_event(Event::Notice { text: &error.to_string() });
    }
    let volumes = Volumes { folder: &plan.folder, out: &out, store: &store, digests: &digests, publisher, is_forced };
    build_volumes(plan, volumes, limits.threads, &mut outcome, on_event);
    digests.save(&store);
    store.finish();
    outcome.differing = store.differing();
    if store.was_written() {
        store.collect_beyond(cache_limit);
    }
    store.notices().iter().for_each(|text| on_event(Event::Notice { text }));
    outcome
}

/// Builds the volumes of `plan`, one after the other, each on all threads.
fn build_volumes(
    plan: &Plan,
    volumes: Volumes<'_>,
    threads: usize,
    outcome: &mut Outcome,
    on_event: &mut (dyn FnMut(Event<'_>) + Send),
) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    for spec in &plan.volumes {
        let name = spec.name.as_str();
        let mut one = || volumes.build(spec, on_event);
        let built = match &pool {
            Ok(pool) => pool.install(one),
            Err(_) => one(),
        };
        match built {
            Ok((way, record)) => {
                let (records, ran) = (record.facts.volume_levels, usize::from(way == Way::Compiled));
                on_event(Event::VolumeBuilt { name, records: &records, ran });
                outcome.ran += ran;
                *(if way == Way::Current { &mut outcome.current } else { &mut outcome.built }) += 1;
                outcome.missed += records.iter().filter(|record| record.missed()).count();
                outcome.volumes.extend(records);
            }
            Err(text) => {
                outcome.failed += 1;
                on_event(Event::VolumeFailed { name, text: &text });
            }
        }
    }
}

/// What a build would do with one asset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Intent {
    /// The surface or volume.
    pub name: String,
    /// Why it would be built; none where it is current.
    pub reasons: Vec<String>,
}

/// What a build would do, as far as that can be known without doing it; nothing is written.
pub fn foresee(plan: &Plan, out: &Path, cache: &Path, is_forced: bool) -> Vec<Intent> {
    let store = Store::open_to_read(cache);
    let digests = InputDigests::open(&store);
    let intent = |name: &str, action: &str, walk: Result<Walk, String>| {
        let intent = |reasons| Intent { name: name.into(), reasons };
        let walk = match walk {
            Ok(walk) => walk,
            Err(text) => return intent(vec![text]),
        };
        let (place, why) = (out.join(name), is_forced.then_some(explain::Why::Forced));
        match store.record_nearby(walk.key()).filter(|_| !is_forced) {
            Some(record) if is_published(&place, &record, &digests) => intent(Vec::new()),
            Some(_) => intent(vec![format!("`{}` is not as it was published", place.display())]),
            None => intent(explain::reasons(explain::last(&store, name).get(action), &walk.into_fields(), why)),
        }
    };
    let surfaces = plan.surfaces.iter().map(|spec| {
        let walk = files_of(spec, &plan.folder, &digests).map(|files| surface::walk_asset(spec, files));
        intent(&spec.name, "asset", walk)
    });
    let volumes = plan.volumes.iter().map(|spec| {
        let walk = volume::files_of(spec, &plan.folder, &digests).map(|files| volume::walk_volume(spec, &files));
        intent(&spec.name, volume::ACTION, walk)
    });
    surfaces.chain(volumes).collect()
}

/// What is to be done for a surface.
enum Finding {
    /// Its asset is as it should be.
    Current(Record),
    /// Its asset was made before, and is published now.
    Fetched(Record),
    /// It is to be built.
    Wanted(SurfaceFiles),
    /// It cannot be built: one line.
    Failed(String),
}

struct Build<'b> {
    plan: &'b Plan,
    out: &'b Path,
    store: &'b Store,
    digests: &'b InputDigests,
    publisher: &'b Publisher,
    limits: Limits,
    is_forced: bool,
    /// Levels by number of the surface.
    records: Vec<Vec<LevelRecord>>,
    outcome: Outcome,
}

impl Build<'_> {
    fn run(&mut self, on_event: &mut dyn FnMut(Event<'_>)) {
        let mut open: Vec<usize> = (0..self.plan.surfaces.len()).collect();
        for round in 1..=ROUNDS {
            let wanted = self.settle(&open, on_event);
            if wanted.is_empty() {
                return;
            }
            open = self.run_graph(&wanted, round == ROUNDS, on_event);
        }
    }

    /// What needs no graph is done; the others.
    fn settle(&mut self, open: &[usize], on_event: &mut dyn FnMut(Event<'_>)) -> Vec<(usize, SurfaceFiles)> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.limits.threads).build();
        let find = || open.par_iter().map(|&index| self.find(&self.plan.surfaces[index])).collect();
        let findings: Vec<Finding> = match pool {
            Ok(pool) => pool.install(find),
            Err(_) => find(),
        };
        let mut wanted = Vec::new();
        for (&index, finding) in open.iter().zip(findings) {
            match finding {
                Finding::Current(record) => {
                    self.outcome.current += 1;
                    self.tell_built(index, &record, 0, on_event);
                }
                Finding::Fetched(record) => {
                    self.outcome.built += 1;
                    self.tell_built(index, &record, 0, on_event);
                }
                Finding::Wanted(files) => wanted.push((index, files)),
                Finding::Failed(text) => self.tell_failed(index, &text, on_event),
            }
        }
        self.store.notices().iter().for_each(|text| on_event(Event::Notice { text }));
        wanted
    }

    /// What is to be done for `spec`; publishes what an earlier build has made.
    fn find(&self, spec: &SurfaceSpec) -> Finding {
        let files = match files_of(spec, &self.plan.folder, self.digests) {
            Ok(files) => files,
            Err(text) => return Finding::Failed(text),
        };
        if self.is_forced {
            return Finding::Wanted(files);
        }
        let key = surface::walk_asset(spec, files).key();
        let Some(record) = self.store.record_nearby(key).or_else(|| self.store.record_far(key)) else {
            return Finding::Wanted(files);
        };
        if is_published(&self.out.join(&spec.name), &record, self.digests) {
            self.store.touch(&record);
            return Finding::Current(record);
        }
        match self.store.artifact(&record) {
            None => Finding::Wanted(files),
            Some(artifact) => match publish(self.publisher, self.out, &spec.name, &artifact) {
                Ok(()) => Finding::Fetched(record),
                Err(text) => Finding::Failed(text),
            },
        }
    }

    /// Builds surfaces; those whose files were edited meanwhile.
    fn run_graph(
        &mut self,
        wanted: &[(usize, SurfaceFiles)],
        is_last: bool,
        on_event: &mut dyn FnMut(Event<'_>),
    ) -> Vec<usize> {
        let (plan, store, limits, is_forced) = (self.plan, self.store, self.limits, self.is_forced);
        let (publisher, out) = (self.publisher, self.out);
        let mut graph = Graph::default();
        let mut goals = HashMap::new();
        for &(index, files) in wanted {
            let goal = surface::add(&mut graph, index, &plan.surfaces[index], files, &plan.folder);
            graph.set_goal(goal);
            goals.insert(goal, plan.surfaces[index].name.as_str());
        }
        let total = graph.len();
        let publish = |id: ActionId, artifact: &Artifact| publish(publisher, out, goals[&id], artifact);
        let (mut done, mut again) = (0, Vec::new());
        schedule::run(&mut graph, store, limits, is_forced, &publish, &mut |graph, happening| match happening {
            Happening::Begins(_) => {}
            Happening::Stage(id, stage) => {
                let place = graph.node(id).place;
                let spec = &plan.surfaces[place.asset];
                on_event(Event::Stage { name: &spec.name, level: place.level, levels: spec.levels.len(), stage });
            }
            Happening::Finished(id) => {
                done += 1;
                on_event(Event::Progress { done: done.min(total), total });
                let node = graph.node(id);
                if let Some(record) = node.record.as_deref().filter(|_| node.is_goal) {
                    let ran = self.explain(graph, node.place.asset, on_event);
                    self.outcome.built += 1;
                    self.tell_built(node.place.asset, record, ran, on_event);
                }
            }
            Happening::Failed(id, failure) => {
                let index = graph.node(id).place.asset;
                self.explain(graph, index, on_event);
                again.extend(self.failed(index, failure, is_last, on_event));
            }
            Happening::Notice(text) => on_event(Event::Notice { text: &text }),
        });
        again.sort_unstable();
        again
    }

    /// Tells of a surface that could not be built; its number, if it is to be tried again.
    fn failed(
        &mut self,
        index: usize,
        failure: Failure,
        is_last: bool,
        on_event: &mut dyn FnMut(Event<'_>),
    ) -> Option<usize> {
        let spec = &self.plan.surfaces[index];
        let text = match failure {
            Failure::Refused(text) => text,
            Failure::InputChanged if is_last => RESTLESS.into(),
            Failure::InputChanged => {
                for file in [Some(&spec.height), spec.color.as_ref()].into_iter().flatten() {
                    self.digests.forget(&self.plan.folder.join(file));
                }
                return Some(index);
            }
        };
        self.tell_failed(index, &text, on_event);
        None
    }

    /// Tells why the actions of a surface ran, and remembers what all of its keys were made of; how many ran.
    fn explain(&mut self, graph: &Graph<SurfaceStep<'_>>, index: usize, on_event: &mut dyn FnMut(Event<'_>)) -> usize {
        let name = &self.plan.surfaces[index].name;
        let old = explain::last(self.store, name);
        let mut new: Fields = old.clone();
        let mut ran = 0;
        for id in graph.ids().filter(|id| graph.node(*id).place.asset == index && graph.state(*id).is_finished()) {
            let node = graph.node(id);
            let Some((_, fields)) = &node.key else { continue };
            let action = action_name(&node.step, node.place.level, node.is_goal);
            if graph.state(id) == State::Done {
                ran += 1;
                let reasons = explain::reasons(old.get(&action), fields, node.why);
                on_event(Event::Ran { name, action: &action, reasons: &reasons });
            }
            new.insert(action, fields.clone());
        }
        if new != old {
            explain::remember(self.store, name, &new);
        }
        self.outcome.ran += ran;
        ran
    }

    fn tell_built(&mut self, index: usize, record: &Record, ran: usize, on_event: &mut dyn FnMut(Event<'_>)) {
        let name = &self.plan.surfaces[index].name;
        record.facts.warnings.iter().for_each(|text| on_event(Event::Warning { name, text }));
        let records = &record.facts.levels;
        on_event(Event::Built { name, records, ran });
        self.records[index].clone_from(records);
    }

    fn tell_failed(&mut self, index: usize, text: &str, on_event: &mut dyn FnMut(Event<'_>)) {
        self.outcome.failed += 1;
        on_event(Event::Failed { name: &self.plan.surfaces[index].name, text });
    }
}

/// The digests of the files of `spec`; an error is one line.
fn files_of(spec: &SurfaceSpec, folder: &Path, digests: &InputDigests) -> Result<SurfaceFiles, String> {
    let digest = |file: &String| digests.digest(&folder.join(file)).map_err(|error| error.to_string());
    Ok(SurfaceFiles { height: digest(&spec.height)?, color: spec.color.as_ref().map(digest).transpose()? })
}

/// Puts the files of an asset in their place.
pub(super) fn publish(publisher: &Publisher, out: &Path, name: &str, artifact: &Artifact) -> Result<(), String> {
    let Artifact::Files(files) = artifact else { return Err("its stored files are no asset".into()) };
    publisher.folder(&out.join(name), files, DOCUMENT, encode::is_payload).map_err(|error| error.to_string())
}

/// Whether the folder `place` holds every file of an asset, as it was made.
pub(super) fn is_published(place: &Path, record: &Record, digests: &InputDigests) -> bool {
    let is_there = |name: &str, wanted| digests.digest(&place.join(name)).is_ok_and(|digest| digest == wanted);
    record.outputs.iter().all(|output| is_there(&output.name, output.digest))
}

/// An action's name within its asset.
fn action_name(step: &SurfaceStep<'_>, level: usize, is_goal: bool) -> String {
    if is_goal || level == 0 { step.stage().into() } else { format!("level {level} {}", step.stage()) }
}
