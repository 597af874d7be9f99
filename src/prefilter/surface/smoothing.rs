//! How smooth the coarse heights are to be: the weight of the Laplacian, by what it does to S.
//!
//! The published weight of 0.01 keeps the slopes, and that is right as long as the grid resolves the structure. Where it
//! does not, slopes alone fold the coarse surface into a zigzag that hides at grazing angles what the original shows
//! there: F_coarse all but vanishes where F_fine does not, S jumps from node to node, and between the nodes the level is
//! wrong by any factor (silk at 16×, GGX 0.3, ε above 75°: 370 % with 0.01, 8 % with 1). What a smoother surface no
//! longer shadows, S shadows. So S is found for some of the cells and some of the directions; where linear interpolation
//! between these fails, larger weights are tried.

use super::VmfLobe;
use super::coarse::{CoarseSurface, MergedLobes, reflectance_of};
use super::downsample::downsample_with;
use super::fit::PRIOR;
use super::reflectance::{PatchReflectance, TableDirections, pair};
use crate::geometry::HeightField;
use crate::math::rng::Stream;

/// Weights of the Laplacian that are tried where the published one fails.
const SMOOTHER: [f64; 2] = [0.1, 1.0];

/// Error of interpolation on the coarse table below which a surface is left as it is: S is wrong by more than F itself.
///
/// Of 36 levels (6 maps, factors 8 to 64, diffuse, GGX 0.3 and 0.1) those without folds lie between 0.005 and 0.4, those
/// with folds between 25 and 17 000; a third of the nodes makes a coarse table, whose errors are many times the level's.
const TOLERABLE: f64 = 1.0;

/// Directions per axis that are kept of a table, at least.
const DIRECTIONS: usize = 8;

/// Cells that are looked at, about.
const CELLS: usize = 4096;

/// Prototypes that their lobes are merged to, at most.
const PROTOTYPES: usize = 192;

/// Stream of the choice of cells.
const CHOICE: u64 = 0x5300;

/// The coarse heights of a level: those of `coarse`, or smoother ones where S could not be interpolated.
pub(super) fn smoothed(
    fine: &HeightField,
    factor: f32,
    coarse: &CoarseSurface<'_>,
    f_fine: &PatchReflectance,
    directions: &TableDirections,
) -> HeightField {
    let kept = directions.every(((directions.resolution - 1) / (DIRECTIONS - 1)).max(1));
    let fine_means = means(f_fine, &kept.nodes);
    let lobes = some_cells(coarse.lobes);
    let merged = MergedLobes::new(&lobes, PROTOTYPES, &kept.directions);
    let all: Vec<usize> = (0..kept.directions.len()).collect();
    let error = |heights: &HeightField| {
        let surface = CoarseSurface { heights, lobes: &lobes, ..*coarse };
        let coarse = reflectance_of(&surface, &merged, [1, 1], &kept.directions);
        interpolation_error(&fine_means, &means(&coarse, &all), kept.directions.resolution)
    };
    let published = error(coarse.heights);
    if published <= TOLERABLE {
        return coarse.heights.clone();
    }
    SMOOTHER
        .map(|weight| downsample_with(fine, factor, weight))
        .into_iter()
        .fold((published, coarse.heights.clone()), |best, heights| {
            let error = error(&heights);
            if error < best.0 { (error, heights) } else { best }
        })
        .1
}

/// The lobes of about [`CELLS`] cells drawn at random; the others have none, and are passed over.
fn some_cells(lobes: &[Vec<VmfLobe>]) -> Vec<Vec<VmfLobe>> {
    let share = CELLS as f32 / lobes[0].len() as f32;
    let stream = Stream::new(0, CHOICE);
    let kept: Vec<bool> = (0..lobes[0].len()).map(|cell| stream.uniform_pair(cell as u64)[0] < share).collect();
    let thin = |lobes: &Vec<VmfLobe>| {
        let none = |lobe: VmfLobe| VmfLobe { weight: 0.0, ..lobe };
        lobes.iter().zip(&kept).map(|(&lobe, &kept)| if kept { lobe } else { none(lobe) }).collect()
    };
    lobes.iter().map(thin).collect()
}

