//! Which texels see which table directions: one bit a texel and direction.
