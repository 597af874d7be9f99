//! Fits of planted tables: what T and S must recover, keep and survive.

use std::f32::consts::PI;

use farfield::geometry::Boundary;
use farfield::material::Brdf;
use farfield::math::rng::Stream;
use farfield::prefilter::surface::fit::{Factors, deconvolve, fit_scaling};
use farfield::prefilter::surface::reflectance::{Part, PatchReflectance, TableDirections, Term, assemble, pair_count};
use formats::lookup;

/// Directions per axis of all tables here.
const N: usize = 5;

fn directions() -> TableDirections {
    TableDirections::new(N)
}

/// F as the formula says, `(patch, channel, pair)`.
fn table(patches: usize, value: impl Fn(usize, usize, usize) -> f32) -> PatchReflectance {
    let terms = [0, 1, 2].map(|channel| Term { part: Part::Diffuse, tint: Some(channel) });
    let pairs = pair_count(N * N);
    let sums: Vec<f32> = (0..patches * 3 * pairs).map(|k| value(k / (3 * pairs), k / pairs % 3, k % pairs)).collect();
    // an albedo of π leaves the sums as they are
    assemble(&sums, &terms, &Brdf { diffuse: [PI; 3], specular: None }, &directions())
}

/// Uniform in [low, high), a function of the indices.
fn random(low: f32, high: f32, at: [usize; 4]) -> f32 {
    let [stream, a, b, c] = at.map(|x| x as u64);
    low + (high - low) * Stream::new(17, stream).uniform((a * 64 + b) * 100_000 + c)
}

/// The scaling that factors say at one patch, channel and pair.
fn scaling(factors: &Factors, p: usize, c: usize, k: usize) -> f64 {
    factors.spatial.iter().zip(&factors.angular).map(|(t, s)| f64::from(t[p][c]) * f64::from(s[k][c])).sum()
}

/// Largest deviation of the factors' scaling from a formula, relative to its mean.
fn worst_scaling(factors: &Factors, patches: usize, wanted: impl Fn(usize, usize, usize) -> f32) -> f64 {
    let (mut worst, mut sum, mut count) = (0.0_f64, 0.0, 0.0);
    for (p, c) in (0..patches).flat_map(|p| (0..3).map(move |c| (p, c))) {
        for k in 0..pair_count(N * N) {
            let wanted = f64::from(wanted(p, c, k));
            worst = worst.max((scaling(factors, p, c, k) - wanted).abs());
            sum += wanted;
            count += 1.0;
        }
    }
    worst * count / sum
}

fn expect_normalised(factors: &Factors, fine: &PatchReflectance, coarse: &PatchReflectance) {
    let directions = directions();
    for c in 0..3 {
        let mean = factors.spatial[0].iter().map(|t| f64::from(t[c])).sum::<f64>() / factors.spatial[0].len() as f64;
        assert!((mean - 1.0).abs() < 1e-6, "T of channel {c} has mean {mean}");
        let [mut model, mut exact] = [0.0; 2];
        for p in 0..fine.patch_count() {
            let mut k = 0;
            for i in 0..directions.len() {
                for o in 0..=i {
                    // a pair of different directions stands for both orders
                    let weight = if i == o { 1.0 } else { 2.0 };
                    model += weight * scaling(factors, p, c, k) * f64::from(coarse.channel(p, c)[k]);
                    exact += weight * f64::from(fine.channel(p, c)[k]);
                    k += 1;
                }
            }
        }
        assert!((model / exact - 1.0).abs() < 1e-6, "channel {c} is biased by {}", model / exact - 1.0);
    }
}

#[test]
fn a_planted_product_is_recovered() {
    let patches = 16;
    let spatial = |p: usize, c: usize| {
        // mean 1 over patches by pairs of opposite deviations
        let off = random(0.0, 0.5, [1, p / 2, c, 0]);
        if p.is_multiple_of(2) { 1.0 + off } else { 1.0 - off }
    };
    let angular = |k: usize, c: usize| random(0.3, 3.0, [2, 0, c, k]);
    let coarse = table(patches, |p, c, k| random(0.05, 1.0, [3, p, c, k]));
    let fine = table(patches, |p, c, k| spatial(p, c) * angular(k, c) * coarse.channel(p, c)[k]);
    for rank in [1, 2, 3] {
        let factors = fit_scaling(&fine, &coarse, &directions(), rank);
        let worst = worst_scaling(&factors, patches, |p, c, k| spatial(p, c) * angular(k, c));
        println!("rank {rank}: scaling within {worst:.1e}, on the nodes {:.1e}", factors.on_node);
        // the prior pulls by the square of 1e-3, over the smallest F squared
        assert!(worst < 2e-3 && factors.on_node < 1e-4, "rank {rank}: {worst} {}", factors.on_node);
        expect_normalised(&factors, &fine, &coarse);
        if rank == 1 {
            for p in 0..patches {
                for c in 0..3 {
                    assert!((factors.spatial[0][p][c] - spatial(p, c)).abs() < 1e-3);
                }
            }
        }
    }
}

