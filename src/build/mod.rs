//! From a manifest to published assets.
//!
//! A [`Plan`] is the part of a [`manifest`] that was asked for. [`build`] reads each surface's maps once, compiles its
//! levels, encodes them, measures their error through their own bytes and publishes the folder at once. What it cost
//! goes to `build.jsonl` beside the assets, never into them: an asset depends on its inputs and settings alone.

pub(crate) mod clock;
mod condition;
pub mod encode;
pub(crate) mod input;
pub mod level_error;
pub mod manifest;
pub mod models;
mod plan;
pub mod record;
mod run;
pub mod stage;
pub mod volume;

pub use input::{Input, InputError};
pub use manifest::{Manifest, Mistake, SceneSpec, SurfaceSpec, VolumeSpec};
pub use models::{Model, ModelData};
pub use plan::{Plan, PlanError, ScenePlan};
pub use record::{LevelRecord, StageSeconds};
pub use run::{Event, Outcome, build};
