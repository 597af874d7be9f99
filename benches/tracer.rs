//! Rays a core-second by kind, on twill: `cargo bench --bench tracer`.
//!
//! Directions are random throughout. "Points in order" start in rows of blocks of 8 × 8 texels, as stratified points do;
//! the others start anywhere, and wait for memory more than half of the time.

use farfield::geometry::{Boundary, HeightField, HeightTracer, Ray, SurfacePoint};
use farfield::math::rng::Stream;
use glam::{DVec3, Vec3};

/// Amplitude of `fixtures/heights/twill.png` in texels.
const TWILL_AMPLITUDE: f32 = 24.415_19;
const RAYS: u64 = 1 << 20;

fn twill() -> HeightField {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/heights/twill.png");
    let image = image::open(path).expect("a fixture of this repository").into_luma16();
    let size = [image.width() as usize, image.height() as usize];
    let heights = image.into_raw().into_iter().map(|code| f32::from(code) / 65535.0 * TWILL_AMPLITUDE).collect();
    HeightField::new(heights, size, [1.0, 1.0], Boundary::Repeat)
}

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

/// CPU seconds of this thread where the system tells (other programs may share the core), else the time of day.
fn core_seconds() -> f64 {
    let scheduled = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = scheduled.and_then(|line| line.split(' ').next().and_then(|first| first.parse::<f64>().ok()));
    nanoseconds.map_or_else(
        || std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).expect("after 1970").as_secs_f64(),
        |ns| ns * 1e-9,
    )
}

/// Prints rays a second of `trace`, called for each of `rays`; `true` counts.
fn report(name: &str, rays: u64, trace: impl Fn(u64) -> bool) {
    let start = core_seconds();
    let found = (0..rays).filter(|&k| trace(k)).count();
    let seconds = core_seconds() - start;
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

fn main() {
    let field = twill();
    let start = core_seconds();
    let tracer = HeightTracer::new(&field);
    println!(
        "tracer/build/1024²: {:.4} s, {:.1} bytes a texel beside the heights",
        core_seconds() - start,
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
