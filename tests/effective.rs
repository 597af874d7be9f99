//! F on the table directions against exact ray casts, obvious sums and closed forms.

mod support;

use std::f64::consts::PI;

use farfield::geometry::{Boundary, HeightField, HeightTracer};
use farfield::material::{Brdf, ggx_gaussians};
use farfield::math::rng::Stream;
use farfield::prefilter::surface::coarse::{CoarseSurface, coarse_reflectance};
use farfield::prefilter::surface::downsample::{coarse_cells, downsample};
use farfield::prefilter::surface::fine::fine_reflectance;
use farfield::prefilter::surface::fit::full_table;
use farfield::prefilter::surface::lobes::fit_lobes;
use farfield::prefilter::surface::reflectance::{PatchReflectance, TableDirections, pair};
use farfield::prefilter::surface::visibility::{EMPTY_SLOT, VisibilityBits};
use farfield::prefilter::surface::{FineSurface, patch_of};
use farfield::transport::effective::{base_scatter, for_each_point, projected_area};
use farfield::transport::{Accumulator, Estimate, PatchPoint, PatchSampling};
use formats::{CellBrdf, Lobe};
use glam::Vec3;
use rayon::prelude::*;
use support::{COS_75, both, crop, diffuse, field, fixture, ggx, waves};

/// Directions of the 7 × 7 table that are cast: 0°, 23°, 48° and 75°, all around.
const NODES: [usize; 6] = [24, 25, 38, 12, 6, 21];
/// Strata per axis of a patch.
const STRATA: usize = 256;

/// All pairs of [`NODES`], the greater index first.
fn pairs() -> Vec<[usize; 2]> {
    let ordered = |a: usize, b: usize| [NODES[a].max(NODES[b]), NODES[a].min(NODES[b])];
    (0..NODES.len()).flat_map(|a| (0..=a).map(move |b| ordered(a, b))).collect()
}

/// F of one patch for all [`pairs`] and several scatters at once: `[scatter][pair]`, RGB.
fn exact(
    field: &HeightField,
    sampling: &PatchSampling,
    directions: &TableDirections,
    scatters: usize,
    mut scatter: impl FnMut(usize, &PatchPoint, [usize; 2]) -> [f32; 3],
) -> Vec<Vec<[Estimate; 3]>> {
    let tracer = HeightTracer::new(field);
    let w: Vec<Vec3> = directions.vectors.iter().map(|&w| Vec3::from(w)).collect();
    let cast = NODES.map(|node| w[node]);
    let pairs = pairs();
    let mut sums = vec![vec![[Accumulator::default(); 3]; pairs.len()]; scatters];
    for_each_point(&tracer, sampling, &cast, |point| {
        let sees = |node: usize| point.sees(NODES.iter().position(|&n| n == node).unwrap());
        for (k, &[i, o]) in pairs.iter().enumerate() {
            let seen = sees(i) && sees(o);
            for (s, sums) in sums.iter_mut().enumerate() {
                let value = if seen { scatter(s, point, [i, o]) } else { [0.0; 3] };
                (0..3).for_each(|c| sums[k][c].add(f64::from(value[c])));
            }
        }
    });
    sums.into_iter().map(|pairs| pairs.into_iter().map(|rgb| rgb.map(|sum| sum.estimate())).collect()).collect()
}

/// How a table's nodes deviate: the worst one in standard errors beyond `bound` of the root mean square F of its
/// channel, and the relative error over all.
fn compare(table: &PatchReflectance, exact: &[Vec<[Estimate; 3]>], bound: f64) -> [f64; 2] {
    let (mut worst, mut square, mut total) = (0.0_f64, 0.0, 0.0);
    let count = (exact.len() * exact[0].len()) as f64;
    let scale =
        [0, 1, 2].map(|c| (exact.iter().flatten().map(|rgb| rgb[c].mean * rgb[c].mean).sum::<f64>() / count).sqrt());
    for (patch, exact) in exact.iter().enumerate() {
        for (&[i, o], rgb) in pairs().iter().zip(exact) {
            for (channel, exact) in rgb.iter().enumerate() {
                let off = (f64::from(table.channel(patch, channel)[pair(i, o)]) - exact.mean).abs();
                worst = worst.max((off - bound * scale[channel]) / exact.standard_error().max(1e-12));
                square += off * off - exact.variance;
                total += exact.mean * exact.mean;
            }
        }
    }
    [worst, (square.max(0.0) / total).sqrt()]
}

