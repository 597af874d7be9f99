//! Two roads: traced rays against the obvious loop over all cells, and what follows from them.

use farfield::geometry::{Boundary, HeightField, HeightTracer, Ray, SurfacePoint};
use farfield::math::rng::Stream;
use glam::{DVec3, Vec3};

/// A small map with its name.
fn small_maps() -> Vec<(&'static str, HeightField)> {
    let rng = Stream::new(1, 0);
    let noise = move |k: usize| rng.uniform(k as u64);
    type Shape = Box<dyn Fn(usize, usize) -> f32>;
    let shapes: Vec<(&'static str, [usize; 2], [f32; 2], Shape)> = vec![
        ("random", [7, 5], [1.0, 1.0], Box::new(move |i, j| 2.0 * noise(7 * j + i))),
        ("random, non-square texels", [5, 9], [0.5, 1.7], Box::new(move |i, j| 3.0 * noise(5 * j + i) - 10.0)),
        ("spike", [9, 9], [1.0, 1.0], Box::new(|i, j| if (i, j) == (4, 4) { 12.0 } else { 0.0 })),
        ("checkerboard steps", [8, 8], [1.0, 1.0], Box::new(|i, j| ((i / 2 + j / 2) % 2) as f32)),
        ("cliffs 80:1", [6, 10], [1.0, 1.0], Box::new(move |i, j| if noise(6 * j + i) > 0.5 { 80.0 } else { 0.0 })),
        ("V-groove", [8, 3], [1.0, 1.0], Box::new(|i, _| (i as f32 - 4.0).abs())),
        ("constant", [3, 4], [1.0, 2.0], Box::new(|_, _| 0.3)),
        ("amplitude 1e-9", [4, 4], [1.0, 1.0], Box::new(move |i, j| 1e-9 * noise(4 * j + i))),
        ("on a high base", [6, 6], [1.0, 1.0], Box::new(move |i, j| 1000.0 + noise(6 * j + i))),
        ("1 × N", [1, 11], [1.0, 1.0], Box::new(move |_, j| noise(j))),
        ("N × 1", [11, 1], [1.0, 0.3], Box::new(move |i, _| noise(i))),
        ("one texel", [1, 1], [1.0, 1.0], Box::new(|_, _| 2.0)),
        ("texels of a micrometre", [13, 8], [1e-6, 1e-6], Box::new(move |i, j| 2e-6 * noise(13 * j + i))),
    ];
    let build = |size: [usize; 2], spacing, shape: &Shape, boundary| {
        let heights = (0..size[0] * size[1]).map(|k| shape(k % size[0], k / size[0])).collect();
        HeightField::new(heights, size, spacing, boundary)
    };
    shapes
        .iter()
        .flat_map(|(name, size, spacing, shape)| {
            [Boundary::Repeat, Boundary::Clamp].map(|boundary| (*name, build(*size, *spacing, shape, boundary)))
        })
        .collect()
}

/// g(t) = a t² + b t + c over one cell: how high the ray is above it, and the part of the ray over it.
struct CellGap {
    own: bool,
    span: [f64; 2],
    abc: [f64; 3],
}

