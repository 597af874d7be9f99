//! The other road: a compressed wide BVH over the same bilinear cells, each a primitive, and the rays for both.
#![allow(dead_code, reason = "shared by tests and benches; each uses its part")]

use std::time::Duration;

use farfield::geometry::{Boundary, HeightField, HeightTracer, Ray, SurfacePoint};
use farfield::math::rng::Stream;
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use obvhs::ray::RayHit;
use obvhs::{Boundable, BvhBuildParams};

/// What a path tracer asks for after a hit: where the surface was hit and where the path goes on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounce {
    pub(crate) point: SurfacePoint,
    pub(crate) direction: Vec3,
}

/// A height map of `fixtures/` that is `amplitude` texels high, in texels.
pub(crate) fn fixture(path: &str, amplitude: f32, boundary: Boundary) -> HeightField {
    let path = format!("{}/fixtures/{path}", env!("CARGO_MANIFEST_DIR"));
    let image = image::open(path).expect("a fixture of this repository").into_luma16();
    let size = [image.width() as usize, image.height() as usize];
    let heights = image.into_raw().into_iter().map(|code| f32::from(code) / 65535.0 * amplitude).collect();
    HeightField::new(heights, size, [1.0, 1.0], boundary)
}

/// Bounce rays: camera rays from above, from all directions down to 6° over the horizon and to all places of the map,
/// hit the surface first at `point`; `direction` is cosine-distributed about its normal there.
///
/// Points of the last row and column of cells are left out: they are other cells where the map ends.
pub(crate) fn bounces(tracer: &HeightTracer, count: usize, rng: Stream) -> Vec<Bounce> {
    let [nu, nv] = tracer.heights().size();
    let high = f64::from(tracer.heights().range()[1]);
    let bounce = |k: u64| {
        let [u, v] = rng.uniform_pair(4 * k);
        let aim = DVec3::new(f64::from(u) * nu as f64, -f64::from(v) * nv as f64, 0.5 * high);
        let view = direction(rng.uniform_pair(4 * k + 1), |u| 0.1 + 0.9 * u);
        let origin = aim + view.as_dvec3() * (high / f64::from(view.z));
        let hit = tracer.intersect(&Ray { origin, direction: -view })?;
        let [i, j] = hit.point.cell;
        let local = direction(rng.uniform_pair(4 * k + 2), f32::sqrt);
        let (tangent, bitangent) = hit.normal.any_orthonormal_pair();
        let direction = (tangent * local.x + bitangent * local.y + hit.normal * local.z).normalize();
        (i + 1 < nu && j + 1 < nv).then_some(Bounce { point: hit.point, direction })
    };
    (0..).filter_map(bounce).take(count).collect()
}

/// The direction whose cosine is `cosine(u[0])`.
fn direction(u: [f32; 2], cosine: impl Fn(f32) -> f32) -> Vec3 {
    let z = cosine(u[0]);
    let (sin, cos) = (u[1] * std::f32::consts::TAU).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * cos, r * sin, z)
}

/// One bilinear cell: its place and its corner heights `[h00, h10, h01, h11]`.
#[derive(Clone, Copy, Debug)]
struct Cell {
    at: [u16; 2],
    corners: [f32; 4],
}

/// Widening of boxes in texels: rays in `f32` are off by a few 1e-4 texels at 1000 texels from the corner.
const BOX_PADDING: f32 = 1e-3;

impl Boundable for Cell {
    fn aabb(&self) -> Aabb {
        let [u, v] = self.at.map(f32::from);
        let low = self.corners.into_iter().fold(f32::INFINITY, f32::min);
        let high = self.corners.into_iter().fold(f32::NEG_INFINITY, f32::max);
        let (low, high) = (Vec3A::new(u, v, low), Vec3A::new(u + 1.0, v + 1.0, high));
        Aabb { min: low - BOX_PADDING, max: high + BOX_PADDING }
    }
}

