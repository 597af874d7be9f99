//! Steep walls: F of maps whose texels are no points, against exact ray casts, and what a white one loses.

mod support;

use farfield::geometry::{Boundary, HeightField, HeightTracer, SurfacePoint};
use farfield::prefilter::surface::fine::fine_reflectance;
use farfield::prefilter::surface::reflectance::{PatchReflectance, TableDirections, pair};
use farfield::prefilter::surface::splits::Splits;
use farfield::prefilter::surface::visibility::{EMPTY_SLOT, VisibilityBits};
use farfield::prefilter::surface::{FineSurface, LevelSettings, LightTransport, reflectance};
use farfield::transport::PatchSampling;
use farfield::transport::effective::{base_scatter, for_each_point};
use glam::Vec3;
use rayon::prelude::*;
use support::{COS_75, at, crop, diffuse, field, fixture};

/// One vertex up, one down: every texel is a saddle, whose centre is level.
fn checkerboard(amplitude: f32) -> HeightField {
    field([64, 64], [1.0; 2], Boundary::Repeat, |i, j| if (i + j) % 2 == 0 { amplitude } else { 0.0 })
}

/// A corner of the cliffs: walls of up to 119:1, one texel wide.
fn cliffs() -> HeightField {
    crop(&fixture("heights/cliffs", 120.0), [128; 2], [1.0; 2], Boundary::Repeat)
}

/// F of the whole white map for all pairs of directions, by exact ray casts in `strata`² places.
fn exact(field: &HeightField, directions: &TableDirections, strata: usize) -> Vec<f64> {
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
                        sums[pair(i, o)] += f64::from(base_scatter(&diffuse(1.0), point.normal, w[i], w[o])[0]);
                    }
                }
            });
            sums
        })
        .collect();
    let points = (strata * strata) as f64;
    (0..parts[0].len()).map(|k| parts.iter().map(|part| part[k]).sum::<f64>() / points).collect()
}

/// Root mean square error of a table over that of F, and its bias.
fn compare(table: &PatchReflectance, exact: &[f64]) -> [f64; 2] {
    let [mut square, mut total, mut bias, mut sum] = [0.0; 4];
    for (&found, exact) in table.channel(0, 0).iter().zip(exact) {
        square += (f64::from(found) - exact).powi(2);
        total += exact.powi(2);
        bias += f64::from(found) - exact;
        sum += exact;
    }
    [(square / total).sqrt(), bias / sum]
}

#[test]
fn direct_light_on_walls_and_saddles_is_that_of_exact_ray_casts() {
    // 7²: all directions within 75°. The casts' own noise is 1 % on the cliffs, of which one place in twenty is a wall,
    // and 0.3 % on the checkerboard; to it comes what bins and lines cost, about 1 % on both.
    // As points, texels were 9 % and 33 % off.
    let directions = TableDirections::new(7);
    for (name, map, strata) in [("cliffs", cliffs(), 384), ("checkerboard", checkerboard(1.0), 192)] {
        let fine = FineSurface { heights: map, brdf: diffuse(1.0), color: None };
        let table = fine_reflectance(&fine, [1, 1], &directions, &mut |_| {});
        let [error, bias] = compare(&table, &exact(&fine.heights, &directions, strata));
        println!("{name}: ε {:.2} %, bias {:+.2} %", 100.0 * error, 100.0 * bias);
        assert!(error < 0.02 && bias.abs() < 0.015, "{name}: {error} {bias}");
    }
}

#[test]
fn parts_of_walls_see_what_exact_ray_casts_see() {
    let (map, directions) = (cliffs(), TableDirections::new(15));
    let (width, tracer, splits) = (map.size()[0], HeightTracer::new(&map), Splits::new(&map));
    let first = map.heights().len();
    let count = splits.parts().len();
    assert!(count > 10_000, "{count}");
    let slots: Vec<u32> =
        (0..count.next_multiple_of(64)).map(|k| if k < count { (first + k) as u32 } else { EMPTY_SLOT }).collect();
    let bits = VisibilityBits::sweep_places(&map, &splits, &directions.vectors, slots);
    let [mut wrong, mut all] = [0.0; 2];
    for (d, w) in directions.vectors.iter().map(|&w| Vec3::from(w)).enumerate().filter(|(_, w)| w.z > COS_75) {
        for (k, part) in splits.parts().iter().enumerate().step_by(7) {
            let texel = part.texel as usize;
            let point = SurfacePoint { cell: [texel % width, texel / width], st: part.st };
            // by the area that the part shows: one that faces away reflects nothing whatever its bit says
            let shown = tracer.normal(point).dot(w).max(0.0);
            let lit = !tracer.occluded(point, w);
            wrong += if lit == (bits.direction(d)[k / 64] >> (k % 64) & 1 == 1) { 0.0 } else { shown };
            all += shown;
        }
    }
    println!("wrong: {:.3} % of the area shown", 100.0 * wrong / all);
    // the bar of texels' bits
    assert!(wrong < 0.003 * all, "{wrong} of {all}");
}

/// Effective albedo of the map towards the direction `o`: ∫ F dωi over cos θo, the quadrature normalised by the plane's.
fn albedo(f: &PatchReflectance, directions: &TableDirections, o: usize) -> f64 {
    let sum: f64 = (0..directions.len()).map(|i| f64::from(f.channel(0, 0)[pair(i.max(o), i.min(o))])).sum();
    let plane: f64 = directions.vectors.iter().map(|w| f64::from(w[2])).sum();
    sum * std::f64::consts::PI / plane / f64::from(directions.vectors[o][2])
}

#[test]
fn white_cliffs_lose_no_light() {
    let directions = TableDirections::new(15);
    let fine = FineSurface { heights: fixture("heights/cliffs", 120.0), brdf: diffuse(1.0), color: None };
    let settings = LevelSettings { light: LightTransport::Baked, ..at(8.0) };
    let (direct, more) = reflectance(&fine, [1, 1], &directions, &settings);
    for [from, to] in [[0.0, 45.0], [45.0, 75.0], [75.0, 90.0_f32]] {
        let band: Vec<f64> = (0..225)
            .filter(|&o| (from..to).contains(&directions.vectors[o][2].acos().to_degrees()))
            .map(|o| albedo(&direct, &directions, o) + albedo(&more.reflectance, &directions, o))
            .collect();
        let mean = band.iter().sum::<f64>() / band.len() as f64;
        println!("{from}° to {to}°: effective albedo {mean:.4}");
        assert!((mean - 1.0).abs() < 0.015, "{from}° to {to}°: {mean}");
    }
}