/// The fine table's systematic error, `[worst node over the root mean square F, relative error over all]`: texel centres
/// stand for texels, swept visibility for casts, bins of normals for normals. The worst at GGX 0.1 is light and view from
/// the same 75°, where 90 % of what would shine is hidden and the lit part of a bin has other normals than the rest.
const FINE_BOUNDS: [[f64; 2]; 3] = [[0.015, 0.004], [0.015, 0.004], [0.1, 0.02]];

#[test]
fn fine_nodes_agree_with_exact_ray_casts() {
    let directions = TableDirections::new(7);
    let patches = [2, 2];
    for (name, amplitude) in [("heights/twill", 24.415), ("heights/fbm", 58.539)] {
        let map = fixture(name, amplitude);
        let brdfs = [diffuse(0.8), ggx(0.3), ggx(0.1)];
        let w: Vec<Vec3> = directions.vectors.iter().map(|&w| Vec3::from(w)).collect();
        let by_patch: Vec<_> = (0..4)
            .into_par_iter()
            .map(|patch| {
                let sampling = PatchSampling::of_grid(patches, patch, STRATA, 3);
                exact(&map, &sampling, &directions, brdfs.len(), |s, p, [i, o]| {
                    base_scatter(&brdfs[s], p.normal, w[i], w[o])
                })
            })
            .collect();
        for (s, (brdf, [node, all])) in brdfs.iter().zip(FINE_BOUNDS).enumerate() {
            let fine = FineSurface { heights: map.clone(), brdf: *brdf, color: None };
            let table = fine_reflectance(&fine, patches, &directions, &mut |_| {});
            let exact: Vec<_> = by_patch.iter().map(|patch| patch[s].clone()).collect();
            let [worst, error] = compare(&table, &exact, node);
            let alpha = brdf.specular.map(|c| c.alpha);
            println!(
                "{name}, GGX {alpha:?}: {worst:.1} standard errors beyond the bound, error {:.2} %",
                100.0 * error
            );
            // 252 numbers a case: 4.5 is a false alarm in 500 suites
            assert!(worst < 4.5, "{name}, GGX {alpha:?}: {worst}");
            assert!(error < all, "{name}, GGX {alpha:?}: {error}");
        }
    }
}

/// The same for the coarse table: a regular grid of places and, on a large map, merged lobes.
const COARSE_BOUNDS: [[f64; 2]; 3] = [[0.015, 0.005], [0.015, 0.005], [0.1, 0.03]];

