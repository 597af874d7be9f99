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

/// A walk of a ray from tile to tile of 4 × 4 cells, in scalars.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    /// The tile, and the way to the next along u and v.
    pub(super) tile: [i32; 2],
    way: [i32; 2],
    /// t where the ray leaves the tile along u and v, and from there to the next plane.
    t: [f32; 2],
    pace: [f32; 2],
    /// t where the ray enters the tile and where the walk ends.
    pub(super) t_in: f32,
    t_stop: f32,
    z: f32,
    dz: [f32; 2],
}

/// Relative rounding of t after a walk: one of 6e-8 a tile and three for the first.
const WALK_PADDING: f32 = 4e-6;
/// Cells that a walk goes along either axis.
const WALK_CELLS: f32 = 64.0;

impl Walk {
    /// t where the ray leaves the tile.
    #[inline(always)]
    fn t_out(&self) -> f32 {
        if self.t[0] < self.t[1] { self.t[0] } else { self.t[1] }
    }

    /// Lowest height of the ray over the tile.
    #[inline(always)]
    pub(super) fn lowest(&self) -> f32 {
        let t_out = self.t_out();
        let t_out = if t_out < self.t_stop { t_out } else { self.t_stop };
        self.z + (self.t_in * self.dz[1] + t_out * self.dz[0])
    }

    /// Goes to the next tile; `false` where the walk ends or passes a corner of tiles so near that either way is right.
    #[inline(always)]
    pub(super) fn advance(&mut self) -> bool {
        let t_out = self.t_out();
        if t_out >= self.t_stop || (self.t[0] - self.t[1]).abs() <= WALK_PADDING * t_out {
            return false;
        }
        // Along u or along v as factors: a branch would be wrong every other time.
        let u = i32::from(self.t[0] < self.t[1]);
        let v = 1 - u;
        self.t = [self.t[0] + self.pace[0] * u as f32, self.t[1] + self.pace[1] * v as f32];
        self.tile = [self.tile[0] + self.way[0] * u, self.tile[1] + self.way[1] * v];
        self.t_in = t_out;
        true
    }
}

impl WideRay {
    /// The walk from the tile of `cell`, where the ray starts, on a map of `size` cells.
    #[inline(always)]
    pub(super) fn walk(&self, cell: [i32; 2], size: [i32; 2]) -> Walk {
        let t = |axis: usize, plane: i32| (plane as f32 - self.start[axis].x) * self.inv[axis].x;
        let forward = [0, 1].map(|axis| 1 - (self.flip[axis] & 1) as i32);
        let far = |axis: usize| (cell[axis] >> 2 << 2) + 4 * forward[axis] - cell[axis];
        let border = |axis: usize| size[axis] * forward[axis] - cell[axis];
        let pace = [self.inv[0].x.abs(), self.inv[1].x.abs()];
        let t_stop = t(0, border(0)).min(t(1, border(1))).min(WALK_CELLS * pace[0].min(pace[1]));
        // Short of the border: there, rounding may not step off the map.
        let t_stop = t_stop * (1.0 - WALK_PADDING);
        Walk {
            tile: [cell[0] >> 2, cell[1] >> 2],
            way: forward.map(|forward| 2 * forward - 1),
            t: [t(0, far(0)), t(1, far(1))],
            pace: [4.0 * pace[0], 4.0 * pace[1]],
            t_in: 0.0,
            t_stop: t_stop.min(self.t_end.x),
            z: self.z.x,
            dz: [self.fall.x, self.rise.x],
        }
    }

    /// Whether the ray ends where `walk` does.
    #[inline(always)]
    pub(super) fn ends_with(&self, walk: &Walk) -> bool {
        walk.t_stop >= self.t_end.x && walk.t_out() >= walk.t_stop
    }

    /// The ray from `t` on, which a walk has reached.
    #[inline(always)]
    pub(super) fn starting_at(mut self, t: f32) -> Self {
        self.t_start = Vec4::splat(t * (1.0 - WALK_PADDING));
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
