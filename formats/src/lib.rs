//! The farfield LoD asset on disk: reading it, evaluating it, writing it.
//!
//! An asset is a folder: `asset.json` and KTX2 payloads. Each of its levels is a coarse displacement map with a BRDF
//! f_low that reflects what the full one did; `README.md` is the specification. [`level_brdf`] evaluates and samples it at
//! a renderer's pace. A [`VolumeAsset`] is the same for a cloud of microflakes, which [`sggx`] evaluates. A complete reader of
//! surfaces:
//!
//! ```
//! use farfield_formats::{Error, SurfaceAsset, lookup::direction_of};
//!
//! fn main() -> Result<(), Error> {
//!     let bark = SurfaceAsset::read("tests/data/v1".as_ref())?;
//!     let level = &bark.levels[0];
//!     let x = [0.3, 0.6]; // fraction of the map along u and v
//!     let height = level.height_at(x, bark.boundary); // metres: displace by it, cast shadow rays against it
//!     let n_c = level.normal_at(&bark, x);
//!     let [wi, wo] = [direction_of([0.4, 0.5]), direction_of([0.7, 0.6])]; // both away from the surface
//!     let f = level.f_low(&bark, x, n_c, wi, wo); // 1/sr, RGB, no cosine
//!     let cos_theta = (0..3).map(|k| n_c[k] * wi[k]).sum::<f32>().max(0.0); // light from behind n_c is none
//!     println!("{}: at {height} m it reflects {:?}", bark.name, f.map(|value| value * cos_theta));
//!     assert!(f.iter().all(|&value| value > 0.0));
//!     Ok(())
//! }
//! ```

pub mod asset;
pub mod cell_brdf;
mod elementary;
mod error;
mod ktx2;
pub mod level_brdf;
pub mod lookup;
pub mod sggx;
pub mod symmetric;
pub mod volume;

pub use asset::SurfaceAsset;
pub use cell_brdf::{BaseBrdf, CellBrdf, Lobe, Specular};
pub use error::Error;
pub use level_brdf::LevelBrdf;
pub use lookup::Boundary;
pub use sggx::{FlakeLobe, Sggx};
pub use volume::{VolumeAsset, VolumeLevel};
