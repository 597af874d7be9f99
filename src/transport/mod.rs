//! Light between surfaces: effective BRDFs of a patch by exact ray casts, with their variance, and lights to see by.
//!
//! [`effective`] samples points of a patch and what they see; F and A of either surface are sums over these points.
//! Every mean travels with its variance and count as an [`Estimate`]. [`light`] holds what illuminates a scene,
//! [`volume`] what becomes of light in media.

pub mod bounces;
pub mod camera;
pub mod effective;
mod estimate;
pub mod film;
pub mod light;
pub mod render;
pub mod sampler;
pub mod scene;
pub mod shading;
pub mod volume;

pub use effective::{PatchPoint, PatchSampling};
pub use estimate::{Accumulator, Estimate};