#[test]
fn coarse_nodes_agree_with_exact_ray_casts_against_every_cell() {
    let directions = TableDirections::new(7);
    let patches = [2, 2];
    let map = fixture("heights/twill", 24.415);
    let cells = coarse_cells(map.size(), 8.0);
    let heights = downsample(&map, 8.0);
    let lobes = fit_lobes(&map, cells, Some(6));
    let colors: Vec<[f32; 3]> =
        (0..cells[0] * cells[1]).map(|k| [0.2 + 0.6 * (k % 3) as f32 / 2.0, 1.0, 0.4]).collect();
    let cases = [(diffuse(0.8), None), (both(0.3), Some(&colors)), (ggx(0.1), None)];
    for ((brdf, colors), [node, all]) in cases.into_iter().zip(COARSE_BOUNDS) {
        let gaussians = brdf.specular.map_or_else(Vec::new, |c| ggx_gaussians(c.alpha));
        let base_color = colors.map(|colors| colors.as_slice());
        let surface =
            CoarseSurface { heights: &heights, lobes: &lobes, base_color, brdf: &brdf, gaussians: &gaussians };
        let table = coarse_reflectance(&surface, patches, &directions);
        let base = farfield::build::encode::base_brdf(&brdf);
        let cell_brdf = |cell: usize| {
            let lobe =
                |l: farfield::prefilter::surface::VmfLobe| Lobe { mean: l.mean, kappa: l.kappa, weight: l.weight };
            CellBrdf::new(lobes.iter().map(|l| lobe(l[cell])), &base, base_color.map_or([1.0; 3], |c| c[cell]))
        };
        let w = &directions.vectors;
        let by_patch: Vec<_> = (0..4)
            .into_par_iter()
            .map(|patch| {
                let sampling = PatchSampling::of_grid(patches, patch, STRATA, 4);
                let mut known: std::collections::HashMap<(usize, [usize; 2]), [f32; 3]> = Default::default();
                let exact = exact(&heights, &sampling, &directions, 1, |_, p, at| {
                    let cell = p.point.cell[1] * cells[0] + p.point.cell[0];
                    let value =
                        known.entry((cell, at)).or_insert_with(|| cell_brdf(cell).normalised(w[at[0]], w[at[1]]));
                    let areas = p.shown_area(Vec3::from(w[at[0]])) * p.shown_area(Vec3::from(w[at[1]]));
                    value.map(|x| x * areas)
                });
                exact.into_iter().next().unwrap()
            })
            .collect();
        let [worst, error] = compare(&table, &by_patch, node);
        let alpha = brdf.specular.map(|c| c.alpha);
        println!("twill 8×, GGX {alpha:?}: {worst:.1} standard errors beyond the bound, error {:.2} %", 100.0 * error);
        assert!(worst < 4.5 && error < all, "GGX {alpha:?}: {worst} {error}");
    }
}

/// Bits of all texels in row-major order.
fn row_major_bits(map: &HeightField, directions: &TableDirections) -> VisibilityBits {
    let texels = map.heights().len();
    let slots = (0..texels.next_multiple_of(64)).map(|t| if t < texels { t as u32 } else { EMPTY_SLOT }).collect();
    VisibilityBits::sweep(map, &directions.vectors, slots)
}

/// F by the obvious loop over texels with their own normals and colours; `[patch][pair]`, RGB.
fn obvious(fine: &FineSurface, patches: [usize; 2], directions: &TableDirections) -> Vec<Vec<[f64; 3]>> {
    let bits = row_major_bits(&fine.heights, directions);
    let tracer = HeightTracer::new(&fine.heights);
    let size = fine.heights.size();
    let n = directions.len();
    let mut sums = vec![vec![[0.0; 3]; n * (n + 1) / 2]; patches[0] * patches[1]];
    let mut counts = vec![0.0; sums.len()];
    for texel in 0..size[0] * size[1] {
        let at = [texel % size[0], texel / size[0]];
        let patch = patch_of(at, size, patches);
        counts[patch] += 1.0;
        let normal = tracer.normal(support::centre(at[0], at[1]));
        let brdf = fine.color.as_ref().map_or(fine.brdf, |color| fine.brdf.tinted(color[texel]));
        let seen: Vec<usize> = (0..n).filter(|&d| (bits.direction(d)[texel / 64] >> (texel % 64)) & 1 == 1).collect();
        for &i in &seen {
            for &o in seen.iter().take_while(|&&o| o <= i) {
                let [wi, wo] = [i, o].map(|d| Vec3::from(directions.vectors[d]));
                let s = base_scatter(&brdf, normal, wi, wo);
                (0..3).for_each(|c| sums[patch][pair(i, o)][c] += f64::from(s[c]));
            }
        }
    }
    for (sums, count) in sums.iter_mut().zip(counts) {
        sums.iter_mut().flatten().for_each(|sum| *sum /= count);
    }
    sums
}

