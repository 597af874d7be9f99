//! What light meets: base BRDFs and the spherical-Gaussian form of their normal distributions.
//!
//! A [`Brdf`] is the sum of a diffuse and a rough-conductor part. Values are 1/sr, RGB, without a cosine; all
//! directions point away from the surface.

mod brdf;
mod ndf_gaussians;

pub use brdf::{Brdf, Conductor};
pub use ndf_gaussians::ggx_gaussians;