/// All cells of one tile of a map with texels of one metre, in the order of the leaves.
pub(crate) struct CellBvh {
    bvh: CwBvh,
    cells: Vec<Cell>,
}

impl CellBvh {
    pub(crate) fn new(field: &HeightField, quality: BvhBuildParams) -> Self {
        assert_eq!(field.spacing(), [1.0; 2], "cells of one metre");
        let [nu, nv] = field.size();
        let cell = |k: usize| {
            let [i, j] = [k % nu, k / nu];
            Cell { at: [i as u16, j as u16], corners: field.corners(i, j) }
        };
        let cells: Vec<Cell> = (0..nu * nv).map(cell).collect();
        let bvh = build_cwbvh(&cells, quality, &mut Duration::default());
        let cells = bvh.primitive_indices.iter().map(|&k| cells[k as usize]).collect();
        Self { bvh, cells }
    }

    /// Bytes held: nodes, cells and their heights.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.bvh.nodes[..]) + size_of_val(&self.cells[..])
    }

    /// Distance of the first hit after the start at `bounce`.
    pub(crate) fn first_hit(&self, field: &HeightField, bounce: &Bounce) -> Option<f64> {
        let Bounce { point, direction } = bounce;
        let [i, j] = point.cell;
        let [s, t] = point.st.map(f64::from);
        let h = field.corners(i, j).map(f64::from);
        let z = (h[0] + (h[1] - h[0]) * s) * (1.0 - t) + (h[2] + (h[3] - h[2]) * s) * t;
        let start = [i as f64 + s, j as f64 + t, z];
        let dir = [f64::from(direction.x), -f64::from(direction.y), f64::from(direction.z)];
        let own = point.cell.map(|x| x as u16);
        let single = obvhs::ray::Ray::new_inf(
            Vec3A::from_array(start.map(|x| x as f32)),
            Vec3A::from_array(dir.map(|x| x as f32)),
        );
        let (mut nearest, mut hit) = (f64::INFINITY, RayHit::none());
        let inv = [1.0 / dir[0], 1.0 / dir[1]];
        self.bvh.ray_traverse(single, &mut hit, |_, k| {
            if let Some(t) = crossing(&self.cells[k], start, dir, inv, own)
                && t < nearest
            {
                nearest = t;
                return t as f32;
            }
            f32::INFINITY
        });
        nearest.is_finite().then_some(nearest)
    }
}

/// First root of the gap a t² + b t + c of the ray over the cell; where it starts on the cell, beyond the start.
#[inline]
fn crossing(cell: &Cell, start: [f64; 3], dir: [f64; 3], inv: [f64; 2], own: [u16; 2]) -> Option<f64> {
    let h = cell.corners.map(f64::from);
    let [s, t] = [0, 1].map(|k| start[k] - f64::from(cell.at[k]));
    let sides = |x: f64, inv: f64| [(-x * inv), (1.0 - x) * inv];
    let ([u0, u1], [v0, v1]) = (sides(s, inv[0]), sides(t, inv[1]));
    let t_in = u0.min(u1).max(v0.min(v1)).max(0.0);
    let t_out = u0.max(u1).min(v0.max(v1));
    if t_in > t_out {
        return None;
    }
    let (hu, hv, twist) = (h[1] - h[0], h[2] - h[0], h[0] - h[1] - h[2] + h[3]);
    let a = -twist * dir[0] * dir[1];
    let b = dir[2] - hu * dir[0] - hv * dir[1] - twist * (s * dir[1] + t * dir[0]);
    if cell.at == own {
        let root = -b / a;
        return (root > 0.0 && root <= t_out).then_some(root);
    }
    let c = start[2] - h[0] - hu * s - hv * t - twist * s * t;
    let disc = b * b - 4.0 * a * c;
    if disc < 0.0 {
        return None;
    }
    let q = -0.5 * (b + disc.sqrt().copysign(b));
    let roots = [q / a, c / q];
    let inside = |t: &f64| (t_in..=t_out).contains(t);
    roots.into_iter().filter(inside).reduce(f64::min)
}
