//! One ray against four boxes or four cells at once, in `f32`: tests that err on the side of meeting.

use glam::Vec4;

use super::patch::{CellRay, Side};

/// A [`CellRay`] for squares in rows of four; rows are counted along the ray, columns along u.
///
/// A ray that starts below the surface is mirrored at z = 0 together with the surface: every ray is stopped by what
/// rises over it. Numbers stand in all four lanes, so that none is spread out twice.
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
    /// The part of the ray that counts.
    t_start: Vec4,
    t_end: Vec4,
    /// 1 above the surface, −1 below.
    mirror: Vec4,
    /// What makes the twist of a cell half the curvature of the gap.
    bend: Vec4,
    side: Side,
    /// Column and row `k ^ flip` along u and v is the k-th along the ray.
    flip: [u32; 2],
}

/// What a walk takes over from a ray: its padded height, the parts of its climb and its end.
pub(super) struct Padded {
    pub(super) z: f32,
    pub(super) fall: f32,
    pub(super) rise: f32,
    pub(super) t_end: f32,
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
/// In roundings of 6e-8: t is off by 21 with the widening of exits, which moves the ray by 42 heights (it climbs at most
/// two of them) and its place by 21 of the cells gone, along two axes and once more in the bend; 14 for the sums.
const GAP_PADDING: f64 = 1e-5;
/// The first of the columns in four bits along u, for a ray along u and against it.
const FIRST_COLUMN: [[u8; 16]; 2] =
    [[0, 0, 1, 0, 2, 0, 1, 0, 3, 0, 1, 0, 2, 0, 1, 0], [0, 0, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 3, 3, 3, 3]];
const LANES: Vec4 = Vec4::new(0.0, 1.0, 2.0, 3.0);

impl WideRay {
    #[inline(always)]
    pub(super) fn new(ray: &CellRay, side: Side, magnitude: Magnitude) -> Self {
        let inv = ray.inv.map(|x| x as f32);
        // The sign as a number: a branch on it would be wrong every other time.
        let backward = inv.map(|inv| inv.to_bits() >> 31);
        let near = backward.map(|backward| backward as f32);
        let mirror = if side == Side::Above { 1.0 } else { -1.0 };
        let cells = 1.0 + ray.t_end * ray.dir[0].abs().max(ray.dir[1].abs());
        let padding = GAP_PADDING * (magnitude.height + magnitude.step * cells);
        let dz = (mirror * ray.dz) as f32;
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
            flip: backward.map(|backward| 3 * backward),
        }
    }

    /// The same ray, of which nothing before `t` counts.
    #[inline(always)]
    pub(super) fn from(self, t: f32) -> Self {
        Self { t_start: Vec4::splat(t), ..self }
    }

    /// The side that the ray comes from.
    #[inline(always)]
    pub(super) fn side(&self) -> Side {
        self.side
    }

    /// 1 where the ray runs along u or v, 0 where it runs against it.
    #[inline(always)]
    pub(super) fn forward(&self) -> [i32; 2] {
        self.flip.map(|flip| 1 - (flip & 1) as i32)
    }

    /// t at which the ray meets the plane at `x` cells along `axis`.
    #[inline(always)]
    pub(super) fn t_at(&self, axis: usize, x: f32) -> f32 {
        (x - self.start[axis].x) * self.inv[axis].x
    }

    /// t from one plane to the next along u and v.
    #[inline(always)]
    pub(super) fn pace(&self) -> [f32; 2] {
        self.inv.map(|inv| inv.x.abs())
    }

    /// What a walk takes over.
    #[inline(always)]
    pub(super) fn padded(&self) -> Padded {
        Padded { z: self.z.x, fall: self.fall.x, rise: self.rise.x, t_end: self.t_end.x }
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

    /// Which of 4 × 4 boxes as high as `highest` the ray may meet: bit 4·k + column, the k-th row along the ray.
    #[inline(always)]
    pub(super) fn meets(&self, slabs: &Slabs, highest: &[[f32; 4]; 4]) -> u32 {
        let mut met = 0;
        for k in 0..4 {
            let high = Vec4::from_array(highest[(self.row(k) & 3) as usize]);
            let [t_in, t_out] = slabs.row(k);
            met |= (t_in.cmple(t_out) & self.lowest(t_in, t_out).cmple(high)).bitmask() << (4 * k);
        }
        met
    }

    /// Which of four rows as high as `highest` the ray may meet: bit k for the k-th along the ray.
    #[inline(always)]
    pub(super) fn meets_rows(&self, slabs: &Slabs, highest: f32) -> u32 {
        let [first, last] = [slabs.columns[0].min_element(), slabs.columns[1].max_element()];
        let (t_in, t_out) = (slabs.rows[0].max(Vec4::splat(first)), slabs.rows[1].min(Vec4::splat(last)));
        (t_in.cmple(t_out) & self.lowest(t_in, t_out).cmple(Vec4::splat(highest))).bitmask()
    }

    /// Lowest height of the ray between `t_in` and `t_out`.
    #[inline(always)]
    fn lowest(&self, t_in: Vec4, t_out: Vec4) -> Vec4 {
        t_in * self.rise + t_out * self.fall + self.z
    }

    /// Which of the four cells of the k-th row along the ray the ray may dip below: bits along u.
    ///
    /// The gap as in `patch`, a Bernstein quadratic over the part of the ray over each cell: it is positive where all
    /// three coefficients are. `first` is the first cell of the row, counted from where the ray starts; `corners` are
    /// `[h00, h10, h01, h11][cell]`, and cells with a NaN are never met.
    #[inline(always)]
    pub(super) fn dips(&self, slabs: &Slabs, k: u32, first: [i32; 2], corners: [Vec4; 4]) -> u32 {
        let [h00, h10, h01, h11] = corners;
        let [t_in, t_out] = slabs.row(k);
        let (along_u, along_v) = (h10 - h00, h01 - h00);
        let twist = (h11 - h01) - along_u;
        let [u, v] = [0, 1].map(|axis| self.start[axis] - Vec4::splat(first[axis] as f32));
        let u = u - LANES;
        let gap = |t: Vec4| {
            let [s, f] = [t * self.dir[0] + u, t * self.dir[1] + v];
            let height = h00 + along_u * s + (along_v + twist * s) * f;
            t * self.dz + self.z - height * self.mirror
        };
        let (g0, g2) = (gap(t_in), gap(t_out));
        let length = t_out - t_in;
        let g1 = (g0 + g2) * 0.5 + twist * self.bend * (length * length);
        (t_in.cmple(t_out) & g0.min(g1).min(g2).cmple(Vec4::ZERO)).bitmask()
    }

    /// The first of 4 × 4 squares along the ray, `[column, row]`, and the rest; `met` as [`Self::meets`] gives it, not empty.
    #[inline(always)]
    pub(super) fn first_square(&self, met: u32) -> ([u32; 2], u32) {
        let k = met.trailing_zeros() >> 2;
        let column = self.first_column(met >> (4 * k) & 15);
        ([column, self.row(k)], met ^ (1 << (4 * k + column)))
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
    fn row(&self, k: u32) -> [Vec4; 2] {
        let [first, last] = self.rows.map(|t| Vec4::splat(t.to_array()[(k & 3) as usize]));
        [self.columns[0].max(first), self.columns[1].min(last)]
    }
}
