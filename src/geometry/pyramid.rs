//! Height bounds over 4 × 4 squares of 4 × 4 squares of … of cells, and their search by one ray.
//!
//! A node of level l covers 16·4^l cells a side and holds the bounds of its 4 × 4 children, which are tested at once; the
//! children of level 0 are the tiles of 4 × 4 cells. Rays that start anywhere wait for memory more than for arithmetic:
//! a node and a tile, one cache line each, are what a short ray reads.

use std::hint::black_box;

use glam::Vec4;

use super::HeightField;
use super::patch::{Patch, Side};
use super::tiles::{TILE, Tiles};
use super::wide_ray::WideRay;

/// Bounds of a node's 4 × 4 children, a row each: the highest heights, and those of the mirrored surface.
///
/// Children outside of the map have −∞ and are never met.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Node([[Vec4; 4]; 2]);

/// Where a level lies within the nodes, and its nodes a row.
#[derive(Clone, Copy, Debug)]
struct LevelSpan {
    offset: usize,
    width: usize,
}

/// Height bounds of all cells and the heights themselves.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    tiles: Tiles,
    nodes: Vec<Node>,
    levels: Vec<LevelSpan>,
}

/// Levels that may wait: 16·4^12 cells are more than any map has.
const LEVELS: usize = 13;
/// log2 of the cells that a node of level 0 covers along each axis.
const NODE_BITS: u32 = 4;

/// log2 of the cells that a node covers along each axis.
#[inline(always)]
pub(super) fn cell_bits(level: u32) -> u32 {
    NODE_BITS + 2 * level
}

/// A block to search: a node, and where cell (0, 0) of its tile lies from the cell that the ray starts in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    pub(super) level: u32,
    pub(super) node: [u32; 2],
    pub(super) tile: [i32; 2],
}

/// A cell that the ray may meet: the cell of the map and its bilinear patch from where the ray starts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub(super) cell: [u32; 2],
    pub(super) at: [i32; 2],
    pub(super) patch: Patch,
}

impl Pyramid {
    pub(super) fn new(heights: &HeightField) -> Self {
        let mut pyramid = Self { tiles: Tiles::new(heights), nodes: Vec::new(), levels: Vec::new() };
        let mut width = heights.size().map(|n| n.div_ceil(TILE));
        let mut bounds = tile_bounds(heights, width);
        while pyramid.levels.is_empty() || width != [1, 1] {
            (bounds, width) = pyramid.push_level(&bounds, width);
        }
        pyramid.nodes.shrink_to_fit();
        pyramid
    }

