//! One ray against four boxes or four cells at once, in `f32`: tests that err on the side of meeting.

use glam::Vec4;

use super::patch::{CellRay, Side};

/// A [`CellRay`] for squares in rows of four; rows are counted along the ray, columns along u.
///
/// A ray that starts below the surface is mirrored at z = 0 together with the surface: every ray is stopped by what
/// rises over it.
#[derive(Clone, Copy, Debug)]
pub(super) struct WideRay {
    /// Where it starts, and cells along u and v per metre of t.
    start: [Vec4; 2],
    dir: [Vec4; 2],
    /// 1 / `dir`, and the same widened by [`SPAN_PADDING`].
    inv: [Vec4; 2],
    inv_out: [Vec4; 2],
    /// Where the ray enters a square along u and v: 0 or 1.
    near: [f32; 2],
    /// Rows along v in the order along the ray.
    rows: Vec4,
    /// Mirrored height of the start less what rounding may add to a gap, metres.
    z: Vec4,
    /// Mirrored climb, and its part in a descent and in an ascent.
    dz: Vec4,
    fall: Vec4,
    rise: Vec4,
    t_start: Vec4,
    t_end: Vec4,
    mirror: Vec4,
    /// What makes the twist of a cell the curvature of the gap.
    bend: Vec4,
    side: Side,
    /// Column and row `k ^ flip` along u and v is the k-th along the ray.
    flip: [u32; 2],
}

/// A walk of a ray from square to square, in scalars.
pub(super) struct Walk {
    start: [f32; 2],
    inv: [f32; 2],
    /// Planes where the ray leaves the square, and the way to the next, in cells from its start.
    plane: [f32; 2],
    pace: [f32; 2],
    way: [i32; 2],
    z: f32,
    rise: f32,
    fall: f32,
    pub(super) t_in: f32,
    t_end: f32,
}

pub(super) struct Step {
    t: [f32; 2],
    pub(super) t_out: f32,
    pub(super) ended: bool,
    pub(super) tie: bool,
}

impl Walk {
    #[inline(always)]
    pub(super) fn step(&self) -> Step {
        let t = [(self.plane[0] - self.start[0]) * self.inv[0], (self.plane[1] - self.start[1]) * self.inv[1]];
        let t_out = t[0].min(t[1]);
        Step { t, t_out, ended: t_out >= self.t_end, tie: (t[0] - t[1]).abs() <= 1e-6 * t_out }
    }
    #[inline(always)]
    pub(super) fn lowest(&self, t_out: f32) -> f32 {
        self.z + (self.t_in * self.rise + t_out.min(self.t_end) * self.fall)
    }
    #[inline(always)]
    pub(super) fn advance(&mut self, step: &Step) -> [i32; 2] {
        let u = i32::from(step.t[0] < step.t[1]);
        let v = 1 - u;
        self.plane = [self.plane[0] + self.pace[0] * u as f32, self.plane[1] + self.pace[1] * v as f32];
        self.t_in = step.t_out;
        [self.way[0] & -u, self.way[1] & -v]
    }
}

impl WideRay {
    #[inline(always)]
    pub(super) fn tile_walk(&self, corner: [i32; 2]) -> Walk {
        let forward = [0, 1].map(|k| 1.0 - self.near[k]);
        let way = [1 - 2 * self.near[0] as i32, 1 - 2 * self.near[1] as i32];
        Walk {
            start: [self.start[0].x, self.start[1].x],
            inv: [self.inv[0].x, self.inv[1].x],
            plane: [corner[0] as f32 + 4.0 * forward[0], corner[1] as f32 + 4.0 * forward[1]],
            pace: [4.0 * way[0] as f32, 4.0 * way[1] as f32],
            way,
            z: self.z.x,
            rise: self.rise.x,
            fall: self.fall.x,
            t_in: 0.0,
            t_end: self.t_end.x,
        }
    }

    #[inline(always)]
    pub(super) fn starting_at(mut self, t: f32) -> Self {
        self.t_start = Vec4::splat(t * (1.0 - 4e-6));
        self
    }
}

