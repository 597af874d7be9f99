//! Exact rays against a bilinear height field: a pyramid of height bounds over its cells.
//!
//! A ray walks from tile to tile of 4 × 4 cells. One that is not done after a few tiles goes on over blocks of the pyramid,
//! each a quarter as large as the ray is long or larger, and searches each from front to back. `Repeat` tiles the plane without end: a
//! ray is followed relative to the cell that it starts in, so its precision does not depend on where in the plane that is,
//! and it ends where it leaves the range of heights.

use glam::{DVec3, Vec3};

use super::patch::{CellRay, Patch, Side};
use super::pyramid::{Block, Candidate, Pyramid, Walked};
use super::wide_ray::{Magnitude, WideRay};
use super::{Boundary, HeightField};

/// A point on the surface: a cell and the fraction (s, t) ∈ [0, 1]² of it along u and v.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Cell along u and v.
    pub cell: [usize; 2],
    /// Fraction of the cell along u and v.
    pub st: [f32; 2],
}

/// A half-line in the frame of the height field, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts: `f64`, for a tiling of 200 000 texels leaves `f32` a hundredth of a texel.
    pub origin: DVec3,
    /// Where it goes; unit length if `Hit::t` is to be metres.
    pub direction: Vec3,
}

/// Where a ray meets the surface first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in units of the ray's direction.
    pub t: f64,
    /// The cell and the fraction of it.
    pub point: SurfacePoint,
    /// Position in the frame of the ray: in the tile that was hit, not in the first one.
    pub position: DVec3,
    /// Unit normal of the bilinear cell, z > 0.
    pub normal: Vec3,
}

/// Traces rays against one height field.
#[derive(Clone, Debug)]
pub struct HeightTracer<'a> {
    heights: &'a HeightField,
    pyramid: Pyramid,
    magnitude: Magnitude,
    /// Lowest and highest vertex with a margin of a few `tolerance`, metres: outside of it there is no surface.
    slab: [f64; 2],
    /// Metres by which a ray may dip below the surface without being stopped: what rounding in `f64` makes of 0.
    tolerance: f64,
}

/// Where a ray crosses the surface: t and the cell.
type Crossing = (f64, Candidate);

/// Where a ray comes over the map and into the range of heights.
struct Entry {
    /// The cell of the map and the same one in the plane.
    cell: [usize; 2],
    plane: [f64; 2],
    /// The rest of the ray.
    ray: CellRay,
    side: Side,
    /// Distance already gone.
    t: f64,
}

/// A repeated map is followed for this many periods of its longer side, but within [`REACH_CELLS`]; a ray that is still
/// within the range of heights then meets nothing.
///
/// Only rays within 0.1° of the horizon get there: 24 texels of height in 256 periods of 1024 texels are 0.005°.
const REACH_PERIODS: f64 = 256.0;
/// Least and largest reach in cells; above the largest, cells are no longer exact in `f32`.
const REACH_CELLS: [f64; 2] = [65_536.0, 4_194_304.0];
/// A horizontal ray along an axis sees the same heights again after one period: one for what is ahead and one for rounding.
const REACH_PERIODS_ALONG_AXIS: f64 = 2.0;
/// [`HeightTracer::tolerance`] in units of the height range and of the largest height.
const TOLERANCE: [f64; 2] = [1e-12, 1e-14];
/// Least tolerance in metres: a flat map at height 0 has no other, and a slab without thickness is never crossed.
const LEAST_TOLERANCE: f64 = 1e-300;
/// Margin of the slab of heights in tolerances: a ray that leaves it has crossed by more than the tolerance.
const SLAB_MARGIN: f64 = 4.0;

impl<'a> HeightTracer<'a> {
    /// Builds the pyramid: 4.6 bytes a texel beside the heights, which stay borrowed.
    pub fn new(heights: &'a HeightField) -> Self {
        let range = heights.range();
        debug_assert!(range.iter().all(|h| h.is_finite()), "heights are finite");
        let [low, high] = range.map(f64::from);
        let tolerance = TOLERANCE[0] * (high - low) + TOLERANCE[1] * low.abs().max(high.abs());
        let tolerance = tolerance.max(LEAST_TOLERANCE);
        let slab = [low - SLAB_MARGIN * tolerance, high + SLAB_MARGIN * tolerance];
        let magnitude = Magnitude { height: low.abs().max(high.abs()), step: largest_step(heights) };
        Self { heights, pyramid: Pyramid::new(heights), magnitude, slab, tolerance }
    }

