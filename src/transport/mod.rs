//! Light between surfaces: effective BRDFs of a patch by exact ray casts, with their variance.

pub mod effective;
mod estimate;
