//! Flights by majorants: delta tracking and ratio tracking against the largest σt of each block.
//!
//! What [`super::tracking`] is measured against, and agrees with. Lengths and places are as there.

use glam::Vec3;

use super::grid::{BLOCK, Medium};
use super::tracking::{Flight, Place};
use crate::math::rng::Draws;

/// Blocks that a flight crosses at most: a ray along the plane of a cloth that repeats would never leave the air above it.
const MAX_BLOCKS: u32 = 1 << 16;

/// Transmittance under which a ratio estimate goes on by Russian roulette.
const ROULETTE: f32 = 0.05;

/// A flight under way: a place, the block that it is in, and what a step means.
struct Cursor {
    at: Vec3,
    block: [i32; 3],
    /// Voxels a unit of length.
    step: Vec3,
    inverse: Vec3,
    size: Vec3,
    blocks: [i32; 3],
    repeat: [bool; 3],
}

impl Medium {
    /// A flight from `from` along `direction` (unit) to its first collision: free-path lengths follow
    /// σt(ω)·exp(−∫σt).
    ///
    /// Delta tracking: tentative collisions at the rate of the block's majorant, kept with probability σt over it.
    #[inline]
    pub fn fly_by_majorant(&self, from: Place, direction: Vec3, draws: &mut Draws) -> Flight {
        let mut cursor = Cursor::new(self, from, direction);
        let w = direction.to_array();
        let mut flown = 0.0;
        let [u, mut accept] = draws.pair();
        let mut depth = -(1.0 - u).ln();
        for _ in 0..MAX_BLOCKS {
            let block = &self.blocks[cursor.block_index()];
            let (exit, axis) = cursor.exit();
            let mut t = 0.0;
            loop {
                let next = t + depth / block.majorant;
                if next >= exit || block.majorant == 0.0 {
                    depth -= (exit - t) * block.majorant;
                    break;
                }
                t = next;
                let at = cursor.at + t * cursor.step;
                if let Some(voxel) = block.index(cursor.bit(at))
                    && accept * block.majorant < self.sigma_t(voxel, w)
                {
                    let distance = f64::from(flown + t) * self.unit();
                    return Flight::Collision { place: Place { at }, voxel, distance };
                }
                let u;
                [u, accept] = draws.pair();
                depth = -(1.0 - u).ln();
            }
            flown += exit;
            if !cursor.cross(exit, axis) {
                break;
            }
        }
        Flight::Escape
    }

    /// An unbiased estimate of the transmittance from `from` along `direction` (unit) over `reach` metres, which may be
    /// infinite.
    ///
    /// Ratio tracking: the product of 1 − σt/majorant over tentative collisions.
    pub fn transmittance_by_majorant(&self, from: Place, direction: Vec3, reach: f64, draws: &mut Draws) -> f32 {
        let mut cursor = Cursor::new(self, from, direction);
        let w = direction.to_array();
        let mut left = (reach / self.unit()) as f32;
        let mut tr = 1.0;
        let mut depth = -(1.0 - draws.uniform()).ln();
        for _ in 0..MAX_BLOCKS {
            let block = &self.blocks[cursor.block_index()];
            let (exit, axis) = cursor.exit();
            let end = exit.min(left);
            let mut t = 0.0;
            loop {
                let next = t + depth / block.majorant;
                if next >= end || block.majorant == 0.0 {
                    depth -= (end - t) * block.majorant;
                    break;
                }
                t = next;
                let [u, survive] = draws.pair();
                depth = -(1.0 - u).ln();
                if let Some(voxel) = block.index(cursor.bit(cursor.at + t * cursor.step)) {
                    tr *= (1.0 - self.sigma_t(voxel, w) / block.majorant).max(0.0);
                    if tr < ROULETTE {
                        if survive * ROULETTE >= tr {
                            return 0.0;
                        }
                        tr = ROULETTE;
                    }
                }
            }
            left -= exit;
            if left <= 0.0 || !cursor.cross(exit, axis) {
                break;
            }
        }
        tr
    }
}

impl Cursor {
    #[inline]
    fn new(medium: &Medium, from: Place, direction: Vec3) -> Self {
        let shape = medium.shape();
        let step = Vec3::from_array(std::array::from_fn(|k| {
            (f64::from(direction[k]) * medium.unit() / shape.voxel[k]) as f32
        }));
        let blocks = shape.blocks().map(|n| n as i32);
        let block = std::array::from_fn(|k| (from.at[k] as i32 / BLOCK as i32).clamp(0, blocks[k] - 1));
        let size = Vec3::from_array(shape.size.map(|n| n as f32));
        Self { at: from.at, block, step, inverse: step.recip(), size, blocks, repeat: shape.repeat }
    }

    #[inline]
    fn block_index(&self) -> usize {
        let [x, y, z] = self.block;
        ((z * self.blocks[1] + y) * self.blocks[0] + x) as usize
    }

    /// Length to the border of the block, and the axis it lies across.
    #[inline]
    fn exit(&self) -> (f32, usize) {
        let mut nearest = (f32::INFINITY, 0);
        for k in 0..3 {
            // A step of 0 never gets to a border; 0 · ∞ is none either.
            let length = (self.border(k) - self.at[k]) * self.inverse[k];
            if self.step[k] != 0.0 && length < nearest.0 {
                nearest = (length, k);
            }
        }
        // Rounding may have put the place a hair beyond the border.
        (nearest.0.max(0.0), nearest.1)
    }

    /// The border of the block ahead along an axis, in voxels.
    #[inline]
    fn border(&self, k: usize) -> f32 {
        let low = (self.block[k] * BLOCK as i32) as f32;
        if self.step[k] > 0.0 { (low + BLOCK as f32).min(self.size[k]) } else { low }
    }

    /// Moves into the next block; false where there is none.
    #[inline]
    fn cross(&mut self, length: f32, axis: usize) -> bool {
        let border = self.border(axis);
        self.at += length * self.step;
        self.at[axis] = border;
        let ahead = self.step[axis] > 0.0;
        self.block[axis] += if ahead { 1 } else { -1 };
        if (0..self.blocks[axis]).contains(&self.block[axis]) {
            return true;
        }
        // Round the corner, where the axis repeats.
        (self.block[axis], self.at[axis]) = if ahead { (0, 0.0) } else { (self.blocks[axis] - 1, self.size[axis]) };
        self.repeat[axis]
    }

    /// The bit of the block's voxel that holds the place `at`, which rounding may have put a hair outside.
    #[inline]
    fn bit(&self, at: Vec3) -> u32 {
        let local = |k: usize| (at[k] as i32 - self.block[k] * BLOCK as i32).clamp(0, BLOCK as i32 - 1) as u32;
        (local(2) * BLOCK as u32 + local(1)) * BLOCK as u32 + local(0)
    }
}
