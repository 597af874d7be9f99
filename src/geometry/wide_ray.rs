//! One ray against four boxes or four cells at once, in `f32`: tests that err on the side of meeting.

use glam::Vec4;

use super::patch::{CellRay, Side};

/// A [`CellRay`] for squares in rows of four.
///
/// A ray that starts below the surface is mirrored at z = 0 together with the surface: every ray is stopped by what
/// rises over it.
#[derive(Clone, Copy, Debug)]
pub(super) struct WideRay {
    start: [f32; 2],
    dir: [f32; 2],
    /// 1 / `dir`, and the same widened by [`SPAN_PADDING`].
    inv: [f32; 2],
    inv_out: [f32; 2],
    /// Planes where the ray enters and leaves each of four squares in a row, in squares; `[u, v]`.
    enter: [Vec4; 2],
    leave: [Vec4; 2],
    /// Mirrored height of the start less what rounding may add to a gap, metres.
    z: f32,
    /// Mirrored climb, and its part in a descent and in an ascent.
    dz: f32,
    fall: f32,
    rise: f32,
    t_end: f32,
    mirror: f32,
    /// What makes the twist of a cell the curvature of the gap.
    bend: f32,
    side: Side,
    /// Whether the ray runs against u and v.
    backward: [bool; 2],
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
/// Bits of a row of four squares in the order along the ray: forward and backward.
const ORDER: [[u8; 16]; 2] =
    [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15], [0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15]];
const LANES: Vec4 = Vec4::new(0.0, 1.0, 2.0, 3.0);

impl WideRay {
    #[inline(always)]
    pub(super) fn new(ray: &CellRay, side: Side, magnitude: Magnitude) -> Self {
        let backward = ray.inv.map(|inv| inv < 0.0);
        let near = backward.map(|backward| if backward { 1.0 } else { 0.0 });
        let mirror = if side == Side::Above { 1.0 } else { -1.0 };
        let cells = 1.0 + ray.t_end * ray.dir[0].abs().max(ray.dir[1].abs());
        let padding = GAP_PADDING * (magnitude.height + magnitude.step * cells);
        let dz = (mirror * ray.dz) as f32;
        let inv = ray.inv.map(|x| x as f32);
        Self {
            start: ray.start.map(|x| x as f32),
            dir: ray.dir.map(|x| x as f32),
            inv,
            inv_out: inv.map(|x| x * (1.0 + SPAN_PADDING)),
            enter: near.map(|near| LANES + near),
            leave: near.map(|near| LANES + (1.0 - near)),
            z: (mirror * ray.z - padding) as f32,
            dz,
            fall: dz.min(0.0),
            rise: dz.max(0.0),
            t_end: ray.t_end as f32 * (1.0 + SPAN_PADDING),
            mirror: mirror as f32,
            bend: (mirror * ray.dir[0] * ray.dir[1]) as f32,
            side,
            backward,
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
        let t = |axis: usize, planes: [Vec4; 2], inv: [f32; 2]| {
            // The plane is a whole number and exact; one rounding of the difference is relative to it.
            (planes[axis] * size + corner[axis] as f32 - self.start[axis]) * inv[axis]
        };
        let first = t(0, self.enter, self.inv).max(Vec4::ZERO);
        let last = t(0, self.leave, self.inv_out).min(Vec4::splat(self.t_end));
        Slabs { columns: [first, last], rows: [t(1, self.enter, self.inv), t(1, self.leave, self.inv_out)] }
    }

    /// Which of 4 × 4 boxes as high as `highest` the ray may meet; bits in the order along the ray.
    #[inline(always)]
    pub(super) fn meets(&self, slabs: &Slabs, highest: &[Vec4; 4]) -> u32 {
        let mut met = 0;
        for (k, &high) in highest.iter().enumerate() {
            let [t_in, t_out] = slabs.row(k);
            let lowest = t_in * self.rise + t_out * self.fall + self.z;
            met |= self.ordered((t_in.cmple(t_out) & lowest.cmple(high)).bitmask(), k);
        }
        met
    }

    /// Which of four cells of row `row` the ray may dip below; `corners` are `[h00, h10, h01, h11][cell]`.
    ///
    /// The gap as in `patch`, a Bernstein quadratic over the part of the ray over each cell: it is positive where all
    /// three coefficients are. NaN corners are never met.
    #[inline(always)]
    pub(super) fn dips(&self, slabs: &Slabs, corner: [i32; 2], row: usize, corners: [Vec4; 4]) -> u32 {
        let [h00, h10, h01, h11] = corners;
        let [t_in, t_out] = slabs.row(row);
        let (along_u, along_v) = (h10 - h00, h01 - h00);
        let twist = (h11 - h01) - along_u;
        let first = [0, 1].map(|axis| self.start[axis] - corner[axis] as f32);
        let (first_u, first_v) = (first[0] - LANES, first[1] - row as f32);
        let gap = |t: Vec4| {
            let [s, f] = [t * self.dir[0] + first_u, t * self.dir[1] + first_v];
            let height = h00 + along_u * s + (along_v + twist * s) * f;
            t * self.dz + self.z - height * self.mirror
        };
        let (g0, g2) = (gap(t_in), gap(t_out));
        let length = t_out - t_in;
        let g1 = (g0 + g2 + twist * self.bend * length * length) * 0.5;
        (t_in.cmple(t_out) & g0.min(g1).min(g2).cmple(Vec4::ZERO)).bitmask()
    }

    /// Bits of row `row` of 4 × 4 squares as bits of all in the order along the ray.
    #[inline(always)]
    pub(super) fn ordered(&self, row_bits: u32, row: usize) -> u32 {
        let place = if self.backward[1] { 3 - row } else { row };
        u32::from(ORDER[usize::from(self.backward[0])][(row_bits & 15) as usize]) << (4 * place)
    }

    /// Column and row of the k-th of 4 × 4 squares along the ray.
    #[inline(always)]
    pub(super) fn square(&self, k: u32) -> [u32; 2] {
        let flip = self.backward.map(|backward| if backward { 3 } else { 0 });
        [(k & 3) ^ flip[0], (k >> 2) ^ flip[1]]
    }
}

impl Slabs {
    /// t of entry and exit over the squares of a row; empty where the first exceeds the second.
    #[inline(always)]
    fn row(&self, row: usize) -> [Vec4; 2] {
        [self.columns[0].max(Vec4::splat(self.rows[0][row])), self.columns[1].min(Vec4::splat(self.rows[1][row]))]
    }
}