/// √(Σ(table − obvious)²/Σ obvious²) below 75°.
fn distance(table: &PatchReflectance, sums: &[Vec<[f64; 3]>], directions: &TableDirections) -> f64 {
    let (mut square, mut total) = (0.0, 0.0);
    for (patch, sums) in sums.iter().enumerate() {
        for i in (0..directions.len()).filter(|&i| directions.vectors[i][2] > COS_75) {
            for o in (0..=i).filter(|&o| directions.vectors[o][2] > COS_75) {
                for (c, &exact) in sums[pair(i, o)].iter().enumerate() {
                    square += (f64::from(table.channel(patch, c)[pair(i, o)]) - exact).powi(2);
                    total += exact * exact;
                }
            }
        }
    }
    (square / total).sqrt()
}

/// A colour map that depends on the slope: what faces +x is red, what faces −x is blue, and a little noise.
fn slope_colors(map: &HeightField) -> Vec<[f32; 3]> {
    let [width, height] = map.size();
    let rng = Stream::new(8, 8);
    (0..width * height)
        .map(|t| {
            let slope = map.slope(t % width, t / width, 0.5, 0.5);
            let red = 0.5 - 0.4 * slope[0].clamp(-1.0, 1.0);
            [red, 0.2 + 0.6 * rng.uniform(t as u64), 0.9 - red * 0.8]
        })
        .collect()
}

#[test]
fn grouping_by_normals_and_colours_changes_little_against_the_obvious_sum() {
    let directions = TableDirections::new(7);
    let map = crop(&fixture("heights/twill", 24.415), [128, 128], [1.0; 2], Boundary::Clamp);
    let colors = slope_colors(&map);
    let cases: [(&str, Brdf, bool, f64); 6] = [
        ("diffuse", diffuse(0.8), false, 0.004),
        ("diffuse, coloured", diffuse(0.8), true, 0.004),
        ("GGX 0.3", ggx(0.3), false, 0.01),
        ("both 0.3, coloured", both(0.3), true, 0.01),
        ("GGX 0.1", ggx(0.1), false, 0.03),
        ("GGX 0.1, coloured", ggx(0.1), true, 0.03),
    ];
    for (name, brdf, colored, bound) in cases {
        let fine = FineSurface { heights: map.clone(), brdf, color: colored.then(|| colors.clone()) };
        for patches in [[2, 3], [1, 1]] {
            let table = fine_reflectance(&fine, patches, &directions, &mut |_| {});
            let error = distance(&table, &obvious(&fine, patches, &directions), &directions);
            println!("{name}, {patches:?}: {:.3} %", 100.0 * error);
            assert!(error < bound, "{name}, {patches:?}: {error}");
        }
    }
}

/// Texels of one wall of [`groove`].
const WALL: usize = 128;

/// A 45° groove along y.
fn groove(boundary: Boundary) -> HeightField {
    field([2 * WALL; 2], [1.0; 2], boundary, |i, _| (i as f32 - WALL as f32).abs())
}

