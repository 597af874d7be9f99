//! A volume through the store: what is current stays, what an earlier build has made is published, the rest is compiled.

use std::path::Path;

use super::super::action::{Facts, Failure, Output, Record};
use super::super::artifact::Artifact;
use super::super::clock::peak_bytes;
use super::super::explain::{self, Fields, Why};
use super::super::inputs::InputDigests;
use super::super::key::Walk;
use super::super::manifest::VolumeSpec;
use super::super::run::{RESTLESS, ROUNDS, is_published, publish};
use super::super::store::Store;
use super::super::{Event, StageSeconds};
use super::run::{Compiled, compile_volume};
use super::walk::{ACTION, VolumeFiles, files_of, walk_volume};
use crate::io::publish::Publisher;

/// What volumes are built with.
#[derive(Clone, Copy, Debug)]
pub(in crate::build) struct Volumes<'b> {
    /// Folder that their paths are relative to.
    pub folder: &'b Path,
    /// Folder of the assets.
    pub out: &'b Path,
    /// What earlier builds have made.
    pub store: &'b Store,
    /// Digests of files.
    pub digests: &'b InputDigests,
    /// What writes assets.
    pub publisher: &'b Publisher,
    /// Whether everything is compiled, whatever is stored.
    pub is_forced: bool,
}

/// How a volume came to be as the manifest wants it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::build) enum Way {
    /// It was so before.
    Current,
    /// The store had it.
    Fetched,
    /// It was compiled.
    Compiled,
}

impl Volumes<'_> {
    /// Makes the asset of `spec` what it should be; an error is one line.
    pub(in crate::build) fn build(
        &self,
        spec: &VolumeSpec,
        on_event: &mut dyn FnMut(Event<'_>),
    ) -> Result<(Way, Record), String> {
        for _ in 0..ROUNDS {
            let files = files_of(spec, self.folder, self.digests)?;
            let walk = walk_volume(spec, &files);
            let why = match self.find(spec, &walk)? {
                Found::Ready(way, record) => {
                    self.tell_warnings(spec, &record, on_event);
                    return Ok((way, record));
                }
                Found::Wanted(why) => why,
            };
            match self.make(spec, &files, walk, why, on_event) {
                Ok(record) => return Ok((Way::Compiled, record)),
                Err(Failure::Refused(text)) => return Err(text),
                Err(Failure::InputChanged) => {
                    spec.grids().iter().for_each(|(_, grid)| self.digests.forget(&self.folder.join(&grid.file)));
                }
            }
        }
        Err(RESTLESS.into())
    }

    /// What an earlier build has made is published, unless it is; else why it is to be compiled, as far as the store knows.
    fn find(&self, spec: &VolumeSpec, walk: &Walk) -> Result<Found, String> {
        if self.is_forced {
            return Ok(Found::Wanted(Some(Why::Forced)));
        }
        let key = walk.key();
        let Some(record) = self.store.record_nearby(key).or_else(|| self.store.record_far(key)) else {
            return Ok(Found::Wanted(None));
        };
        if is_published(&self.out.join(&spec.name), &record, self.digests) {
            self.store.touch(&record);
            return Ok(Found::Ready(Way::Current, record));
        }
        match self.store.artifact(&record) {
            None => Ok(Found::Wanted(Some(Why::Lost))),
            Some(artifact) => {
                publish(self.publisher, self.out, &spec.name, &artifact)?;
                Ok(Found::Ready(Way::Fetched, record))
            }
        }
    }

    /// Compiles, keeps and publishes.
    fn make(
        &self,
        spec: &VolumeSpec,
        files: &VolumeFiles,
        walk: Walk,
        why: Option<Why>,
        on_event: &mut dyn FnMut(Event<'_>),
    ) -> Result<Record, Failure> {
        let Compiled { files, levels, warnings } = compile_volume(spec, self.folder, files, on_event)?;
        let record = Record {
            key: walk.key(),
            outputs: files.iter().map(|(name, bytes)| Output::of(name, bytes)).collect(),
            cost: levels.iter().flat_map(|level| level.stages.iter().cloned()).collect::<Vec<StageSeconds>>(),
            facts: Facts { warnings, volume_levels: levels, ..Facts::default() },
            peak_bytes: peak_bytes(),
        };
        let artifact = Artifact::Files(files);
        self.store.keep(&record, &artifact.encode(), true);
        let (name, levels) = (spec.name.as_str(), spec.levels.len());
        on_event(Event::Stage { name, level: levels, levels, stage: "publish" });
        publish(self.publisher, self.out, name, &artifact).map_err(Failure::Refused)?;
        self.explain(name, walk, why, on_event);
        Ok(record)
    }

    /// Tells why a volume was compiled, and remembers what its key was made of.
    fn explain(&self, name: &str, walk: Walk, why: Option<Why>, on_event: &mut dyn FnMut(Event<'_>)) {
        let (old, fields) = (explain::last(self.store, name), walk.into_fields());
        let reasons = explain::reasons(old.get(ACTION), &fields, why);
        on_event(Event::Ran { name, action: ACTION, reasons: &reasons });
        let new = Fields::from([(ACTION.to_string(), fields)]);
        if new != old {
            explain::remember(self.store, name, &new);
        }
    }

    fn tell_warnings(&self, spec: &VolumeSpec, record: &Record, on_event: &mut dyn FnMut(Event<'_>)) {
        record.facts.warnings.iter().for_each(|text| on_event(Event::VolumeWarning { name: &spec.name, text }));
    }
}

/// What the store knows of a volume.
enum Found {
    /// Its asset, which is now in its place.
    Ready(Way, Record),
    /// Nothing of use, and why, if it should.
    Wanted(Option<Why>),
}
