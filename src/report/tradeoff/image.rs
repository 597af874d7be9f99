//! The error of an image: a level beside the original, under one area light.

use formats::asset::SurfaceAsset;

use super::TradeoffSettings;
use crate::build::models::ModelData;
use crate::build::{Input, SurfaceSpec};
use crate::report::metrics::{Halves, Interval, mean_error, relative_mse};
use crate::report::verification::{Light, View};
use crate::report::verify::setups::{self, Shot, Subject};
use crate::transport::film::Film;
use crate::transport::render::{RenderSettings, render};
use crate::transport::sampler::Sampling;
use crate::transport::scene::{Lod, Scene};

/// The light and view.
const CASE: (Light, View) = (Light::Area, View::Oblique);

/// Cells along a pixel: as far away as levels pay, and near enough for T to be seen.
const CELLS: f64 = 8.0;

/// The original's image, and what it shows.
pub(super) struct Reference {
    subject: Subject,
    shot: Shot,
    halves: [Vec<[f32; 3]>; 2],
}

impl Reference {
    /// Draws the original where `level`, the one level of an asset, is to be seen.
    pub(super) fn draw(spec: &SurfaceSpec, input: &Input, asset: &SurfaceAsset, settings: &TradeoffSettings) -> Self {
        let subject = Subject::new(spec, &input.fine.heights);
        let [u, v] = asset.levels[0].factor;
        let shot = subject.shot(CASE.1, CELLS * (u * v).sqrt(), settings.size);
        let halves = draw(&ModelData::full(input), asset, &subject, &shot, settings, 0);
        Self { subject, shot, halves }
    }

    /// Relative mean square error without noise, and relative error of the mean, of the level in `asset`.
    pub(super) fn errors(
        &self,
        asset: &SurfaceAsset,
        settings: &TradeoffSettings,
    ) -> (Option<Interval>, Option<Interval>) {
        let level = ModelData::farfield(asset.clone());
        let halves = draw(&level, asset, &self.subject, &self.shot, settings, 1);
        let [reference, level] = [&self.halves, &halves].map(|halves| Halves::new(&halves[0], &halves[1]));
        (relative_mse(reference, level).map(|mse| mse.bias), mean_error(reference, level))
    }
}

/// Two independent halves of a model's image; `stream` tells model and original apart.
fn draw(
    data: &ModelData,
    asset: &SurfaceAsset,
    subject: &Subject,
    shot: &Shot,
    settings: &TradeoffSettings,
    stream: u64,
) -> [Vec<[f32; 3]>; 2] {
    let scene = Scene {
        camera: shot.camera,
        lights: setups::lights(CASE.0, shot.width, subject.relief),
        surface: data.object(shot.tiles, None),
    };
    [0, 1].map(|half| {
        let seed = settings.seed.wrapping_mul(1000).wrapping_add(2 * stream + half);
        let integrator = data.integrator(asset.light);
        let how = RenderSettings { integrator, lod: Lod::Fixed(0), seed, sampling: Sampling::Sobol };
        let mut film = Film::new(scene.camera.size());
        render(&scene, &how, 0..u64::from(settings.samples_per_half), &mut film);
        film.radiance()
    })
}
