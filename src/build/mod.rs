//! From a manifest to published assets.

pub mod manifest;
