//! The measurement of a level's error, measured.

mod support;

use farfield::geometry::{Boundary, HeightField, HeightTracer};
use farfield::math::rng::Stream;
use farfield::prefilter::surface::{FineSurface, LevelSettings, patch_of};
use farfield::transport::effective::base_scatter;
use formats::asset::SurfaceAsset;
use glam::Vec3;
use rayon::prelude::*;
use support::{COS_75, at, both, compiled, diffuse, field, measured, random_direction, through_bytes, waves};

/// Hills of slope 0.7 on a map that tiles.
fn hills() -> HeightField {
    field([48, 48], [1.0; 2], Boundary::Repeat, waves([48, 48], 12.0, 2.0, 4))
}

fn small() -> LevelSettings {
    LevelSettings { patches: Some(2), directions: Some(7), ..at(8.0) }
}

#[test]
fn a_level_that_is_exact_has_no_error() {
    let plane = field([32, 32], [1.0; 2], Boundary::Repeat, |_, _| 0.0);
    let fine = FineSurface { heights: plane, brdf: diffuse(0.5), color: None };
    let error = measured(&fine, &through_bytes(&fine, compiled(&fine, &small())), 3);
    println!("{error:?}");
    for (name, figure) in error.figures() {
        // every point sees the same, so there is no noise; f_c in f32 and S in half floats are what is left
        assert!(figure.value.abs() < 1e-3, "{name}: {figure:?}");
        assert!(figure.standard_error < 1e-4, "{name}: {figure:?}");
    }
}

/// `asset` with S multiplied by `scale`.
fn scaled(asset: &SurfaceAsset, scale: f32) -> SurfaceAsset {
    let mut asset = asset.clone();
    asset.levels[0].angular.iter_mut().flatten().flatten().for_each(|s| *s *= scale);
    asset
}

#[test]
fn a_planted_scale_is_found_as_error_and_bias() {
    let plane = field([32, 32], [1.0; 2], Boundary::Clamp, |_, _| 0.0);
    let fine = FineSurface { heights: plane, brdf: diffuse(0.5), color: None };
    let asset = through_bytes(&fine, compiled(&fine, &small()));
    for scale in [1.05_f32, 0.5] {
        let error = measured(&fine, &scaled(&asset, scale), 3);
        let planted = f64::from(scale) - 1.0;
        assert!((error.bias.value - planted).abs() < 1e-3, "{scale}: bias {:?}", error.bias);
        for figure in [error.below_75, error.above_75] {
            assert!((figure.value - planted.abs()).abs() < 1e-3, "{scale}: {figure:?}");
        }
    }
}

#[test]
fn a_planted_scale_is_found_on_a_rough_map_too() {
    let fine = FineSurface { heights: hills(), brdf: both(0.3), color: None };
    let asset = through_bytes(&fine, compiled(&fine, &small()));
    let [before, after] = [1.0, 1.05].map(|scale| measured(&fine, &scaled(&asset, scale), 3));
    println!("before {before:?}\nafter {after:?}");
    // Σd/ΣF is linear in S and the points are the same
    let expected = 1.05 * (1.0 + before.bias.value) - 1.0;
    assert!((after.bias.value - expected).abs() < 1e-5, "bias {} instead of {expected}", after.bias.value);
    // ε² = Σ(1.05·L − F)²/ΣF² with d = L − F: between the two as vectors
    let [low, high] = [(0.05 - before.below_75.value).abs(), 0.05 + 1.05 * before.below_75.value];
    assert!((low..=high).contains(&after.below_75.value), "{:?}", after.below_75);
}

/// F of the fine and of the coarse surface with f_low, summed over a regular grid of points of one patch.
fn brute_force(
    fine: &FineSurface,
    asset: &SurfaceAsset,
    patch: usize,
    directions: &[Vec3],
) -> Vec<([usize; 2], [f64; 3], [f64; 3])> {
    /// Points per axis of the map.
    const POINTS: usize = 80;
    let level = &asset.levels[0];
    let cells = level.cells;
    let spacing = [0, 1].map(|k| (asset.size[k] / cells[k] as f64) as f32);
    let coarse = HeightField::new(level.heights.clone(), cells, spacing, fine.heights.boundary());
    let tracers = [HeightTracer::new(&fine.heights), HeightTracer::new(&coarse)];
    let pairs: Vec<[usize; 2]> = (0..directions.len()).flat_map(|i| (0..i).map(move |o| [i, o])).collect();
    let mut sums: Vec<_> = pairs.iter().map(|&pair| (pair, [0.0; 3], [0.0; 3])).collect();
    let mut count = 0.0;
    let mut f_low = std::collections::HashMap::new();
    for point in 0..POINTS * POINTS {
        let grid = [point % POINTS, point / POINTS];
        if patch_of(grid, [POINTS; 2], level.patches) != patch {
            continue;
        }
        count += 1.0;
        let x = grid.map(|k| (k as f32 + 0.5) / POINTS as f32);
        let places = [fine.heights.size(), cells].map(|size| {
            let place = [0, 1].map(|k| x[k] * size[k] as f32);
            let cell = [0, 1].map(|k| (place[k] as usize).min(size[k] - 1));
            farfield::geometry::SurfacePoint { cell, st: [0, 1].map(|k| place[k] - cell[k] as f32) }
        });
        let normals = [0, 1].map(|s| tracers[s].normal(places[s]));
        let sees: Vec<[bool; 2]> = directions
            .iter()
            .map(|&w| [0, 1].map(|s| normals[s].dot(w) > 0.0 && !tracers[s].occluded(places[s], w)))
            .collect();
        for (k, &[i, o]) in pairs.iter().enumerate() {
            let [wi, wo] = [directions[i], directions[o]];
            if sees[i][0] && sees[o][0] {
                let s = base_scatter(&fine.brdf, normals[0], wi, wo);
                (0..3).for_each(|c| sums[k].1[c] += f64::from(s[c]));
            }
            if sees[i][1] && sees[o][1] {
                // f_c·⟨n_c, ωg⟩ depends on the cell alone; T and the geometry on the point
                let cell = level.cell_at(x);
                let f_c = *f_low.entry((cell, k)).or_insert_with(|| {
                    level.cell_brdf(cell, &asset.bsdf).eval([0.0, 0.0, 1.0], wi.to_array(), wo.to_array())
                });
                let scale = level.scaling_at(x, asset.boundary, wi.to_array(), wo.to_array());
                let n_c = normals[1];
                let geometry = n_c.dot(wi) * n_c.dot(wo) / (n_c.z * n_c.z);
                (0..3).for_each(|c| sums[k].2[c] += f64::from(scale[c] * f_c[c] * geometry));
            }
        }
    }
    sums.into_iter().map(|(pair, f, l)| (pair, f.map(|x| x / count), l.map(|x| x / count))).collect()
}

