//! The farfield LoD asset.

pub mod cell_brdf;