/// Where a ray is over four columns and four rows of squares: t of entry and of exit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slabs {
    columns: [Vec4; 2],
    rows: [Vec4; 2],
}

/// What bounds the rounding of a gap in `f32`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Magnitude {
    /// Largest |height|, metres.
    pub(super) height: f64,
    /// Largest step between neighbouring vertices, metres.
    pub(super) step: f64,
}

/// Relative widening of exits: t of a plane in `f32` is off by at most 3 roundings of 6e-8 of itself.
const SPAN_PADDING: f32 = 1e-6;
/// Bound on the rounding of a gap, in units of the largest height and of the largest step times the cells gone.
///
/// Heights along the ray are off by at most 8 roundings of 6e-8, places by 5 and by the widening of exits; a place comes in
/// four times, twice along each axis.
const GAP_PADDING: f64 = 1e-5;
/// First set bit of four, and last.
const FIRST_COLUMN: [[u8; 16]; 2] =
    [[0, 0, 1, 0, 2, 0, 1, 0, 3, 0, 1, 0, 2, 0, 1, 0], [0, 0, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 3, 3, 3, 3]];
const LANES: Vec4 = Vec4::new(0.0, 1.0, 2.0, 3.0);

impl WideRay {
    #[inline(always)]
    pub(super) fn new(ray: &CellRay, side: Side, magnitude: Magnitude) -> Self {
        let backward = ray.inv.map(|inv| inv < 0.0);
        let near = backward.map(|backward| f32::from(u8::from(backward)));
        let mirror = if side == Side::Above { 1.0 } else { -1.0 };
        let cells = 1.0 + ray.t_end * ray.dir[0].abs().max(ray.dir[1].abs());
        let padding = GAP_PADDING * (magnitude.height + magnitude.step * cells);
        let dz = (mirror * ray.dz) as f32;
        let inv = ray.inv.map(|x| x as f32);
        Self {
            start: ray.start.map(|x| Vec4::splat(x as f32)),
            dir: ray.dir.map(|x| Vec4::splat(x as f32)),
            inv: inv.map(Vec4::splat),
            inv_out: inv.map(|x| Vec4::splat(x * (1.0 + SPAN_PADDING))),
            near,
            rows: (LANES - 3.0 * near[1]).abs(),
            z: Vec4::splat((mirror * ray.z - padding) as f32),
            dz: Vec4::splat(dz),
            fall: Vec4::splat(dz.min(0.0)),
            rise: Vec4::splat(dz.max(0.0)),
            t_start: Vec4::ZERO,
            t_end: Vec4::splat(ray.t_end as f32 * (1.0 + SPAN_PADDING)),
            mirror: Vec4::splat(mirror as f32),
            bend: Vec4::splat((0.5 * mirror * ray.dir[0] * ray.dir[1]) as f32),
            side,
            flip: backward.map(|backward| 3 * u32::from(backward)),
        }
    }

    /// The side that the ray comes from.
    #[inline(always)]
    pub(super) fn side(&self) -> Side {
        self.side
    }

    /// The ray over 4 × 4 squares of `size` cells, the first at `corner`.
    #[inline(always)]
    pub(super) fn slabs(&self, corner: [i32; 2], size: f32) -> Slabs {
        // The planes are whole numbers and exact; the one rounding of the difference is relative to it.
        let both = |axis: usize, squares: Vec4| {
            let (squares, corner) = (squares * size, corner[axis] as f32);
            let side = size * self.near[axis];
            let enter = squares + Vec4::splat(corner + side) - self.start[axis];
            let leave = squares + Vec4::splat(corner + (size - side)) - self.start[axis];
            [enter * self.inv[axis], leave * self.inv_out[axis]]
        };
        let [first, last] = both(0, LANES);
        Slabs { columns: [first.max(self.t_start), last.min(self.t_end)], rows: both(1, self.rows) }
    }

