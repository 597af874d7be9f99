//! Height fields and exact rays against them.
//!
//! A [`HeightField`] is what every later room calls the surface: a grid of vertices in metres over the base plane,
//! bilinear between them. Frame: the base plane is z = 0, x = +u, y = −v (rows run down), right-handed. A
//! [`HeightTracer`] answers what a ray meets: from a [`SurfacePoint`], whether a direction is hidden; from anywhere, the
//! first [`Hit`].

mod height_field;
mod panels;
mod patch;
mod pyramid;
pub mod tracer;
mod walk;
mod wide_ray;

pub use height_field::{Boundary, HeightField};
pub use tracer::{HeightTracer, Hit, Ray, SurfacePoint};
