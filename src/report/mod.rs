//! What people read: tables of what was planned, built and is in an asset; and the report of a verification.
//!
//! A [`verification`] is the figures of a comparison with the original, as written to `report.json`; [`html`] draws it
//! with its pictures as one file. The figures come from [`metrics`], [`flip`] and [`equal_time`], which are functions of
//! images and times; the plots from [`svg`], the coloured pictures of an error from [`error_map`].

pub mod equal_time;
pub mod error_map;
pub mod flip;
pub mod html;
mod inspected;
mod inspected_volume;
pub mod metrics;
mod planned;
pub mod summary;
pub mod svg;
mod table;
pub mod tradeoff;
pub mod verification;
mod verified;
pub mod verify;

pub use html::{CaseKey, CasePictures, ModelPictures, Pictures};
pub use inspected::{Inspected, asset_json, asset_text};
pub use inspected_volume::{InspectedVolume, volume_json, volume_text};
pub use planned::{planned, planned_volume};
pub use table::{level_table, volume_table};
pub use verification::Verification;
pub use verified::{level_json, verification_table};
