//! Rays a core-second by kind, in one thread: `cargo bench --bench tracer`.
//!
//! First bounce rays on twill and rocks, beside a compressed wide BVH over the same bilinear cells: camera rays from random
//! directions above hit the map at random places, and go on cosine-distributed about the normal there; the closest hit of
//! that is timed, the rays are made before. Then rays of other kinds on twill, in random directions throughout. "Points
//! in order" start in rows of blocks of 8 × 8 texels, as stratified points do; the others start anywhere, and wait for
//! memory a third of the time.

#[path = "../tests/tracing_cwbvh/reference.rs"]
mod reference;

use cpu_time::ThreadTime;
use farfield::geometry::{Boundary, HeightField, HeightTracer, Ray, SurfacePoint};
use farfield::math::rng::Stream;
use glam::{DVec3, Vec3};
use obvhs::BvhBuildParams;
use reference::{Bounce, CellBvh, bounces, fixture};

/// Amplitude of `fixtures/heights/twill.png` in texels.
const TWILL_AMPLITUDE: f32 = 24.415_19;
/// Amplitude of `fixtures/rocks/height.png` in texels.
const ROCKS_AMPLITUDE: f32 = 35.9;
const RAYS: u64 = 1 << 20;
/// Batches of bounce rays, and rays in each: one after the other by every tracer, so that all meet the same noise.
const BATCHES: usize = 16;
const BATCH_RAYS: usize = 1 << 16;

/// Uniform in solid angle between two cosines.
fn direction(rng: Stream, k: u64, cosines: [f32; 2]) -> Vec3 {
    let [a, b] = rng.uniform_pair(k);
    let z = cosines[0] + (cosines[1] - cosines[0]) * a;
    let (sin, cos) = (b * std::f32::consts::TAU).sin_cos();
    let r = (1.0 - z * z).sqrt();
    Vec3::new(r * cos, r * sin, z)
}

fn point(rng: Stream, k: u64, field: &HeightField) -> SurfacePoint {
    let [u, v] = rng.uniform_pair(k);
    let place = [u * field.size()[0] as f32, v * field.size()[1] as f32];
    SurfacePoint { cell: place.map(|x| x as usize), st: place.map(f32::fract) }
}

/// Prints rays a second of `trace`, called for each of `rays`; `true` counts.
fn report(name: &str, rays: u64, trace: impl Fn(u64) -> bool) {
    let start = ThreadTime::now();
    let found = (0..rays).filter(|&k| trace(k)).count();
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "tracer/{name}: {:.3} million rays a core-second, {:.1} % found",
        rays as f64 / seconds / 1e6,
        100.0 * found as f64 / rays as f64
    );
}

/// Marches along the ray a tenth of a texel at a time: what a shader does, neither exact nor bounded in error.
fn marched(high: f32, tracer: &HeightTracer, point: SurfacePoint, direction: Vec3) -> bool {
    let field = tracer.heights();
    let [nu, nv] = field.size().map(|n| n as i64);
    let start = tracer.position(point).as_vec3();
    let step = 0.1 / direction.x.abs().max(direction.y.abs()).max(1e-3);
    let mut t = step;
    while start.z + t * direction.z < high && t < 2000.0 {
        let at = start + direction * t;
        let [u, v] = [at.x, -at.y];
        let cell = [u.floor() as i64, v.floor() as i64];
        let [s, f] = [u - u.floor(), v - v.floor()];
        let h = field.corners(cell[0].rem_euclid(nu) as usize, cell[1].rem_euclid(nv) as usize);
        if at.z < (h[0] * (1.0 - s) + h[1] * s) * (1.0 - f) + (h[2] * (1.0 - s) + h[3] * s) * f {
            return true;
        }
        t += step;
    }
    false
}

type Count<'a> = Box<dyn Fn(&[Bounce]) -> usize + 'a>;

/// One way to trace bounce rays: its name, the bytes it holds and how many of some rays hit.
struct Way<'a> {
    name: &'a str,
    bytes: usize,
    count: Count<'a>,
}

impl<'a> Way<'a> {
    fn new(name: &'a str, bytes: usize, hits: impl Fn(&Bounce) -> bool + 'a) -> Self {
        Self { name, bytes, count: Box::new(move |rays| rays.iter().filter(|ray| hits(ray)).count()) }
    }

    /// By a tracer; its bytes and those of the heights.
    fn tracing(name: &'a str, tracer: &'a HeightTracer<'a>) -> Self {
        let bytes = tracer.bytes() + size_of_val(tracer.heights().heights());
        Self::new(name, bytes, |ray| tracer.intersect_from(ray.point, ray.direction).is_some())
    }
}

