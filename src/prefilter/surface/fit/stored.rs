//! The tables as they are stored, and what a reader finds between their texels.

use super::super::LARGEST_STORED;
use super::super::reflectance::pair;
use crate::geometry::Boundary;
use formats::lookup;

/// T to store, so that its bilinear interpolation has the means `means` over the patches.
///
/// The mean over a patch of the interpolant is ¾ of its own texel and ⅛ of each neighbour along each axis. Richardson
/// iteration: the blur's eigenvalues lie in [¼, 1], so the error falls by ¾ a step, to 1e-12 in 100.
pub fn deconvolve(means: &[[f32; 3]], patches: [usize; 2], boundary: Boundary) -> Vec<[f32; 3]> {
    let target: Vec<[f64; 3]> = means.iter().map(|t| t.map(f64::from)).collect();
    let mut stored = target.clone();
    for _ in 0..100 {
        let blurred = patch_means(&stored, patches, boundary);
        for ((stored, target), blurred) in stored.iter_mut().zip(&target).zip(&blurred) {
            (0..3).for_each(|k| stored[k] += target[k] - blurred[k]);
        }
    }
    stored.iter().map(|t| t.map(|x| (x as f32).clamp(-LARGEST_STORED, LARGEST_STORED))).collect()
}

/// Means of the bilinear interpolant of a table of `patches` over a grid of `parts`, whole multiples of `patches`.
pub(in crate::prefilter::surface) fn part_means(
    table: &[[f32; 3]],
    patches: [usize; 2],
    parts: [usize; 2],
    boundary: Boundary,
) -> Vec<[f32; 3]> {
    let boundary = match boundary {
        Boundary::Repeat => lookup::Boundary::Repeat,
        Boundary::Clamp => lookup::Boundary::Clamp,
    };
    // an axis that is not divided is read at two places on either side of the kink in a patch's middle
    let cuts = [0, 1].map(|axis| if parts[axis] == patches[axis] { 2 } else { 1 });
    let centre = |k: usize, axis: usize| (k as f32 + 0.5) / (parts[axis] * cuts[axis]) as f32;
    (0..parts[0] * parts[1])
        .map(|part| {
            let mut mean = [0.0; 3];
            for cut in 0..cuts[0] * cuts[1] {
                let place = [part % parts[0] * cuts[0] + cut % cuts[0], part / parts[0] * cuts[1] + cut / cuts[0]];
                let x = [0, 1].map(|axis| centre(place[axis], axis));
                for (texel, weight) in lookup::bilinear_taps(x, patches, boundary) {
                    (0..3).for_each(|c| mean[c] += weight * table[texel][c] / (cuts[0] * cuts[1]) as f32);
                }
            }
            mean
        })
        .collect()
}

/// Means over the patches of the bilinear interpolant of a table.
fn patch_means(table: &[[f64; 3]], [width, height]: [usize; 2], boundary: Boundary) -> Vec<[f64; 3]> {
    let neighbours = |k: usize, n: usize| match boundary {
        Boundary::Repeat => [(k + n - 1) % n, k, (k + 1) % n],
        Boundary::Clamp => [k.saturating_sub(1), k, (k + 1).min(n - 1)],
    };
    const TAPS: [f64; 3] = [0.125, 0.75, 0.125];
    let mut means = vec![[0.0; 3]; table.len()];
    for v in 0..height {
        for u in 0..width {
            for (&b, wv) in neighbours(v, height).iter().zip(TAPS) {
                for (&a, wu) in neighbours(u, width).iter().zip(TAPS) {
                    (0..3).for_each(|k| means[v * width + u][k] += wu * wv * table[b * width + a][k]);
                }
            }
        }
    }
    means
}

/// S in full, `[wo][wi]`, from its pairs.
pub fn full_table(pairs: &[[f32; 3]], directions: usize) -> Vec<[f32; 3]> {
    (0..directions * directions)
        .map(|at| {
            let (o, i) = (at / directions, at % directions);
            pairs[pair(i.max(o), i.min(o))]
        })
        .collect()
}
