//! Heights in tiles of 4 × 4 vertices, and what a ray in `f32` may meet of 4 × 4 cells.
//!
//! A tile is one cache line, and 4 × 4 tiles lie together: a ray through a few cells stays on one or two pages, where
//! rows of a large map would put every vertex row on a page of its own. The test of a row of four cells is the gap of
//! [`super::patch`] in four lanes, widened by what rounding in `f32` may make of it; the cells that remain are decided in
//! `f64`.

use std::hint::black_box;

use glam::Vec4;

use super::HeightField;
use super::wide_ray::WideRay;

/// Vertices of a tile along each axis.
pub(super) const TILE: usize = 4;

/// 4 × 4 vertices, a row each.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Tile([Vec4; TILE]);

/// All vertices of a field and one more row and column: the first of the next tile of the map, or the last again.
///
/// Beyond those, vertices are NaN: no gap over a cell that has one is below anything.
#[derive(Clone, Debug)]
pub(super) struct Tiles {
    tiles: Vec<Tile>,
    /// Groups of 4 × 4 tiles a row.
    groups: u32,
}

impl Tiles {
    pub(super) fn new(heights: &HeightField) -> Self {
        let size = heights.size();
        let [columns, rows] = size.map(|n| (n.div_ceil(TILE) + 1).div_ceil(TILE));
        let none = Tile([Vec4::NAN; TILE]);
        let mut all = Self { tiles: vec![none; columns * rows * TILE * TILE], groups: columns as u32 };
        for (j, i) in (0..=size[1]).flat_map(|j| (0..=size[0]).map(move |i| (j, i))) {
            let tile = all.index((i / TILE) as u32, (j / TILE) as u32);
            all.tiles[tile].0[j % TILE][i % TILE] = heights.vertex(i, j);
        }
        all
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.tiles.capacity() * size_of::<Tile>()
    }

    #[inline(always)]
    fn index(&self, x: u32, y: u32) -> usize {
        (((y >> 2) * self.groups + (x >> 2)) << 4 | (y & 3) << 2 | (x & 3)) as usize
    }

    #[inline(always)]
    fn tile(&self, x: u32, y: u32) -> &Tile {
        &self.tiles[self.index(x, y)]
    }

    #[inline(always)]
    pub(super) fn vertex(&self, i: u32, j: u32) -> f32 {
        self.tile(i >> 2, j >> 2).0[(j & 3) as usize][(i & 3) as usize]
    }

    /// Corner heights `[h00, h10, h01, h11]` of a cell.
    #[inline(always)]
    pub(super) fn corners(&self, [i, j]: [u32; 2]) -> [f32; 4] {
        [self.vertex(i, j), self.vertex(i + 1, j), self.vertex(i, j + 1), self.vertex(i + 1, j + 1)]
    }

    /// The cells of tile (x, y) that the ray may meet: bit 4·row + column, rows and columns in the order along the ray.
    #[inline(always)]
    pub(super) fn candidates(&self, ray: &WideRay, [x, y]: [u32; 2], corner: [i32; 2]) -> u32 {
        let slabs = ray.slabs(corner, 1.0);
        let [left, right] = [self.tile(x, y), self.tile(x + 1, y)];
        let [left_end, right_end] = [self.tile(x, y + 1), self.tile(x + 1, y + 1)];
        let row = |k: usize| if k < TILE { (left.0[k], right.0[k].x) } else { (left_end.0[0], right_end.0[0].x) };
        let pair = |(h, end): (Vec4, f32)| [h, Vec4::new(h.y, h.z, h.w, end)];
        let mut found = 0;
        for k in 0..TILE {
            let ([h00, h10], [h01, h11]) = (pair(row(k)), pair(row(k + 1)));
            found |= ray.ordered(ray.dips(&slabs, corner, k, [h00, h10, h01, h11]), k);
        }
        found
    }

    /// Asks for the tiles around `cell` at once: tests would wait for them one by one.
    #[inline(always)]
    pub(super) fn touch(&self, [i, j]: [u32; 2]) {
        let [x, y] = [i >> 2, j >> 2];
        for [x, y] in [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]] {
            black_box(self.tile(x, y).0[0].x);
        }
    }
}