    /// Appends the nodes above `bounds` (of `width` columns and rows); returns their own bounds and width.
    fn push_level(&mut self, bounds: &[[f32; 2]], width: [usize; 2]) -> (Vec<[f32; 2]>, [usize; 2]) {
        let [columns, rows] = width.map(|n| n.div_ceil(4));
        self.levels.push(LevelSpan { offset: self.nodes.len(), width: columns });
        let mut own = Vec::with_capacity(columns * rows);
        for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
            let mut node = Node([[Vec4::NEG_INFINITY; 4]; 2]);
            for (j, i) in (0..4).flat_map(|j| (0..4).map(move |i| (j, i))) {
                if 4 * x + i < width[0] && 4 * y + j < width[1] {
                    let both = bounds[(4 * y + j) * width[0] + 4 * x + i];
                    (node.0[0][j][i], node.0[1][j][i]) = (both[0], both[1]);
                }
            }
            let highest = |rows: [Vec4; 4]| rows[0].max(rows[1]).max(rows[2].max(rows[3])).max_element();
            own.push(node.0.map(highest));
            self.nodes.push(node);
        }
        (own, [columns, rows])
    }

    /// The level that one node covers the whole map at.
    pub(super) fn top(&self) -> u32 {
        self.levels.len() as u32 - 1
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.tiles.bytes() + self.nodes.capacity() * size_of::<Node>()
    }

    /// Corner heights `[h00, h10, h01, h11]` of a cell.
    #[inline(always)]
    pub(super) fn corners(&self, cell: [usize; 2]) -> [f32; 4] {
        self.tiles.corners(cell.map(|x| x as u32))
    }

    /// Asks for what a ray from `cell` reads first at once; the search would wait for it piece by piece.
    #[inline(always)]
    pub(super) fn touch(&self, cell: [usize; 2]) {
        let cell = cell.map(|x| x as u32);
        let [x, y] = cell.map(|x| x >> NODE_BITS);
        black_box(self.node(0, x, y).0[0][0].x);
        self.tiles.touch(cell);
    }

    #[inline(always)]
    fn node(&self, level: u32, x: u32, y: u32) -> &Node {
        let span = self.levels[level as usize];
        &self.nodes[span.offset + y as usize * span.width + x as usize]
    }

    /// The first `Some` that `leaf` gives for the cells under `block` that the ray may meet, front to back.
    #[inline(always)]
    pub(super) fn search<R>(&self, ray: &WideRay, block: Block, leaf: impl Fn(&Candidate) -> Option<R>) -> Option<R> {
        let mut waiting = [0u32; LEVELS];
        let Block { mut level, node: [mut x, mut y], tile } = block;
        let place = |x: u32, y: u32, bits: u32| [(x << bits) as i32 + tile[0], (y << bits) as i32 + tile[1]];
        let mut met = self.children(ray, level, [x, y], place(x, y, cell_bits(level)));
        loop {
            if met == 0 {
                if level == block.level {
                    return None;
                }
                (level, x, y) = (level + 1, x >> 2, y >> 2);
                met = waiting[level as usize];
                continue;
            }
            let [column, row] = ray.square(met.trailing_zeros());
            met &= met - 1;
            let child = [4 * x + column, 4 * y + row];
            if level > 0 {
                waiting[level as usize] = met;
                (level, [x, y]) = (level - 1, child);
                met = self.children(ray, level, child, place(x, y, cell_bits(level)));
                continue;
            }
            let found = self.search_tile(ray, child, place(child[0], child[1], 2), &leaf);
            if found.is_some() {
                return found;
            }
        }
    }

    /// The children of a node that the ray may meet.
    #[inline(always)]
    fn children(&self, ray: &WideRay, level: u32, [x, y]: [u32; 2], corner: [i32; 2]) -> u32 {
        let slabs = ray.slabs(corner, (1u32 << (cell_bits(level) - 2)) as f32);
        ray.meets(&slabs, &self.node(level, x, y).0[usize::from(ray.side() == Side::Below)])
    }

    #[inline(always)]
    fn search_tile<R>(
        &self,
        ray: &WideRay,
        tile: [u32; 2],
        corner: [i32; 2],
        leaf: impl Fn(&Candidate) -> Option<R>,
    ) -> Option<R> {
        let mut met = self.tiles.candidates(ray, tile, corner);
        while met != 0 {
            let [column, row] = ray.square(met.trailing_zeros());
            met &= met - 1;
            let cell = [4 * tile[0] + column, 4 * tile[1] + row];
            let at = [corner[0] + column as i32, corner[1] + row as i32];
            let patch = Patch { corners: self.tiles.corners(cell).map(f64::from), cell: at.map(f64::from) };
            let found = leaf(&Candidate { cell, at, patch });
            if found.is_some() {
                return found;
            }
        }
        None
    }
}

/// Highest height over every 4 × 4 cells, and that of the mirrored surface; `[v][u]`.
fn tile_bounds(heights: &HeightField, [columns, rows]: [usize; 2]) -> Vec<[f32; 2]> {
    let size = heights.size();
    let bounds = |k: usize| {
        let first = [TILE * (k % columns), TILE * (k / columns)];
        let last = [0, 1].map(|axis| (first[axis] + TILE).min(size[axis]));
        let mut both = [f32::NEG_INFINITY; 2];
        for (j, i) in (first[1]..=last[1]).flat_map(|j| (first[0]..=last[0]).map(move |i| (j, i))) {
            let h = heights.vertex(i, j);
            both = [both[0].max(h), both[1].max(-h)];
        }
        both
    };
    (0..columns * rows).map(bounds).collect()
}
