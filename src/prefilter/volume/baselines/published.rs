//! The published optimiser (\[WU19\] 3.6.3, 3.8.2): gradient descent in the weights themselves, every iteration of which traces
//! a noisy image of 100 × 100 pixels for each of four lights apart in each of six views.

use crate::medium::Medium;
use crate::prefilter::volume::{Problem, Recording, Weights};
use crate::transport::volume::means::{View, Walks};
use glam::Vec3;

/// Iterations of the longest run of \[WU19\] table 3.2.
pub const ITERATIONS: usize = 30;
/// Paths of one image: 100 × 100 pixels, 16 each.
pub const PATHS: usize = 160_000;
/// Smallest and largest weight that a step may lead to.
const RANGE: [f64; 2] = [0.02, 20.0];

/// The views of \[WU19\] figure 3.7.
pub fn views() -> Vec<View> {
    [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z].to_vec()
}

/// Step sizes δ_t = a/(t + b), \[WU19\] (3.20), the same for all weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    /// a.
    pub a: f64,
    /// b.
    pub b: f64,
}

/// The weights after each iteration, `paths` an image.
pub fn descend(problem: &Problem<'_>, medium: &Medium, steps: Steps, paths: usize, iterations: usize) -> Vec<Weights> {
    let mut weights = Weights::ones(problem.clusters().count, medium.lobe_count());
    let mut trace = Vec::new();
    for t in 1..=iterations {
        let slopes = gradient(problem, medium, &weights, Walks { count: paths, seed: t as u64 * 1000 });
        let step = steps.a / (t as f64 + steps.b);
        let places = weights.logarithms();
        let moved = places.iter().zip(slopes).map(|(ln, slope)| {
            let w = ln.exp();
            // ∂E/∂w = ∂E/∂ln w / w
            (w - step * slope / w).clamp(RANGE[0], RANGE[1]).ln()
        });
        weights = weights.from_logarithms(&moved.collect::<Vec<_>>());
        trace.push(weights.clone());
    }
    trace
}

/// ∂E/∂ln w of all weights, \[WU19\] (3.18): a view and a light at a time, so that no more than one image is in memory.
fn gradient(problem: &Problem<'_>, medium: &Medium, weights: &Weights, walks: Walks) -> Vec<f64> {
    let mut gradient = vec![0.0; weights.unknowns()];
    let lights = problem.lights();
    let target = problem.target();
    let clusters = problem.clusters().count;
    for (v, view) in problem.views().iter().enumerate() {
        for (l, light) in lights.iter().enumerate() {
            let seed = walks.seed + (v * lights.len() + l) as u64;
            let views = std::slice::from_ref(view);
            let recording = Recording::new(medium, problem.clusters(), weights, views, Walks { seed, ..walks });
            let image = recording.evaluate(weights, weights, std::slice::from_ref(light));
            for (k, c) in (0..clusters).flat_map(|k| (0..3).map(move |c| (k, c))) {
                let row = ((v * (clusters + 1) + k) * lights.len() + l) * 3 + c;
                let off = target.scales[row].powi(2) * (image.means[k * 3 + c] - target.means[row]);
                for (sum, slope) in gradient.iter_mut().zip(&image.derivatives[k * 3 + c]) {
                    *sum += 2.0 * off * slope;
                }
            }
        }
    }
    gradient
}
