//! `farfield render`.

use std::collections::BTreeMap;
use std::ops::Range;

use super::args::{Integrator, Lod, Model, RenderArgs};
use super::{DONE, FAILED, SENSELESS, complain, print};
use crate::build::clock::cpu_seconds;
use crate::build::manifest::ObjectSpec;
use crate::build::stage::{Stage, StageError};
use crate::build::volume::stage::VolumeStage;
use crate::build::{self, ScenePlan};
use crate::io::exr_writer::{ExrImage, encode_exr};
use crate::io::preview::encode_png;
use crate::io::publish::Publisher;
use crate::transport::film::Film;
use crate::transport::render::{self as renderer, RenderSettings};
use crate::transport::sampler::Sampling;
use crate::transport::{scene, volume};

/// Draws a scene; the exit code.
pub(super) fn run(args: &RenderArgs) -> u8 {
    let plan = match ScenePlan::read(&args.manifest, &args.scene) {
        Ok(plan) => plan,
        Err(error) => {
            error.lines().iter().for_each(|line| complain("error", line));
            return SENSELESS;
        }
    };
    let stage = match Shown::read(&plan, args) {
        Ok(stage) => stage,
        Err(error) => {
            complain("error", &error.to_string());
            return if matches!(error, StageError::Senseless { .. }) { SENSELESS } else { FAILED };
        }
    };
    stage.warnings().iter().for_each(|line| complain("warning", line));
    let settings = match settings(args, &stage) {
        Ok(settings) => settings,
        Err(line) => {
            complain("error", &line);
            return SENSELESS;
        }
    };
    let pool = match rayon::ThreadPoolBuilder::new().num_threads(args.jobs.map_or(0, usize::from)).build() {
        Ok(pool) => pool,
        Err(error) => {
            complain("error", &format!("`--jobs`: {error}"));
            return FAILED;
        }
    };
    let (film, seconds) = pool.install(|| draw(args, &stage, &settings));
    match write(args, &film, &settings) {
        Ok(()) if args.quiet => DONE,
        Ok(()) => {
            let [width, height] = film.size();
            let path = args.output.display();
            print(&format!(
                "{path}: {width} × {height}, {} samples a pixel, {seconds:.2} CPU seconds\n",
                film.samples()
            ));
            DONE
        }
        Err(line) => {
            complain("error", &line);
            FAILED
        }
    }
}

/// What a scene shows.
enum Shown {
    Surface(Box<Stage>),
    Volume(Box<VolumeStage>),
}

impl Shown {
    /// Reads what the scene of `plan` needs.
    fn read(plan: &ScenePlan, args: &RenderArgs) -> Result<Self, StageError> {
        let model = model(args.model);
        match plan.scene.objects.first() {
            Some(ObjectSpec::Volume { .. }) => {
                VolumeStage::read(plan, model, &args.out).map(|stage| Self::Volume(Box::new(stage)))
            }
            _ => Stage::read(plan, model, &args.out).map(|stage| Self::Surface(Box::new(stage))),
        }
    }

    fn warnings(&self) -> &[String] {
        match self {
            Self::Surface(stage) => &stage.warnings,
            Self::Volume(stage) => &stage.warnings,
        }
    }

    /// Numbers of the levels, fine to coarse.
    fn indices(&self) -> Vec<u32> {
        match self {
            Self::Surface(stage) => stage.model().indices().collect(),
            Self::Volume(stage) => stage.indices().collect(),
        }
    }

    /// The integrator that shows what the levels stand for: all light of a volume.
    fn integrator(&self) -> renderer::Integrator {
        match self {
            Self::Surface(stage) => stage.integrator(),
            Self::Volume(_) => renderer::Integrator::Path,
        }
    }
}

/// How the scene is rendered; the error is one line.
fn settings(args: &RenderArgs, stage: &Shown) -> Result<RenderSettings, String> {
    let lod = match args.lod {
        Lod::Auto => scene::Lod::Auto,
        Lod::Level(_) if args.model == Model::Full => {
            if !args.quiet {
                complain("note", "`--lod` changes nothing: `--model full` has no levels");
            }
            scene::Lod::Auto
        }
        Lod::Level(index) => {
            let indices = stage.indices();
            let place = indices.iter().position(|&level| level as usize == index);
            let levels = indices.len();
            scene::Lod::Fixed(
                place.ok_or_else(|| format!("`--lod` is {index}; wanted 1 to {levels}, the levels there are"))?,
            )
        }
    };
    let fitting = stage.integrator();
    let integrator = match args.integrator {
        None => fitting,
        Some(Integrator::Direct) => renderer::Integrator::Direct,
        Some(Integrator::Path) => renderer::Integrator::Path,
    };
    if integrator != fitting && matches!(args.model, Model::Farfield | Model::Lobes) {
        let [found, wanted] = [integrator, fitting].map(integrator_name);
        complain(
            "warning",
            &format!("`--integrator {found}` does not fit the `light` of the asset; wanted `{wanted}`, the default"),
        );
    }
    Ok(RenderSettings { integrator, lod, seed: args.seed, sampling: Sampling::Sobol })
}

