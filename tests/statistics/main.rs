//! Samplers against their densities, estimators against quadrature: statistical tests with one budget of false alarms.
//!
//! Every test asks [`budget::threshold`] for the least p-value it may have. Adding a sampler is adding a file with
//! `test_count` and listing it there.

mod brdfs;
mod budget;
mod chi_square;
mod leadr;
mod sggx;
