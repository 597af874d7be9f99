//! Core-seconds of the published estimator on twill at 8×, from a subset of its bins scaled by count, beside a whole
//! level of ours, and the error of F on the nodes of both: `cargo bench --bench published`.
//!
//! Equal error is judged on F alone: the root mean square error of the patches' F at the nodes of the table, against an
//! exact reference of 16 times the published number of points. Each method is judged by its own model of the coarse
//! surface: f'_low as printed for the published one, f_c for ours.

use cpu_time::{ProcessTime, ThreadTime};
use farfield::geometry::{Boundary, HeightField, HeightTracer};
use farfield::material::{Brdf, Conductor, ggx_gaussians};
use farfield::math::rng::Stream;
use farfield::prefilter::surface::coarse::{CoarseSurface, coarse_reflectance};
use farfield::prefilter::surface::downsample::downsample;
use farfield::prefilter::surface::fine::fine_reflectance;
use farfield::prefilter::surface::lobes::fit_lobes;
use farfield::prefilter::surface::published::{Published, PublishedSettings, Surfaces};
use farfield::prefilter::surface::reflectance::{PatchReflectance, TableDirections, pair};
use farfield::prefilter::surface::{FineSurface, LevelSettings, LightTransport, VmfLobe, compile};
use farfield::transport::PatchSampling;
use farfield::transport::effective::{base_scatter, for_each_point};
use formats::cell_brdf::{BaseBrdf, CellBrdf, Lobe, Specular};
use glam::Vec3;
use rayon::prelude::*;

/// Amplitude of `fixtures/heights/twill.png` in texels.
const TWILL_AMPLITUDE: f32 = 24.415_19;
/// Downsampling factor.
const FACTOR: f32 = 8.0;
/// Direction cells of S per axis.
const N: usize = 15;
/// Bins of S and pairs of T that are measured.
const ANGULAR_BINS: u64 = 48;
const SPATIAL_PAIRS: usize = 24;
/// Directions whose pairs are compared with the reference.
const ERROR_DIRECTIONS: u64 = 12;
/// Strata per axis of the reference: 16 times 50².
const REFERENCE_STRATA: usize = 200;

fn twill() -> HeightField {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/heights/twill.png");
    let image = image::open(path).expect("a fixture of this repository").into_luma16();
    let size = [image.width() as usize, image.height() as usize];
    let heights = image.into_raw().into_iter().map(|code| f32::from(code) / 65535.0 * TWILL_AMPLITUDE).collect();
    HeightField::new(heights, size, [1.0, 1.0], Boundary::Repeat)
}

/// F of both surfaces, exact but for sampling: `[patch][pair]`, one channel (the bases are grey).
struct Reference {
    fine: Vec<Vec<f64>>,
    coarse: Vec<Vec<f64>>,
}

/// All pairs of `nodes`, as positions in it.
fn pairs(nodes: &[usize]) -> Vec<[usize; 2]> {
    (0..nodes.len()).flat_map(|i| (0..=i).map(move |o| [i, o])).collect()
}

