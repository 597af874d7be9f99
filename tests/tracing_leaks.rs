//! No ray is lost: what must be hit is hit, from the side that the ray comes from, wherever it starts and passes.

#[path = "tracing_cwbvh/reference.rs"]
mod reference;

use farfield::geometry::{Boundary, HeightField, HeightTracer, Hit, Ray, SurfacePoint};
use farfield::math::rng::Stream;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use reference::{bounces, fixture};

const TWILL_AMPLITUDE: f32 = 24.415_19;

fn twill(boundary: Boundary) -> HeightField {
    fixture("heights/twill.png", TWILL_AMPLITUDE, boundary)
}

/// A small map whose sides are no multiple of anything: most of its cells are at a border.
fn odd() -> HeightField {
    let rng = Stream::new(21, 0);
    HeightField::new((0..35).map(|k| 3.0 * rng.uniform(k)).collect(), [7, 5], [1.0, 1.0], Boundary::Repeat)
}

/// Where rays are aimed: the extent of a map in texels and metres.
struct Map {
    size: [usize; 2],
    range: [f64; 2],
}

impl Map {
    fn of(field: &HeightField) -> Self {
        Self { size: field.size(), range: field.range().map(f64::from) }
    }
}

/// Horizontal part of direction k: any, along an axis, exactly diagonal through corners, nearly so, none.
fn heading(rng: Stream, k: u64) -> [f32; 2] {
    let sign = |bit: u64| if k >> bit & 1 == 0 { 1.0 } else { -1.0 };
    let [a, b] = rng.uniform_pair(4 * k).map(|x| 2.0 * x - 1.0);
    match k % 8 {
        0..=2 => [a, b],
        3 => [sign(3), 0.0],
        4 => [0.0, sign(3)],
        5 => [sign(3), sign(4)],
        6 => [sign(3) * (1.0 + 1e-6 * a), sign(4)],
        _ => [0.0, 0.0],
    }
}

/// What ray k aims at in the plane, within some tiles of the first: a corner of cells, a border of cells, a corner or a
/// border of tiles, or anything.
fn aim(rng: Stream, k: u64, size: [usize; 2]) -> [f64; 2] {
    let [a, b] = rng.uniform_pair(4 * k + 1).map(f64::from);
    let [nu, nv] = size.map(|n| n as f64);
    let (u, v) = ((a * 4.0 - 2.0) * nu, (b * 4.0 - 2.0) * nv);
    match k / 8 % 5 {
        0 => [u.floor(), v.floor()],
        1 => [u.floor(), v],
        2 => [(u / nu).floor() * nu, v],
        3 => [(u / nu).floor() * nu, (v / nv).floor() * nv],
        _ => [u, v],
    }
}

/// Ray k from above the map, or from below it.
fn ray(rng: Stream, k: u64, map: &Map, from_above: bool) -> Ray {
    let [low, high] = map.range;
    let [a, b] = rng.uniform_pair(4 * k + 2);
    let [x, y] = heading(rng, k);
    // From 3° over the horizon to the vertical.
    let down = 0.05 + 3.0 * a * a;
    let direction = Vec3::new(x, y, if from_above { -down } else { down }).normalize();
    let [u, v] = aim(rng, k, map.size);
    let middle = DVec3::new(u, -v, low + f64::from(b) * (high - low));
    let climb = if from_above { high - middle.z } else { middle.z - low };
    // From outside of the heights; as far back as that takes and a little more.
    let back = (climb + 0.01 * (high - low)) / f64::from(direction.z.abs());
    Ray { origin: middle - direction.as_dvec3() * back, direction }
}

/// Distance of `hit` from the ray's line, and of its point from the place it names, in texels.
fn errors(tracer: &HeightTracer, ray: &Ray, hit: &Hit) -> [f64; 2] {
    let [nu, nv] = tracer.heights().size().map(|n| n as f64);
    let along = ray.origin + ray.direction.as_dvec3() * hit.t;
    let first = tracer.position(hit.point);
    let away = hit.position - first;
    let [tiles_u, tiles_v] = [away.x / nu, away.y / nv];
    let off = (tiles_u - tiles_u.round()).abs() * nu + (tiles_v - tiles_v.round()).abs() * nv + away.z.abs();
    [(along - hit.position).length(), off]
}

