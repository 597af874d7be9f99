//! `farfield watch`.

use std::path::PathBuf;

use super::args::BuildArgs;
use super::build::{compile, plan, publisher, remote};
use super::{SENSELESS, complain};
use crate::build::{Looks, Plan, Watcher};

/// Builds, and again whenever the manifest, a map or a grid has changed, until interrupted; an exit code if it cannot begin.
pub(super) fn run(args: &BuildArgs) -> u8 {
    if args.dry_run {
        complain("error", "`watch` builds; `--dry-run` goes with `build`");
        return SENSELESS;
    }
    let publisher = match publisher(&args.out) {
        Ok(publisher) => publisher,
        Err(code) => return code,
    };
    let mut watcher = Watcher::default();
    loop {
        let remote = match remote(args) {
            Ok(remote) => remote,
            Err(code) => return code,
        };
        let mut files = vec![args.manifest.clone()];
        // How things look is asked before they are read: what changes afterwards is a change.
        let mut looks = Looks::of(&files);
        if let Ok(plan) = plan(args) {
            let maps = maps_of(&plan);
            looks = looks.and(Looks::of(&maps));
            compile(&plan, args, remote, &publisher);
            files.extend(maps);
        }
        if !args.quiet {
            complain("watching", &format!("{} files", files.len()));
        }
        watcher.wait(&files, &looks);
    }
}

/// Every file that the surfaces and volumes of `plan` are made from, each once.
fn maps_of(plan: &Plan) -> Vec<PathBuf> {
    let surfaces = plan.surfaces.iter().flat_map(|surface| [Some(&surface.height), surface.color.as_ref()]);
    let volumes = plan.volumes.iter().flat_map(|volume| volume.grids()).map(|(_, grid)| &grid.file);
    let mut maps: Vec<PathBuf> = surfaces.flatten().chain(volumes).map(|file| plan.folder.join(file)).collect();
    maps.sort();
    maps.dedup();
    maps
}