fn reference(
    tracers: [&HeightTracer<'_>; 2],
    brdf: &Brdf,
    lobes: &[Vec<VmfLobe>],
    table: &TableDirections,
    nodes: &[usize],
) -> Reference {
    let directions: Vec<Vec3> = nodes.iter().map(|&k| Vec3::from(table.vectors[k])).collect();
    let pairs = pairs(nodes);
    let specular = brdf.specular.map(|c| Specular { f0: c.f0, alpha: c.alpha, gaussians: ggx_gaussians(c.alpha) });
    let base = BaseBrdf { diffuse: brdf.diffuse, specular };
    let width = tracers[1].heights().size()[0];
    let sums = |patch: usize, coarse: bool| {
        let sampling = PatchSampling::of_grid([4, 4], patch, REFERENCE_STRATA, 77);
        let mut cells = std::collections::HashMap::new();
        let mut sums = vec![0.0; pairs.len()];
        for_each_point(tracers[usize::from(coarse)], &sampling, &directions, |point| {
            let cell = point.point.cell[1] * width + point.point.cell[0];
            let scatter: Option<&Vec<f32>> = coarse.then(|| {
                &*cells.entry(cell).or_insert_with(|| {
                    let lobe = |l: VmfLobe| Lobe { mean: l.mean, kappa: l.kappa, weight: l.weight };
                    let brdf = CellBrdf::new(lobes.iter().map(|lobes| lobe(lobes[cell])), &base, [1.0; 3]);
                    let value = |&[i, o]: &[usize; 2]| brdf.normalised(directions[i].into(), directions[o].into())[0];
                    pairs.iter().map(value).collect()
                })
            });
            for (k, (sum, &[i, o])) in sums.iter_mut().zip(&pairs).enumerate() {
                if point.sees(i) && point.sees(o) {
                    let [wi, wo] = [directions[i], directions[o]];
                    *sum += f64::from(match scatter {
                        Some(values) => values[k] * point.shown_area(wi) * point.shown_area(wo),
                        None => base_scatter(brdf, point.normal, wi, wo)[0],
                    });
                }
            }
        });
        sums.into_iter().map(|sum| sum / (REFERENCE_STRATA * REFERENCE_STRATA) as f64).collect()
    };
    let all = |coarse| (0..16).into_par_iter().map(|patch| sums(patch, coarse)).collect();
    Reference { fine: all(false), coarse: all(true) }
}

/// √(Σ(F̂ − F)²/ΣF²) of single patches and of their mean.
fn error_of(ours: &PatchReflectance, exact: &[Vec<f64>], nodes: &[usize]) -> [f64; 2] {
    let pairs = pairs(nodes);
    let at = |[i, o]: [usize; 2]| pair(nodes[i].max(nodes[o]), nodes[i].min(nodes[o]));
    let [mut single, mut mean] = [[0.0; 2]; 2];
    for (k, &nodes) in pairs.iter().enumerate() {
        let values: Vec<[f64; 2]> =
            (0..16).map(|patch| [f64::from(ours.channel(patch, 0)[at(nodes)]), exact[patch][k]]).collect();
        for [got, wanted] in &values {
            single[0] += (got - wanted).powi(2);
            single[1] += wanted.powi(2);
        }
        let [got, wanted] = [0, 1].map(|side| values.iter().map(|v| v[side]).sum::<f64>() / 16.0);
        mean[0] += (got - wanted).powi(2);
        mean[1] += wanted.powi(2);
    }
    [single, mean].map(|[error, total]| (error / total).sqrt())
}

fn main() {
    let heights = twill();
    let coarse = downsample(&heights, FACTOR);
    let lobes = fit_lobes(&heights, coarse.size(), None);
    let tracers = [&HeightTracer::new(&heights), &HeightTracer::new(&coarse)];
    let table = TableDirections::new(N);
    let diffuse = Brdf { diffuse: [0.5; 3], specular: None };
    let glossy = Brdf { diffuse: [0.0; 3], specular: Some(Conductor::ggx(0.3, [0.9; 3])) };
    for (name, brdf) in [("diffuse 0.5", diffuse), ("GGX 0.3", glossy)] {
        let bins = Stream::new(1, 0);
        let node = |k: u64| (bins.bits(k) % (N * N) as u64) as usize;
        let nodes: Vec<usize> = (0..ERROR_DIRECTIONS).map(|k| node(1000 + k)).collect();

        let settings = PublishedSettings::default();
        let surfaces = Surfaces { fine: tracers[0], brdf, color: None, coarse: tracers[1], lobes: &lobes };
        let published = Published::new(surfaces, settings);
        let total = published_seconds(name, &published, &settings, |k| Vec3::from(table.vectors[node(k)]));
        let directions: Vec<Vec3> = nodes.iter().map(|&k| Vec3::from(table.vectors[k])).collect();
        let error = published.reflectance_error(&directions);
        println!(
            "    error of F on the nodes: fine {:.4} a patch, {:.4} the mean; coarse {:.4}, {:.4}",
            error.fine_patch, error.fine_mean, error.coarse_patch, error.coarse_mean
        );

        let surface = FineSurface { heights: heights.clone(), brdf, color: None };
        let level = LevelSettings {
            factor: FACTOR,
            patches: 4,
            directions: N,
            rank: 1,
            lobes: None,
            light: LightTransport::Direct,
            error: 0.02,
            seed: 1,
        };
        let start = ProcessTime::now();
        let compiled = compile(&surface, &level, &mut |_| ());
        let seconds = start.elapsed().as_secs_f64();
        println!(
            "ours/{name}: {seconds:.2} core-seconds for the whole level, on-node error {:.4}; ratio {:.0}",
            compiled.on_node,
            total / seconds
        );
        let exact = reference(tracers, &brdf, &lobes, &table, &nodes);
        let gaussians = brdf.specular.map_or_else(Vec::new, |c| ggx_gaussians(c.alpha));
        let side =
            CoarseSurface { heights: &coarse, lobes: &lobes, base_color: None, brdf: &brdf, gaussians: &gaussians };
        let [fine_patch, fine_mean] =
            error_of(&fine_reflectance(&surface, [4, 4], &table, &mut |_| ()), &exact.fine, &nodes);
        let [coarse_patch, coarse_mean] = error_of(&coarse_reflectance(&side, [4, 4], &table), &exact.coarse, &nodes);
        println!(
            "    error of F on the nodes: fine {fine_patch:.4} a patch, {fine_mean:.4} the mean; coarse {coarse_patch:.4}, {coarse_mean:.4}"
        );
    }
}

/// Core-seconds of all bins of S and T, from a subset.
fn published_seconds(
    name: &str,
    published: &Published<'_>,
    settings: &PublishedSettings,
    node: impl Fn(u64) -> Vec3,
) -> f64 {
    let start = ThreadTime::now();
    let mut sum = (0..ANGULAR_BINS).map(|k| published.angular(k, node(2 * k), node(2 * k + 1))[0]).sum::<f64>();
    let angular = start.elapsed().as_secs_f64() / ANGULAR_BINS as f64;
    let start = ThreadTime::now();
    let patches = settings.patches[0] * settings.patches[1];
    sum += (0..patches).map(|patch| published.spatial(patch, SPATIAL_PAIRS)[0]).sum::<f64>();
    let spatial = start.elapsed().as_secs_f64() / (patches * SPATIAL_PAIRS) as f64;
    assert!(sum.is_finite(), "the work was done");
    let (bins, pairs) = (N.pow(4), patches * settings.pairs);
    let [s, t] = [angular * bins as f64, spatial * pairs as f64];
    println!("published/{name}: S {s:.0} core-seconds ({ANGULAR_BINS} of {bins} bins, scaled by count),");
    println!(
        "    T {t:.0} core-seconds ({} of {pairs} pairs, scaled by count), {:.0} in all",
        patches * SPATIAL_PAIRS,
        s + t
    );
    s + t
}
