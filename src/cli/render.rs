//! `farfield render`.

use super::args::{Lod, Model, RenderArgs};
use super::{FAILED, SENSELESS, complain};
use crate::build::ScenePlan;

/// Draws a scene; the exit code.
pub(super) fn run(args: &RenderArgs) -> u8 {
    let plan = match ScenePlan::read(&args.manifest, &args.scene) {
        Ok(plan) => plan,
        Err(error) => {
            error.lines().iter().for_each(|line| complain("error", line));
            return SENSELESS;
        }
    };
    if args.model == Model::Full && args.lod != Lod::Auto && !args.quiet {
        complain("note", "`--lod` changes nothing: `--model full` has no levels");
    }
    complain("error", &format!("scene `{}`: this version reads scenes and does not draw them yet", plan.scene.name));
    FAILED
}
