//! What is done where nothing better is at hand: averaged heights, and slope moments. For reports and benches.
//!
//! The third baseline, lobes without a scaling, is a level whose T and S are 1; it needs no code here.

pub mod leadr;
pub mod naive;
