//! What f_low costs and how well it is sampled: `level_brdf ASSET_DIR…`, the first level of each; a random asset without.
//!
//! Times are nanoseconds a call at random places and directions. A sample's weight is f·cosθ/pdf, mean of RGB, over
//! the place's mean weight; its variance is that at one place and viewer, averaged over places. Beside it stands the
//! variance of cosine sampling, and lost samples count as weight 0.

#[path = "../tests/sample/mod.rs"]
mod sample;

use farfield_formats::SurfaceAsset;
use farfield_formats::level_brdf::{BoundBrdf, LevelBrdf, LevelHit};
use farfield_formats::lookup::direction_of;
use sample::{Random, Sample};
use std::error::Error;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

/// Places at which samples are judged, and samples at each.
const PLACES: usize = 200;
const SAMPLES: usize = 4096;

/// Different hits of a timing: the fastest of several passes over all of them counts.
const HITS: usize = 1 << 12;
const PASSES: usize = 100;

fn main() -> Result<(), Box<dyn Error>> {
    let dirs: Vec<String> = std::env::args().skip(1).collect();
    let assets: Vec<SurfaceAsset> = if dirs.is_empty() {
        vec![Sample { directions: 15, ..Sample::ROOMY }.asset()]
    } else {
        dirs.iter().map(|dir| SurfaceAsset::read(Path::new(dir))).collect::<Result<_, _>>()?
    };
    for asset in &assets {
        let level = asset.levels.first().ok_or("the asset has no level")?;
        let begin = Instant::now();
        let brdf = LevelBrdf::new(asset, level);
        let gaussians = asset.bsdf.specular.as_ref().map_or(0, |specular| specular.gaussians.len());
        println!(
            "{}: {} cells, {} lobes, {gaussians} Gaussians, N {}; prepared in {:.1} ms",
            asset.name,
            level.cells[0] * level.cells[1],
            level.lobes.len(),
            level.directions,
            begin.elapsed().as_secs_f64() * 1e3
        );
        costs(asset, &brdf);
        for degrees in [0.0, 45.0, 80.0] {
            quality(asset, &brdf, degrees);
        }
    }
    Ok(())
}

fn hit(asset: &SurfaceAsset, random: &mut Random) -> LevelHit {
    let x = [random.unit(), random.unit()];
    LevelHit { x, n_c: asset.levels[0].normal_at(asset, x), tilt: [0.0; 2] }
}

fn costs(asset: &SurfaceAsset, brdf: &LevelBrdf<'_>) {
    let mut random = Random(1);
    let hits: Vec<_> = (0..HITS).map(|_| (hit(asset, &mut random), random.direction(), random.direction())).collect();
    let one = brdf.at(&hits[0].0, hits[0].1);
    let bound: Vec<BoundBrdf<'_>> = hits[..16].iter().map(|(hit, wo, _)| brdf.at(hit, *wo)).collect();
    let time = |what: &str, call: &mut dyn FnMut(usize) -> f32| {
        let pass = |_| {
            let begin = Instant::now();
            black_box((0..HITS).map(&mut *call).sum::<f32>());
            begin.elapsed().as_secs_f64()
        };
        let fastest = (0..PASSES).map(pass).fold(f64::INFINITY, f64::min);
        println!("  {what:<22}{:7.0} ns", fastest * 1e9 / HITS as f64);
    };
    let wi = |k: usize| hits[k % HITS].2;
    time("bind a hit", &mut |k| black_box(brdf.at(&hits[k % HITS].0, hits[k % HITS].1)).pdf([0.0, 0.0, -1.0]));
    time("eval", &mut |k| one.eval(wi(k))[1]);
    time("pdf", &mut |k| one.pdf(wi(k)));
    time("eval_pdf", &mut |k| one.eval_pdf(wi(k)).1);
    time("eval, 16 hits in turn", &mut |k| bound[k % 16].eval(wi(k))[1]);
    time("sample", &mut |k| bound[k % 16].sample(wi(k).map(|c| c.abs().min(0.999))).map_or(0.0, |s| s.pdf));
    time("bind, sample, eval_pdf", &mut |k| {
        let bound = brdf.at(&hits[k % HITS].0, hits[k % HITS].1);
        bound.sample(wi(k).map(|c| c.abs().min(0.999))).map_or(0.0, |s| s.pdf) + bound.eval_pdf(wi(k + 1)).1
    });
    let level = &asset.levels[0];
    time("SurfaceLevel::f_low", &mut |k| {
        let (hit, wo, wi) = hits[k % HITS];
        level.f_low(asset, hit.x, hit.n_c, wi, wo)[1]
    });
}