    /// Which of 4 × 4 boxes as high as `highest` the ray may meet: bits 4·k + column, the k-th row along the ray.
    #[inline(always)]
    pub(super) fn meets(&self, slabs: &Slabs, highest: &[[f32; 4]; 4]) -> u32 {
        let mut met = 0;
        for k in 0..4 {
            let row = (k as u32 ^ self.flip[1]) as usize & 3;
            let [t_in, t_out] = slabs.row(k);
            let lowest = t_in * self.rise + t_out * self.fall + self.z;
            met |= (t_in.cmple(t_out) & lowest.cmple(Vec4::from_array(highest[row]))).bitmask() << (4 * k);
        }
        met
    }

    /// Which of four rows as high as `highest` the ray may meet; bits in the order along the ray.
    #[inline(always)]
    pub(super) fn meets_rows(&self, slabs: &Slabs, highest: f32) -> u32 {
        let [first, last] = [slabs.columns[0].min_element(), slabs.columns[1].max_element()];
        let (t_in, t_out) = (slabs.rows[0].max(Vec4::splat(first)), slabs.rows[1].min(Vec4::splat(last)));
        let lowest = t_in * self.rise + t_out * self.fall + self.z;
        (t_in.cmple(t_out) & lowest.cmple(Vec4::splat(highest))).bitmask()
    }

    /// Which of the four cells of the `k`-th row along the ray, row `row` of those at `corner`, the ray may dip below; bits
    /// along u. `corners` are `[h00, h10, h01, h11][cell]`.
    ///
    /// The gap as in `patch`, a Bernstein quadratic over the part of the ray over each cell: it is positive where all
    /// three coefficients are. NaN corners are never met.
    #[inline(always)]
    pub(super) fn dips(&self, slabs: &Slabs, k: usize, corner: [i32; 2], corners: [Vec4; 4]) -> u32 {
        let [h00, h10, h01, h11] = corners;
        let [t_in, t_out] = slabs.row(k);
        let (along_u, along_v) = (h10 - h00, h01 - h00);
        let twist = (h11 - h01) - along_u;
        let first_u = self.start[0] - Vec4::splat(corner[0] as f32) - LANES;
        let first_v = self.start[1] - Vec4::splat(corner[1] as f32);
        let gap = |t: Vec4| {
            let [s, f] = [t * self.dir[0] + first_u, t * self.dir[1] + first_v];
            let height = h00 + along_u * s + (along_v + twist * s) * f;
            t * self.dz + self.z - height * self.mirror
        };
        let (g0, g2) = (gap(t_in), gap(t_out));
        let length = t_out - t_in;
        let g1 = (g0 + g2) * 0.5 + twist * self.bend * (length * length);
        (t_in.cmple(t_out) & g0.min(g1).min(g2).cmple(Vec4::ZERO)).bitmask()
    }

    /// Column and row of the first of 4 × 4 squares along the ray; `met` as [`Self::meets`] gives it, not empty.
    #[inline(always)]
    pub(super) fn first_square(&self, met: u32) -> (u32, [u32; 2]) {
        let k = met.trailing_zeros() >> 2;
        let column = self.first_column(met >> (4 * k) & 15);
        (met ^ (1 << (4 * k + column)), [column, self.row(k)])
    }

    /// The k-th row along the ray.
    #[inline(always)]
    pub(super) fn row(&self, k: u32) -> u32 {
        k ^ self.flip[1]
    }

    /// The first of the columns along the ray; `columns` are bits along u, at least one.
    #[inline(always)]
    pub(super) fn first_column(&self, columns: u32) -> u32 {
        u32::from(FIRST_COLUMN[(self.flip[0] & 1) as usize][(columns & 15) as usize])
    }
}

impl Slabs {
    /// t of entry and exit over the squares of the k-th row; empty where the first exceeds the second.
    #[inline(always)]
    fn row(&self, k: usize) -> [Vec4; 2] {
        let [first, last] = self.rows.map(|t| Vec4::splat(t.to_array()[k]));
        [self.columns[0].max(first), self.columns[1].min(last)]
    }
}