/// Prints bounce rays a second on one map by the tracer and by the reference, batch by batch in turn.
fn bounce_rays(map: &str, path: &str, amplitude: f32) {
    let [tiled, single] = [Boundary::Repeat, Boundary::Clamp].map(|boundary| fixture(path, amplitude, boundary));
    let [tiled_tracer, single_tracer] = [&tiled, &single].map(HeightTracer::new);
    let bvh = CellBvh::new(&single, BvhBuildParams::slow_build());
    let rays = bounces(&tiled_tracer, BATCHES * BATCH_RAYS, Stream::new(7, 0));
    let ways = [
        Way::tracing("tiled", &tiled_tracer),
        Way::tracing("one tile", &single_tracer),
        Way::new("one tile, CWBVH", bvh.bytes(), |ray| bvh.first_hit(&single, ray).is_some()),
    ];
    let mut seconds = [const { Vec::new() }; 3];
    let mut found = [0; 3];
    for number in 0..BATCHES {
        let batch = |number: usize| &rays[number * BATCH_RAYS..(number + 1) * BATCH_RAYS];
        for (k, way) in ways.iter().enumerate() {
            // Other rays first: the way before has left the caches full of its own nodes.
            std::hint::black_box((way.count)(batch((number + 1) % BATCHES)));
            let start = ThreadTime::now();
            found[k] += (way.count)(batch(number));
            seconds[k].push(start.elapsed().as_secs_f64());
        }
    }
    let speed = |seconds: f64| BATCH_RAYS as f64 / seconds / 1e6;
    for (k, way) in ways.iter().enumerate() {
        println!(
            "tracer/bounce, {map}, {}: {:.3} million rays a core-second (best batch {:.3}), {:.2} times the CWBVH, \
             {:.1} % found, {:.1} bytes a texel",
            way.name,
            speed(median(&seconds[k])),
            speed(seconds[k].iter().copied().fold(f64::INFINITY, f64::min)),
            median(&seconds[2].iter().zip(&seconds[k]).map(|(reference, own)| reference / own).collect::<Vec<_>>()),
            100.0 * found[k] as f64 / rays.len() as f64,
            way.bytes as f64 / tiled.heights().len() as f64
        );
    }
}

fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn main() {
    bounce_rays("twill", "heights/twill.png", TWILL_AMPLITUDE);
    bounce_rays("rocks", "rocks/height.png", ROCKS_AMPLITUDE);
    let field = fixture("heights/twill.png", TWILL_AMPLITUDE, Boundary::Repeat);
    let start = ThreadTime::now();
    let tracer = HeightTracer::new(&field);
    println!(
        "tracer/build/1024²: {:.4} s, {:.1} bytes a texel beside the heights",
        start.elapsed().as_secs_f64(),
        tracer.bytes() as f64 / 1048576.0
    );
    let high = field.range()[1];
    let rng = Stream::new(1, 0);
    let points: Vec<_> = (0..RAYS).map(|k| point(rng, k, &field)).collect();
    let mut in_order = points.clone();
    in_order.sort_by_key(|p| (p.cell[1] / 8, p.cell[0] / 8));
    let point = |k: u64| points[k as usize];
    let towards = Stream::new(1, 1);
    for (name, cosines) in
        [("shadow, uniform", [0.0, 1.0]), ("shadow, below 75°", [0.2588, 1.0]), ("shadow, above 75°", [0.0, 0.2588])]
    {
        let directions: Vec<_> = (0..RAYS).map(|k| direction(towards, k, cosines)).collect();
        report(name, RAYS, |k| tracer.occluded(point(k), directions[k as usize]));
        report(&format!("{name}, points in order"), RAYS, |k| {
            tracer.occluded(in_order[k as usize], directions[k as usize])
        });
        let facing: Vec<_> = (0..RAYS).filter(|&k| tracer.normal(point(k)).dot(directions[k as usize]) > 0.0).collect();
        report(&format!("{name}, front-facing"), facing.len() as u64, |k| {
            tracer.occluded(point(facing[k as usize]), directions[facing[k as usize] as usize])
        });
        report(&format!("{name}, first hit from the surface"), facing.len() as u64, |k| {
            tracer.intersect_from(point(facing[k as usize]), directions[facing[k as usize] as usize]).is_some()
        });
        report(&format!("{name}, marched by 0.1 texel"), RAYS / 64, |k| {
            marched(high, &tracer, point(k), directions[k as usize])
        });
        report(&format!("{name}, from far"), RAYS, |k| {
            let d = -directions[k as usize];
            let origin = tracer.position(point(k)) - d.as_dvec3() * 500.0 + DVec3::Z * 0.01;
            tracer.intersect(&Ray { origin, direction: d }).is_some()
        });
    }
    // Every pixel of a view, row by row: neighbours walk the same nodes.
    let view = direction(towards, 12345, [0.5, 0.6]);
    report("first hit, coherent", RAYS, |k| {
        let origin = DVec3::new((k % 1024) as f64, -((k / 1024) as f64), 100.0);
        tracer.intersect(&Ray { origin, direction: -view }).is_some()
    });
}
