//! Numbers without a subject: random numbers, warps and frames, the normal and the von Mises-Fisher distribution, vector
//! kernels. Nothing here can fail.

pub mod frame;
pub mod gaussian;
pub mod rng;
pub mod simd;
pub mod vmf;
pub mod warp;
