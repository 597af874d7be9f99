//! The farfield LoD asset on disk: reading, writing and evaluating it.

pub mod asset;
pub mod cell_brdf;
mod error;
mod ktx2;
pub mod lookup;

pub use asset::SurfaceAsset;
pub use cell_brdf::{BaseBrdf, CellBrdf, Lobe, Specular};
pub use error::Error;
pub use lookup::Boundary;
