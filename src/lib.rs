//! Farfield, a prefiltering asset compiler for level-of-detail content.
//!
//! A height map far finer than a pixel goes in; coarse levels that reflect the same light come out. The rooms, bottom up:
//!
//! - [`math`]: random numbers, von Mises-Fisher statistics, vector kernels
//! - [`geometry`]: height fields and exact rays against them
//! - [`material`]: base BRDFs and their spherical-Gaussian forms
//! - [`medium`]: grids of microflakes, flights through them, phase functions
//! - [`transport`]: effective BRDFs of a patch by exact ray casts
//! - [`prefilter`]: one fine level in, one coarse level out
//! - [`io`]: every byte in or out
//! - [`build`]: manifest to plan to asset
//! - [`report`]: tables that people read
//! - [`cli`]: arguments, progress, exit codes

pub mod build;
pub mod cli;
pub mod geometry;
pub mod io;
pub mod material;
pub mod math;
pub mod medium;
pub mod prefilter;
pub mod report;
pub mod transport;
