//! Volumes: what a manifest entry describes, read from its files; media as levels of an asset, and back. A volume is one
//! action of the store.

mod cached;
pub mod encode;
pub mod input;
pub mod run;
mod shapes;
pub mod stage;
#[cfg(test)]
mod tests;
mod walk;

pub(in crate::build) use cached::{Volumes, Way};
pub use input::{VolumeAlbedo, VolumeInput, VolumeInputError, read};
pub use run::VolumeRecord;
pub(in crate::build) use walk::{ACTION, files_of, walk_volume};
