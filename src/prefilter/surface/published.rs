//! The published estimator of T and S, kept as a baseline for benches and tests.
