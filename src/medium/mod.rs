//! What light meets inside of a volume: grids of microflakes, free flights through them, and what flakes reflect.
//!
//! A [`Medium`] is a grid of voxels, each constant, with a density of flake area and up to [`MAX_LOBES`] SGGX lobes of
//! flakes. A fine volume has one lobe a voxel; a prefiltered one is a `Medium` too. Frame: right-handed, along the axes of
//! the grid, metres, the origin at the corner of voxel (0, 0, 0); an axis that repeats has no ends.
//!
//! A [`Place`] is a point of the grid, a flight goes from place to place: [`Medium::fly`] and [`Medium::transmittance`] are
//! exact; delta tracking and ratio tracking ([`Medium::fly_by_majorant`]) are there to be compared with. Directions that fly
//! point along the flight; directions of the phase function point away from the flakes ([`formats::sggx`]).

mod grid;
mod majorant;
mod phase;
mod tracking;

pub use grid::{MAX_LOBES, Medium, MediumShape, Voxel};
pub use phase::{BoundFlakes, Scatter};
pub use tracking::{Flight, Place};
