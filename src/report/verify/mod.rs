//! The comparison itself: original and models rendered side by side, level by level.
//!
//! Every image is two halves of independent samples. Model and reference share nothing but the scene: their random numbers
//! are different, so that the noise of one says nothing of the other.

mod setups;

use std::path::Path;

use formats::asset::SurfaceAsset;

use self::setups::{Shot, Subject};
use super::equal_time::{EqualTime, EqualTimePoint, LevelTiming};
use super::flip::{self, PIXELS_PER_DEGREE};
use super::html::{CaseKey, CasePictures, Drawn, Pictures};
use super::metrics::{Halves, relative_mse_of_image};
use super::summary::summaries;
use super::verification::{
    AssetVerification, Case, Cost, LevelVerification, Light, Model, ModelResult, SCHEMA, Settings, SourceFile,
    Verification, View,
};
use crate::build::clock::cpu_seconds;
use crate::build::models::ModelData;
use crate::build::{Plan, SurfaceSpec, stage};
use crate::io::preview::encode_png;
use crate::transport::film::Film;
use crate::transport::render::{Integrator, RenderSettings, render};
use crate::transport::sampler::Sampling;
use crate::transport::scene::{Lod, Scene};

/// How much is rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VerifySettings {
    /// Width and height of the images in pixels.
    pub size: usize,
    /// Samples a pixel of either half of an image.
    pub samples_per_half: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The one level to verify; `None` is all.
    pub level: Option<u32>,
}

/// What happens during a verification.
#[derive(Clone, Copy, Debug)]
pub enum VerifyEvent<'a> {
    /// An image is about to be rendered.
    Image {
        /// Surface.
        name: &'a str,
        /// Number of the level.
        level: u32,
        /// Light and view.
        case: (Light, View),
        /// `full` or a model.
        model: &'a str,
    },
    /// A level begins.
    Level {
        /// Surface.
        name: &'a str,
        /// Number of the level.
        level: u32,
    },
    /// Something the user should know.
    Warning {
        /// Surface.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
    /// A surface cannot be verified.
    Failed {
        /// Surface.
        name: &'a str,
        /// One line.
        text: &'a str,
    },
    /// A level is done.
    Done {
        /// Surface.
        name: &'a str,
        /// Its figures.
        level: &'a LevelVerification,
    },
}

/// A verification with its pictures, and how many surfaces could not be verified.
#[derive(Debug)]
pub struct Verified {
    /// The figures.
    pub verification: Verification,
    /// The pictures.
    pub pictures: Pictures,
    /// Surfaces without figures.
    pub failed: usize,
}

/// Pixels a side of the images of the equal-time comparison.
const TIMED_SIZE: usize = 32;
/// Samples a pixel of either half of its reference: 8192 in all.
const TIMED_REFERENCE: u32 = 4096;
/// Samples a pixel of its points.
const TIMED_SAMPLES: [u32; 9] = [4, 8, 16, 32, 64, 128, 256, 512, 1024];
/// The light and view that are timed.
const TIMED_CASE: (Light, View) = (Light::Area, View::Oblique);