    /// The height field that is traced.
    pub fn heights(&self) -> &'a HeightField {
        self.heights
    }

    /// Bytes that the tracer holds beside the heights.
    pub fn bytes(&self) -> usize {
        self.pyramid.bytes()
    }

    /// Unit normal of the bilinear surface at `point`.
    pub fn normal(&self, point: SurfacePoint) -> Vec3 {
        self.slant(&self.patch(point.cell), point.st)
    }

    /// Position of `point` in the first tile, metres.
    pub fn position(&self, point: SurfacePoint) -> DVec3 {
        self.place(&self.patch(point.cell), point.cell.map(|x| x as f64), point.st)
    }

    /// Position at the fraction `st` of a patch that is `cell` of the plane.
    fn place(&self, patch: &Patch, cell: [f64; 2], st: [f32; 2]) -> DVec3 {
        let [dx, dy] = self.heights.spacing().map(f64::from);
        let [s, t] = st.map(f64::from);
        DVec3::new((cell[0] + s) * dx, -(cell[1] + t) * dy, patch.height([s, t]))
    }

    /// Unit normal at the fraction `st` of a patch.
    fn slant(&self, patch: &Patch, st: [f32; 2]) -> Vec3 {
        let [x, y] = self.heights.corner_slope(patch.corners.map(|h| h as f32), st);
        Vec3::new(-x, -y, 1.0).normalize()
    }

    /// Whether the surface hides `direction` from the front of `point`; directions behind the tangent plane are hidden.
    ///
    /// The half-line that starts on the surface is hidden where any of it beyond the start is below the surface; running
    /// within the surface is not below. The start itself is divided out of its own cell's equation: no offset.
    pub fn occluded(&self, point: SurfacePoint, direction: Vec3) -> bool {
        self.occluded_within(point, direction, f64::INFINITY)
    }

    /// The same for the first `t_max` of the half-line, in units of `direction`.
    pub fn occluded_within(&self, point: SurfacePoint, direction: Vec3, t_max: f64) -> bool {
        let first = self.patch(point.cell);
        let ray = self.leaving(&first, point, direction, t_max);
        if !matches!(first.departure(&ray), (Side::Above, None)) {
            return true;
        }
        let stops = |cell: &Candidate| (cell.at != [0, 0] && cell.patch().stops(&ray, self.tolerance)).then_some(());
        self.search(&ray, Side::Above, point.cell, stops).is_some()
    }

    /// The first crossing of the surface by `ray`, from either side.
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.intersect_within(ray, f64::INFINITY)
    }

    /// The same for the first `t_max` of `ray`, in units of its direction.
    pub fn intersect_within(&self, ray: &Ray, t_max: f64) -> Option<Hit> {
        self.first_crossing(self.entering(ray, t_max)?)
    }

    fn first_crossing(&self, entry: Entry) -> Option<Hit> {
        let Entry { cell, plane, ray: local, side, t: t_start } = entry;
        let found = self.search(&local, side, cell, |cell| self.crossing(cell, &local, side))?;
        Some(self.hit(&local, plane, t_start, found))
    }

    /// Where the first `t_max` of `ray` goes below the surface; at once where it starts below.
    ///
    /// For a ray that was followed above another part of the surface up to its start, which rounding may have put a hair
    /// too low: nothing slips through where two parts meet.
    pub fn descend_within(&self, ray: &Ray, t_max: f64) -> Option<Hit> {
        let entry = self.entering(ray, t_max)?;
        if entry.side == Side::Above {
            return self.first_crossing(entry);
        }
        let start = self.pyramid.starting_in(entry.cell);
        Some(self.hit(&entry.ray, entry.plane, entry.t, (0.0, start)))
    }

    /// The first crossing of the surface by the half-line that starts on it at `point`, which itself does not count.
    pub fn intersect_from(&self, point: SurfacePoint, direction: Vec3) -> Option<Hit> {
        self.intersect_from_within(point, direction, f64::INFINITY)
    }

    /// The same for the first `t_max` of the half-line, in units of `direction`.
    pub fn intersect_from_within(&self, point: SurfacePoint, direction: Vec3, t_max: f64) -> Option<Hit> {
        let first = self.patch(point.cell);
        let ray = self.leaving(&first, point, direction, t_max);
        let (side, crossing) = first.departure(&ray);
        let plane = point.cell.map(|x| x as f64);
        let hit = |cell: &Candidate| {
            let own = cell.at == [0, 0];
            let t = if own { crossing } else { cell.patch().crossing(&ray, side, self.tolerance) };
            t.map(|t| (t, *cell))
        };
        let found = self.search(&ray, side, point.cell, hit)?;
        Some(self.hit(&ray, plane, 0.0, found))
    }

    /// Where the ray leaves its side of the surface over a cell.
    #[inline(always)]
    fn crossing(&self, cell: &Candidate, ray: &CellRay, side: Side) -> Option<Crossing> {
        let patch = cell.patch();
        patch.crossing(ray, side, self.tolerance).map(|t| (t, *cell))
    }

    /// The hit of a crossing; the ray's first cell is `first` of the plane, and the ray has gone `t_start` before.
    fn hit(&self, ray: &CellRay, first: [f64; 2], t_start: f64, (t, found): Crossing) -> Hit {
        let (cell, patch) = (found.cell.map(|x| x as usize), found.patch());
        let st = [0, 1].map(|k| (ray.start[k] - patch.cell[k] + ray.dir[k] * t).clamp(0.0, 1.0) as f32);
        let position = self.place(&patch, [first[0] + patch.cell[0], first[1] + patch.cell[1]], st);
        Hit { t: t_start + t, point: SurfacePoint { cell, st }, position, normal: self.slant(&patch, st) }
    }

    /// The patch of `cell` for a ray that starts in it.
    #[inline(always)]
    fn patch(&self, cell: [usize; 2]) -> Patch {
        Patch { corners: self.pyramid.corners(cell).map(f64::from), cell: [0.0; 2] }
    }

    /// Cells a metre along u and v; v runs against y.
    fn cells_per_metre(&self, direction: Vec3) -> [f64; 2] {
        let [dx, dy] = self.heights.spacing().map(f64::from);
        [f64::from(direction.x) / dx, -f64::from(direction.y) / dy]
    }

    /// The ray from `point` on the surface, as far as the surface may reach.
    #[inline(always)]
    fn leaving(&self, first: &Patch, point: SurfacePoint, direction: Vec3, t_max: f64) -> CellRay {
        debug_assert!(direction.is_finite() && direction != Vec3::ZERO, "a direction");
        let z = first.height(point.st.map(f64::from));
        let ray = CellRay::new(point.st, self.cells_per_metre(direction), z, f64::from(direction.z));
        self.bounded(ray, t_max)
    }

    /// `ray` from where it is over the map and within the range of heights.
    fn entering(&self, ray: &Ray, t_max: f64) -> Option<Entry> {
        debug_assert!(ray.direction.is_finite() && ray.direction != Vec3::ZERO, "a direction");
        let size = self.heights.size().map(|n| n as f64);
        let [dx, dy] = self.heights.spacing().map(f64::from);
        let start = [ray.origin.x / dx, -ray.origin.y / dy, ray.origin.z];
        let [du, dv] = self.cells_per_metre(ray.direction);
        let dir = [du, dv, f64::from(ray.direction.z)];
        let (t, axis) = self.entry_time(start, dir)?;
        if t > t_max {
            return None;
        }
        let (mut cell, mut plane, mut st) = ([0; 2], [0.0; 2], [0.0f32; 2]);
        for k in [0, 1] {
            let x = start[k] + dir[k] * t;
            let (floor, wrapped) = match self.heights.boundary() {
                Boundary::Repeat => (x.floor(), x.floor().rem_euclid(size[k])),
                Boundary::Clamp => (x.floor().clamp(0.0, size[k] - 1.0), x.floor().clamp(0.0, size[k] - 1.0)),
            };
            (cell[k], plane[k], st[k]) = (wrapped as usize, floor, (x - floor).clamp(0.0, 1.0) as f32);
        }
        // Through the top or bottom of the slab, height and side are known: no rounding may put the ray elsewhere.
        let (z, side) = match axis {
            Some(2) if dir[2] < 0.0 => (self.slab[1], Side::Above),
            Some(2) => (self.slab[0], Side::Below),
            _ => {
                let z = start[2] + dir[2] * t;
                let height = self.patch(cell).height(st.map(f64::from));
                (z, if z >= height { Side::Above } else { Side::Below })
            }
        };
        Some(Entry { cell, plane, ray: self.bounded(CellRay::new(st, [du, dv], z, dir[2]), t_max - t), side, t })
    }

    /// When the ray enters the slab of heights and, if the map is finite, its rectangle; and through which axis.
    fn entry_time(&self, start: [f64; 3], dir: [f64; 3]) -> Option<(f64, Option<usize>)> {
        let sides = match self.heights.boundary() {
            Boundary::Repeat => [f64::NEG_INFINITY, f64::INFINITY],
            Boundary::Clamp => [0.0, 1.0],
        };
        let [u, v] = self.heights.size().map(|n| sides.map(|side| side * n as f64));
        let (mut t_in, mut through, mut t_out) = (0.0, None, f64::INFINITY);
        for (axis, [low, high]) in [u, v, self.slab].into_iter().enumerate() {
            if dir[axis] == 0.0 {
                if !(low..=high).contains(&start[axis]) {
                    return None;
                }
                continue;
            }
            let ends = [(low - start[axis]) / dir[axis], (high - start[axis]) / dir[axis]];
            if ends[0].min(ends[1]) > t_in {
                (t_in, through) = (ends[0].min(ends[1]), Some(axis));
            }
            t_out = t_out.min(ends[0].max(ends[1]));
        }
        (t_in <= t_out).then_some((t_in, through))
    }

    /// Ends a ray at `t_max`, where it leaves the range of heights, and after the periods that a repeated map is followed
    /// for.
    fn bounded(&self, mut ray: CellRay, t_max: f64) -> CellRay {
        let size = self.heights.size().map(|n| n as f64);
        let cells = (REACH_PERIODS * size[0].max(size[1])).clamp(REACH_CELLS[0], REACH_CELLS[1]);
        // Infinite for vertical rays.
        let mut reach = cells / ray.dir[0].abs().max(ray.dir[1].abs());
        let mut leaves = (self.slab[usize::from(ray.dz > 0.0)] - ray.z) / ray.dz;
        if ray.dz == 0.0 {
            leaves = f64::INFINITY;
            reach = match ray.dir {
                [0.0, dv] => REACH_PERIODS_ALONG_AXIS * size[1] / dv.abs(),
                [du, 0.0] => REACH_PERIODS_ALONG_AXIS * size[0] / du.abs(),
                _ => reach,
            };
        }
        // Rounding of `leaves` must not cut off the last of the surface.
        ray.t_end = (leaves * (1.0 + 1e-12)).min(reach).min(t_max).max(0.0);
        ray
    }

    /// The first `Some` that `leaf` gives for the cells that the ray may meet, from `cell` where it starts.
    #[inline(always)]
    fn search<R>(
        &self,
        ray: &CellRay,
        side: Side,
        cell: [usize; 2],
        leaf: impl Fn(&Candidate) -> Option<R>,
    ) -> Option<R> {
        let wide_ray = WideRay::new(ray, side, self.magnitude);
        match self.pyramid.walk(&wide_ray, cell, &leaf) {
            Walked::Found(found) => Some(found),
            Walked::Missed => None,
            Walked::Unfinished(t) => self.search_blocks(ray, &wide_ray.from(t), cell, &leaf),
        }
    }

    /// Searches the blocks under `ray` one after the other, from the one with `cell`.
    #[inline(never)]
    fn search_blocks<R>(
        &self,
        ray: &CellRay,
        wide_ray: &WideRay,
        cell: [usize; 2],
        leaf: impl Fn(&Candidate) -> Option<R>,
    ) -> Option<R> {
        let size = self.heights.size().map(|n| n as i32);
        let forward = wide_ray.forward();
        let length = ray.t_end * ray.dir[0].abs().max(ray.dir[1].abs());
        let mut block = Block::new(block_level(length).min(self.pyramid.top()), cell);
        loop {
            let found = self.pyramid.search(wide_ray, block, &leaf);
            if found.is_some() {
                return found;
            }
            let ends = [0, 1].map(|k| ray.t_at(k, f64::from(block.far_side(k, forward[k], size[k]))));
            let axis = usize::from(ends[1] < ends[0]);
            if ends[axis] >= ray.t_end {
                return None;
            }
            let wraps = block.step(axis, forward[axis], size[axis]);
            if wraps && self.heights.boundary() == Boundary::Clamp {
                return None;
            }
        }
    }
}

