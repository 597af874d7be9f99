//! Core-seconds of the published estimator on twill at 8×, from a subset of its bins scaled by count, and its error at
//! its own counts: `cargo bench --bench published`.
//!
//! Stand-ins, neither of which changes what a path costs: the coarse heights are box means and each cell has one vMF lobe
//! from the mean of its normals. The coarse surface's error is that of these stand-ins.

use std::f32::consts::{FRAC_PI_4, PI};

use farfield::geometry::{Boundary, HeightField, HeightTracer, SurfacePoint};
use farfield::material::{Brdf, Conductor};
use farfield::math::rng::Stream;
use farfield::prefilter::surface::VmfLobe;
use farfield::prefilter::surface::published::{Published, PublishedSettings, Surfaces};
use glam::Vec3;

/// Amplitude of `fixtures/heights/twill.png` in texels.
const TWILL_AMPLITUDE: f32 = 24.415_19;
const FACTOR: usize = 8;
/// Direction cells of S per axis.
const N: usize = 15;
/// Bins of S and pairs of T that are measured.
const ANGULAR_BINS: u64 = 48;
const SPATIAL_PAIRS: usize = 24;
/// Directions whose pairs are compared with the reference.
const ERROR_DIRECTIONS: u64 = 12;

fn twill() -> HeightField {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/heights/twill.png");
    let image = image::open(path).expect("a fixture of this repository").into_luma16();
    let size = [image.width() as usize, image.height() as usize];
    let heights = image.into_raw().into_iter().map(|code| f32::from(code) / 65535.0 * TWILL_AMPLITUDE).collect();
    HeightField::new(heights, size, [1.0, 1.0], Boundary::Repeat)
}

/// Means of the vertices around each coarse vertex.
fn box_means(fine: &HeightField) -> HeightField {
    let size = fine.size().map(|n| n / FACTOR);
    let wrapped = |x: usize, k: usize, n: usize| (x * FACTOR + n + k - FACTOR / 2) % n;
    let mean = |i: usize, j: usize| {
        let places = (0..FACTOR * FACTOR)
            .map(|k| fine.vertex(wrapped(i, k % FACTOR, fine.size()[0]), wrapped(j, k / FACTOR, fine.size()[1])));
        places.sum::<f32>() / (FACTOR * FACTOR) as f32
    };
    let heights = (0..size[0] * size[1]).map(|k| mean(k % size[0], k / size[0])).collect();
    HeightField::new(heights, size, fine.spacing().map(|x| x * FACTOR as f32), fine.boundary())
}

/// One lobe a cell: mean normal by area, κ = r(3 − r²)/(1 − r²), weight such that it shows the base area.
fn single_lobes(tracer: &HeightTracer, size: [usize; 2]) -> Vec<VmfLobe> {
    let lobe = |cell: usize| {
        let first = [cell % size[0] * FACTOR, cell / size[0] * FACTOR];
        let (mut sum, mut area) = (Vec3::ZERO, 0.0);
        for k in 0..FACTOR * FACTOR {
            let place = [first[0] + k % FACTOR, first[1] + k / FACTOR];
            let normal = tracer.normal(SurfacePoint { cell: place, st: [0.5, 0.5] });
            sum += normal / normal.z;
            area += 1.0 / normal.z;
        }
        let r = (sum.length() / area).min(0.9999);
        VmfLobe {
            mean: sum.normalize().to_array(),
            kappa: r * (3.0 - r * r) / (1.0 - r * r),
            weight: area / (FACTOR * FACTOR) as f32,
        }
    };
    (0..size[0] * size[1]).map(lobe).collect()
}

/// Centre of cell k of the N × N concentric map: Shirley and Chiu's disk (r, φ), z = 1 − r².
fn node(k: usize) -> Vec3 {
    let [a, b] = [k % N, k / N].map(|x| 2.0 * (x as f32 + 0.5) / N as f32 - 1.0);
    let (r, phi) = match () {
        () if a == 0.0 && b == 0.0 => (0.0, 0.0),
        () if a.abs() > b.abs() => (a, FRAC_PI_4 * b / a),
        () => (b, PI / 2.0 - FRAC_PI_4 * a / b),
    };
    let z = 1.0 - r * r;
    let sin_theta = r.signum() * (1.0 - z * z).sqrt();
    Vec3::new(sin_theta * phi.cos(), sin_theta * phi.sin(), z)
}

/// CPU seconds of this thread where the system tells (other programs may share the core), else the time of day.
fn core_seconds() -> f64 {
    let scheduled = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = scheduled.and_then(|line| line.split(' ').next().and_then(|first| first.parse::<f64>().ok()));
    nanoseconds.map_or_else(
        || std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("after 1970").as_secs_f64(),
        |ns| ns * 1e-9,
    )
}

fn main() {
    let fine = twill();
    let coarse = box_means(&fine);
    let (fine, coarse) = (HeightTracer::new(&fine), HeightTracer::new(&coarse));
    let lobes = vec![single_lobes(&fine, coarse.heights().size())];
    let diffuse = Brdf { diffuse: [0.5; 3], specular: None };
    let glossy = Brdf { diffuse: [0.0; 3], specular: Some(Conductor { alpha: 0.3, f0: [0.9; 3] }) };
    for (name, brdf) in [("diffuse 0.5", diffuse), ("GGX 0.3", glossy)] {
        let settings = PublishedSettings::default();
        let surfaces = Surfaces { fine: &fine, brdf, color: None, coarse: &coarse, lobes: &lobes };
        let published = Published::new(surfaces, settings);
        let bins = Stream::new(1, 0);
        let node_of = |k: u64| node((bins.bits(k) % (N * N) as u64) as usize);

        let start = core_seconds();
        let mut sum =
            (0..ANGULAR_BINS).map(|k| published.angular(k, node_of(2 * k), node_of(2 * k + 1))[0]).sum::<f64>();
        let angular = (core_seconds() - start) / ANGULAR_BINS as f64;
        let start = core_seconds();
        let patches = settings.patches[0] * settings.patches[1];
        sum += (0..patches).map(|patch| published.spatial(patch, SPATIAL_PAIRS)[0]).sum::<f64>();
        let spatial = (core_seconds() - start) / (patches * SPATIAL_PAIRS) as f64;
        assert!(sum.is_finite(), "the work was done");

        let (bins, pairs) = (N.pow(4), patches * settings.pairs);
        let [s, t] = [angular * bins as f64, spatial * pairs as f64];
        let paths = 2 * settings.path_strata.pow(2);
        let rate = paths as f64 * settings.position_strata.pow(2) as f64 / angular;
        println!("published/{name}: S {s:.0} core-seconds ({ANGULAR_BINS} of {bins} bins, scaled by count),");
        println!(
            "    T {t:.0} core-seconds ({} of {pairs} pairs, scaled by count), {:.0} in all; {:.2} million paths a core-second",
            patches * SPATIAL_PAIRS,
            s + t,
            rate * 1e-6
        );

        let directions: Vec<_> = (0..ERROR_DIRECTIONS).map(|k| node_of(1000 + k)).collect();
        let error = published.reflectance_error(&directions);
        println!(
            "    RMS error of F on the nodes over RMS F: fine {:.4} a patch, {:.5} the mean of patches; coarse {:.4}, {:.5}",
            error.fine_patch, error.fine_mean, error.coarse_patch, error.coarse_mean
        );
    }
}
