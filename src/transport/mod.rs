//! Light between surfaces: effective BRDFs of a patch by exact ray casts, with their variance.
//!
//! [`effective`] samples points of a patch and what they see; F and A of either surface are sums over these points. Every
//! mean travels with its variance and count as an [`Estimate`].

pub mod effective;
mod estimate;

pub use effective::{PatchPoint, PatchSampling};
pub use estimate::{Accumulator, Estimate};
