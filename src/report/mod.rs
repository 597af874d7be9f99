//! Tables that people read: what was planned, what was built, what is in an asset.

mod inspected;
mod planned;
mod table;

pub use inspected::{Inspected, asset_json, asset_text};
pub use planned::planned;
pub use table::level_table;
