//! A ray's walk over the first tiles from its start, tile by tile.
//!
//! Most rays that leave a surface meet it again within a few cells or rise above their surroundings: going from one tile of
//! 4 × 4 cells to the next, a few instructions each, finds that out sooner than a search of the pyramid from its top.

use super::wide_ray::{Padded, WideRay};

/// Where a walk is: all in scalars, to stay in registers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walk {
    /// The tile, and the way to the next along u and v: 1 or −1, wrapping.
    tile: [u32; 2],
    way: [u32; 2],
    /// t where the ray leaves the tile through its sides along u and v, and from there to the next sides.
    t: [f32; 2],
    pace: [f32; 2],
    /// t where the ray enters the tile, and where the walk ends.
    t_in: f32,
    t_stop: f32,
    /// Height of the ray less its padding, and its climb: the part of a descent and that of an ascent.
    z: f32,
    fall: f32,
    rise: f32,
}

/// Bound on the relative rounding between two t of a walk: each is off by three roundings of 6e-8 and one more a tile.
const WALK_PADDING: f32 = 4e-6;
/// Cells that a walk goes along u or v at most: 16 tiles. Half of it took 5 % longer on twill and rocks, more was no faster.
const WALK_CELLS: f32 = 64.0;

impl Walk {
    /// The walk from the tile of `cell`, where the ray starts, on a map of `size` cells.
    #[inline(always)]
    pub(super) fn new(ray: &WideRay, cell: [i32; 2], size: [i32; 2]) -> Self {
        let forward = ray.forward();
        let t = |axis: usize, side: i32| ray.t_at(axis, (side - cell[axis]) as f32);
        let side = |axis: usize| (cell[axis] & !3) + 4 * forward[axis];
        let border = |axis: usize| forward[axis] * size[axis];
        let Padded { z, fall, rise, t_end } = ray.padded();
        let pace = ray.pace();
        let reach = t(0, border(0)).min(t(1, border(1))).min(WALK_CELLS * pace[0].min(pace[1]));
        Self {
            tile: cell.map(|x| x as u32 >> 2),
            way: forward.map(|forward| (2 * forward - 1) as u32),
            t: [t(0, side(0)), t(1, side(1))],
            pace: pace.map(|pace| 4.0 * pace),
            t_in: 0.0,
            // Short of the border: rounding may not step over it.
            t_stop: (reach * (1.0 - WALK_PADDING)).min(t_end),
            z,
            fall,
            rise,
        }
    }

    /// The tile that the walk is at.
    #[inline(always)]
    pub(super) fn tile(&self) -> [u32; 2] {
        self.tile
    }

    /// Lowest height of the ray over the tile.
    #[inline(always)]
    pub(super) fn lowest(&self) -> f32 {
        let t_out = self.t_out();
        let t_out = if t_out < self.t_stop { t_out } else { self.t_stop };
        self.z + (self.t_in * self.rise + t_out * self.fall)
    }

    /// Goes on to the next tile; `false` where the walk ends, or passes a corner of tiles so closely that rounding decides
    /// which side of it: there, both tiles beside the corner count.
    #[inline(always)]
    pub(super) fn advance(&mut self) -> bool {
        let t_out = self.t_out();
        if t_out >= self.t_stop || (self.t[0] - self.t[1]).abs() <= WALK_PADDING * t_out {
            return false;
        }
        // Along u or along v as factors: a branch would be wrong every other time.
        let u = u8::from(self.t[0] < self.t[1]);
        let v = 1 - u;
        self.t = [self.t[0] + self.pace[0] * f32::from(u), self.t[1] + self.pace[1] * f32::from(v)];
        self.tile = [0, 1].map(|axis| self.tile[axis].wrapping_add(self.way[axis] * u32::from([u, v][axis])));
        self.t_in = t_out;
        true
    }

    /// t before which there is nothing to meet, once [`Self::advance`] says no; `None` if the ray ends there as well.
    #[inline(always)]
    pub(super) fn rest(&self, ray: &WideRay) -> Option<f32> {
        // Where rounding decides whether the ray ends over this tile, it does not.
        let t_end = ray.padded().t_end;
        let ended = self.t_stop >= t_end && self.t_out() * (1.0 - WALK_PADDING) > t_end;
        (!ended).then_some(self.t_in * (1.0 - WALK_PADDING))
    }

    /// t where the ray leaves the tile. `f32::min` would look for NaN.
    #[inline(always)]
    fn t_out(&self) -> f32 {
        if self.t[0] < self.t[1] { self.t[0] } else { self.t[1] }
    }
}
