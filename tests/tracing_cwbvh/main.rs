//! Two roads: bounce rays against the pyramid and against a compressed wide BVH over the same bilinear cells.

mod reference;

use farfield::geometry::{Boundary, HeightTracer};
use farfield::math::rng::Stream;
use obvhs::BvhBuildParams;
use reference::{Bounce, CellBvh, bounces, fixture};

/// Bounce rays a map.
const RAYS: usize = 1 << 18;
/// Relative difference of distances that counts as none.
const SAME: f64 = 1e-5;
/// By how much a ray is tilted to tell whether it grazes; ten times the rounding of its direction.
const TILT: f32 = 1e-6;
/// Rays that may differ, of those above: each shown to graze.
const GRAZING: usize = 3;

/// Same hit or miss, and the distance.
fn agree(a: Option<f64>, b: Option<f64>) -> bool {
    match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() <= SAME * a.max(b),
        (None, None) => true,
        _ => false,
    }
}

/// Whether the ray's hit changes when it is raised or lowered by [`TILT`]: it touches a crest within rounding.
fn grazes(tracer: &HeightTracer, ray: &Bounce) -> bool {
    let tilted = |tilt: f32| {
        let direction = (ray.direction + tracer.normal(ray.point) * tilt).normalize();
        tracer.intersect_from(ray.point, direction).map(|hit| hit.t)
    };
    !agree(tilted(TILT), tilted(-TILT))
}

fn compare(path: &str, amplitude: f32) {
    let tiled = fixture(path, amplitude, Boundary::Repeat);
    let single = fixture(path, amplitude, Boundary::Clamp);
    let tracer = HeightTracer::new(&single);
    let bvh = CellBvh::new(&single, BvhBuildParams::fast_build());
    let rays = bounces(&HeightTracer::new(&tiled), RAYS, Stream::new(11, 0));
    let (mut hits, mut differ, mut largest) = (0, 0, 0.0f64);
    for (k, ray) in rays.iter().enumerate() {
        let ours = tracer.intersect_from(ray.point, ray.direction).map(|hit| hit.t);
        let theirs = bvh.first_hit(&single, ray);
        if let (Some(a), Some(b)) = (ours, theirs)
            && agree(ours, theirs)
        {
            hits += 1;
            largest = largest.max((a - b).abs() / a.max(b));
        } else if !agree(ours, theirs) {
            differ += 1;
            println!("{path}, ray {k}: {ours:?}, {theirs:?} by the other road; {ray:?}");
            assert!(grazes(&tracer, ray), "{path}, ray {k}: {ours:?} is {theirs:?} and does not graze");
        }
    }
    println!("{path}: {hits} hits of {RAYS} rays, largest relative difference {largest:.1e}, {differ} graze");
    assert!(hits > RAYS / 10, "{path}: {hits} hits");
    assert!(differ <= GRAZING, "{path}: {differ} of {RAYS} rays differ");
}

#[test]
fn bounce_rays_on_twill_hit_what_a_wide_bvh_hits() {
    compare("heights/twill.png", 24.415_19);
}

#[test]
fn bounce_rays_on_rocks_hit_what_a_wide_bvh_hits() {
    compare("rocks/height.png", 35.9);
}
