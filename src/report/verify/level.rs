//! One level: every light and view, the original beside every model.

use super::setups::{self, Shot};
use super::{Surface, VerifyEvent, VerifySettings, timed};
use crate::build::clock::cpu_seconds;
use crate::build::models::ModelData;
use crate::io::preview::encode_png;
use crate::report::equal_time::LevelTiming;
use crate::report::flip;
use crate::report::html::{CaseKey, CasePictures, Drawn, Pictures};
use crate::report::metrics::Halves;
use crate::report::summary::summaries;
use crate::report::verification::{Case, Cost, LevelVerification, Light, Model, ModelResult, View};
use crate::transport::film::Film;
use crate::transport::render::{RenderSettings, render};
use crate::transport::sampler::Sampling;
use crate::transport::scene::{Lod, Scene};

/// One level under comparison.
pub(super) struct LevelRun<'a> {
    pub(super) surface: &'a Surface,
    /// Its place in the asset.
    pub(super) place: usize,
    pub(super) settings: &'a VerifySettings,
}

/// Two halves of an image and what both took.
pub(super) struct Image {
    halves: [Vec<[f32; 3]>; 2],
    cpu_seconds: f64,
}

impl Image {
    pub(super) fn halves(&self) -> Halves<'_> {
        Halves::new(&self.halves[0], &self.halves[1])
    }
}

impl LevelRun<'_> {
    pub(super) fn verify(
        &self,
        pictures: &mut Pictures,
        on_event: &mut dyn FnMut(VerifyEvent<'_>),
    ) -> LevelVerification {
        let level = &self.surface.asset.levels[self.place];
        let mut cases = Vec::new();
        for (light, view) in Light::ALL.into_iter().flat_map(|light| View::ALL.map(|view| (light, view))) {
            let (case, drawn) = self.case((light, view), on_event);
            let key = CaseKey { asset: self.surface.name.clone(), level: level.index, light, view };
            pictures.insert(key, drawn);
            cases.push(case);
        }
        let equal_time = vec![timed::equal_time(self, on_event)];
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
        let shot = self.shot(view, 1.0, size);
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
        let pictures = CasePictures::draw(&picture, &drawn, exposure, |rgb, factor| {
            encode_png(rgb, pixels[0], pixels[1], factor.log2())
        });
        let scene = self.scene(&self.surface.full, light, &shot);
        let case = Case {
            light,
            view,
            footprint_texels: scene.central_footprint().expect("the camera looks at the base"),
            reference_mean: reference.halves().mean(),
            reference_noise: reference.halves().relative_noise(),
            exposure: f64::from(exposure),
            models: results,
            timing: Cost { cpu_seconds: reference.cpu_seconds },
        };
        (case, pictures)
    }

    /// The view in which a pixel is `cells` cells of the level along either side.
    pub(super) fn shot(&self, view: View, cells: f64, pixels: usize) -> Shot {
        let [u, v] = self.surface.asset.levels[self.place].factor;
        self.surface.subject.shot(view, cells * (u * v).sqrt(), pixels)
    }

    pub(super) fn scene<'s>(&self, data: &'s ModelData, light: Light, shot: &Shot) -> Scene<'s> {
        Scene {
            camera: shot.camera,
            lights: setups::lights(light, shot.width, self.surface.subject.relief),
            surface: data.object(shot.tiles, None),
        }
    }

    /// Two halves of a model's image; `stream` tells images apart whose noise must be independent.
    pub(super) fn image(&self, data: &ModelData, light: Light, shot: &Shot, samples: u32, stream: u64) -> Image {
        let scene = self.scene(data, light, shot);
        let started = cpu_seconds();
        let halves = [0, 1].map(|half| {
            let seed = self.settings.seed.wrapping_mul(1000).wrapping_add(2 * stream + half);
            self.film(&scene, data, seed, samples).radiance()
        });
        Image { halves, cpu_seconds: cpu_seconds() - started }
    }

    pub(super) fn film(&self, scene: &Scene<'_>, data: &ModelData, seed: u64, samples: u32) -> Film {
        let place = if data.level_count() == 1 { 0 } else { self.place };
        let integrator = data.integrator(self.surface.asset.light);
        let settings = RenderSettings { integrator, lod: Lod::Fixed(place), seed, sampling: Sampling::Sobol };
        let mut film = Film::new(scene.camera.size());
        render(scene, &settings, 0..u64::from(samples), &mut film);
        film
    }
}