/// Traces `count` rays; panics at the first that is lost.
fn expect_no_leak(name: &str, field: &HeightField, count: u64, seed: u64) {
    let (tracer, map) = (HeightTracer::new(field), Map::of(field));
    let steep = 1.0 + map.range[1] - map.range[0];
    (0..count).into_par_iter().for_each(|k| {
        let from_above = k % 2 == 0;
        let ray = ray(Stream::new(seed, 0), k / 2, &map, from_above);
        let hit = tracer.intersect(&ray);
        let hit = hit.unwrap_or_else(|| panic!("{name}, ray {k} passes the surface: {ray:?}"));
        // `st` is single precision and so is the start of the ray within its cell: 6e-8 cells times the slope.
        let [line, place] = errors(&tracer, &ray, &hit);
        assert!(line < 3e-7 * steep && place < 1e-9 * steep, "{name}, ray {k}: off by {line:e}, {place:e}: {ray:?}");
        let faced = hit.normal.dot(ray.direction) * if from_above { -1.0 } else { 1.0 };
        assert!(faced > -1e-6, "{name}, ray {k} hits the far side: {ray:?} {hit:?}");
        assert!(tracer.intersect_within(&ray, hit.t * (1.0 - 1e-9)).is_none(), "{name}, ray {k}: something before");
    });
}

#[test]
fn a_million_rays_cannot_pass_a_tiled_map() {
    expect_no_leak("twill", &twill(Boundary::Repeat), 1 << 19, 31);
    expect_no_leak("7 × 5", &odd(), 1 << 19, 32);
}

#[test]
#[ignore = "15 seconds"]
fn ten_million_rays_cannot_pass_a_tiled_map() {
    expect_no_leak("twill", &twill(Boundary::Repeat), 8_000_000, 33);
    expect_no_leak("7 × 5", &odd(), 2_000_000, 34);
}

#[test]
fn a_flat_map_is_hit_at_its_height() {
    for height in [0.0, 2.5, -1e3] {
        let field = HeightField::new(vec![height; 48], [8, 6], [1.0, 1.0], Boundary::Repeat);
        let (tracer, map) = (HeightTracer::new(&field), Map::of(&field));
        for k in 0..100_000u64 {
            let mut ray = ray(Stream::new(41, 0), k, &map, k / 8 % 2 == 0);
            ray.origin -= ray.direction.as_dvec3() * 7.0;
            let t = (f64::from(height) - ray.origin.z) / f64::from(ray.direction.z);
            let hit = tracer.intersect(&ray).unwrap_or_else(|| panic!("ray {k} passes the plane at {height}: {ray:?}"));
            // The slab is wider than the plane by a few tolerances, 1e-14 of the height, over a cosine of at least 0.03.
            let rounding = 1e-12 * (t + f64::from(height).abs());
            assert!((hit.t - t).abs() <= rounding, "ray {k}: {} is {t}", hit.t);
            assert_eq!(hit.normal, Vec3::Z);
        }
    }
}

#[test]
fn rays_in_a_groove_meet_its_walls_where_they_are_as_high() {
    // h = |u − 8| over 0…16: a ray at height z along the slope meets the wall at u = 8 ± z.
    let heights = (0..16 * 9).map(|k| ((k % 16) as f32 - 8.0).abs()).collect();
    let field = HeightField::new(heights, [16, 9], [1.0, 1.0], Boundary::Repeat);
    let tracer = HeightTracer::new(&field);
    let rng = Stream::new(42, 0);
    for k in 0..200_000u64 {
        let [a, b] = rng.uniform_pair(2 * k);
        let z = if k % 3 == 0 { (1.0 + (6.0 * a).floor()).into() } else { 0.01 + 7.9 * f64::from(a) };
        let slant = if k % 2 == 0 { 0.0 } else { 4.0 * rng.uniform(2 * k + 1) - 2.0 };
        let along = if k % 4 < 2 { 1.0 } else { -1.0 };
        let direction = Vec3::new(along, slant, 0.0);
        let v = if k % 5 == 0 { (b * 9.0).floor() } else { b * 9.0 };
        let origin = DVec3::new(8.0, -f64::from(v), z);
        let hit = tracer.intersect(&Ray { origin, direction }).expect("a wall on either side");
        assert!((hit.t - z).abs() < 1e-6, "ray {k} at height {z}: {} {direction}", hit.t);
    }
}