#[test]
fn two_planted_products_are_recovered_by_two_factors_and_not_by_one() {
    let patches = 16;
    let scale = |p: usize, c: usize, k: usize| {
        let second = if p.is_multiple_of(2) { 0.4 } else { -0.4 } * random(0.5, 1.0, [4, p / 2, c, 0]);
        let direction = (k as f32 * 0.37 + c as f32).sin();
        random(0.9, 1.1, [5, p, c, 0]) * random(1.0, 2.0, [6, 0, c, k]) + second * direction
    };
    let coarse = table(patches, |p, c, k| random(0.2, 1.0, [7, p, c, k]));
    let fine = table(patches, |p, c, k| scale(p, c, k) * coarse.channel(p, c)[k]);
    let [one, two] = [1, 2].map(|rank| fit_scaling(&fine, &coarse, &directions(), rank));
    let worst = worst_scaling(&two, patches, scale);
    println!("on the nodes: {:.4} with one, {:.1e} with two; scaling within {worst:.1e}", one.on_node, two.on_node);
    assert_eq!([one.spatial.len(), two.spatial.len()], [1, 2]);
    assert!(one.on_node > 0.05 && two.on_node < 1e-3 && worst < 5e-3);
    expect_normalised(&one, &fine, &coarse);
    expect_normalised(&two, &fine, &coarse);
}

#[test]
fn noisy_tables_are_fitted_without_bias() {
    // 20 % of independent noise on both tables: least squares would be too dark, averages of ratios too bright.
    for (patches, rank) in [(1, 1), (4, 1), (16, 1), (16, 2), (16, 3)] {
        let coarse = table(patches, |p, c, k| random(0.05, 1.0, [8, p, c, k]) * random(0.65, 1.35, [9, p, c, k]));
        let fine = table(patches, |p, c, k| random(0.05, 1.0, [8, p, c, k]) * random(0.65, 1.35, [10, p, c, k]));
        let factors = fit_scaling(&fine, &coarse, &directions(), rank);
        expect_normalised(&factors, &fine, &coarse);
    }
}

#[test]
fn more_factors_never_fit_worse() {
    for patches in [1, 2, 3, 16] {
        let coarse = table(patches, |p, c, k| random(0.1, 1.0, [11, p, c, k]));
        let fine = table(patches, |p, c, k| random(0.1, 1.0, [12, p, c, k]));
        let errors = [1, 2, 3].map(|rank| fit_scaling(&fine, &coarse, &directions(), rank).on_node);
        println!("{patches} patches: {errors:?}");
        // 1e-3: rescaling to zero bias is not the least square
        assert!(errors[1] <= errors[0] * 1.001 && errors[2] <= errors[1] * 1.001, "{patches} patches: {errors:?}");
    }
}

/// Everything finite, T and ΣTS not negative on the patches.
fn expect_sound(factors: &Factors, what: &str) {
    let all = factors.spatial.iter().chain(&factors.angular).flatten().flatten();
    assert!(all.clone().all(|x| x.is_finite()), "{what}: not finite");
    assert!(factors.on_node.is_finite(), "{what}");
    for p in 0..factors.spatial[0].len() {
        for k in 0..factors.angular[0].len() {
            for c in 0..3 {
                // rounding to f32 of terms up to the largest
                assert!(scaling(factors, p, c, k) >= -1e-5, "{what}: patch {p}, pair {k}");
            }
        }
    }
    if factors.spatial.len() == 1 {
        assert!(factors.spatial[0].iter().flatten().chain(factors.angular[0].iter().flatten()).all(|&x| x >= 0.0));
    }
}

#[test]
fn tables_that_are_black_in_whole_or_part_give_finite_scales() {
    let some = |p: usize, c: usize, k: usize| random(0.1, 1.0, [13, p, c, k]);
    type Formula<'a> = Box<dyn Fn(usize, usize, usize) -> f32 + 'a>;
    let cases: Vec<(&str, Formula, Formula)> = vec![
        ("both black", Box::new(|_, _, _| 0.0), Box::new(|_, _, _| 0.0)),
        ("fine black", Box::new(|_, _, _| 0.0), Box::new(some)),
        ("coarse black", Box::new(some), Box::new(|_, _, _| 0.0)),
        (
            "one channel black",
            Box::new(|p, c, k| if c == 1 { 0.0 } else { some(p, c, k) }),
            Box::new(|p, c, k| if c == 1 { 0.0 } else { some(p, c, k) }),
        ),
        ("half the pairs black", Box::new(|p, c, k| if k % 2 == 0 { 0.0 } else { some(p, c, k) }), {
            Box::new(|p, c, k| if k % 2 == 0 { 0.0 } else { some(p, c, k) })
        }),
        (
            "pairs that only the coarse surface lights",
            Box::new(|p, c, k| if k % 3 == 0 { 0.0 } else { some(p, c, k) }),
            { Box::new(some) },
        ),
        ("pairs that only the fine surface lights", Box::new(some), {
            Box::new(|p, c, k| if k % 3 == 0 { 0.0 } else { some(p, c, k) })
        }),
        ("a black patch", Box::new(|p, c, k| if p == 2 { 0.0 } else { some(p, c, k) }), Box::new(some)),
        ("values of 1e-30", Box::new(|p, c, k| 1e-30 * some(p, c, k)), Box::new(|p, c, k| 1e-30 * some(k % 4, c, p))),
        ("values of 1e15", Box::new(|p, c, k| 1e15 * some(p, c, k)), Box::new(|p, c, k| 1e15 * some(k % 4, c, p))),
    ];
    for (what, fine, coarse) in cases {
        for patches in [1, 4] {
            let [fine, coarse] = [&fine, &coarse].map(|formula| table(patches, formula));
            for rank in [1, 2, 3] {
                let factors = fit_scaling(&fine, &coarse, &directions(), rank);
                let what = format!("{what}, {patches} patches, rank {rank}");
                expect_sound(&factors, &what);
                let largest = factors.spatial.iter().chain(&factors.angular).flatten().flatten();
                let largest = largest.fold(0.0_f32, |a, &x| a.max(x.abs()));
                assert!(largest < 1e3, "{what}: a scale of {largest}");
            }
        }
    }
}