/// log2 of the cells of the longest ray that is searched for over blocks of level 0, of 16 cells; four times that a level.
const LEVEL_0_BITS: u32 = 6;

/// The level of the blocks to search for a ray over `cells` cells.
#[inline]
fn block_level(cells: f64) -> u32 {
    let bits = (cells.clamp(1.0, REACH_CELLS[1]) as u32).next_power_of_two().trailing_zeros();
    bits.saturating_sub(LEVEL_0_BITS).div_ceil(2)
}

/// Largest step between neighbouring vertices, metres.
fn largest_step(heights: &HeightField) -> f64 {
    let [nu, nv] = heights.size();
    let mut largest = 0.0f32;
    for (j, i) in (0..nv).flat_map(|j| (0..nu).map(move |i| (j, i))) {
        let h = heights.vertex(i, j);
        largest = largest.max((heights.vertex(i + 1, j) - h).abs()).max((heights.vertex(i, j + 1) - h).abs());
    }
    f64::from(largest)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Heights 0 to 8 in no order: every ray has much to meet.
    fn jagged(size: [usize; 2], boundary: Boundary) -> HeightField {
        let heights = (0..size[0] * size[1]).map(|k| (k * k * 7919 % 1009) as f32 * 8.0 / 1009.0).collect();
        HeightField::new(heights, size, [1.0, 1.0], boundary)
    }

    #[test]
    fn a_walk_meets_first_what_a_search_of_all_blocks_meets_first() {
        for (size, boundary) in
            [([90, 70], Boundary::Repeat), ([90, 70], Boundary::Clamp), ([64, 64], Boundary::Repeat)]
        {
            let field = jagged(size, boundary);
            let tracer = HeightTracer::new(&field);
            for k in 0..20_000usize {
                // Every third ray starts on a border or a corner, every fifth runs along an axis or a diagonal.
                let st =
                    if k % 3 == 0 { [0.0, (k % 2) as f32] } else { [(k % 97) as f32 / 97.0, (k % 89) as f32 / 89.0] };
                let point = SurfacePoint { cell: [k * 31 % size[0], k * 17 % size[1]], st };
                let (sin, cos) = (k as f32 * 2.399_963).sin_cos();
                let flat = if k % 5 == 0 { [cos.round(), sin.round()] } else { [cos, sin] };
                let climb = [0.02, 0.1, 0.5, 2.0][k % 4];
                let patch = tracer.patch(point.cell);
                let ray = tracer.leaving(&patch, point, Vec3::new(flat[0], flat[1], climb), f64::INFINITY);
                for side in [Side::Above, Side::Below] {
                    let first =
                        |cell: &Candidate| (cell.at != [0, 0]).then(|| tracer.crossing(cell, &ray, side)).flatten();
                    let all = WideRay::new(&ray, side, tracer.magnitude);
                    let [walked, searched] = [
                        tracer.search(&ray, side, point.cell, first),
                        tracer.search_blocks(&ray, &all, point.cell, first),
                    ]
                    .map(|found| found.map(|(t, cell)| (t, cell.at)));
                    assert_eq!(walked, searched, "{size:?} {boundary:?}, ray {k}, {side:?}: {ray:?}");
                }
            }
        }
    }
}
