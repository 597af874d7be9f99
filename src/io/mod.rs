//! Every byte in or out: height maps, colour maps, voxel grids, environments, renderings, and the folders that assets are published
//! in.
//!
//! A file is read once, whole, as a [`SourceFile`]; what is decoded is what was hashed. Its kind follows from its
//! first bytes, not from its name. Every length that a header claims is held against [`MAX_TEXELS`] and against the
//! bytes that are there before anything is allocated. An [`Error`] is one line: file, what was found, what was wanted.

pub mod color;
pub mod environment;
mod error;
mod exr_image;
pub mod exr_writer;
pub mod grid;
pub mod heights;
mod jpeg_image;
mod png_image;
pub mod preview;
pub mod publish;
mod raster;
pub mod scratch;
mod source;
mod tiff_image;

pub use error::Error;
pub use raster::MAX_TEXELS;
pub use source::SourceFile;

#[cfg(test)]
mod tests;
