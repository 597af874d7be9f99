//! Height fields and exact rays against them.
//!
//! A [`HeightField`] is what every later room calls the surface: a grid of vertices in metres over the base plane,
//! bilinear between them. Frame: the base plane is z = 0, x = +u, y = −v (rows run down), right-handed.

mod height_field;
pub mod tracer;

pub use height_field::{Boundary, HeightField};