/// The model in the words of `build`.
fn model(model: Model) -> build::Model {
    match model {
        Model::Farfield => build::Model::Farfield,
        Model::Full => build::Model::Full,
        Model::Naive => build::Model::Naive,
        Model::Lobes => build::Model::Lobes,
        Model::Leadr => build::Model::Leadr,
    }
}

/// The image, and the CPU seconds that it took.
fn draw(args: &RenderArgs, stage: &Shown, settings: &RenderSettings) -> (Film, f64) {
    match stage {
        Shown::Surface(stage) => {
            let scene = stage.scene();
            draw_passes(args, stage.film(), |samples, film| renderer::render(&scene, settings, samples, film))
        }
        Shown::Volume(stage) => {
            let scene = stage.scene();
            draw_passes(args, stage.film(), |samples, film| volume::render::render(&scene, settings, samples, film))
        }
    }
}

/// The image made of passes of samples, and the CPU seconds that it took.
fn draw_passes(args: &RenderArgs, size: [usize; 2], mut draw: impl FnMut(Range<u64>, &mut Film)) -> (Film, f64) {
    let mut film = Film::new(size);
    let started = cpu_seconds();
    match args.time {
        None => draw(0..u64::from(args.spp), &mut film),
        Some(seconds) => {
            // doubling passes: the last may take as long as all before it, so it is cut to what is left
            let (mut done, mut pass) = (0, 1);
            loop {
                draw(done..done + pass, &mut film);
                done += pass;
                let spent = cpu_seconds() - started;
                let left = (seconds - spent) / spent.max(1e-6) * done as f64;
                if left < 1.0 {
                    break;
                }
                pass = (left as u64).clamp(1, done);
            }
        }
    }
    (film, cpu_seconds() - started)
}

/// Writes the image and, if wanted, its preview; the error is one line.
fn write(args: &RenderArgs, film: &Film, settings: &RenderSettings) -> Result<(), String> {
    let publisher = Publisher::default();
    let [width, height] = film.size();
    let rgb = film.radiance();
    let bytes = encode_exr(&exr(args, film, settings, &rgb));
    publisher.file(&args.output, &bytes).map_err(|error| error.to_string())?;
    if args.png {
        let png = encode_png(&rgb, width as u32, height as u32, args.exposure);
        publisher.file(&args.output.with_extension("png"), &png).map_err(|error| error.to_string())?;
    }
    Ok(())
}

/// An integrator as the command line calls it.
fn integrator_name(integrator: renderer::Integrator) -> &'static str {
    match integrator {
        renderer::Integrator::Direct => "direct",
        renderer::Integrator::Path => "path",
    }
}

/// Radiance, variance and sample count, with what they are of.
fn exr(args: &RenderArgs, film: &Film, settings: &RenderSettings, rgb: &[[f32; 3]]) -> ExrImage {
    let variance = film.variance();
    let plane = |pixels: &[[f32; 3]], channel: usize| pixels.iter().map(|pixel| pixel[channel]).collect::<Vec<f32>>();
    let mut channels = Vec::new();
    for (channel, name) in ["R", "G", "B"].into_iter().enumerate() {
        channels.push((name.to_string(), plane(rgb, channel)));
        channels.push((format!("variance.{name}"), plane(&variance, channel)));
    }
    channels.push(("samples".into(), vec![film.samples() as f32; rgb.len()]));
    let integrator = integrator_name(settings.integrator);
    let lod = match args.lod {
        Lod::Auto => "auto".to_string(),
        Lod::Level(index) => index.to_string(),
    };
    let attributes = BTreeMap::from([
        ("farfield.integrator".to_string(), integrator.to_string()),
        ("farfield.lod".into(), lod),
        ("farfield.model".into(), model(args.model).name().into()),
        ("farfield.samples".into(), film.samples().to_string()),
        ("farfield.scene".into(), args.scene.clone()),
        ("farfield.seed".into(), args.seed.to_string()),
        ("farfield.version".into(), env!("CARGO_PKG_VERSION").into()),
    ]);
    ExrImage { size: film.size(), channels, attributes }
}
