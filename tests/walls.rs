//! Steep walls: F of maps whose texels are no points, against exact ray casts, and what a white one loses.

mod support;

use farfield::geometry::{Boundary, HeightField, HeightTracer};
use farfield::material::Brdf;
use farfield::prefilter::surface::coarse::{CoarseSurface, coarse_reflectance};
use farfield::prefilter::surface::downsample::{coarse_cells, downsample};
use farfield::prefilter::surface::fine::fine_reflectance;
use farfield::prefilter::surface::lobes::fit_lobes;
use farfield::prefilter::surface::reflectance::{PatchReflectance, TableDirections, pair};
use farfield::prefilter::surface::{FineSurface, LevelSettings, LightTransport, reflectance};
use farfield::transport::PatchSampling;
use farfield::transport::effective::{base_scatter, for_each_point};
use formats::{CellBrdf, Lobe};
use glam::Vec3;
use rayon::prelude::*;
use support::{COS_75, at, crop, diffuse, field, fixture, ggx};

/// One vertex up, one down: every texel is a saddle, whose centre is level.
fn checkerboard(amplitude: f32) -> HeightField {
    field([64, 64], [1.0; 2], Boundary::Repeat, |i, j| if (i + j) % 2 == 0 { amplitude } else { 0.0 })
}

/// F of the whole map for all pairs of directions, by exact ray casts in `strata`² places, one channel: `[pair]`.
fn exact(
    field: &HeightField,
    directions: &TableDirections,
    strata: usize,
    scatter: impl Fn(&farfield::transport::PatchPoint<'_>, usize, usize) -> f32 + Sync,
) -> Vec<f64> {
    let tracer = HeightTracer::new(field);
    let w: Vec<Vec3> = directions.vectors.iter().map(|&w| Vec3::from(w)).collect();
    let parts: Vec<Vec<f64>> = (0..16)
        .into_par_iter()
        .map(|part| {
            let sampling = PatchSampling::of_grid([4, 4], part, strata / 4, 3);
            let mut sums = vec![0.0; w.len() * (w.len() + 1) / 2];
            for_each_point(&tracer, &sampling, &w, |point| {
                for i in (0..w.len()).filter(|&i| point.sees(i)) {
                    for o in (0..=i).filter(|&o| point.sees(o)) {
                        sums[pair(i, o)] += f64::from(scatter(point, i, o));
                    }
                }
            });
            sums
        })
        .collect();
    let points = (strata / 4 * (strata / 4) * 16) as f64;
    (0..parts[0].len()).map(|k| parts.iter().map(|part| part[k]).sum::<f64>() / points).collect()
}

/// Relative error of a table over all pairs with both directions below 75° and over the others, and their biases.
fn compare(table: &PatchReflectance, exact: &[f64], directions: &TableDirections) -> [[f64; 2]; 2] {
    [true, false].map(|wanted| {
        let [mut square, mut total, mut bias, mut sum] = [0.0; 4];
        for i in 0..directions.len() {
            for o in 0..=i {
                let below = directions.vectors[i][2] > COS_75 && directions.vectors[o][2] > COS_75;
                if below != wanted {
                    continue;
                }
                let (found, exact) = (f64::from(table.channel(0, 0)[pair(i, o)]), exact[pair(i, o)]);
                square += (found - exact).powi(2);
                total += exact.powi(2);
                bias += found - exact;
                sum += exact;
            }
        }
        [(square / total).sqrt(), bias / sum]
    })
}

#[test]
fn diagnose() {
    let directions = TableDirections::new(7);
    let w: Vec<Vec3> = directions.vectors.iter().map(|&w| Vec3::from(w)).collect();
    let subjects = [
        ("rocks", crop(&fixture("rocks/height", 35.9), [128; 2], [1.0; 2], Boundary::Clamp), 128),
        ("cliffs", crop(&fixture("heights/cliffs", 120.0), [128; 2], [1.0; 2], Boundary::Repeat), 768),
        ("checkerboard 1", checkerboard(1.0), 192),
        ("checkerboard 8", checkerboard(8.0), 64),
    ];
    for (name, map, strata) in &subjects {
        let [width, height] = map.size();
        let areas: Vec<f32> = (0..width * height)
            .map(|k| {
                let steep = |s: f32, t: f32| {
                    let [x, y] = map.slope(k % width, k / width, s, t);
                    (1.0 + x * x + y * y).sqrt()
                };
                steep(0.0, 0.0).max(steep(1.0, 0.0)).max(steep(0.0, 1.0)).max(steep(1.0, 1.0))
            })
            .collect();
        let share = |limit: f32| areas.iter().filter(|&&a| a > limit).count() as f32 / areas.len() as f32;
        println!(
            "{name}: steepest {:.1}, share over 2, 3, 4, 6, 8: {:?}, area of those over 4: {:.2}",
            areas.iter().copied().fold(0.0, f32::max),
            [2.0, 3.0, 4.0, 6.0, 8.0].map(share),
            areas.iter().filter(|&&a| a > 4.0).sum::<f32>() / areas.len() as f32
        );
        let splits = farfield::prefilter::surface::splits::Splits::new(map);
        println!("parts {}", splits.parts().len());
        for brdf in [diffuse(1.0)] {
            let tracer = HeightTracer::new(map);
            let mut sums = vec![0.0; w.len() * (w.len() + 1) / 2];
            for texel in 0..width * height {
                for place in splits.places_of(texel) {
                    let part = splits.place(place);
                    let point = farfield::geometry::SurfacePoint { cell: [texel % width, texel / width], st: part.st };
                    let normal = tracer.normal(point);
                    let seen: Vec<usize> =
                        (0..w.len()).filter(|&k| normal.dot(w[k]) > 0.0 && !tracer.occluded(point, w[k])).collect();
                    for &i in &seen {
                        for &o in seen.iter().filter(|&&o| o <= i) {
                            sums[pair(i, o)] += f64::from(base_scatter(&brdf, normal, w[i], w[o])[0])
                                * 0.5_f64.powi(i32::from(part.halvings))
                                / (width * height) as f64;
                        }
                    }
                }
            }
            {
                let fine = FineSurface { heights: map.clone(), brdf, color: None };
                let table = fine_reflectance(&fine, [1, 1], &directions, &mut |_| {});
                println!("  fine against exact V of its places: {:.4?}", compare(&table, &sums, &directions));
                let truth = exact(map, &directions, *strata, |p, i, o| base_scatter(&brdf, p.normal, w[i], w[o])[0]);
                let mut best = table.clone();
                let _ = &mut best;
                let total: f64 = truth.iter().map(|x| x * x).sum();
                let off: f64 = truth.iter().zip(&sums).map(|(a, b)| (a - b) * (a - b)).sum();
                println!("  places against truth {:.4}", (off / total).sqrt());
            }
            let fine = FineSurface { heights: map.clone(), brdf, color: None };
            let table = fine_reflectance(&fine, [1, 1], &directions, &mut |_| {});
            let truth = exact(map, &directions, *strata, |p, i, o| base_scatter(&brdf, p.normal, w[i], w[o])[0]);
            println!("  fine: below, above: [ε, bias] {:.4?}", compare(&table, &truth, &directions));
        }
    }
}
