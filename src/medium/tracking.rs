//! Free flights, exactly: from voxel to voxel with the optical depth that each adds, empty blocks skipped.
//!
//! A voxel is constant, so the depth along a ray is a sum of products, and both the place of the next collision and the
//! transmittance are known without tentative collisions: one random number a flight, and a transmittance without noise.
//! [`super::majorant`] has the tracking by majorants that this is measured against.
//!
//! Lengths are in the medium's unit, the shortest edge of a voxel; places are in voxels, so that a flight's step along an
//! axis is its direction times unit over edge.

use std::ops::ControlFlow;

use glam::{DVec3, Vec3};

use super::grid::{BLOCK, Block, Medium};
use crate::math::rng::Draws;

/// Voxels and empty blocks that a flight crosses at most: a ray along the plane of a cloth that repeats would never leave
/// the air above it.
const MAX_STEPS: u32 = 1 << 18;

/// Optical depth beyond which nothing comes through: e^−30 is 1e-13.
const OPAQUE: f32 = 30.0;

/// A point of the grid, in voxels from its corner; along axes that repeat within the first period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Voxels along x, y, z.
    pub at: Vec3,
}

/// How a flight ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Flight {
    /// At flakes.
    Collision {
        /// Where.
        place: Place,
        /// Index of the occupied voxel.
        voxel: usize,
        /// Metres flown.
        distance: f64,
    },
    /// Out of the medium.
    Escape,
}

/// A ray through the grid: the voxel that it is in, and the lengths at which it leaves it.
struct Cursor {
    /// Where the ray would have started, had it not gone round any corner.
    origin: Vec3,
    /// Voxels a unit of length, and its inverse.
    step: Vec3,
    inverse: Vec3,
    voxel: [i32; 3],
    /// Length at which the ray leaves the voxel across each axis.
    leave: [f32; 3],
    /// Length between two borders.
    stride: [f32; 3],
    size: [i32; 3],
    blocks: [i32; 3],
    repeat: [bool; 3],
}

impl Medium {
    /// The place where the ray from `origin` (metres) along `direction` (unit) first meets the grid, with the metres to it;
    /// `None` where it never does.
    pub fn enter(&self, origin: DVec3, direction: DVec3) -> Option<(Place, f64)> {
        let extent = self.shape().extent();
        let [mut near, mut far] = [0.0_f64, f64::INFINITY];
        for k in (0..3).filter(|&k| !self.shape().repeat[k]) {
            let [a, b] = [0.0, extent[k]].map(|rim| (rim - origin[k]) / direction[k]);
            if direction[k] != 0.0 {
                near = near.max(a.min(b));
                far = far.min(a.max(b));
            } else if !(0.0..=extent[k]).contains(&origin[k]) {
                return None;
            }
        }
        (near < far).then(|| (self.place(origin + direction * near), near))
    }

    /// The place of a point of the medium (metres): wrapped along axes that repeat, clamped to the rim along others.
    pub fn place(&self, point: DVec3) -> Place {
        let shape = self.shape();
        let at = std::array::from_fn(|k| {
            let [voxels, size] = [point[k] / shape.voxel[k], shape.size[k] as f64];
            let inside = if shape.repeat[k] { voxels.rem_euclid(size) } else { voxels.clamp(0.0, size) };
            inside as f32
        });
        Place { at: Vec3::from_array(at) }
    }

    /// A flight from `from` along `direction` (unit) to its first collision: lengths follow σt(ω)·exp(−∫σt).
    #[inline]
    pub fn fly(&self, from: Place, direction: Vec3, draws: &mut Draws) -> Flight {
        let w = direction.to_array();
        let mut depth = -(1.0 - draws.uniform()).ln();
        let mut cursor = Cursor::new(self, from, direction);
        let met = cursor.walk(self, f32::INFINITY, |voxel, [enter, leave]| {
            let sigma_t = self.sigma_t(voxel, w);
            let more = sigma_t * (leave - enter);
            if depth < more {
                return ControlFlow::Break((voxel, enter + depth / sigma_t));
            }
            depth -= more;
            ControlFlow::Continue(())
        });
        let Some((voxel, length)) = met else { return Flight::Escape };
        let place = Place { at: cursor.origin + length * cursor.step };
        Flight::Collision { place, voxel, distance: f64::from(length) * self.unit() }
    }