/// The gap over each cell that the ray passes until it leaves the heights for good, in plain monomials.
///
/// Every column of cells, and in it every cell that the ray could be over, with one to spare on either side.
fn gaps(field: &HeightField, start: [f64; 3], dir: [f64; 3], first: [i64; 2]) -> Vec<CellGap> {
    let size = field.size().map(|n| n as i64);
    let [low, high] = field.range().map(f64::from);
    let exit = if dir[2] > 0.0 { (high - start[2]) / dir[2] } else { (low - start[2]) / dir[2] };
    let t_end = if dir[2] == 0.0 {
        100.0 / dir[0].abs().max(dir[1].abs())
    } else {
        exit + 0.01 / dir.map(f64::abs).iter().sum::<f64>()
    };
    let mut all = Vec::new();
    let reach = |axis: usize, t: [f64; 2]| {
        let ends = t.map(|t| (start[axis] + dir[axis] * t).floor() as i64);
        ends[0].min(ends[1]) - 1..=ends[0].max(ends[1]) + 1
    };
    for column in reach(0, [0.0, t_end]) {
        let ends = [0.0, 1.0].map(|side| ((column as f64 + side - start[0]) / dir[0]).clamp(0.0, t_end));
        let over = if dir[0] == 0.0 { [0.0, t_end] } else { ends };
        for cell in reach(1, over).map(|row| [column, row]) {
            let [i, j] = [0, 1].map(|k| cell[k].rem_euclid(size[k]) as usize);
            if field.boundary() == Boundary::Clamp && (cell[0] != i as i64 || cell[1] != j as i64) {
                continue;
            }
            let mut span = [0.0f64, t_end];
            for k in [0, 1] {
                let ends = [0.0, 1.0].map(|side| cell[k] as f64 + side);
                if dir[k] == 0.0 {
                    if start[k] < ends[0] || start[k] > ends[1] {
                        span[1] = -1.0;
                    }
                } else {
                    let t = ends.map(|x| (x - start[k]) / dir[k]);
                    span = [span[0].max(t[0].min(t[1])), span[1].min(t[0].max(t[1]))];
                }
            }
            if span[0] > span[1] {
                continue;
            }
            let h = field.corners(i, j).map(f64::from);
            let (hu, hv, twist) = (h[1] - h[0], h[2] - h[0], h[0] - h[1] - h[2] + h[3]);
            let [s, t] = [start[0] - cell[0] as f64, start[1] - cell[1] as f64];
            let a = -twist * dir[0] * dir[1];
            let b = dir[2] - hu * dir[0] - hv * dir[1] - twist * (s * dir[1] + t * dir[0]);
            let c = start[2] - h[0] - hu * s - hv * t - twist * s * t;
            all.push(CellGap { own: cell == first, span, abc: [a, b, c] });
        }
    }
    all
}

/// Lowest gap of a ray that leaves the surface; for its own cell, of g(t)/t.
fn clearance(gaps: &[CellGap]) -> f64 {
    let lowest = |gap: &CellGap| {
        let [a, b, c] = gap.abc;
        let [t0, t1] = gap.span;
        if gap.own {
            return b.min(a * t1.min(1e6) + b);
        }
        let turn = if a > 0.0 { (-b / (2.0 * a)).clamp(t0, t1) } else { t0 };
        [t0, t1, turn].map(|t| (a * t + b) * t + c).into_iter().fold(f64::INFINITY, f64::min)
    };
    gaps.iter().map(lowest).fold(f64::INFINITY, f64::min)
}

/// Smallest root of any cell's gap within its span.
fn first_root(gaps: &[CellGap]) -> Option<f64> {
    let roots = |gap: &CellGap| {
        let [a, b, c] = gap.abc;
        let [t0, t1] = gap.span;
        let disc = b * b - 4.0 * a * c;
        let both = if a.abs() * (t1 - t0) < 1e-13 * b.abs() {
            [-c / b, f64::NAN]
        } else {
            [-1.0, 1.0].map(|sign| (-b + sign * disc.sqrt()) / (2.0 * a))
        };
        let slack = 1e-9 * t1;
        both.into_iter().filter(|t| (t0 - slack..=t1 + slack).contains(t)).fold(f64::INFINITY, f64::min)
    };
    let first = gaps.iter().map(roots).fold(f64::INFINITY, f64::min);
    first.is_finite().then_some(first)
}

/// A direction of kind `k`: oblique, grazing, along an axis, vertical or down a wall.
fn direction(rng: Stream, k: u64, field: &HeightField) -> Vec3 {
    let [low, high] = field.range();
    let tile = field.extent()[0].min(field.extent()[1]);
    let grazing = ((high - low) / (3.0 * tile)).max(1e-3);
    let [phi, height] = [rng.uniform(2 * k) * std::f32::consts::TAU, rng.uniform(2 * k + 1)];
    let (sin, cos) = phi.sin_cos();
    let scale = (high - low).max(1e-3 * tile) / tile;
    match k % 8 {
        0 | 1 => Vec3::new(cos, sin, 0.05 + height * 2.0 * scale),
        2 => Vec3::new(cos, sin, grazing * (1.0 + height)),
        3 => Vec3::new([1.0, -1.0][(k / 8 % 2) as usize], 0.0, grazing * (1.0 + height)),
        4 => Vec3::new(0.0, [1.0, -1.0][(k / 8 % 2) as usize], height * scale),
        5 => Vec3::Z,
        6 => Vec3::new(cos, sin, -height * scale),
        _ => Vec3::new(cos, sin, 4.0 * height * scale),
    }
}

