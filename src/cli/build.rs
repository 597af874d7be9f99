//! `farfield build`.

use std::sync::Arc;

use super::args::BuildArgs;
use super::progress::{Progress, Verbosity};
use super::{DONE, FAILED, INTERRUPTED, SENSELESS, complain, print};
use crate::build::{Event, Outcome, Plan, build};
use crate::io::publish::Publisher;
use crate::report;

/// Builds what was asked for; the exit code.
pub(super) fn run(args: &BuildArgs) -> u8 {
    let plan = match Plan::read(&args.manifest, &args.names) {
        Ok(plan) => plan,
        Err(error) => {
            error.lines().iter().for_each(|line| complain("error", line));
            return SENSELESS;
        }
    };
    let plan = match args.error {
        Some(error) => plan.with_error(error),
        None => plan,
    };
    if args.dry_run {
        print(&dry_run(&plan, args));
        return DONE;
    }
    if args.force && !args.quiet {
        complain("note", "`--force` changes nothing: this version builds everything anew");
    }
    if args.cache.is_some() && !args.quiet {
        complain("note", "`--cache` changes nothing: this version keeps no cache");
    }
    compile(&plan, args)
}

/// What would be built.
fn dry_run(plan: &Plan, args: &BuildArgs) -> String {
    let surfaces = plan.surfaces.iter().map(|surface| report::planned(surface, &args.out, args.json));
    let volumes = plan.volumes.iter().map(|volume| report::planned_volume(volume, &args.out, args.json));
    surfaces.chain(volumes).collect()
}

/// Builds the plan on the wanted number of threads.
fn compile(plan: &Plan, args: &BuildArgs) -> u8 {
    let publisher = Arc::new(Publisher::default());
    if let Err(error) = publisher.probe(&args.out) {
        complain("error", &error.to_string());
        return FAILED;
    }
    if let Err(error) = on_interruption(Arc::clone(&publisher)) {
        complain("warning", &format!("an interruption may come in the middle of writing: {error}"));
    }
    let threads = args.jobs.map_or(0, usize::from); // 0 is one a processor
    let pool = match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool,
        Err(error) => {
            complain("error", &format!("`--jobs`: {error}"));
            return FAILED;
        }
    };
    let mut progress = Progress::new(match (args.verbose, args.quiet) {
        (true, _) => Verbosity::Stages,
        (_, true) => Verbosity::Quiet,
        _ => Verbosity::Normal,
    });
    let outcome = pool.install(|| {
        build(plan, &args.out, &publisher, &mut |event| {
            progress.tell(event);
            if args.json {
                print(&json_lines(event));
            }
        })
    });
    progress.finish();
    if !args.json {
        print(&report::level_table(&outcome.records));
        print(&report::volume_table(&outcome.volumes));
    }
    exit_code(&outcome, args.strict)
}

/// A finished surface as JSON, one level a line; a failed one as one line.
fn json_lines(event: Event<'_>) -> String {
    match event {
        Event::Built { records, .. } => records.iter().map(|record| record.to_json() + "\n").collect(),
        Event::Failed { name, text } | Event::VolumeFailed { name, text } => {
            format!("{}\n", serde_json::json!({ "name": name, "failed": text }))
        }
        Event::VolumeBuilt { records, .. } => records.iter().map(|record| record.to_json() + "\n").collect(),
        Event::Stage { .. } | Event::Warning { .. } | Event::VolumeWarning { .. } => String::new(),
    }
}

/// 1 where a surface failed or, if `strict`, missed its error.
fn exit_code(outcome: &Outcome, strict: bool) -> u8 {
    if outcome.failed > 0 || strict && outcome.missed > 0 { FAILED } else { DONE }
}

/// Ends the process on an interruption, after the publication under way, if there is one.
fn on_interruption(publisher: Arc<Publisher>) -> Result<(), ctrlc::Error> {
    ctrlc::set_handler(move || {
        let _none_begins = publisher.halt();
        complain("error", "interrupted; what was published before is whole");
        std::process::exit(INTERRUPTED);
    })
}
