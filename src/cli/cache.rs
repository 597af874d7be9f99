//! `farfield cache`.

use std::path::Path;

use super::args::{CacheArgs, CacheCommand, VerifyCacheArgs};
use super::build::{cache_folder, limits};
use super::{DONE, FAILED, SENSELESS, complain, print};
use crate::build::{Event, Plan, Request, Store, build};
use crate::io::publish::Publisher;
use crate::io::scratch::Scratch;

/// Looks after the cache; the exit code.
pub(super) fn run(command: &CacheCommand) -> u8 {
    let args = match command {
        CacheCommand::Stats(args) | CacheCommand::Gc(args) => args,
        CacheCommand::Verify(args) => &args.cache,
    };
    let folder = cache_folder(args.cache.as_ref(), &args.manifest);
    if !folder.is_dir() {
        let wanted = "wanted a build cache, which `farfield build` makes";
        complain("error", &format!("`{}`: is no folder; {wanted}", folder.display()));
        return FAILED;
    }
    match command {
        CacheCommand::Stats(_) => stats(&Store::open_to_read(&folder), args),
        CacheCommand::Gc(_) => gc(&Store::open(&folder, None), args),
        CacheCommand::Verify(VerifyCacheArgs { rerun, .. }) => match verify(&Store::open(&folder, None), args) {
            DONE if *rerun => rerun_all(&folder, args),
            code => code,
        },
    }
}

/// Runs every action of the manifest, publishes nothing, and compares; the exit code.
fn rerun_all(folder: &Path, args: &CacheArgs) -> u8 {
    let plan = match Plan::read(&args.manifest, &[]) {
        Ok(plan) => plan,
        Err(error) => {
            error.lines().iter().for_each(|line| complain("error", line));
            return SENSELESS;
        }
    };
    let scratch = match Scratch::claim(&folder.join("tmp"), "") {
        Ok(scratch) => scratch,
        Err(error) => {
            complain("error", &format!("`{}`: cannot be written to: {error}", folder.display()));
            return FAILED;
        }
    };
    let request = Request {
        out: scratch.folder().join("lod"),
        cache: folder.into(),
        cache_limit: u64::MAX,
        remote: None,
        limits: limits(None, None),
        is_forced: true,
    };
    let outcome = build(&plan, request, &Publisher::default(), &mut |event| match event {
        Event::Failed { name, text } => complain("error", &format!("surface `{name}`: {text}")),
        Event::VolumeFailed { name, text } => complain("error", &format!("volume `{name}`: {text}")),
        Event::Notice { text } => complain("warning", text),
        _ => {}
    });
    print(&if args.json {
        format!(
            "{}\n",
            serde_json::json!({ "ran": outcome.ran, "differing": outcome.differing, "failed": outcome.failed })
        )
    } else {
        format!("{} actions ran, {} gave other bytes than before\n", outcome.ran, outcome.differing)
    });
    if outcome.differing + outcome.failed > 0 { FAILED } else { DONE }
}

fn stats(store: &Store, args: &CacheArgs) -> u8 {
    let stats = store.stats();
    print(&if args.json {
        let line = serde_json::json!({
            "records": stats.records, "record_bytes": stats.record_bytes, "artifacts": stats.artifacts,
            "artifact_bytes": stats.artifact_bytes, "orphans": stats.orphans,
        });
        format!("{line}\n")
    } else {
        format!(
            "records    {:>8}  {:>10}\nartifacts  {:>8}  {:>10}\norphans    {:>8}\n",
            stats.records,
            size(stats.record_bytes),
            stats.artifacts,
            size(stats.artifact_bytes),
            stats.orphans
        )
    });
    DONE
}

fn gc(store: &Store, args: &CacheArgs) -> u8 {
    let removed = store.collect(args.limit);
    print(&if args.json {
        let line =
            serde_json::json!({ "orphans": removed.orphans, "evicted": removed.evicted, "bytes": removed.bytes });
        format!("{line}\n")
    } else {
        format!("removed {} orphans and {} artifacts, {}\n", removed.orphans, removed.evicted, size(removed.bytes))
    });
    told(store)
}

fn verify(store: &Store, args: &CacheArgs) -> u8 {
    let damages = store.verify();
    for damage in &damages {
        let path = damage.path.display();
        let end = if damage.is_removed { "removed; the next build makes it again" } else { "it cannot be removed" };
        complain("error", &format!("`{path}`: is not what its name says; {end}"));
    }
    let stats = store.stats();
    let files = stats.records + stats.artifacts;
    print(&if args.json {
        format!("{}\n", serde_json::json!({ "whole": files, "damaged": damages.len() }))
    } else {
        format!("{files} files are whole, {} are not\n", damages.len())
    });
    if damages.is_empty() { told(store) } else { FAILED }
}

/// Tells what the store has to say; the exit code.
fn told(store: &Store) -> u8 {
    store.notices().iter().for_each(|text| complain("warning", text));
    DONE
}

/// Bytes for people.
fn size(bytes: u64) -> String {
    let units = ["B", "KiB", "MiB", "GiB", "TiB"];
    let power = (0..units.len() - 1).find(|&power| bytes >> (10 * power) < 1024).unwrap_or(units.len() - 1);
    if power == 0 {
        format!("{bytes} B")
    } else {
        format!("{:.1} {}", bytes as f64 / (1_u64 << (10 * power)) as f64, units[power])
    }
}
