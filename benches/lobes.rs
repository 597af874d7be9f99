//! Time of the stages from heights to lobes, and the error of each lobe count: `cargo bench --bench lobes`.

use farfield::geometry::{Boundary, HeightField};
use farfield::prefilter::surface::downsample::{coarse_cells, downsample};
use farfield::prefilter::surface::lobes::{choose_lobe_count, fit_lobes, lobe_count_errors};
use std::time::Instant;

/// Name and amplitude in texels (fixtures/heights/heights.json).
const FIXTURES: [(&str, f32); 6] =
    [("fbm", 58.54), ("twill", 24.42), ("silk", 24.45), ("bump", 28.0), ("vgroove", 32.0), ("cliffs", 120.0)];

fn main() {
    total_variation_table();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
        pool.install(|| stage_times(threads));
    }
}

fn total_variation_table() {
    println!("total variation of the blurred distribution by lobes a cell\n");
    println!("| map | factor | 1 | 2 | 3 | 4 | 6 | 8 | noise | chosen |");
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for (name, amplitude) in FIXTURES {
        let fine = fixture(name, amplitude);
        for factor in [8.0, 64.0] {
            let cells = coarse_cells(fine.size(), factor);
            let errors = lobe_count_errors(&fine, cells);
            let row: Vec<String> = errors.iter().map(|e| format!("{:.3}", e.total_variation)).collect();
            let [noise, chosen] = [errors[0].sampling_noise, choose_lobe_count(&fine, cells) as f64];
            println!("| {name} | {factor} | {} | {noise:.3} | {chosen} |", row.join(" | "));
        }
    }
}

fn stage_times(threads: usize) {
    println!("\n{threads} thread(s), best of 5, seconds for 1024² (million texels a second)\n");
    println!("| map | factor | downsample | choose count | fit 6 lobes | fit 1 lobe |");
    println!("|---|---|---|---|---|---|");
    for (name, amplitude) in &FIXTURES[..2] {
        let fine = fixture(name, *amplitude);
        for factor in [8.0, 64.0] {
            let cells = coarse_cells(fine.size(), factor);
            let times = [
                best_time(|| drop(downsample(&fine, factor))),
                best_time(|| assert!(choose_lobe_count(&fine, cells) > 0)),
                best_time(|| drop(fit_lobes(&fine, cells, Some(6)))),
                best_time(|| drop(fit_lobes(&fine, cells, Some(1)))),
            ];
            let texels = fine.heights().len() as f64;
            let row = times.map(|t| format!("{t:.3} ({:.1})", texels * 1e-6 / t));
            println!("| {name} | {factor} | {} |", row.join(" | "));
        }
    }
}

fn best_time(work: impl Fn()) -> f64 {
    let once = || {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    };
    (0..5).map(|_| once()).fold(f64::MAX, f64::min)
}

/// A map of fixtures/heights, lengths in texels.
fn fixture(name: &str, amplitude: f32) -> HeightField {
    let path = format!("{}/fixtures/heights/{name}.png", env!("CARGO_MANIFEST_DIR"));
    let map = image::open(path).expect("a fixture of this repository").into_luma16();
    let size = [map.width() as usize, map.height() as usize];
    let heights = map.into_raw().iter().map(|&code| f32::from(code) / 65535.0 * amplitude).collect();
    HeightField::new(heights, size, [1.0, 1.0], Boundary::Repeat)
}