#[test]
fn the_error_agrees_with_a_brute_force_estimate() {
    for (name, brdf, color) in
        [("diffuse", diffuse(0.8), false), ("both 0.3", both(0.3), false), ("red", diffuse(0.8), true)]
    {
        let mut fine = FineSurface { heights: hills(), brdf, color: None };
        if color {
            // the base is white here: a colour map of one value is the same base
            fine.brdf = fine.brdf.tinted([1.0, 0.5, 0.25]);
        }
        let asset = through_bytes(&fine, compiled(&fine, &small()));
        let error = measured(&fine, &asset, 11);
        // Blocks of directions of their own for every patch; their spread tells how sure this estimate is.
        const BLOCKS: usize = 10;
        let blocks: Vec<[f64; 4]> = (0..BLOCKS)
            .into_par_iter()
            .map(|block| {
                let mut sums = [0.0; 4];
                for patch in 0..4 {
                    let rng = Stream::new(5, (block * 4 + patch) as u64);
                    let drawn = (0..).map(|k| random_direction(rng, k)).filter(|w| w.z > COS_75);
                    let directions: Vec<Vec3> = drawn.take(7).collect();
                    for (_, f, l) in brute_force(&fine, &asset, patch, &directions) {
                        for c in 0..3 {
                            let d = l[c] - f[c];
                            [d * d, f[c] * f[c], d, f[c]].iter().zip(&mut sums).for_each(|(x, sum)| *sum += x);
                        }
                    }
                }
                sums
            })
            .collect();
        let figures = |blocks: &[[f64; 4]]| {
            let sum = |k: usize| blocks.iter().map(|block| block[k]).sum::<f64>();
            [(sum(0) / sum(1)).sqrt(), sum(2) / sum(3)]
        };
        let all = figures(&blocks);
        let mut variance = [0.0; 2];
        for left_out in 0..BLOCKS {
            let rest: Vec<_> = (0..BLOCKS).filter(|&b| b != left_out).map(|b| blocks[b]).collect();
            let off = figures(&rest);
            let n = BLOCKS as f64;
            (0..2).for_each(|k| variance[k] += (n - 1.0) / n * (off[k] - all[k]).powi(2));
        }
        for ((what, measured), (found, variance)) in
            [("ε", error.below_75), ("bias", error.bias)].into_iter().zip(all.into_iter().zip(variance))
        {
            let combined = (variance + measured.standard_error.powi(2)).sqrt();
            println!("{name}, {what}: measured {measured:?}, by brute force {found:.4} ± {:.4}", variance.sqrt());
            // 4 comparisons; a regular grid of points adds under 1e-3
            assert!((measured.value - found).abs() < 3.5 * combined + 1e-3, "{name}, {what}: {measured:?} {found}");
        }
    }
}

#[test]
fn the_standard_error_covers_what_other_seeds_find() {
    let fine = FineSurface { heights: hills(), brdf: diffuse(0.8), color: None };
    let asset = through_bytes(&fine, compiled(&fine, &small()));
    let runs: Vec<_> = (100..105).map(|seed| measured(&fine, &asset, seed)).collect();
    for (what, values) in [
        ("below 75°", runs.iter().map(|e| e.below_75).collect::<Vec<_>>()),
        ("bias", runs.iter().map(|e| e.bias).collect()),
    ] {
        let n = values.len() as f64;
        let mean = values.iter().map(|f| f.value).sum::<f64>() / n;
        let spread = (values.iter().map(|f| (f.value - mean).powi(2)).sum::<f64>() / (n - 1.0)).sqrt();
        let stated = (values.iter().map(|f| f.standard_error.powi(2)).sum::<f64>() / n).sqrt();
        println!("{what}: {mean:.4}, spread {spread:.5} over seeds, stated {stated:.5}");
        // χ² of 4 degrees of freedom: a spread above 2.2 times the truth comes by chance once in 1400 suites
        assert!(spread < 2.2 * stated, "{what}: {spread} over seeds, {stated} stated");
    }
}