fn cell_units(field: &HeightField, direction: Vec3) -> [f64; 3] {
    let [dx, dy] = field.spacing().map(f64::from);
    [f64::from(direction.x) / dx, -f64::from(direction.y) / dy, f64::from(direction.z)]
}

fn surface_height(field: &HeightField, point: SurfacePoint) -> f64 {
    let h = field.corners(point.cell[0], point.cell[1]).map(f64::from);
    let [s, t] = point.st.map(f64::from);
    h[0] + (h[1] - h[0]) * s + (h[2] - h[0]) * t + (h[0] - h[1] - h[2] + h[3]) * s * t
}

/// A point of kind `k`: inside of a cell, on its border, on its corner.
fn surface_point(rng: Stream, k: u64, field: &HeightField) -> SurfacePoint {
    let [nu, nv] = field.size();
    let [u, v] = rng.uniform_pair(1_000_000 + k);
    let [s, t] = rng.uniform_pair(2_000_000 + k);
    let edge = |x: f32| if x > 0.5 { 1.0 } else { 0.0 };
    let st = match k % 5 {
        0 => [edge(s), t],
        1 => [edge(s), edge(t)],
        _ => [s, t],
    };
    SurfacePoint { cell: [(u * nu as f32) as usize, (v * nv as f32) as usize], st }
}

#[test]
fn shadow_rays_equal_the_loop_over_all_cells() {
    for (map, (name, field)) in small_maps().into_iter().enumerate() {
        let tracer = HeightTracer::new(&field);
        let rng = Stream::new(2, map as u64);
        let scale = f64::from(field.range()[1] - field.range()[0]) + 1e-10 * f64::from(field.range()[1].abs());
        let mut unclear = 0;
        for k in 0..2000 {
            let point = surface_point(rng, k, &field);
            let direction = direction(rng, k, &field);
            let start = [0, 1].map(|a| point.cell[a] as f64 + f64::from(point.st[a]));
            let start = [start[0], start[1], surface_height(&field, point)];
            let gaps = gaps(&field, start, cell_units(&field, direction), point.cell.map(|x| x as i64));
            let clear = clearance(&gaps);
            if clear.abs() < 1e-9 * scale && clear < -1e-13 * scale {
                unclear += 1;
                continue;
            }
            let hidden = tracer.occluded(point, direction);
            assert_eq!(hidden, clear < -1e-13 * scale, "{name}, ray {k}: {point:?} {direction}, clearance {clear:e}");
        }
        assert!(unclear < 100, "{name}: {unclear} rays too close to call");
    }
}

#[test]
fn first_hits_equal_the_loop_over_all_cells() {
    for (map, (name, field)) in small_maps().into_iter().enumerate() {
        let tracer = HeightTracer::new(&field);
        let rng = Stream::new(3, map as u64);
        let [low, high] = field.range().map(f64::from);
        let extent = field.extent().map(f64::from);
        let size = extent[0].max(extent[1]);
        for k in 0..2000 {
            let [u, v] = rng.uniform_pair(3_000_000 + k).map(f64::from);
            let below = k % 2 == 0;
            let away = (0.3 + f64::from(rng.uniform(4_000_000 + k))) * (high - low).max(0.1 * size);
            let z = if below { low - away } else { high + away };
            let origin = DVec3::new((1.4 * u - 0.2) * extent[0], -(1.4 * v - 0.2) * extent[1], z);
            let aim = direction(rng, k, &field);
            let climb = aim.z.abs().max(0.3 * ((high - low) / size) as f32).max(0.1);
            let direction = Vec3::new(aim.x, aim.y, if below { climb } else { -climb }).normalize();
            let [dx, dy] = field.spacing().map(f64::from);
            let start = [origin.x / dx, -origin.y / dy, origin.z];
            let brute = first_root(&gaps(&field, start, cell_units(&field, direction), [i64::MAX; 2]));
            let hit = tracer.intersect(&Ray { origin, direction });
            match (hit, brute) {
                (Some(hit), Some(t)) => {
                    let error = (hit.t - t).abs();
                    assert!(error < 2e-5 * size.max(t), "{name}, ray {k}: t {} is {t}", hit.t);
                    let along = origin + direction.as_dvec3() * hit.t;
                    assert!(
                        (along - hit.position).length() < 2e-5 * (size + high.abs()),
                        "{name}: {along} {}",
                        hit.position
                    );
                    assert!((hit.normal.length() - 1.0).abs() < 1e-5 && hit.normal.z > 0.0);
                }
                (None, None) => {}
                _ => panic!("{name}, ray {k}: {hit:?} is {brute:?}, {origin} {direction}"),
            }
        }
    }
}

