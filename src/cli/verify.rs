//! `farfield verify`.

use super::args::VerifyArgs;
use super::{DONE, FAILED, SENSELESS, complain, print};
use crate::build::Plan;
use crate::io::publish::Publisher;
use crate::report::verify::{Verified, VerifyEvent, VerifySettings, verify};
use crate::report::{html, level_json, verification_table};

/// Compares assets with their originals; the exit code.
pub(super) fn run(args: &VerifyArgs) -> u8 {
    let plan = match Plan::read(&args.manifest, &args.names) {
        Ok(plan) => plan,
        Err(error) => {
            error.lines().iter().for_each(|line| complain("error", line));
            return SENSELESS;
        }
    };
    for volume in &plan.volumes {
        complain("warning", &format!("`{}`: volumes are not verified in this version", volume.name));
    }
    let most_levels = plan.surfaces.iter().map(|surface| surface.levels.len()).max().unwrap_or(0);
    if let Some(level) = args.level.filter(|level| *level > most_levels) {
        complain("error", &format!("`--level` is {level}; wanted 1 to {most_levels}, the levels of the manifest"));
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
    let settings = VerifySettings {
        size: args.size as usize,
        samples_per_half: args.spp,
        seed: args.seed,
        level: args.level.map(|level| level as u32),
    };
    let verified = pool.install(|| verify(&plan, &args.out, &settings, &mut |event| tell(args, event)));
    if verified.verification.assets.is_empty() {
        return FAILED;
    }
    if let Err(line) = write(args, &publisher, &verified) {
        complain("error", &line);
        return FAILED;
    }
    if verified.failed > 0 { FAILED } else { DONE }
}

/// Tells what happens.
fn tell(args: &VerifyArgs, event: VerifyEvent<'_>) {
    match event {
        VerifyEvent::Image { name, level, case: (light, view), model } if args.verbose => {
            eprintln!("{name}: level {level}: {} light, {} view: {model}", light.name(), view.name());
        }
        VerifyEvent::Image { .. } => {}
        VerifyEvent::Level { name, level } if !args.quiet => eprintln!("{name}: level {level}"),
        VerifyEvent::Level { .. } => {}
        VerifyEvent::Warning { name, text } => complain("warning", &format!("surface `{name}`: {text}")),
        VerifyEvent::Failed { name, text } => complain("error", &format!("surface `{name}`: {text}")),
        VerifyEvent::Done { name, level } if args.json => print(&level_json(name, level)),
        VerifyEvent::Done { .. } => {}
    }
}

/// Writes the report and says where it is; the error is one line.
fn write(args: &VerifyArgs, publisher: &Publisher, verified: &Verified) -> Result<(), String> {
    let page = html::render(&verified.verification, &verified.pictures);
    let files = [("report.json", verified.verification.to_json()), ("report.html", page)];
    for (name, text) in files {
        publisher.file(&args.report.join(name), text.as_bytes()).map_err(|error| error.to_string())?;
    }
    if !args.json {
        print(&verification_table(&verified.verification));
        print(&format!("report: {}\n", args.report.join("report.html").display()));
    }
    Ok(())
}
