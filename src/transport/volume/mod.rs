//! Light in volumes: a path tracer for media of microflakes, and the means of their images.
//!
//! [`render`] makes images of a scene with any [`Light`](super::light::Light); [`means`] follows light from an environment to
//! parallel views, without pixels: what a fit compares. Both are made of the same [`walk`].
//!
//! A volume's frame is that of its grid, z the world's y: the point (x, y, z) of the grid, of extent (w, h, d), is at
//! (x − w/2, z − d/2, h/2 − y) of the world.

pub mod means;
pub mod render;
pub mod scene;
pub mod walk;

pub use scene::{Backdrop, VolumeLevel, VolumeObject, VolumeScene};
