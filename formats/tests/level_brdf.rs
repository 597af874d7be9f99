//! f_low bound to a hit: the same values as the reader's, and samples that follow their density.

mod sample;

use farfield_formats::asset::SurfaceLevel;
use farfield_formats::level_brdf::{BoundBrdf, LevelBrdf, LevelHit};
use farfield_formats::lookup::direction_of;
use farfield_formats::{Boundary, Lobe, Specular, SurfaceAsset};
use sample::{Random, Sample};
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// Standard deviations that a statistic may be off: one false alarm in 30 000, so that some 300 checks of the project
/// stay below 1 % together.
const Z: f64 = 4.0;

/// GGX as spherical Gaussians, to some 10 %: λ = 5/α² · 3^−l with the amplitudes of its tail.
fn specular(alpha: f32) -> Specular {
    let top = 5.0 / (alpha * alpha);
    let ladder = std::iter::successors(Some(top), |lambda| Some(lambda / 3.0)).take_while(|&lambda| lambda > 0.6);
    let mut gaussians: Vec<[f32; 2]> =
        ladder.map(|lambda| [lambda, 0.5 * (lambda / top).powi(2) * top / 8.0]).collect();
    gaussians.push([0.0, 0.01 * alpha * alpha]);
    Specular { f0: [0.9, 0.5, 0.1], alpha, gaussians }
}

/// Sample assets of every shape, rank and kind of base BRDF.
fn assets() -> Vec<SurfaceAsset> {
    let more = [
        Sample::ROOMY,
        Sample { boundary: Boundary::Clamp, has_color: false, rank: 1, ..Sample::ROOMY },
        Sample { is_specular: false, cells: [1, 5], lobes: 1, patches: [1, 1], directions: 1, ..Sample::SMALL },
        Sample { lobes: 8, rank: 3, directions: 3, ..Sample::SMALL },
        Sample { lobes: 4, directions: 15, rank: 1, ..Sample::SMALL },
    ];
    let mut assets = vec![SurfaceAsset::read(Path::new("tests/data/v1")).unwrap()];
    assets.extend(more.map(Sample::asset));
    assets.extend([0.02, 1.0].map(|alpha| {
        let mut asset = Sample { seed: 11, ..Sample::ROOMY }.asset();
        asset.bsdf.specular = Some(specular(alpha));
        asset
    }));
    assets
}

/// An asset whose lobes and base BRDF are wide enough for quadrature: κ at most 150, α as given.
fn smooth(sample: Sample, alpha: Option<f32>) -> SurfaceAsset {
    let mut asset = sample.asset();
    asset.bsdf.specular = alpha.map(specular);
    for lobe in asset.levels[0].lobes.iter_mut().flatten() {
        lobe.kappa = lobe.kappa.min(150.0);
    }
    asset
}

fn random_hit(asset: &SurfaceAsset, random: &mut Random) -> LevelHit {
    let x = [random.unit(), random.unit()];
    LevelHit { x, n_c: asset.levels[0].normal_at(asset, x), tilt: [0.0; 2] }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    v.map(|c| c / dot(v, v).sqrt())
}

/// The normal of the sum of both displacements.
fn tilted(n: [f32; 3], tilt: [f32; 2]) -> [f32; 3] {
    unit([n[0] - tilt[0] * n[2], n[1] - tilt[1] * n[2], n[2]])
}

#[test]
fn a_bound_hit_reflects_what_the_reader_says() {
    for asset in assets() {
        let (level, mut random) = (&asset.levels[0], Random(3));
        let brdf = LevelBrdf::new(&asset, level);
        for _ in 0..500 {
            let hit = random_hit(&asset, &mut random);
            let wo = random.direction();
            let bound = brdf.at(&hit, wo);
            let check = |wi, got: [f32; 3]| {
                let wanted = level.f_low(&asset, hit.x, hit.n_c, wi, wo);
                // sums of up to 8 lobes and 64 products in another order
                let is_near = |k: usize| (got[k] - wanted[k]).abs() <= 1e-5 * wanted[k].abs();
                assert!((0..3).all(is_near), "{got:?}, wanted {wanted:?} for {wi:?} {wo:?}");
            };
            for _ in 0..4 {
                let wi = random.direction();
                let (f, pdf) = bound.eval_pdf(wi);
                assert_eq!((f, pdf), (bound.eval(wi), bound.pdf(wi)));
                check(wi, f);
                let cell = brdf.cell_brdf(level.cell_at(hit.x));
                assert_eq!(
                    cell.eval(hit.n_c, wi, wo),
                    level.cell_brdf(level.cell_at(hit.x), &asset.bsdf).eval(hit.n_c, wi, wo)
                );
            }
            if let Some(sample) = bound.sample([random.unit(), random.unit(), random.unit()]) {
                check(sample.wi, sample.f);
                assert_eq!(sample.pdf, bound.pdf(sample.wi));
            }
        }
    }
}

