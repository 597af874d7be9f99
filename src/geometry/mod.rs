//! Height fields and exact rays against them.
//!
//! A [`HeightField`] is what every later room calls the surface: a grid of vertices in metres over the base plane,
//! bilinear between them. Frame: the base plane is z = 0, x = +u, y = −v (rows run down), right-handed. A
//! [`HeightTracer`] answers what a ray meets: from a [`SurfacePoint`], whether a direction is hidden; from anywhere, the
//! first [`Hit`]. A [`DisplacedPlane`] tiles a height field, if wanted on a [`LargeShape`], and is what scenes are made of.

mod displaced_plane;
mod height_field;
mod large_shape;
mod panels;
mod patch;
mod pyramid;
pub mod tracer;
mod walk;
mod wide_ray;

pub use displaced_plane::{DisplacedPlane, PlaneHit};
pub use height_field::{Boundary, HeightField};
pub use large_shape::{Facet, LargeShape, Stretch};
pub use tracer::{HeightTracer, Hit, Ray, SurfacePoint};
