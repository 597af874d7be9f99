//! Paths a core-second at full resolution, with majorants of super-voxels and with one global majorant.

use std::path::Path;

use cpu_time::ProcessTime;
use farfield::math::rng::{Draws, Stream};
use farfield::medium::{Flight, Medium, Place};
use farfield::transport::volume::means::{Masks, Observer, SmoothLight, VIEW_CELLS, ViewMeans, Walks, follow};
use glam::{DVec3, Vec3};

use crate::vol::Scene;

/// Walks of a measurement.
const COUNT: usize = 200_000;

/// Counts what walks do.
#[derive(Default)]
struct Events {
    walks: u64,
    reflections: u64,
}

impl Observer for Events {
    fn reflects(&mut self, _voxel: usize, _posterior: [f32; 3]) {
        self.reflections += 1;
    }

    fn leaves(&mut self, _cell: usize, _direction: Vec3, _throughput: Vec3, _survival: f32) {
        self.walks += 1;
    }

    fn ends(&mut self, _cell: usize) {
        self.walks += 1;
    }
}

/// One line a scene.
pub(crate) fn run(scenes: &[Scene], folder: &Path) {
    println!(
        "Paths in an oblique view at full resolution, under constant light; then flights of white flakes by three ways."
    );
    println!(
        "scene    occupied  bytes/voxel  reflections  Mpaths/core-s  1/(var.s)  exact  majorants  one majorant  gain"
    );
    for scene in scenes {
        let medium = scene.medium(folder);
        let voxels: usize = medium.shape().size.iter().product();
        let share = 100.0 * medium.occupied() as f64 / voxels as f64;
        let bytes = medium.bytes() as f64 / medium.occupied() as f64;
        let (paths, reflections) = paths_a_second(&medium);
        let flights = [
            flights_a_second(&medium, Medium::fly),
            flights_a_second(&medium, Medium::fly_by_majorant),
            flights_a_second(&medium.with_global_majorant(), Medium::fly_by_majorant),
        ];
        let [exact, local, global] = flights.map(|rate| rate / 1e6);
        println!(
            "{:<8} {share:>7.1}%  {bytes:>11.1}  {reflections:>11.2}  {:>13.3}  {:>9.0}  {exact:>5.3}  {local:>9.3}  {global:>12.3}  {:>4.1}",
            scene.name,
            paths / 1e6,
            efficiency(&medium),
            exact / global
        );
    }
}

/// One over variance times CPU seconds of the mean in red, relative to its square.
fn efficiency(medium: &Medium) -> f64 {
    let masks = Masks { clusters: vec![1; VIEW_CELLS] };
    let walks = Walks { count: COUNT / 2, seed: 3 };
    let start = ProcessTime::now();
    let means = ViewMeans::new(medium, VIEW.normalize(), &[SmoothLight::ONE], (&masks, 1), walks);
    let seconds = start.elapsed().as_secs_f64();
    means.means[0][0][0].powi(2) / (means.variances[0][0][0] * seconds)
}

/// A way to fly.
type Fly = fn(&Medium, Place, Vec3, &mut Draws) -> Flight;

/// Paths a CPU second with this way to fly: white flakes, at most 20 reflections.
fn flights_a_second(medium: &Medium, fly: Fly) -> f64 {
    let direction = -VIEW.normalize();
    let extent = medium.shape().extent();
    let start = ProcessTime::now();
    let mut reflections = 0;
    for k in 0..COUNT / 4 {
        let mut draws = Draws::new(Stream::new(2, k as u64));
        let [u, v] = draws.pair();
        let origin = DVec3::new(f64::from(u) * extent[0], f64::from(v) * extent[1], extent[2]);
        let Some((mut place, _)) = medium.enter(origin, direction.as_dvec3()) else { continue };
        let mut direction = direction;
        for _ in 0..20 {
            let Flight::Collision { place: met, voxel, .. } = fly(medium, place, direction, &mut draws) else { break };
            place = met;
            direction = medium.flakes(voxel, -direction).sample(draws.pair()).wi;
            reflections += 1;
        }
    }
    assert!(reflections > 0, "a medium that reflects");
    (COUNT / 4) as f64 / start.elapsed().as_secs_f64()
}

/// To the viewer, not normalised.
const VIEW: Vec3 = Vec3::new(0.3, 0.2, 1.0);

/// Paths a CPU second from an oblique view, and reflections a path.
fn paths_a_second(medium: &Medium) -> (f64, f64) {
    let start = ProcessTime::now();
    let events = follow(medium, VIEW.normalize(), Walks { count: COUNT, seed: 1 }, Events::default);
    let seconds = start.elapsed().as_secs_f64();
    let total = |what: fn(&Events) -> u64| events.iter().map(what).sum::<u64>() as f64;
    (total(|e| e.walks) / seconds, total(|e| e.reflections) / total(|e| e.walks))
}
