//! From a manifest to published assets.
//!
//! A [`Plan`] is the part of a [`manifest`] that was asked for, and [`build()`] makes it so. Read in this order:
//!
//! - [`action`]: a step is a pure function from inputs and settings to an [`artifact`]. It visits all that it depends on.
//! - [`key`]: what was visited, hashed, is the key of the action; kept, it is what [`explain`] tells from.
//! - [`store`]: records and artifacts of earlier builds by key and digest, here and on a shared server. Every byte is
//!   held against its digest; what is missing or damaged is made again.
//! - [`graph`]: the actions of a build, their needs and their states. A key is made of the *digests* of what is needed,
//!   so a stage that runs again and gives the same bytes stops the ripple there.
//! - [`schedule`]: which action runs when, within threads and memory; a worker looks up, runs, keeps.
//! - [`surface`]: what the actions of a surface are. The key of its asset is made of files and settings alone: a build
//!   of what is current looks at that one record, and at nothing else.
//! - [`volume`]: a volume is one action, with a key of the same kind, looked up and kept in the same store.
//!
//! What a build cost goes to `build.jsonl` beside the assets, never into them: an asset depends on its inputs and
//! settings alone.

pub mod action;
pub mod artifact;
pub(crate) mod clock;
mod condition;
pub mod encode;
pub mod explain;
pub mod graph;
pub(crate) mod input;
pub mod inputs;
pub mod key;
pub(crate) mod level;
pub mod level_error;
pub mod manifest;
pub mod models;
mod plan;
pub mod record;
mod run;
pub mod schedule;
pub mod stage;
pub mod store;
pub mod surface;
pub mod volume;
mod watch;
mod worker;

pub use input::{Input, InputError};
pub use manifest::{Manifest, Mistake, SceneSpec, SurfaceSpec, VolumeSpec};
pub use models::{Model, ModelData};
pub use plan::{Plan, PlanError, ScenePlan};
pub use record::{LevelRecord, StageSeconds};
pub use run::{Event, Intent, Outcome, Request, build, foresee};
pub use schedule::Limits;
pub use store::{Remote, Store};
pub use watch::{Looks, Watcher};
