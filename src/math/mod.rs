//! Numbers without a subject: random numbers, von Mises-Fisher statistics, vector kernels. Nothing here can fail.

pub mod rng;
pub mod simd;
pub mod vmf;