/// `point` moved to a border or a corner of its cell.
fn snapped(point: SurfacePoint, k: u64) -> SurfacePoint {
    let snap = |x: f32| if x < 0.5 { 0.0 } else { 1.0 };
    let [s, t] = point.st;
    let st = match k % 3 {
        0 => [snap(s), t],
        1 => [s, snap(t)],
        _ => [snap(s), snap(t)],
    };
    SurfacePoint { st, ..point }
}

/// A direction over the tangent plane at `point`: cosine-distributed, or with heading k of [`heading`] and lifted.
fn bounced(tracer: &HeightTracer, point: SurfacePoint, rng: Stream, k: u64) -> Vec3 {
    let normal = tracer.normal(point);
    if k % 4 == 3 {
        let [x, y] = heading(rng, k / 4);
        let steepness = -(normal.x * x + normal.y * y) / normal.z;
        return Vec3::new(x, y, steepness + 0.01 + rng.uniform(4 * k + 3)).normalize();
    }
    let [a, b] = rng.uniform_pair(4 * k + 3);
    let (sin, cos) = (b * std::f32::consts::TAU).sin_cos();
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    ((tangent * cos + bitangent * sin) * a.sqrt() + normal * (1.0 - a).sqrt()).normalize()
}

/// Follows paths of up to 12 bounces; every hit must be from above, and nothing may be over the point hit.
fn expect_paths_above(name: &str, field: &HeightField, paths: u64, borders: bool) {
    const BOUNCES: u64 = 12;
    let (tracer, map) = (HeightTracer::new(field), Map::of(field));
    let hits: u64 = (0..paths)
        .into_par_iter()
        .map(|path| {
            let rng = Stream::new(51, path);
            let mut point = tracer.intersect(&ray(rng, path, &map, true)).expect("a tiled map is hit").point;
            for k in 0..BOUNCES {
                point = if borders { snapped(point, path + k) } else { point };
                assert!(!tracer.occluded(point, Vec3::Z), "{name}, path {path}: something over {point:?}");
                let direction = bounced(&tracer, point, rng, k + 8 * path);
                let Some(hit) = tracer.intersect_from(point, direction) else { return k };
                let facing = hit.normal.dot(direction);
                assert!(facing < 1e-5, "{name}, path {path}: {hit:?} from below, {point:?} {direction}");
                point = hit.point;
            }
            BOUNCES
        })
        .sum();
    assert!(hits > paths / 10, "{name}: {hits} bounces");
}

#[test]
fn paths_never_end_below_the_surface() {
    expect_paths_above("twill", &twill(Boundary::Repeat), 300_000, false);
    expect_paths_above("7 × 5", &odd(), 100_000, false);
}

#[test]
fn paths_over_borders_and_corners_never_end_below_the_surface() {
    expect_paths_above("twill", &twill(Boundary::Repeat), 300_000, true);
    expect_paths_above("7 × 5", &odd(), 100_000, true);
}

#[test]
fn a_dome_does_not_shadow_itself() {
    // h = −(i − 32)² − (j − 32)²: whole numbers, no twist, and over any facet's tangent plane there is nothing. The last
    // row and column repeat the ones before and stand out: rays that end there are not asked.
    let square = |x: usize| (x as f32 - 32.0) * (x as f32 - 32.0);
    let heights = (0..65 * 65).map(|k| -square(k % 65) - square(k / 65)).collect();
    let field = HeightField::new(heights, [65, 65], [1.0, 1.0], Boundary::Clamp);
    let tracer = HeightTracer::new(&field);
    let (mut asked, rng) = (0, Stream::new(61, 0));
    for k in 0..400_000u64 {
        let [a, b] = rng.uniform_pair(4 * k).map(f64::from);
        let view = Vec3::new(3e-4, -2e-4, -1.0).normalize();
        let origin = DVec3::new(64.0 * a, -64.0 * b, 0.0) - view.as_dvec3() * 10.0;
        let Some(hit) = tracer.intersect(&Ray { origin, direction: view }) else { continue };
        if hit.point.cell.contains(&64) {
            continue;
        }
        let normal = hit.normal;
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        let (sin, cos) = (rng.uniform(4 * k + 1) * std::f32::consts::TAU).sin_cos();
        // A third of them grazing; the normal itself is rounded to 6e-8.
        let lift = if k % 3 == 0 { 1e-6 } else { rng.uniform(4 * k + 2) + 1e-6 };
        let direction = (tangent * cos + bitangent * sin + normal * lift).normalize();
        let shadow = tracer.intersect_from(hit.point, direction);
        if shadow.is_some_and(|shadow| shadow.point.cell.contains(&64)) {
            continue;
        }
        asked += 1;
        assert!(shadow.is_none(), "ray {k}: {:?} shadows itself towards {direction}: {shadow:?}", hit.point);
        assert!(
            !tracer.occluded_within(hit.point, direction, 0.5),
            "ray {k}: {:?} shadows itself towards {direction}",
            hit.point
        );
    }
    assert!(asked > 200_000, "{asked} rays");
}

