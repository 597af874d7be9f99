//! `farfield tradeoff`.

use super::args::TradeoffArgs;
use super::{DONE, FAILED, SENSELESS, complain, print};
use crate::build::{Plan, SurfaceSpec};
use crate::io::publish::Publisher;
use crate::report::tradeoff::{TradeoffSettings, level_lines, plots, study, study_tables, sweep, table};

/// Sweeps or studies one surface; the exit code.
pub(super) fn run(args: &TradeoffArgs) -> u8 {
    let plan = match Plan::read(&args.manifest, std::slice::from_ref(&args.name)) {
        Ok(plan) => plan,
        Err(error) => {
            error.lines().iter().for_each(|line| complain("error", line));
            return SENSELESS;
        }
    };
    let Some(spec) = plan.surfaces.first() else { return SENSELESS };
    let levels = spec.levels.len();
    if let Some(level) = args.level.filter(|level| *level > levels) {
        complain("error", &format!("`--level` is {level}; wanted 1 to {levels}, the levels of `{}`", spec.name));
        return SENSELESS;
    }
    let publisher = Publisher::default();
    if let Err(error) = publisher.probe(&args.report) {
        complain("error", &error.to_string());
        return FAILED;
    }
    let pool = match rayon::ThreadPoolBuilder::new().num_threads(args.jobs.map_or(0, usize::from)).build() {
        Ok(pool) => pool,
        Err(error) => {
            complain("error", &format!("`--jobs`: {error}"));
            return FAILED;
        }
    };
    let written =
        pool.install(|| if args.study { write_study(args, &plan, spec) } else { write_sweep(args, &plan, spec) });
    let files = match written {
        Ok(files) => files,
        Err(text) => {
            complain("error", &format!("surface `{}`: {text}", spec.name));
            return FAILED;
        }
    };
    for (name, text) in files {
        if let Err(error) = publisher.file(&args.report.join(name), text.as_bytes()) {
            complain("error", &error.to_string());
            return FAILED;
        }
    }
    DONE
}

/// Tells what is done.
fn tell(args: &TradeoffArgs, step: &str) {
    if !args.quiet {
        eprintln!("{step}");
    }
}

/// The files of a sweep, which is printed.
fn write_sweep(args: &TradeoffArgs, plan: &Plan, spec: &SurfaceSpec) -> Result<Vec<(String, String)>, String> {
    let settings = TradeoffSettings {
        errors: args.errors.clone(),
        level: args.level,
        size: args.size as usize,
        samples_per_half: args.spp,
        seed: args.seed,
    };
    let tradeoff = sweep(spec, &plan.folder, &settings, &mut |step| tell(args, step))?;
    let (text, lines, name) = (table(&tradeoff), level_lines(&tradeoff), &spec.name);
    print(if args.json { &lines } else { &text });
    let files = [("txt", text), ("json", lines), ("svg", plots(&tradeoff))];
    Ok(files.map(|(kind, text)| (format!("tradeoff-{name}.{kind}"), text)).to_vec())
}

/// The files of a study, which is printed.
fn write_study(args: &TradeoffArgs, plan: &Plan, spec: &SurfaceSpec) -> Result<Vec<(String, String)>, String> {
    let indices = (1..=spec.levels.len()).filter(|index| args.level.is_none_or(|level| level == *index));
    let studies = indices.map(|index| study(spec, &plan.folder, index, &mut |step| tell(args, step)));
    let studies = studies.collect::<Result<Vec<_>, _>>()?;
    let text = studies.iter().map(study_tables).collect::<Vec<_>>().join("\n");
    let lines: String = studies.iter().map(|study| format!("{}\n", serde_json::json!(study))).collect();
    print(if args.json { &lines } else { &text });
    let files = [("txt", text), ("json", lines)];
    Ok(files.map(|(kind, text)| (format!("study-{}.{kind}", spec.name), text)).to_vec())
}
