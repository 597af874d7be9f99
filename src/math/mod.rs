//! Numbers without a subject: random numbers, warps and frames, the normal and the von Mises-Fisher distribution, SGGX
//! normals, spherical harmonics, small linear algebra, vector kernels. Nothing here can fail.

pub mod frame;
pub mod gaussian;
pub mod linear;
pub mod rng;
pub mod sggx;
pub mod sh;
pub mod simd;
pub mod vmf;
pub mod warp;
