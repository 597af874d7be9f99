//! Builds as a user meets them: what runs again and what does not, what a killed, crowded or damaged build leaves, what
//! a shared store may do. The binary is run; what it did is what it says with `--explain --json`.

#[allow(dead_code, reason = "the tests of the command line use the rest")]
#[path = "../cli/project.rs"]
mod project;

mod accidents;
mod edits;
mod remote;
mod reruns;
mod scheduling;
mod upkeep;
mod volumes;
mod watching;
mod workshop;
