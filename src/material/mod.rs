//! What light meets: base BRDFs, how to sample them, and the spherical-Gaussian form of their normal distributions.
//!
//! A [`Brdf`] is the sum of a diffuse part and a rough [`Conductor`]. Values are 1/sr, RGB, without a cosine; all
//! directions point away from the surface. [`Brdf::sample`] and [`Brdf::pdf`] are its importance sampling. Prefiltering
//! knows GGX only ([`ggx_gaussians`]). [`LeadrBrdf`] is another filter of surfaces, kept as a baseline.

mod brdf;
mod conductor;
mod leadr;
mod ndf_gaussians;
mod sampling;
mod slopes;

pub use brdf::Brdf;
pub use conductor::{Conductor, Distribution};
pub use leadr::{LeadrBrdf, SlopeMoments};
pub use ndf_gaussians::ggx_gaussians;
pub use sampling::BrdfSample;