#[test]
fn where_neither_surface_reflects_the_scale_is_one() {
    let dark = |k: usize| k.is_multiple_of(4);
    let coarse = table(4, |p, c, k| if dark(k) { 0.0 } else { random(0.1, 1.0, [14, p, c, k]) });
    let fine = table(4, |p, c, k| coarse.channel(p, c)[k]);
    let factors = fit_scaling(&fine, &coarse, &directions(), 1);
    for (k, s) in factors.angular[0].iter().enumerate() {
        assert!(s.iter().all(|s| (s - 1.0).abs() < 1e-5), "pair {k}: {s:?}");
    }
}

#[test]
fn pairs_that_a_further_factor_would_make_negative_are_set_back_and_the_others_keep_it() {
    // Patches that shine at pairs of their own: a best sum of products goes below 0 somewhere.
    let lit = |p: usize, k: usize| random(0.0, 1.0, [15, p, 0, k]) > 0.6;
    let coarse = table(6, |_, _, _| 1.0);
    let fine = table(6, |p, _, k| if lit(p, k) { 1.0 } else { 0.0 });
    for rank in [2, 3] {
        let factors = fit_scaling(&fine, &coarse, &directions(), rank);
        expect_sound(&factors, "set back");
        assert_eq!(factors.spatial.len(), rank);
        let set_back = |s: &&[f32; 3]| s[0] == 0.0;
        let count = factors.angular[1].iter().filter(set_back).count();
        assert!((1..pair_count(N * N)).contains(&count), "rank {rank}: {count} pairs set back");
        // a pair that was set back reflects over all patches what it did before: the fit stays without bias
        expect_normalised(&factors, &fine, &coarse);
    }
}

/// Means over patches of what a reader finds between the stored texels, by the midpoint rule: exact, for it is linear
/// between the half-patch lines that the points respect.
fn read_means(stored: &[[f32; 3]], patches: [usize; 2], boundary: Boundary) -> Vec<[f64; 3]> {
    const POINTS: usize = 8;
    let boundary = farfield::build::encode::boundary(boundary);
    let mut means = vec![[0.0; 3]; patches[0] * patches[1]];
    for (p, mean) in means.iter_mut().enumerate() {
        let corner = [p % patches[0], p / patches[0]];
        for point in 0..POINTS * POINTS {
            let within = [point % POINTS, point / POINTS].map(|k| (k as f32 + 0.5) / POINTS as f32);
            let x = [0, 1].map(|axis| (corner[axis] as f32 + within[axis]) / patches[axis] as f32);
            for (texel, weight) in lookup::bilinear_taps(x, patches, boundary) {
                (0..3).for_each(|c| {
                    mean[c] += f64::from(weight) * f64::from(stored[texel][c]) / (POINTS * POINTS) as f64;
                });
            }
        }
    }
    means
}

#[test]
fn stored_tables_keep_the_means_of_their_patches_when_read() {
    let shapes = [[1, 1], [2, 2], [4, 4], [4, 2], [1, 3], [3, 5], [16, 16]];
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        for patches in shapes {
            let wanted: Vec<[f32; 3]> =
                (0..patches[0] * patches[1]).map(|p| [0, 1, 2].map(|c| random(0.5, 1.5, [16, p, c, 0]))).collect();
            let stored = deconvolve(&wanted, patches, boundary);
            for (p, (read, wanted)) in read_means(&stored, patches, boundary).iter().zip(&wanted).enumerate() {
                for c in 0..3 {
                    let off = (read[c] - f64::from(wanted[c])).abs();
                    assert!(off < 2e-6, "{boundary:?} {patches:?}, patch {p}: off by {off}");
                }
            }
        }
    }
}

#[test]
fn a_constant_table_is_stored_as_it_is() {
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        for patches in [[1, 1], [2, 2], [4, 3]] {
            let wanted = vec![[1.0, 0.25, 3.0]; patches[0] * patches[1]];
            assert_eq!(deconvolve(&wanted, patches, boundary), wanted);
        }
    }
}
