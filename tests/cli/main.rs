//! The command line as a user meets it: whole messages, exit codes, and what is on the disk afterwards.

mod commands;
mod interruption;
mod malformed;
mod manifests;
mod project;
mod rendering;
mod repeatability;
mod tradeoff;
mod volumes;
