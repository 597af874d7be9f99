//! What levels are compared with.

pub mod naive;
