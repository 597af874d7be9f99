//! The published optimiser beside ours, on its own objective: six views, unit weights.
//!
//! The step sizes are the best of five pairs after eight iterations with a sixteenth of the paths. With `FARFIELD_SHARE=16`
//! all of it has a sixteenth of the paths, for a quick look.

use std::path::Path;

use cpu_time::ProcessTime;
use farfield::prefilter::volume::baselines::naive;
use farfield::prefilter::volume::baselines::published::{self, Steps};
use farfield::prefilter::volume::{Clusters, Problem, Prototypes, RowWeights, Weights};
use farfield::transport::volume::means::Walks;

use crate::vol::Scene;

const STEPS: [Steps; 5] = [
    Steps { a: 0.002, b: 1.0 },
    Steps { a: 0.01, b: 1.0 },
    Steps { a: 0.05, b: 4.0 },
    Steps { a: 0.2, b: 10.0 },
    Steps { a: 0.8, b: 20.0 },
];

/// A line an optimiser and scene, at 4×.
pub(crate) fn run(scenes: &[Scene], folder: &Path) {
    let share = std::env::var("FARFIELD_SHARE").ok().and_then(|share| share.parse().ok()).unwrap_or(1_usize);
    println!("scene     optimiser  objective (3.16)   CPU s with reference means   without");
    for scene in scenes {
        let fine = scene.medium(folder);
        let prototypes = Prototypes::new(&fine, 4.0, None, 1);
        let average = naive::level(&fine, 4.0, &prototypes);
        let problem = |count: usize, seed: u64| {
            let clusters = Clusters::new(&average, None, 1);
            let views = (published::views(), RowWeights::Unit);
            Problem::with_views(&fine, &average, clusters, views, Walks { count, seed })
        };
        // What both are judged by has means and walks of its own.
        let judge = problem(40_000, 77);
        let objective = |weights: &Weights| judge.objective(&average, weights, Walks { count: 20_000, seed: 78 });
        let ones = Weights::ones(judge.clusters().count, average.lobe_count());
        println!("{:<8} naive      {:>10.5}", scene.name, objective(&ones));
        let start = ProcessTime::now();
        let small = problem(4096, 1);
        let reference = start.elapsed().as_secs_f64();
        let (weights, _) = small.minimise(&average, &ones);
        let ours = start.elapsed().as_secs_f64();
        println!("{:<8} ours       {:>10.5}  {ours:>8.2}  {:>8.2}", scene.name, objective(&weights), ours - reference);
        let start = ProcessTime::now();
        let large = problem(published::PATHS / share, 2);
        let reference = start.elapsed().as_secs_f64();
        let tried = |steps: &Steps| {
            let trace = published::descend(&large, &average, *steps, published::PATHS / share / 16, 8);
            objective(&trace[7])
        };
        let best = STEPS.iter().min_by(|a, b| tried(a).total_cmp(&tried(b))).expect("five pairs");
        let start = ProcessTime::now();
        let trace = published::descend(&large, &average, *best, published::PATHS / share, published::ITERATIONS);
        let seconds = start.elapsed().as_secs_f64();
        let last = objective(&trace[trace.len() - 1]);
        println!(
            "{:<8} published  {last:>10.5}  {:>8.1}  {seconds:>8.1}  (a = {}, b = {}): {:.0} times ours",
            scene.name,
            reference + seconds,
            best.a,
            best.b,
            (reference + seconds) / ours
        );
    }
}
