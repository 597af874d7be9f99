//! How well levels are fitted: objective, CPU seconds, what validation says, by optimiser and density.

use std::path::Path;

use cpu_time::ProcessTime;
use farfield::prefilter::volume::{Density, Optimizer, VolumeSettings, compile};

use crate::vol::Scene;

/// One line a scene, factor, optimiser and density.
pub(crate) fn run(scenes: &[Scene], folder: &Path) {
    println!(
        "scene     factor  m  K  optimiser density        objective: naive  fit   share  validation: naive  fit  factor  CPU s"
    );
    for scene in scenes {
        let fine = scene.medium(folder);
        for factor in [4.0, 8.0] {
            for (optimizer, density) in [
                (Optimizer::LevenbergMarquardt, Density::Average),
                (Optimizer::StochasticGradient, Density::Average),
                (Optimizer::LevenbergMarquardt, Density::Factor),
                (Optimizer::LevenbergMarquardt, Density::Transmittance),
                (Optimizer::LevenbergMarquardt, Density::Auto),
            ] {
                let settings = VolumeSettings { factor, optimizer, density, ..VolumeSettings::default() };
                let start = ProcessTime::now();
                let level = compile(&fine, &settings);
                let seconds = start.elapsed().as_secs_f64();
                let found = &level.diagnostics;
                let name = if optimizer == Optimizer::StochasticGradient { "sgd" } else { "lm" };
                println!(
                    "{:<8} {factor:>6}  {}  {}  {name:<9} {:<13} {:>12.4} {:>9.4}  {:>5.2} {:>13.4} {:>7.4}  {:>5.2}  {seconds:>5.1}",
                    scene.name,
                    level.medium.lobe_count(),
                    level.clusters.count,
                    format!("{density:?}"),
                    found.objective[0],
                    found.objective[1],
                    found.effective_share,
                    found.validation[0],
                    found.validation[1],
                    found.density_factor
                );
                println!(
                    "          errors of normals {:.3?}, w {:.3?}, s {:.3?}, eigenvalues {:.2e} to {:.2e}",
                    level.prototypes.normal_errors,
                    level.weights.factors,
                    level.weights.colours,
                    found.eigenvalues.first().unwrap_or(&0.0),
                    found.eigenvalues.last().unwrap_or(&0.0)
                );
            }
        }
    }
}
