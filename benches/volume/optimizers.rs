//! The two optimisers on one problem: (3.16) on fresh walks, in which neither's noise is.

use std::path::Path;

use cpu_time::ProcessTime;
use farfield::prefilter::volume::baselines::naive;
use farfield::prefilter::volume::{Clusters, Problem, Prototypes, Weights};
use farfield::transport::volume::means::Walks;

use crate::vol::Scene;

/// One line a scene and factor.
pub(crate) fn run(scenes: &[Scene], folder: &Path) {
    println!("scene     factor   naive    lm (CPU s)   sgd (CPU s)   difference over the gap");
    for scene in scenes {
        let fine = scene.medium(folder);
        for factor in [4.0, 8.0] {
            let prototypes = Prototypes::new(&fine, factor, None, 1);
            let average = naive::level(&fine, factor, &prototypes);
            let problem = Problem::new(&fine, &average, Clusters::new(&average, None, 1), 16_384, 1);
            let ones = Weights::ones(problem.clusters().count, average.lobe_count());
            let objective =
                |weights: &Weights| problem.objective(&average, weights, Walks { count: 40_000, seed: 1 << 40 });
            let start = ProcessTime::now();
            let (lm, _) = problem.minimise(&average, &ones);
            let lm_seconds = start.elapsed().as_secs_f64();
            let start = ProcessTime::now();
            let (sgd, _) = problem.descend(&average, &ones);
            let sgd_seconds = start.elapsed().as_secs_f64();
            let [naive, lm, sgd] = [&ones, &lm, &sgd].map(objective);
            println!(
                "{:<8} {factor:>6} {naive:>9.4} {lm:>8.4} ({lm_seconds:.1}) {sgd:>8.4} ({sgd_seconds:.1})  {:.4}",
                scene.name,
                (sgd - lm) / (naive - lm)
            );
        }
    }
}