/// Compares the assets of `plan` in `out` with their originals.
pub fn verify(
    plan: &Plan,
    out: &Path,
    settings: &VerifySettings,
    on_event: &mut dyn FnMut(VerifyEvent<'_>),
) -> Verified {
    let started = cpu_seconds();
    let mut pictures = Pictures::default();
    let mut assets = Vec::new();
    let mut failed = 0;
    for spec in &plan.surfaces {
        match Surface::read(spec, &plan.folder, out, on_event) {
            Ok(surface) => assets.push(surface.verify(settings, &mut pictures, on_event)),
            Err(text) => {
                failed += 1;
                on_event(VerifyEvent::Failed { name: &spec.name, text: &text });
            }
        }
    }
    let verification = Verification {
        schema: SCHEMA,
        farfield_version: env!("CARGO_PKG_VERSION").into(),
        settings: settings.written(),
        assets,
        timing: Cost { cpu_seconds: cpu_seconds() - started },
    };
    Verified { verification, pictures, failed }
}

impl VerifySettings {
    /// As the report states them.
    fn written(&self) -> Settings {
        Settings {
            image_size: [self.size as u32; 2],
            samples_per_half: self.samples_per_half,
            reference_samples_per_half: self.samples_per_half,
            seed: self.seed,
            levels: self.level.map(|level| vec![level]),
            lights: setups::light_settings(),
            views: setups::view_settings(),
            flip_pixels_per_degree: f64::from(PIXELS_PER_DEGREE),
        }
    }
}

/// Original, asset and baselines of one surface.
struct Surface {
    name: String,
    asset: SurfaceAsset,
    asset_digest: String,
    sources: Vec<SourceFile>,
    subject: Subject,
    full: ModelData,
    models: [ModelData; 4],
}

impl Surface {
    fn read(
        spec: &SurfaceSpec,
        folder: &Path,
        out: &Path,
        on_event: &mut dyn FnMut(VerifyEvent<'_>),
    ) -> Result<Self, String> {
        let (asset, asset_digest) = stage::read_asset(&spec.name, out).map_err(|error| error.to_string())?;
        let input = crate::build::input::read(spec, folder).map_err(|error| error.to_string())?;
        for text in &input.warnings {
            on_event(VerifyEvent::Warning { name: &spec.name, text });
        }
        if asset.source.digest != input.height_digest {
            return Err(format!(
                "the asset in `{}` was built from another height map than `{}` is now; wanted `farfield build {}` first",
                out.join(&spec.name).display(),
                spec.height,
                spec.name
            ));
        }
        let [low, high] = input.fine.heights.range().map(f64::from);
        let texels = input.fine.heights.size();
        let subject = Subject { size: spec.size, texels, boundary: spec.boundary, relief: high - low };
        let source = |role: &str, digest: &str| SourceFile {
            role: role.into(),
            digest: digest.into(),
            size: texels.map(|n| n as u32),
        };
        let mut sources = vec![source("height", &input.height_digest)];
        sources.extend(input.color_digest.iter().map(|digest| source("color", digest)));
        let cells: Vec<[usize; 2]> = asset.levels.iter().map(|level| level.cells).collect();
        let models = [
            ModelData::farfield(asset.clone()),
            ModelData::lobes(&asset),
            ModelData::leadr(&input, &cells),
            ModelData::naive(&input, &cells),
        ];
        Ok(Self {
            name: spec.name.clone(),
            asset,
            asset_digest,
            sources,
            subject,
            full: ModelData::full(&input),
            models,
        })
    }

    fn verify(
        &self,
        settings: &VerifySettings,
        pictures: &mut Pictures,
        on_event: &mut dyn FnMut(VerifyEvent<'_>),
    ) -> AssetVerification {
        let wanted = |index: u32| settings.level.is_none_or(|level| level == index);
        let places = (0..self.asset.levels.len()).filter(|&place| wanted(self.asset.levels[place].index));
        let levels = places
            .map(|place| {
                on_event(VerifyEvent::Level { name: &self.name, level: self.asset.levels[place].index });
                let level = LevelRun { surface: self, place, settings }.verify(pictures, on_event);
                on_event(VerifyEvent::Done { name: &self.name, level: &level });
                level
            })
            .collect();
        AssetVerification {
            name: self.name.clone(),
            asset_digest: self.asset_digest.clone(),
            light: "direct".into(),
            surface_settings: self.asset.settings.clone(),
            sources: self.sources.clone(),
            levels,
        }
    }
}

/// One level under comparison.
struct LevelRun<'a> {
    surface: &'a Surface,
    /// Its place in the asset.
    place: usize,
    settings: &'a VerifySettings,
}

/// Two halves of an image and what both took.
struct Image {
    halves: [Vec<[f32; 3]>; 2],
    cpu_seconds: f64,
}

impl Image {
    fn halves(&self) -> Halves<'_> {
        Halves::new(&self.halves[0], &self.halves[1])
    }
}

impl LevelRun<'_> {
    fn verify(&self, pictures: &mut Pictures, on_event: &mut dyn FnMut(VerifyEvent<'_>)) -> LevelVerification {
        let level = &self.surface.asset.levels[self.place];
        let mut cases = Vec::new();
        for (light, view) in Light::ALL.into_iter().flat_map(|light| View::ALL.map(|view| (light, view))) {
            let (case, drawn) = self.case((light, view), on_event);
            let key = CaseKey { asset: self.surface.name.clone(), level: level.index, light, view };
            pictures.insert(key, drawn);
            cases.push(case);
        }
        let equal_time = vec![self.equal_time(on_event)];
        LevelVerification {
            index: level.index,
            factor: level.factor,
            cells: level.cells,
            epsilon_below_75: level.error.map(|error| error.below_75),
            summary: summaries(&cases),
            timing: LevelTiming::of(&equal_time),
            cases,
            equal_time,
        }
    }

    /// One light and view: the original and every model.
    fn case(&self, case: (Light, View), on_event: &mut dyn FnMut(VerifyEvent<'_>)) -> (Case, CasePictures) {
        let (light, view) = case;
        let size = self.settings.size;
        let shot = self.shot(view, size);
        let samples = self.settings.samples_per_half;
        let mut image = |data: &ModelData, name: &str, stream: u64| {
            let level = self.surface.asset.levels[self.place].index;
            on_event(VerifyEvent::Image { name: &self.surface.name, level, case, model: name });
            self.image(data, light, &shot, samples, stream)
        };
        let reference = image(&self.surface.full, "full", 0);
        let picture = reference.halves().image();
        let exposure = flip::exposure(&picture);
        let pixels = [size as u32; 2];
        let mut results = Vec::new();
        let mut drawn = Vec::new();
        for (k, model) in Model::ALL.into_iter().enumerate() {
            let rendered = image(&self.surface.models[k], model.name(), k as u64 + 1);
            let mean = rendered.halves().image();
            let map = flip::flip(&picture, &mean, pixels, exposure);
            let cost = Cost { cpu_seconds: rendered.cpu_seconds };
            let images = [reference.halves(), rendered.halves()];
            results.push(ModelResult::measured(model, samples, images, map.mean, cost));
            drawn.push((model, mean, map));
        }
        let drawn: Vec<Drawn<'_>> =
            drawn.iter().map(|(model, image, flip)| Drawn { model: *model, image, flip }).collect();
        let pictures =
            CasePictures::draw(&picture, &drawn, exposure, |rgb, factor| encode_png(rgb, pixels[0], pixels[1], factor));
        let scene = self.scene(&self.surface.full, light, &shot);
        let case = Case {
            light,
            view,
            footprint_texels: scene.central_footprint().unwrap_or(f64::NAN),
            reference_mean: reference.halves().mean(),
            reference_noise: reference.halves().relative_noise(),
            exposure: f64::from(exposure),
            models: results,
            timing: Cost { cpu_seconds: reference.cpu_seconds },
        };
        (case, pictures)
    }

    /// Original and level at rising sample counts.
    fn equal_time(&self, on_event: &mut dyn FnMut(VerifyEvent<'_>)) -> EqualTime {
        let (light, view) = TIMED_CASE;
        let shot = self.shot(view, TIMED_SIZE);
        let level = self.surface.asset.levels[self.place].index;
        on_event(VerifyEvent::Image { name: &self.surface.name, level, case: TIMED_CASE, model: "equal time" });
        let reference = self.image(&self.surface.full, light, &shot, TIMED_REFERENCE, 0);
        let curves = [&self.surface.full, &self.surface.models[0]].map(|data| {
            let scene = self.scene(data, light, &shot);
            TIMED_SAMPLES.map(|samples| {
                let started = cpu_seconds();
                // seeds of its own: the reference must be independent
                let film = self.film(&scene, data, self.settings.seed.wrapping_add(100), samples);
                let seconds = cpu_seconds() - started;
                let mse = relative_mse_of_image(reference.halves(), &film.radiance()).unwrap_or(f64::NAN);
                (mse, seconds)
            })
        });
        // a clock of milliseconds says little of short renders: all take what the longest takes a sample
        let seconds = curves.each_ref().map(|curve| {
            let a_sample = curve[TIMED_SAMPLES.len() - 1].1 / f64::from(TIMED_SAMPLES[TIMED_SAMPLES.len() - 1]);
            TIMED_SAMPLES.map(|samples| a_sample * f64::from(samples)).to_vec()
        });
        let point = |k: usize| EqualTimePoint {
            samples: TIMED_SAMPLES[k],
            mse_full: curves[0][k].0,
            mse_farfield: curves[1][k].0,
        };
        EqualTime::timed(TIMED_CASE, 2 * TIMED_REFERENCE, (0..TIMED_SAMPLES.len()).map(point).collect(), seconds)
    }

    /// The view in which a pixel's footprint is a cell of the level.
    fn shot(&self, view: View, pixels: usize) -> Shot {
        let [u, v] = self.surface.asset.levels[self.place].factor;
        self.surface.subject.shot(view, (u * v).sqrt(), pixels)
    }

    fn scene<'s>(&self, data: &'s ModelData, light: Light, shot: &Shot) -> Scene<'s> {
        Scene {
            camera: shot.camera,
            lights: setups::lights(light, shot.width, self.surface.subject.relief),
            surface: data.object(shot.tiles, None),
        }
    }

    /// Two halves of a model's image; `stream` tells images apart whose noise must be independent.
    fn image(&self, data: &ModelData, light: Light, shot: &Shot, samples: u32, stream: u64) -> Image {
        let scene = self.scene(data, light, shot);
        let started = cpu_seconds();
        let halves = [0, 1].map(|half| {
            let seed = self.settings.seed.wrapping_mul(1000).wrapping_add(2 * stream + half);
            self.film(&scene, data, seed, samples).radiance()
        });
        Image { halves, cpu_seconds: cpu_seconds() - started }
    }

    fn film(&self, scene: &Scene<'_>, data: &ModelData, seed: u64, samples: u32) -> Film {
        let place = if data.level_count() == 1 { 0 } else { self.place };
        let settings =
            RenderSettings { integrator: Integrator::Direct, lod: Lod::Fixed(place), seed, sampling: Sampling::Sobol };
        let mut film = Film::new(scene.camera.size());
        render(scene, &settings, 0..u64::from(samples), &mut film);
        film
    }
}