#[test]
fn light_and_viewer_may_change_places() {
    for mut asset in assets() {
        // S of the sample assets is random; what a compiler stores is symmetric.
        for table in &mut asset.levels[0].angular {
            let n = table.len().isqrt();
            for (o, i) in (0..n * n).map(|k| (k / n, k % n)).filter(|(o, i)| i < o) {
                table[o * n + i] = table[i * n + o];
            }
        }
        let brdf = LevelBrdf::new(&asset, &asset.levels[0]);
        let mut random = Random(4);
        for _ in 0..1000 {
            let mut hit = random_hit(&asset, &mut random);
            if random.unit() < 0.5 {
                hit.tilt = [random.within(-0.5, 0.5), random.within(-0.5, 0.5)];
            }
            let [wi, wo] = [random.direction(), random.direction()];
            let [there, back] = [brdf.at(&hit, wo).eval(wi), brdf.at(&hit, wi).eval(wo)];
            let is_near = |k: usize| (there[k] - back[k]).abs() <= 1e-5 * there[k].abs();
            assert!((0..3).all(is_near), "{there:?} and {back:?} for {wi:?} {wo:?}");
        }
    }
}

/// A bound hit under every condition that sampling should stand: base BRDF, viewer, tilt.
fn for_each_case(mut check: impl FnMut(&str, &BoundBrdf<'_>, [f32; 3])) {
    for (name, alpha) in [("diffuse", None), ("GGX 0.05", Some(0.05)), ("GGX 0.3", Some(0.3)), ("GGX 1", Some(1.0))] {
        let asset = smooth(Sample { directions: 15, seed: 5, ..Sample::ROOMY }, alpha);
        let brdf = LevelBrdf::new(&asset, &asset.levels[0]);
        let mut random = Random(6);
        for (degrees, tilt) in [(0.0f32, [0.0; 2]), (45.0, [0.0; 2]), (80.0, [0.0; 2]), (40.0, [0.5, -0.3])] {
            let mut hit = LevelHit { tilt, ..random_hit(&asset, &mut random) };
            hit.n_c = tilted(hit.n_c, tilt);
            let phi = random.unit() * 6.0;
            let (sin, cos) = degrees.to_radians().sin_cos();
            let bound = brdf.at(&hit, [sin * phi.cos(), sin * phi.sin(), cos]);
            check(&format!("{name}, viewer at {degrees}°, tilt {tilt:?}"), &bound, hit.n_c);
        }
    }
}

/// Cells of the direction square along one axis, and points of each: the sphere is two squares.
const CELLS: usize = 20;
const POINTS: usize = 28;

/// ∫ value dω over every cell of both hemispheres, midpoint rule.
fn cell_integrals<const K: usize>(value: impl Fn([f32; 3]) -> [f64; K]) -> Vec<[f64; K]> {
    let at = |cell: usize, point: usize| (cell as f32 + (point as f32 + 0.5) / POINTS as f32) / CELLS as f32;
    let solid_angle = TAU / ((CELLS * POINTS) as f64).powi(2);
    let cell = |index: usize| {
        let (up, i, j) = (index < CELLS * CELLS, index % CELLS, index / CELLS % CELLS);
        let mut sum = [0.0; K];
        for point in 0..POINTS * POINTS {
            let [x, y, z] = direction_of([at(i, point % POINTS), at(j, point / POINTS)]);
            let at_point = value([x, y, if up { z } else { -z }]);
            (0..K).for_each(|k| sum[k] += at_point[k] * solid_angle);
        }
        sum
    };
    (0..2 * CELLS * CELLS).map(cell).collect()
}

/// The cell that a direction lies in.
fn cell_of(w: [f32; 3]) -> usize {
    let square = farfield_formats::lookup::square_of([w[0], w[1], w[2].abs()]);
    let [i, j] = square.map(|s| ((s * CELLS as f32) as usize).min(CELLS - 1));
    j * CELLS + i + if w[2] > 0.0 { 0 } else { CELLS * CELLS }
}

/// How far a χ² of so many degrees of freedom lies above its mean, in standard deviations (Wilson and Hilferty).
fn deviation(chi2: f64, freedom: usize) -> f64 {
    let spread = 2.0 / (9.0 * freedom as f64);
    ((chi2 / freedom as f64).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// χ² and its degrees of freedom; bins under five expected are pooled.
fn chi_square(hits: &[f64], expected: &[f64]) -> (f64, usize) {
    let (mut chi2, mut bins, mut rest) = (0.0, 0usize, [0.0; 2]);
    for (&hits, &expected) in hits.iter().zip(expected) {
        if expected < 5.0 {
            rest = [rest[0] + hits, rest[1] + expected];
        } else {
            chi2 += (hits - expected).powi(2) / expected;
            bins += 1;
        }
    }
    if rest[1] >= 5.0 {
        chi2 += (rest[0] - rest[1]).powi(2) / rest[1];
        bins += 1;
    }
    (chi2, bins - 1)
}

#[test]
fn samples_follow_their_density_and_estimate_the_reflected_light() {
    const SAMPLES: usize = 200_000;
    for_each_case(|name, bound, n_c| {
        let cos_theta = |w| f64::from(dot(n_c, w)).max(0.0);
        let exact = cell_integrals(|w| {
            let (f, pdf) = bound.eval_pdf(w);
            [f64::from(pdf), f64::from(f[1]) * cos_theta(w)]
        });
        let mut hits = vec![0.0; exact.len() + 1];
        let (mut random, mut sum, mut squares, mut largest) = (Random(7), 0.0, 0.0, 0.0f64);
        for _ in 0..SAMPLES {
            let Some(sample) = bound.sample([random.unit(), random.unit(), random.unit()]) else {
                hits[exact.len()] += 1.0;
                continue;
            };
            hits[cell_of(sample.wi)] += 1.0;
            let weight = f64::from(sample.f[1]) * cos_theta(sample.wi) / f64::from(sample.pdf);
            (sum, squares, largest) = (sum + weight, squares + weight * weight, largest.max(weight));
        }
        let n = SAMPLES as f64;
        let inside: f64 = exact.iter().map(|cell| cell[0]).sum();
        let expected: Vec<f64> = exact.iter().map(|cell| cell[0] * n).chain([(1.0 - inside).max(0.0) * n]).collect();
        let lost = hits[exact.len()] / n;
        // 560² points a hemisphere leave 5e-4 at the jump of the density at the horizon of n_c.
        let noise = Z * (lost * (1.0 - lost) / n).sqrt() + 5e-4;
        assert!((inside + lost - 1.0).abs() < noise, "{name}: pdf integrates to {inside}, lost {lost}");
        let (chi2, freedom) = chi_square(&hits, &expected);
        let z = deviation(chi2, freedom);
        assert!(z < Z, "{name}: chi² {chi2} of {freedom}, {z} standard deviations");
        let (mean, wanted) = (sum / n, exact.iter().map(|cell| cell[1]).sum::<f64>());
        let error = ((squares / n - mean * mean) / n).sqrt();
        println!(
            "{name}: lost {lost:.3}, chi² {z:.2}, mean {mean:.5} ± {error:.5}, exact {wanted:.5}, largest {largest:.2}"
        );
        assert!((mean - wanted).abs() < Z * error + 1e-3 * wanted, "{name}: {mean} ± {error}, exact {wanted}");
        assert!(largest < 30.0 * mean, "{name}: a weight of {largest}, mean {mean}");
    });
}

#[test]
fn the_additive_term_is_what_the_reader_says_and_is_sampled_by_its_density() {
    const SAMPLES: usize = 200_000;
    let asset = Sample { additive: Some(7), ..Sample::ROOMY }.asset();
    let (level, mut random) = (&asset.levels[0], Random(15));
    let brdf = LevelBrdf::new(&asset, level);
    for _ in 0..500 {
        let hit = random_hit(&asset, &mut random);
        let [wi, wo] = [random.direction(), random.direction()];
        let (got, wanted) =
            (brdf.additive_at(&hit, wo).unwrap().eval(wi), level.additive_at(hit.x, asset.boundary, wi, wo));
        assert!((0..3).all(|k| (got[k] - wanted[k]).abs() <= 1e-5 * wanted[k]), "{got:?}, wanted {wanted:?}");
        assert_eq!(brdf.additive_at(&hit, [wo[0], wo[1], -wo[2]]).map(|term| term.eval(wi)), None);
        assert_eq!(brdf.additive_at(&hit, wo).unwrap().eval([wi[0], wi[1], -wi[2]]), [0.0; 3]);
    }
    for tilt in [[0.0; 2], [0.5, -0.3]] {
        let bound = brdf.additive_at(&LevelHit { tilt, ..random_hit(&asset, &mut random) }, [0.0, 0.6, 0.8]).unwrap();
        let cos_theta = |w| f64::from(dot(bound.normal(), w)).max(0.0);
        let exact = cell_integrals(|w| [f64::from(bound.pdf(w)), f64::from(bound.eval(w)[1]) * cos_theta(w)]);
        let expected: Vec<f64> = exact.iter().map(|cell| cell[0] * SAMPLES as f64).collect();
        let (mut hits, mut sum, mut squares) = (vec![0.0; exact.len()], 0.0, 0.0);
        for _ in 0..SAMPLES {
            let Some(sample) = bound.sample([random.unit(), random.unit()]) else { continue };
            assert_eq!((sample.pdf, sample.f), (bound.pdf(sample.wi), bound.eval(sample.wi)));
            hits[cell_of(sample.wi)] += 1.0;
            let weight = f64::from(sample.f[1]) * cos_theta(sample.wi) / f64::from(sample.pdf);
            (sum, squares) = (sum + weight, squares + weight * weight);
        }
        let (chi2, freedom) = chi_square(&hits, &expected);
        let z = deviation(chi2, freedom);
        let (mean, wanted) = (sum / SAMPLES as f64, exact.iter().map(|cell| cell[1]).sum::<f64>());
        let error = ((squares / SAMPLES as f64 - mean * mean) / SAMPLES as f64).sqrt();
        println!("tilt {tilt:?}: chi² {z:.2}, mean {mean:.5} ± {error:.5}, exact {wanted:.5}");
        assert!(z < Z, "tilt {tilt:?}: chi² {chi2} of {freedom}, {z} standard deviations");
        assert!((mean - wanted).abs() < Z * error + 1e-3 * wanted, "tilt {tilt:?}: {mean} ± {error}, exact {wanted}");
    }
}

#[test]
fn hard_cases_give_finite_numbers() {
    let grazing = |phi: f32| {
        let (sin, cos) = 89.9f32.to_radians().sin_cos();
        [sin * phi.cos(), sin * phi.sin(), cos]
    };
    let mut random = Random(8);
    for alpha in [None, Some(0.001), Some(0.02), Some(1.0)] {
        for kappa in [0.0, 1e-3, 5.0, 1e6] {
            let mut asset = Sample { lobes: 3, rank: 1, ..Sample::SMALL }.asset();
            asset.bsdf.specular = alpha.map(specular);
            let steep = unit([0.999, 0.0, 0.045]);
            for lobe in asset.levels[0].lobes.iter_mut().flatten() {
                let mean = if random.unit() < 0.5 { steep } else { lobe.mean };
                *lobe = Lobe { mean, kappa, ..*lobe };
            }
            let brdf = LevelBrdf::new(&asset, &asset.levels[0]);
            let views = [grazing(0.0), grazing(PI as f32), grazing(2.0), [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]];
            for (wo, tilt) in views.iter().flat_map(|&wo| [(wo, [0.0; 2]), (wo, [3.0, -2.0])]) {
                let hit = random_hit(&asset, &mut random);
                let bound = brdf.at(&LevelHit { tilt, n_c: tilted(hit.n_c, tilt), ..hit }, wo);
                let more = (0..200).map(|_| random.direction()).collect::<Vec<_>>();
                for &wi in views.iter().chain(&more).chain([&wo.map(|c| -c)]) {
                    let (f, pdf) = bound.eval_pdf(wi);
                    assert!(f.iter().all(|f| f.is_finite() && *f >= 0.0), "α {alpha:?}, κ {kappa}: {f:?}");
                    assert!(pdf.is_finite() && pdf >= 0.0, "α {alpha:?}, κ {kappa}: pdf {pdf}");
                }
                let corners = [[0.0; 3], [0.999_999_94; 3], [0.0, 0.5, 0.999_999_94]];
                let u = (0..200).map(|_| [random.unit(), random.unit(), random.unit()]).chain(corners);
                for sample in u.filter_map(|u| bound.sample(u)) {
                    assert!(
                        (dot(sample.wi, sample.wi) - 1.0).abs() < 1e-5 && sample.pdf > 0.0 && sample.pdf.is_finite()
                    );
                    assert!(sample.f.iter().all(|f| f.is_finite()));
                }
            }
        }
    }
}

#[test]
fn nothing_is_seen_from_below() {
    let asset = Sample::ROOMY.asset();
    let brdf = LevelBrdf::new(&asset, &asset.levels[0]);
    let mut random = Random(9);
    for _ in 0..200 {
        let hit = random_hit(&asset, &mut random);
        let [up, [x, y, z]] = [random.direction(), random.direction()];
        let below = brdf.at(&hit, [x, y, -z]);
        assert_eq!(below.eval_pdf(up), ([0.0; 3], 0.0));
        assert_eq!(below.sample([random.unit(), random.unit(), random.unit()]), None);
        assert_eq!(brdf.at(&hit, up).eval_pdf([x, y, -z]), ([0.0; 3], 0.0));
    }
}

/// A level that is flat, or of one lobe, and whose scaling is 1.
fn plain(lobe: Lobe) -> SurfaceAsset {
    let sample = Sample { is_specular: false, has_color: false, cells: [1, 1], patches: [1, 1], ..Sample::SMALL };
    let mut asset = Sample { lobes: 1, rank: 1, ..sample }.asset();
    let level: &mut SurfaceLevel = &mut asset.levels[0];
    level.lobes[0][0] = lobe;
    level.spatial[0][0] = [1.0; 3];
    level.angular[0].fill([1.0; 3]);
    asset
}

#[test]
fn a_tilted_flat_lambertian_level_keeps_its_albedo() {
    let asset = plain(Lobe { mean: [0.0, 0.0, 1.0], kappa: 1e6, weight: 1.0 });
    let brdf = LevelBrdf::new(&asset, &asset.levels[0]);
    let mut random = Random(10);
    for _ in 0..2000 {
        let tilt = [random.within(-2.0, 2.0), random.within(-2.0, 2.0)];
        let n_c = tilted([0.0, 0.0, 1.0], tilt);
        let [wi, wo] = [random.direction(), random.direction()];
        let f = brdf.at(&LevelHit { x: [0.5; 2], n_c, tilt }, wo).eval(wi);
        // within 5 standard deviations of the lobe of its horizon a direction sees its width
        if dot(n_c, wi).min(dot(n_c, wo)) > 0.02 {
            for (f, albedo) in f.into_iter().zip(asset.bsdf.diffuse) {
                assert!((f64::from(f) * PI / f64::from(albedo) - 1.0).abs() < 5e-3, "{f} for tilt {tilt:?}");
            }
        } else if dot(n_c, wi).min(dot(n_c, wo)) < -0.02 {
            assert_eq!(f, [0.0; 3]);
        }
    }
}

#[test]
fn a_small_tilt_changes_little() {
    let asset = smooth(Sample { directions: 15, ..Sample::ROOMY }, Some(0.3));
    let brdf = LevelBrdf::new(&asset, &asset.levels[0]);
    let mut random = Random(12);
    for _ in 0..500 {
        let hit = random_hit(&asset, &mut random);
        let [wi, wo] = [random.direction(), random.direction()];
        let [flat, leaning] = [[0.0; 2], [1e-5, -1e-5]].map(|tilt| brdf.at(&LevelHit { tilt, ..hit }, wo).eval(wi));
        if wi[2].min(wo[2]) > 1e-3 {
            // κ of 150 and tables of 15² move some 100 times the tilt
            assert!((0..3).all(|k| (flat[k] - leaning[k]).abs() <= 2e-3 * flat[k]), "{flat:?} {leaning:?}");
        }
    }
}

#[test]
fn a_level_may_be_shared_between_threads() {
    let asset = Sample::ROOMY.asset();
    let brdf = LevelBrdf::new(&asset, &asset.levels[0]);
    let hit = random_hit(&asset, &mut Random(13));
    let value = || brdf.at(&hit, [0.0, 0.6, 0.8]).eval([0.6, 0.0, 0.8]);
    let there = std::thread::scope(|scope| scope.spawn(value).join().unwrap());
    assert_eq!(there, value());
}