#[test]
fn rays_at_borders_and_corners_never_leak() {
    for (name, field) in small_maps().into_iter().filter(|(_, field)| field.boundary() == Boundary::Repeat) {
        let tracer = HeightTracer::new(&field);
        let rng = Stream::new(4, 0);
        let [low, high] = field.range().map(f64::from);
        let [dx, dy] = field.spacing().map(f64::from);
        for k in 0..4000u64 {
            // Through a vertex or a border, from far above or below, in oblique, diagonal and parallel directions.
            let [a, b] = rng.uniform_pair(k);
            let [fu, fv] = rng.uniform_pair(10_000 + k).map(|x| (x * 40.0).floor() - 20.0);
            let through = DVec3::new(f64::from(fu) * dx, f64::from(if k % 3 == 0 { fv } else { fv + a }) * dy, 0.0);
            let tilt = match k % 4 {
                0 => DVec3::new(0.0, f64::from(b) * dy, 0.0),
                1 => DVec3::new(dx, dy, 0.0),
                2 => DVec3::new(1e-7 * dx, dy, 0.0),
                _ => DVec3::new((f64::from(a) - 0.5) * dx, (f64::from(b) - 0.5) * dy, 0.0),
            };
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            let step = 0.3 * (high - low).max(0.1 * dx);
            let direction = DVec3::new(tilt.x, tilt.y, -sign * step);
            let origin = through + DVec3::Z * if sign > 0.0 { high } else { low } - direction * 3.0;
            let hit = tracer.intersect(&Ray { origin, direction: direction.normalize().as_vec3() });
            assert!(hit.is_some(), "{name}, ray {k}: nothing hit from {origin} to {direction}");
        }
    }
}

#[test]
fn rays_that_leave_the_surface_meet_it_where_shadow_rays_say() {
    for (map, (name, field)) in small_maps().into_iter().enumerate() {
        let tracer = HeightTracer::new(&field);
        let rng = Stream::new(5, map as u64);
        for k in 0..2000 {
            let point = surface_point(rng, k, &field);
            let direction = direction(rng, k, &field);
            if tracer.normal(point).dot(direction) <= 1e-5 {
                continue;
            }
            let hit = tracer.intersect_from(point, direction);
            assert_eq!(hit.is_some(), tracer.occluded(point, direction), "{name}, ray {k}: {point:?} {direction}");
            if let Some(hit) = hit {
                let along = tracer.position(point) + direction.as_dvec3() * hit.t;
                let [low, high] = field.range().map(f64::from);
                let size = field.extent()[0].max(field.extent()[1]);
                assert!((along - hit.position).length() < 1e-5 * (f64::from(size) + high.max(-low)), "{name}, ray {k}");
            }
        }
    }
}

#[test]
fn rays_that_never_end_are_stopped() {
    for (_, field) in small_maps() {
        let tracer = HeightTracer::new(&field);
        let rng = Stream::new(6, 0);
        for k in 0..20 {
            let point = surface_point(rng, k, &field);
            for direction in
                [Vec3::X, Vec3::Y, -Vec3::X, -Vec3::Y, Vec3::new(0.6, 0.8, 0.0), Vec3::new(0.6, 0.8, 1e-9), -Vec3::Z]
            {
                let _ = tracer.occluded(point, direction);
                let origin = tracer.position(point) + DVec3::Z * 1e-3;
                let _ = tracer.intersect(&Ray { origin, direction });
            }
        }
    }
}

#[test]
fn far_tiles_are_hit_like_the_first() {
    let (_, field) = small_maps().swap_remove(0);
    let tracer = HeightTracer::new(&field);
    let [width, depth] = field.extent().map(f64::from);
    let direction = Vec3::new(0.3, 0.4, -0.7).normalize();
    let near = Ray { origin: DVec3::new(0.25, -0.625, 5.0), direction };
    let far = Ray { origin: near.origin + DVec3::new(1e6 * width, 1e6 * depth, 0.0), ..near };
    let (near, far) = (tracer.intersect(&near).unwrap(), tracer.intersect(&far).unwrap());
    assert_eq!(near.point.cell, far.point.cell);
    assert!((near.t - far.t).abs() < 1e-6);
}
