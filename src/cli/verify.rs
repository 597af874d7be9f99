//! `farfield verify`.

use super::args::VerifyArgs;
use super::{FAILED, SENSELESS, complain};
use crate::build::Plan;

/// Compares assets with their originals; the exit code.
pub(super) fn run(args: &VerifyArgs) -> u8 {
    let plan = match Plan::read(&args.manifest, &args.names) {
        Ok(plan) => plan,
        Err(error) => {
            error.lines().iter().for_each(|line| complain("error", line));
            return SENSELESS;
        }
    };
    let most_levels = plan.surfaces.iter().map(|surface| surface.levels.len()).max().unwrap_or(0);
    if let Some(level) = args.level.filter(|level| *level > most_levels) {
        complain("error", &format!("`--level` is {level}; wanted 1 to {most_levels}, the levels of the manifest"));
        return SENSELESS;
    }
    complain("error", "this version compiles surfaces and does not verify them yet");
    FAILED
}
