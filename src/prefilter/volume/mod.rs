//! From a fine volume to a coarse one.

pub mod orientation;