#[test]
fn segments_end_at_their_length() {
    let field = twill(Boundary::Repeat);
    let tracer = HeightTracer::new(&field);
    let mut unclear = 0;
    let rays = bounces(&tracer, 200_000, Stream::new(71, 0));
    for (k, bounce) in rays.iter().enumerate() {
        let (point, direction) = (bounce.point, bounce.direction);
        let Some(hit) = tracer.intersect_from(point, direction) else {
            assert!(!tracer.occluded_within(point, direction, 1e3), "ray {k} meets nothing");
            continue;
        };
        // A hit counts once the ray is below by the tolerance, 2.4e-11 here: a ray that grazes may take longer.
        let (before, after) = (hit.t * (1.0 - 1e-9), hit.t + 1e-6);
        assert_eq!(tracer.intersect_from_within(point, direction, before), None, "ray {k} at {}", hit.t);
        assert!(!tracer.occluded_within(point, direction, before), "ray {k} at {}", hit.t);
        let found = tracer.intersect_from_within(point, direction, after);
        assert!(found.is_none_or(|found| (found.t - hit.t).abs() < 1e-9 * hit.t), "ray {k}: {found:?} is {hit:?}");
        unclear += usize::from(found.is_none());
        unclear += usize::from(!tracer.occluded_within(point, direction, after));
        // The same segment from a place in space: the point is single precision, hence the margin.
        let ray = Ray { origin: tracer.position(point) + direction.as_dvec3() * 1e-3 * hit.t, direction };
        let rest = hit.t * (1.0 - 1e-3);
        if let Some(free) = tracer.intersect(&ray)
            && (free.t - rest).abs() < 1e-5 * rest
        {
            assert_eq!(tracer.intersect_within(&ray, free.t * (1.0 - 1e-9)), None, "ray {k} at {}", free.t);
            unclear += usize::from(tracer.intersect_within(&ray, free.t + 1e-6).is_none());
        }
    }
    assert!(unclear <= 12, "{unclear} segments end within 1e-6 behind a hit that they do not see");
}

#[test]
fn a_map_of_200_000_texels_a_side_takes_the_memory_of_its_tile() {
    const TILES: u64 = 195;
    let field = twill(Boundary::Repeat);
    let (tracer, map) = (HeightTracer::new(&field), Map::of(&field));
    let texels = field.heights().len();
    assert_eq!(texels, 1024 * 1024);
    let bytes = tracer.bytes() + size_of_val(field.heights());
    assert!(bytes <= 32 * texels, "{} bytes a texel", bytes as f64 / texels as f64);
    let rng = Stream::new(81, 0);
    let mut largest = 0.0f64;
    for k in 0..200_000u64 {
        // Places in multiples of 2⁻²⁰ texels: exact in every tile. Where rays enter the heights is rounded to 3e-11
        // texels at 200 000, and from there to the 6e-8 of `SurfacePoint`: that is all the difference there may be.
        let exact = |x: f64| (x * 1_048_576.0).round() / 1_048_576.0;
        let mut near = ray(rng, k, &map, true);
        near.origin = DVec3::new(exact(near.origin.x), exact(near.origin.y), near.origin.z);
        let [a, b] = rng.uniform_pair(4 * k + 3).map(|x| f64::from((x * TILES as f32).floor()) * 1024.0);
        let far = Ray { origin: near.origin + DVec3::new(a, -b, 0.0), ..near };
        let (near, far) = (tracer.intersect(&near).expect("a hit"), tracer.intersect(&far).expect("a hit"));
        largest = largest.max((near.t - far.t).abs() / near.t);
        let away = far.position - near.position - DVec3::new(a, -b, 0.0);
        assert!(away.length() < 1e-5 * near.t, "ray {k}: {away} at {}", near.t);
    }
    println!("largest relative difference of distances over 200 000 texels: {largest:.1e}");
    assert!(largest < 1e-5, "distances differ by {largest:e}");
}