#[test]
fn a_groove_of_two_colours_shows_each_colour_to_its_side() {
    // Walls that face +x (first half: the height falls) are red, those that face −x green; both partly blue.
    let color = (0..4 * WALL * WALL).map(|t| if t % (2 * WALL) < WALL { [1.0, 0.0, 0.25] } else { [0.0, 1.0, 0.75] });
    let fine = FineSurface { heights: groove(Boundary::Repeat), brdf: diffuse(0.8), color: Some(color.collect()) };
    let directions = TableDirections::new(15);
    let table = fine_reflectance(&fine, [1, 1], &directions, &mut |_| {});
    let half = 0.5_f64.sqrt();
    // What a wall of normal (side·½√2, 0, ½√2) shows, by the slope z/|x| of the direction: above 45° all of it; below,
    // the rim opposite hides the lower part and 2t/(1 + t) is left, for all lines of sight the same upper part.
    let shown = |side: f64, w: [f32; 3]| {
        let [x, _, z] = w.map(f64::from);
        let facing = ((side * x + z) * half).max(0.0);
        let t = z / x.abs().max(1e-9);
        (facing, if t >= 1.0 || facing == 0.0 { 1.0 } else { 2.0 * t / (1.0 + t) })
    };
    let mut single = 0;
    for i in 0..directions.len() {
        for o in 0..=i {
            let [wi, wo] = [directions.vectors[i], directions.vectors[o]];
            let walls = [1.0, -1.0].map(|side| {
                let ((ci, lit_i), (co, lit_o)) = (shown(side, wi), shown(side, wo));
                let scatter = 0.5 * 0.8 / PI * ci * co / half;
                // one texel of the wall more or less is seen
                (scatter * lit_i.min(lit_o), scatter * 1.01 / WALL as f64 + 1e-6)
            });
            let [(red, red_by), (green, green_by)] = walls;
            let expected = [red, green, 0.25 * red + 0.75 * green];
            for (c, (expected, by)) in expected.into_iter().zip([red_by, green_by, red_by + green_by]).enumerate() {
                let got = f64::from(table.channel(0, c)[pair(i, o)]);
                assert!((got - expected).abs() <= by, "{wi:?} {wo:?} channel {c}: {got}, wanted {expected}");
            }
            if red > 0.01 && green == 0.0 {
                single += 1;
                assert_eq!(table.channel(0, 1)[pair(i, o)], 0.0, "green is seen from the red side");
            }
        }
    }
    assert!(single > 1000, "{single} pairs see one colour only");
}

#[test]
fn a_groove_on_a_strip_is_shadowed_as_on_a_square() {
    // The same groove on a map of two rows: light from 45° off the axis still comes a long way over it.
    let directions = TableDirections::new(15);
    let on = |rows: usize| {
        let heights = field([2 * WALL, rows], [1.0; 2], Boundary::Repeat, |i, _| (i as f32 - WALL as f32).abs());
        let fine = FineSurface { heights, brdf: diffuse(0.8), color: None };
        fine_reflectance(&fine, [1, 1], &directions, &mut |_| {})
    };
    let [strip, square] = [on(2), on(2 * WALL)];
    for k in 0..strip.pair_count() {
        let [strip, square] = [&strip, &square].map(|table| table.channel(0, 0)[k]);
        // one texel of a wall more or less
        assert!((strip - square).abs() < 0.01 + 1e-3 * square, "pair {k}: {strip} on the strip, {square}");
    }
}

#[test]
fn a_colour_that_knows_nothing_of_normals_multiplies_by_its_mean() {
    let map = crop(&fixture("heights/twill", 24.415), [256, 256], [1.0; 2], Boundary::Clamp);
    let rng = Stream::new(21, 0);
    let color: Vec<[f32; 3]> =
        (0..256 * 256).map(|t| [0, 1, 2].map(|c| rng.uniform(3 * t + c).powi(c as i32 + 1))).collect();
    let mean = [0, 1, 2].map(|c| color.iter().map(|rgb| f64::from(rgb[c])).sum::<f64>() / color.len() as f64);
    let variance = [0, 1, 2]
        .map(|c| color.iter().map(|rgb| (f64::from(rgb[c]) - mean[c]).powi(2)).sum::<f64>() / color.len() as f64);
    let directions = TableDirections::new(5);
    let bits = row_major_bits(&map, &directions);
    let tracer = HeightTracer::new(&map);
    let plain = FineSurface { heights: map.clone(), brdf: diffuse(0.8), color: None };
    let colored = FineSurface { color: Some(color), ..plain.clone() };
    let [plain, colored] = [plain, colored].map(|fine| fine_reflectance(&fine, [1, 1], &directions, &mut |_| {}));
    let mut worst = 0.0_f64;
    for i in 0..directions.len() {
        for o in 0..=i {
            let [wi, wo] = [i, o].map(|d| Vec3::from(directions.vectors[d]));
            // Σ s² over the texels that see both: the variance of Σ s·colour for independent colours
            let squares: f64 = (0..256 * 256)
                .filter(|t| (bits.direction(i)[t / 64] & bits.direction(o)[t / 64]) >> (t % 64) & 1 == 1)
                .map(|t| base_scatter(&diffuse(0.8), tracer.normal(support::centre(t % 256, t / 256)), wi, wo)[0])
                .map(|s| f64::from(s).powi(2))
                .sum();
            for c in 0..3 {
                let expected = mean[c] * f64::from(plain.channel(0, c)[pair(i, o)]);
                let got = f64::from(colored.channel(0, c)[pair(i, o)]);
                let error = (variance[c] * squares).sqrt() / 65536.0;
                worst = worst.max((got - expected).abs() / error);
            }
        }
    }
    println!("worst of 975 deviations: {worst:.2} standard errors");
    // 975 numbers, many of them alike: beyond 4.5 once in 150 suites
    assert!(worst < 4.5, "{worst} standard errors");
}

