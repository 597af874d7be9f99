//! What levels are compared with.

pub mod naive;
pub mod published;