    /// The transmittance from `from` along `direction` (unit) over `reach` metres, which may be infinite.
    pub fn transmittance(&self, from: Place, direction: Vec3, reach: f64) -> f32 {
        let w = direction.to_array();
        let mut depth = 0.0;
        let mut cursor = Cursor::new(self, from, direction);
        let opaque = cursor.walk(self, (reach / self.unit()) as f32, |voxel, [enter, leave]| {
            depth += self.sigma_t(voxel, w) * (leave - enter);
            if depth > OPAQUE { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        if opaque.is_some() { 0.0 } else { (-depth).exp() }
    }
}

impl Cursor {
    #[inline]
    fn new(medium: &Medium, from: Place, direction: Vec3) -> Self {
        let shape = medium.shape();
        let step = direction * medium.steps();
        let inverse = step.recip();
        let size = shape.size.map(|n| n as i32);
        // A place on the far rim belongs to the last voxel.
        let voxel = std::array::from_fn(|k| (from.at[k] as i32).clamp(0, size[k] - 1));
        let mut cursor = Self {
            origin: from.at,
            step,
            inverse,
            voxel,
            leave: [f32::INFINITY; 3],
            stride: inverse.abs().to_array(),
            size,
            blocks: shape.blocks().map(|n| n as i32),
            repeat: shape.repeat,
        };
        (0..3).for_each(|k| cursor.leave[k] = cursor.border(k, cursor.voxel[k] + i32::from(step[k] > 0.0)));
        cursor
    }

    /// Length to the plane `at` (voxels) across an axis; a step of 0 never gets there.
    #[inline]
    fn border(&self, axis: usize, at: i32) -> f32 {
        if self.step[axis] == 0.0 { f32::INFINITY } else { (at as f32 - self.origin[axis]) * self.inverse[axis] }
    }

    /// Calls `visit` for every occupied voxel within `reach`, with the lengths at which the ray enters and leaves it, until
    /// it breaks; `None` where it never does.
    #[inline]
    fn walk<B>(
        &mut self,
        medium: &Medium,
        reach: f32,
        mut visit: impl FnMut(usize, [f32; 2]) -> ControlFlow<B>,
    ) -> Option<B> {
        let mut at = 0.0_f32;
        let mut block = self.block(medium);
        for _ in 0..MAX_STEPS {
            let mut axis = self.first_border();
            let leave = if block.occupied != 0 {
                // Rounding may put a border a hair behind the ray.
                let leave = self.leave[axis].max(at);
                if let Some(voxel) = block.index(self.bit())
                    && let ControlFlow::Break(value) = visit(voxel, [at, leave.min(reach)])
                {
                    return Some(value);
                }
                self.voxel[axis] += if self.step[axis] > 0.0 { 1 } else { -1 };
                self.leave[axis] += self.stride[axis];
                leave
            } else {
                let leave;
                (leave, axis) = self.skip(block.clearance(), at);
                leave
            };
            at = leave;
            if at >= reach || !(0..self.size[axis]).contains(&self.voxel[axis]) && !self.wrap(axis) {
                return None;
            }
            block = self.block(medium);
        }
        None
    }

    /// The axis across which the ray leaves its voxel.
    #[inline]
    fn first_border(&self) -> usize {
        let [x, y, z] = self.leave;
        if x < y {
            if x < z { 0 } else { 2 }
        } else if y < z {
            1
        } else {
            2
        }
    }

    #[inline]
    fn block<'m>(&self, medium: &'m Medium) -> &'m Block {
        let [x, y, z] = self.voxel.map(|v| v / BLOCK as i32);
        &medium.blocks[((z * self.blocks[1] + y) * self.blocks[0] + x) as usize]
    }

    /// The voxel's bit in its block.
    #[inline]
    fn bit(&self) -> u32 {
        let [x, y, z] = self.voxel.map(|v| v as u32 % BLOCK as u32);
        (z * BLOCK as u32 + y) * BLOCK as u32 + x
    }

    /// Moves out of the cube of empty blocks that reaches `clearance` blocks around this one, within the grid; returns the
    /// length there and the axis that is crossed.
    fn skip(&mut self, clearance: i32, at: f32) -> (f32, usize) {
        // Length, axis and the voxel beyond.
        let mut nearest = (f32::INFINITY, 0, 0);
        for k in 0..3 {
            let block = self.voxel[k] / BLOCK as i32;
            let (border, beyond) = if self.step[k] > 0.0 {
                let border = ((block + clearance + 1) * BLOCK as i32).min(self.size[k]);
                (border, border)
            } else {
                let border = ((block - clearance) * BLOCK as i32).max(0);
                (border, border - 1)
            };
            let length = self.border(k, border);
            if length < nearest.0 {
                nearest = (length, k, beyond);
            }
        }
        let (length, axis, beyond) = (nearest.0.max(at), nearest.1, nearest.2);
        for k in 0..3 {
            if k == axis {
                self.voxel[k] = beyond;
            } else {
                // Rounding may reach over a border that another axis has not crossed.
                self.voxel[k] = ((self.origin[k] + length * self.step[k]) as i32).clamp(0, self.size[k] - 1);
            }
            self.leave[k] = self.border(k, self.voxel[k] + i32::from(self.step[k] > 0.0));
        }
        (length, axis)
    }

    /// Round the corner, where the axis repeats; false where it does not.
    fn wrap(&mut self, axis: usize) -> bool {
        if !self.repeat[axis] {
            return false;
        }
        let size = self.size[axis];
        let back = if self.voxel[axis] < 0 { size } else { -size };
        self.voxel[axis] += back;
        self.origin[axis] += back as f32;
        true
    }
}