/// Means over the map of F between the directions `nodes` of its table, `[i][o]`, RGB.
pub(super) fn means(f: &PatchReflectance, nodes: &[usize]) -> Vec<[f64; 3]> {
    let patches = f.patch_count();
    let mean = |channel: usize, k: usize| {
        (0..patches).map(|patch| f64::from(f.channel(patch, channel)[k])).sum::<f64>() / patches as f64
    };
    let at = |i: usize, o: usize| [0, 1, 2].map(|channel| mean(channel, pair(i.max(o), i.min(o))));
    nodes.iter().flat_map(|&i| nodes.iter().map(move |&o| at(i, o))).collect()
}

/// What linear interpolation of S = F_fine/F_coarse costs: root mean square of its error times F_coarse, over that of F_fine.
///
/// Between two nodes at t ∈ [0, 1], it is t(1 − t)/2 times the second difference, whose square has the mean 1/120. The
/// four axes of ωi and ωo are taken as independent, and alike in pairs for S is symmetric.
pub(super) fn interpolation_error(fine: &[[f64; 3]], coarse: &[[f64; 3]], resolution: usize) -> f64 {
    let directions = resolution * resolution;
    let [mut error, mut total] = [0.0; 2];
    for channel in 0..3 {
        let prior = PRIOR * coarse.iter().map(|f| f[channel]).sum::<f64>() / coarse.len() as f64 + f64::MIN_POSITIVE;
        let s = |k: usize| (fine[k][channel] + prior) / (coarse[k][channel] + prior);
        for i in 0..directions {
            for (place, step) in [(i % resolution, 1), (i / resolution, resolution)] {
                if place == 0 || place + 1 == resolution {
                    continue;
                }
                for o in 0..directions {
                    let [before, at, after] = [i - step, i, i + step].map(|i| i * directions + o);
                    let bend = s(before) + s(after) - 2.0 * s(at);
                    error += 2.0 / 120.0 * (bend * coarse[at][channel]).powi(2);
                }
            }
        }
        total += fine.iter().map(|f| f[channel].powi(2)).sum::<f64>();
    }
    if total > 0.0 { (error / total).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A table of a smooth F, with S = 1 + `bend`·(u² + v²) in units of nodes.
    fn tables(n: usize, bend: f64) -> [Vec<[f64; 3]>; 2] {
        let square = |k: usize| ((k % n) as f64).powi(2) + ((k / n) as f64).powi(2);
        let coarse = vec![[0.5; 3]; n.pow(4)];
        let fine = (0..n.pow(4)).map(|k| [0.5 * (1.0 + bend * (square(k / (n * n)) + square(k % (n * n)))); 3]);
        [fine.collect(), coarse]
    }

    #[test]
    fn a_linear_scaling_is_interpolated_without_error() {
        let n = 5_usize;
        let coarse = vec![[0.3; 3]; n.pow(4)];
        let linear = |k: usize| 0.3 * (1.0 + 0.1 * (k % n) as f64 + 0.2 * (k / n % n) as f64);
        let fine: Vec<[f64; 3]> = (0..n.pow(4)).map(|k| [linear(k); 3]).collect();
        assert!(interpolation_error(&fine, &coarse, n) < 1e-12);
    }

    #[test]
    fn a_bent_scaling_costs_what_its_second_difference_says() {
        // δ² = 2·bend along each of 4 axes, in the (n − 2)/n of the nodes that have two neighbours
        let (n, bend) = (6_usize, 1e-3);
        let [fine, coarse] = tables(n, bend);
        let total: f64 = fine.iter().map(|f| f[0] * f[0]).sum();
        let inner = n.pow(4) as f64 * (n - 2) as f64 / n as f64;
        let expected = (4.0 * inner / 120.0 * (2.0 * bend * 0.5).powi(2) / total).sqrt();
        // the prior is a millionth of F
        assert!((interpolation_error(&fine, &coarse, n) / expected - 1.0).abs() < 1e-5);
    }

    #[test]
    fn nothing_reflected_is_no_error() {
        assert_eq!(interpolation_error(&[[0.0; 3]; 81], &[[0.0; 3]; 81], 3), 0.0);
    }
}