#[test]
fn tables_are_symmetric_because_a_pair_is_kept_once() {
    let map = field([32, 32], [1.0; 2], Boundary::Repeat, waves([32, 32], 8.0, 3.0, 1));
    let directions = TableDirections::new(5);
    let fine = FineSurface { heights: map, brdf: both(0.2), color: None };
    let table = fine_reflectance(&fine, [1, 1], &directions, &mut |_| {});
    let pairs: Vec<[f32; 3]> = (0..table.pair_count()).map(|k| [0, 1, 2].map(|c| table.channel(0, c)[k])).collect();
    let full = full_table(&pairs, 25);
    assert_eq!(full.len(), 625);
    for i in 0..25 {
        for o in 0..25 {
            assert_eq!(full[o * 25 + i], full[i * 25 + o]);
            assert_eq!(full[o * 25 + i], pairs[pair(i.max(o), i.min(o))]);
        }
    }
}

#[test]
fn a_white_diffuse_surface_reflects_no_more_than_it_shows() {
    // ∫F dωi <= A(ωo): direct light alone, and what is shadowed is lost. The quadrature over the table's cells is
    // bounded by that of the facet which it favours most.
    let directions = TableDirections::new(15);
    let solid_angle = 2.0 * PI / directions.len() as f64;
    let sum_over_lights = |n: Vec3| -> f64 {
        directions.vectors.iter().map(|&w| f64::from(n.dot(Vec3::from(w)).max(0.0))).sum::<f64>() * solid_angle / PI
    };
    let favoured = (0..4000)
        .map(|k| sum_over_lights(support::random_direction(Stream::new(1, 1), k)))
        .fold(sum_over_lights(Vec3::Z), f64::max);
    assert!(favoured < 1.012, "15² centres integrate a facet's cosine to {favoured}");
    for (name, amplitude) in [("heights/twill", 24.415), ("heights/fbm", 58.539), ("heights/cliffs", 120.0)] {
        let map = fixture(name, amplitude);
        let tracer = HeightTracer::new(&map);
        let fine = FineSurface { heights: map.clone(), brdf: diffuse(1.0), color: None };
        let table = fine_reflectance(&fine, [1, 1], &directions, &mut |_| {});
        let mut albedo = [1.0_f64, 0.0];
        for o in (0..directions.len()).step_by(7) {
            let f = |i: usize| f64::from(table.channel(0, 0)[pair(i.max(o), i.min(o))]);
            let reflected = (0..directions.len()).map(f).sum::<f64>() * solid_angle;
            let sampling = PatchSampling::of_grid([1, 1], 0, 200, 6);
            let area = projected_area(&tracer, &sampling, Vec3::from(directions.vectors[o]));
            // 1 %: visible area by bits of texel centres instead of casts
            let limit = favoured * (1.01 * area.mean + 4.0 * area.standard_error());
            assert!(reflected <= limit, "{name} towards {:?}: {reflected} of {area:?}", directions.vectors[o]);
            albedo = [albedo[0].min(reflected / area.mean), albedo[1].max(reflected / area.mean)];
        }
        println!("{name}: directional albedo under direct light {:.3} to {:.3}", albedo[0], albedo[1]);
    }
}
