//! `farfield build`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::args::BuildArgs;
use super::progress::{Progress, Verbosity};
use super::{DONE, FAILED, INTERRUPTED, SENSELESS, complain, print};
use crate::build::{Event, Limits, Outcome, Plan, Remote, Request, build, foresee};
use crate::io::publish::Publisher;
use crate::report;

/// Memory where the system does not tell how much there is: half of what a small machine has today.
const UNKNOWN_MEMORY: u64 = 8 << 30;

/// Builds what was asked for; the exit code.
pub(super) fn run(args: &BuildArgs) -> u8 {
    let (plan, remote) = match (plan(args), remote(args)) {
        (Ok(plan), Ok(remote)) => (plan, remote),
        (Err(code), _) | (_, Err(code)) => return code,
    };
    if args.dry_run {
        print(&dry_run(&plan, args));
        return DONE;
    }
    let publisher = match publisher(&args.out) {
        Ok(publisher) => publisher,
        Err(code) => return code,
    };
    compile(&plan, args, remote, &publisher)
}

/// What is asked for; else the exit code.
pub(super) fn plan(args: &BuildArgs) -> Result<Plan, u8> {
    let plan = Plan::read(&args.manifest, &args.names).map_err(|error| {
        error.lines().iter().for_each(|line| complain("error", line));
        SENSELESS
    })?;
    Ok(match args.error {
        Some(error) => plan.with_error(error),
        None => plan,
    })
}

/// The remote store that is asked for, if any; else the exit code.
pub(super) fn remote(args: &BuildArgs) -> Result<Option<Remote>, u8> {
    args.remote.as_deref().map(Remote::from_environment).transpose().map_err(|text| {
        complain("error", &format!("`--remote`: {text}"));
        SENSELESS
    })
}

/// A publisher that an interruption waits for; else the exit code.
pub(super) fn publisher(out: &Path) -> Result<Arc<Publisher>, u8> {
    let publisher = Arc::new(Publisher::default());
    if let Err(error) = publisher.probe(out) {
        complain("error", &error.to_string());
        return Err(FAILED);
    }
    if let Err(error) = on_interruption(Arc::clone(&publisher)) {
        complain("warning", &format!("an interruption may come in the middle of writing: {error}"));
    }
    Ok(publisher)
}

/// The folder of the cache of the manifest at `manifest`.
pub(super) fn cache_folder(cache: Option<&PathBuf>, manifest: &Path) -> PathBuf {
    cache.cloned().unwrap_or_else(|| manifest.parent().unwrap_or(Path::new("")).join(".farfield"))
}

/// What would be built, and why.
fn dry_run(plan: &Plan, args: &BuildArgs) -> String {
    let surfaces = plan.surfaces.iter().map(|surface| report::planned(surface, &args.out, args.json));
    let volumes = plan.volumes.iter().map(|volume| report::planned_volume(volume, &args.out, args.json));
    let planned: String = surfaces.chain(volumes).collect();
    if !args.explain {
        return planned;
    }
    let cache = cache_folder(args.cache.as_ref(), &args.manifest);
    let intents = foresee(plan, &args.out, &cache, args.force);
    let lines = intents.iter().map(|intent| match (args.json, intent.reasons.as_slice()) {
        (true, reasons) => format!("{}\n", serde_json::json!({ "name": intent.name, "would_build": reasons })),
        (false, []) => format!("{}: up to date\n", intent.name),
        (false, reasons) => format!("{}: would be built: {}\n", intent.name, reasons.join("; ")),
    });
    planned + &lines.collect::<String>()
}

/// Builds the plan within the wanted limits; the exit code.
pub(super) fn compile(plan: &Plan, args: &BuildArgs, remote: Option<Remote>, publisher: &Publisher) -> u8 {
    let request = Request {
        out: args.out.clone(),
        cache: cache_folder(args.cache.as_ref(), &args.manifest),
        cache_limit: args.cache_limit,
        remote,
        limits: limits(args.jobs, args.memory),
        is_forced: args.force,
    };
    let mut progress = Progress::new(match (args.verbose, args.quiet) {
        (true, _) => Verbosity::Stages,
        (_, true) => Verbosity::Quiet,
        _ => Verbosity::Normal,
    });
    let outcome = build(plan, request, publisher, &mut |event| {
        progress.tell(event);
        print(&lines(event, args));
    });
    progress.finish(&outcome);
    if !args.json {
        print(&report::level_table(&outcome.records));
        print(&report::volume_table(&outcome.volumes));
    }
    exit_code(&outcome, args.strict)
}

/// What a build may use: what is wanted, or one thread a processor and three quarters of the memory.
pub(super) fn limits(jobs: Option<u16>, memory: Option<u64>) -> Limits {
    let processors = || std::thread::available_parallelism().map_or(1, usize::from);
    Limits {
        threads: jobs.map_or_else(processors, usize::from),
        memory: memory.unwrap_or_else(three_quarters_of_memory),
    }
}

/// What an event puts on stdout.
fn lines(event: Event<'_>, args: &BuildArgs) -> String {
    match event {
        Event::Built { records, .. } if args.json => records.iter().map(|record| record.to_json() + "\n").collect(),
        Event::VolumeBuilt { records, .. } if args.json => {
            records.iter().map(|record| record.to_json() + "\n").collect()
        }
        Event::Failed { name, text } | Event::VolumeFailed { name, text } if args.json => {
            format!("{}\n", serde_json::json!({ "name": name, "failed": text }))
        }
        Event::Ran { name, action, reasons } if args.explain && args.json => {
            format!("{}\n", serde_json::json!({ "name": name, "ran": action, "because": reasons }))
        }
        Event::Ran { name, action, reasons } if args.explain => format!("{name}: {action}: {}\n", reasons.join("; ")),
        Event::Built { name, ran: 0, .. } | Event::VolumeBuilt { name, ran: 0, .. } if args.explain => {
            format!("{name}: nothing ran\n")
        }
        _ => String::new(),
    }
}

/// 1 where a surface failed or, if `strict`, missed its error.
fn exit_code(outcome: &Outcome, strict: bool) -> u8 {
    if outcome.failed > 0 || strict && outcome.missed > 0 { FAILED } else { DONE }
}

/// Three quarters of the machine's memory.
fn three_quarters_of_memory() -> u64 {
    let text = std::fs::read_to_string("/proc/meminfo").unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("MemTotal:"));
    let kibibytes =
        line.and_then(|rest| rest.trim().strip_suffix(" kB")).and_then(|number| number.trim().parse::<u64>().ok());
    kibibytes.map_or(UNKNOWN_MEMORY, |kibibytes| kibibytes * 768)
}

/// Ends the process on an interruption, after the publication under way, if there is one.
fn on_interruption(publisher: Arc<Publisher>) -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(move || {
        let _none_begins = publisher.halt();
        complain("error", "interrupted; what was published before is whole");
        std::process::exit(INTERRUPTED);
    })
}
