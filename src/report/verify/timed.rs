//! Original and level at rising sample counts: error against time.

use super::VerifyEvent;
use super::level::LevelRun;
use crate::build::clock::cpu_seconds;
use crate::build::models::ModelData;
use crate::report::equal_time::{COMPARED_SAMPLES, EqualTime, EqualTimePoint};
use crate::report::metrics::{Halves, relative_mse_of_image};
use crate::report::verification::{Light, View};
use crate::transport::scene::Scene;

/// The light and view that are timed.
const CASE: (Light, View) = (Light::Area, View::Oblique);
/// Pixels a side of the images.
const SIZE: usize = 32;
/// Cells of the level along a pixel: as far away as levels pay, where the original's noise is large.
const CELLS: f64 = 8.0;
/// Samples a pixel of either half of the reference: so many times those of the other images' halves, at most 4096.
const REFERENCE_RATIO: u32 = 32;
const MAX_REFERENCE: u32 = 4096;
/// Samples a pixel of the points; above 64 only where the reference has eight times as many.
const SAMPLES: [u32; 9] = [4, 8, 16, 32, 64, 128, 256, 512, 1024];
const MARGIN: u32 = 8;
/// Added to the seed: the reference must be independent of the points.
const SEED_STEP: u64 = 100;

/// The comparison of one level.
pub(super) fn equal_time(level: &LevelRun<'_>, on_event: &mut dyn FnMut(VerifyEvent<'_>)) -> EqualTime {
    let (light, view) = CASE;
    let surface = level.surface;
    let index = surface.asset.levels[level.place].index;
    on_event(VerifyEvent::Image { name: &surface.name, level: index, case: CASE, model: "equal time" });
    let shot = level.shot(view, CELLS, SIZE);
    let half = MAX_REFERENCE.min(REFERENCE_RATIO * level.settings.samples_per_half);
    let counts: Vec<u32> = SAMPLES.into_iter().filter(|n| *n <= COMPARED_SAMPLES || n * MARGIN <= 2 * half).collect();
    let reference = level.image(&surface.full, light, &shot, half, 0);
    let [full, farfield] = [&surface.full, &surface.models[0]].map(|data| {
        let scene = level.scene(data, light, &shot);
        counts.iter().map(|&samples| point(level, &scene, data, reference.halves(), samples)).collect::<Vec<_>>()
    });
    let points = counts.iter().zip(full.iter().zip(&farfield));
    let points = points.map(|(&samples, (full, farfield))| EqualTimePoint {
        samples,
        mse_full: full.mse,
        mse_farfield: farfield.mse,
    });
    let footprint = level.scene(&surface.full, light, &shot).central_footprint().expect("the camera looks at the base");
    let seconds = [&full, &farfield].map(|curve| evened(&counts, curve));
    EqualTime::timed(CASE, footprint, 2 * half, points.collect(), seconds)
}

/// Error and time of one image.
struct Point {
    mse: f64,
    cpu_seconds: f64,
}

fn point(level: &LevelRun<'_>, scene: &Scene<'_>, data: &ModelData, reference: Halves<'_>, samples: u32) -> Point {
    let started = cpu_seconds();
    let film = level.film(scene, data, level.settings.seed.wrapping_add(SEED_STEP), samples);
    let cpu_seconds = cpu_seconds() - started;
    // a black reference has no relative error: the report then shows none
    let mse = relative_mse_of_image(reference, &film.radiance()).unwrap_or(f64::NAN);
    Point { mse, cpu_seconds }
}

/// CPU seconds of every count at the pace of the longest: a clock of milliseconds says little of short renders.
fn evened(counts: &[u32], curve: &[Point]) -> Vec<f64> {
    let (Some(count), Some(longest)) = (counts.last(), curve.last()) else { return Vec::new() };
    let a_sample = longest.cpu_seconds / f64::from(*count);
    counts.iter().map(|samples| a_sample * f64::from(*samples)).collect()
}