/// Variances and weights of both ways of sampling for viewers at a polar angle.
fn quality(asset: &SurfaceAsset, brdf: &LevelBrdf<'_>, degrees: f32) {
    let mut random = Random(2);
    let (mut ours, mut cosine, mut weights, mut lost) = (0.0, 0.0, Vec::new(), 0);
    for _ in 0..PLACES {
        let hit = hit(asset, &mut random);
        let phi = std::f32::consts::TAU * random.unit();
        let (sin, cos) = degrees.to_radians().sin_cos();
        let bound = brdf.at(&hit, [sin * phi.cos(), sin * phi.sin(), cos]);
        let mut there = Vec::with_capacity(SAMPLES);
        let mut plain = Vec::with_capacity(SAMPLES);
        for _ in 0..SAMPLES {
            let u = [random.unit(), random.unit(), random.unit()];
            let sample = bound.sample(u);
            lost += usize::from(sample.is_none());
            there.push(sample.map_or(0.0, |s| mean(s.f) * cos_theta(hit.n_c, s.wi) / f64::from(s.pdf)));
            // The concentric map with 1 − z = 1 − √(1 − u): uniform over the disk is cosine over the hemisphere.
            let wi = lifted(hit.n_c, direction_of([u[0], u[1]]));
            plain.push(mean(bound.eval(wi)) * std::f64::consts::PI);
        }
        let [(average, variance), (_, plain)] = [&there, &plain].map(|list| moments(list));
        if average > 0.0 {
            ours += variance / (average * average) / PLACES as f64;
            cosine += plain / (average * average) / PLACES as f64;
            weights.extend(there.iter().map(|weight| weight / average));
        }
    }
    weights.sort_by(f64::total_cmp);
    println!(
        "  {degrees:>2}°: variance {ours:.3}, of cosine sampling {cosine:.3} ({:.1} times); weights 99.9 % {:.2}, \
         largest {:.2}; lost {:.1} %",
        cosine / ours,
        weights[weights.len() * 999 / 1000],
        weights[weights.len() - 1],
        100.0 * lost as f64 / (PLACES * SAMPLES) as f64
    );
}

/// The direction of equal-area `up` about z, bent to a cosine distribution and turned to be about `n`.
fn lifted(n: [f32; 3], up: [f32; 3]) -> [f32; 3] {
    // 1 − z of `up` is uniform: so is sin²θ of the cosine distribution.
    let sin2 = 1.0 - up[2];
    let scale = if up[2] < 1.0 { (sin2 / (1.0 - up[2] * up[2])).sqrt() } else { 0.0 };
    let local = [up[0] * scale, up[1] * scale, (1.0 - sin2).max(0.0).sqrt()];
    // Reflection about the half vector of z and n, turned by π: a rotation of z to n for n above the horizon.
    let half = [n[0], n[1], n[2] + 1.0];
    let along = 2.0 * (0..3).map(|k| half[k] * local[k]).sum::<f32>() / half.iter().map(|c| c * c).sum::<f32>();
    [0, 1, 2].map(|k| along * half[k] - local[k])
}

fn cos_theta(n: [f32; 3], w: [f32; 3]) -> f64 {
    (0..3).map(|k| f64::from(n[k] * w[k])).sum()
}

fn mean(rgb: [f32; 3]) -> f64 {
    rgb.iter().map(|&c| f64::from(c)).sum::<f64>() / 3.0
}

/// Mean and variance.
fn moments(list: &[f64]) -> (f64, f64) {
    let average = list.iter().sum::<f64>() / list.len() as f64;
    (average, list.iter().map(|x| (x - average).powi(2)).sum::<f64>() / (list.len() - 1) as f64)
}
