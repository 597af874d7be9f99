//! Prefiltering: one fine level in, one coarse level out. Knows neither files nor cache keys.

pub mod surface;
pub mod volume;
