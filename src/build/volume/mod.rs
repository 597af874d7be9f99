//! Volumes: what a manifest entry describes, read from its files; media as levels of an asset, and back.

pub mod encode;
pub mod input;
pub mod run;
mod shapes;
pub mod stage;
#[cfg(test)]
mod tests;

pub use input::{VolumeAlbedo, VolumeInput, VolumeInputError, read};
pub use run::VolumeRecord;
