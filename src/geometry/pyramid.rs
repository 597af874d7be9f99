//! Height bounds over 4 × 4 squares of 4 × 4 squares of … of cells, and how a ray finds the cells that it meets.
//!
//! A tile is 4 × 4 cells. A node of level l covers 16·4^l cells a side and holds the bounds of its 4 × 4 children, tiles
//! for level 0. Rays that start anywhere wait for memory: a short ray reads two cache lines, the bounds of the tiles
//! around it and the heights of its own. Tests run in `f32` and err on the side of meeting; what is hit is decided
//! over the cells, in `f64`.

use super::HeightField;
use super::panels::Panels;
use super::patch::{Patch, Side};
use super::walk::Walk;
use super::wide_ray::WideRay;

/// How high a node's 4 × 4 children rise, `[v][u]`: −∞ for those outside of the map. A cache line.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Node([[f32; 4]; 4]);

/// Where a level lies within the nodes, and its nodes a row.
#[derive(Clone, Copy, Debug)]
struct LevelSpan {
    offset: usize,
    width: usize,
}

/// Height bounds of all cells, and the heights themselves.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    panels: Panels,
    /// Nodes of the surface and of the surface mirrored at z = 0, level 0 first. Most rays read the first alone.
    nodes: [Vec<Node>; 2],
    levels: Vec<LevelSpan>,
    /// Cells along u and v.
    size: [i32; 2],
}

/// log2 of the cells that a node of level 0 covers along each axis.
const NODE_BITS: u32 = 4;
/// Levels that may wait: 16·4^12 cells are more than any map has.
const LEVELS: usize = 13;

/// A block to search: a node, and where cell (0, 0) of its tile of the plane lies from the cell that the ray starts in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    level: u32,
    node: [u32; 2],
    origin: [i32; 2],
}

/// A cell that the ray may meet: of the map, and counted from where the ray starts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub(super) cell: [u32; 2],
    pub(super) at: [i32; 2],
    corners: [f32; 4],
}

/// How a walk ended.
pub(super) enum Walked<R> {
    /// With what the leaf gave.
    Found(R),
    /// At the end of the ray.
    Missed,
    /// The ray goes on; nothing is met before t.
    Unfinished(f32),
}

impl Pyramid {
    pub(super) fn new(heights: &HeightField) -> Self {
        let size = heights.size().map(|n| n as i32);
        let mut pyramid =
            Self { panels: Panels::new(heights), nodes: [const { Vec::new() }; 2], levels: Vec::new(), size };
        let mut width = heights.size().map(|n| n.div_ceil(4));
        let mut bounds = tile_bounds(heights, width);
        while pyramid.levels.is_empty() || width != [1, 1] {
            (bounds, width) = pyramid.push_level(&bounds, width);
        }
        pyramid.nodes.iter_mut().for_each(Vec::shrink_to_fit);
        pyramid
    }

    /// Appends the nodes above `bounds` (of `width` columns and rows); returns their own bounds and width.
    fn push_level(&mut self, bounds: &[[f32; 2]], width: [usize; 2]) -> (Vec<[f32; 2]>, [usize; 2]) {
        let [columns, rows] = width.map(|n| n.div_ceil(4));
        self.levels.push(LevelSpan { offset: self.nodes[0].len(), width: columns });
        let mut own = Vec::with_capacity(columns * rows);
        for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
            let mut highest = [f32::NEG_INFINITY; 2];
            for face in [0, 1] {
                let mut node = Node([[f32::NEG_INFINITY; 4]; 4]);
                for (j, i) in (0..4).flat_map(|j| (0..4).map(move |i| (j, i))) {
                    if 4 * x + i < width[0] && 4 * y + j < width[1] {
                        node.0[j][i] = bounds[(4 * y + j) * width[0] + 4 * x + i][face];
                        highest[face] = highest[face].max(node.0[j][i]);
                    }
                }
                self.nodes[face].push(node);
            }
            own.push(highest);
        }
        (own, [columns, rows])
    }

    /// The level that one node covers the whole map at.
    pub(super) fn top(&self) -> u32 {
        self.levels.len() as u32 - 1
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.panels.bytes() + self.nodes.iter().map(|nodes| nodes.capacity() * size_of::<Node>()).sum::<usize>()
    }

    /// The candidate that a ray starts in.
    pub(super) fn starting_in(&self, cell: [usize; 2]) -> Candidate {
        Candidate { cell: cell.map(|x| x as u32), at: [0; 2], corners: self.corners(cell) }
    }

    /// Corner heights `[h00, h10, h01, h11]` of a cell.
    #[inline(always)]
    pub(super) fn corners(&self, cell: [usize; 2]) -> [f32; 4] {
        self.panels.corners(cell)
    }

    /// The first `Some` that `leaf` gives for the cells that the ray may meet over the first tiles from `cell`.
    #[inline(always)]
    pub(super) fn walk<R>(&self, ray: &WideRay, cell: [usize; 2], leaf: impl Fn(&Candidate) -> Option<R>) -> Walked<R> {
        let cell = cell.map(|x| x as i32);
        let mut walk = Walk::new(ray, cell, self.size);
        let (nodes, width) = (&self.nodes[ray.side().index()][..], self.levels[0].width);
        while let Some(highest) = meet(nodes, width, &mut walk) {
            let tile = walk.tile();
            let corner = [0, 1].map(|axis| 4 * tile[axis] as i32 - cell[axis]);
            if let Some(found) = self.search_tile(ray, tile, corner, highest, &leaf) {
                return Walked::Found(found);
            }
            if !walk.advance() {
                break;
            }
        }
        walk.rest(ray).map_or(Walked::Missed, Walked::Unfinished)
    }

    /// The first `Some` that `leaf` gives for the cells under `block` that the ray may meet, front to back.
    #[inline(always)]
    pub(super) fn search<R>(&self, ray: &WideRay, block: Block, leaf: impl Fn(&Candidate) -> Option<R>) -> Option<R> {
        let mut waiting = [0u32; LEVELS];
        let (mut level, mut node) = (block.level, block.node);
        let mut met = self.children(ray, block, level, node);
        loop {
            if met == 0 {
                if level == block.level {
                    return None;
                }
                (level, node) = (level + 1, node.map(|x| x >> 2));
                met = waiting[level as usize];
                continue;
            }
            let (square, rest) = ray.first_square(met);
            let child = [4 * node[0] + square[0], 4 * node[1] + square[1]];
            met = rest;
            if level > 0 {
                waiting[level as usize] = met;
                (level, node) = (level - 1, child);
                met = self.children(ray, block, level, child);
                continue;
            }
            let highest = self.bounds(ray.side(), 0, node)[square[1] as usize][square[0] as usize];
            let found = self.search_tile(ray, child, block.place(child, 2), highest, &leaf);
            if found.is_some() {
                return found;
            }
        }
    }

    /// The children of a node under `block` that the ray may meet.
    #[inline(always)]
    fn children(&self, ray: &WideRay, block: Block, level: u32, node: [u32; 2]) -> u32 {
        let bits = cell_bits(level);
        let slabs = ray.slabs(block.place(node, bits), (1u32 << (bits - 2)) as f32);
        ray.meets(&slabs, self.bounds(ray.side(), level, node))
    }

    #[inline(always)]
    fn bounds(&self, side: Side, level: u32, [x, y]: [u32; 2]) -> &[[f32; 4]; 4] {
        let span = self.levels[level as usize];
        &self.nodes[side.index()][span.offset + y as usize * span.width + x as usize].0
    }

    /// The first `Some` that `leaf` gives for the cells of a tile, whose first cell is at `corner` from the ray's start.
    #[inline(always)]
    fn search_tile<R>(
        &self,
        ray: &WideRay,
        tile: [u32; 2],
        corner: [i32; 2],
        highest: f32,
        leaf: impl Fn(&Candidate) -> Option<R>,
    ) -> Option<R> {
        let slabs = ray.slabs(corner, 1.0);
        let mut rows = ray.meets_rows(&slabs, highest);
        while rows != 0 {
            let k = rows.trailing_zeros();
            rows &= rows - 1;
            let row = ray.row(k);
            let (j, first) = (4 * tile[1] + row, [corner[0], corner[1] + row as i32]);
            let corners = self.panels.row_corners(tile[0] as usize, j as usize);
            let mut columns = ray.dips(&slabs, k, first, corners);
            while columns != 0 {
                let column = ray.first_column(columns);
                columns ^= 1 << column;
                let candidate = Candidate {
                    cell: [4 * tile[0] + column, j],
                    at: [first[0] + column as i32, first[1]],
                    corners: corners.map(|h| h.to_array()[(column & 3) as usize]),
                };
                let found = leaf(&candidate);
                if found.is_some() {
                    return found;
                }
            }
        }
        None
    }
}

impl Block {
    /// The block of `level` with `cell`, for a ray that starts in that cell.
    pub(super) fn new(level: u32, cell: [usize; 2]) -> Self {
        Self { level, node: cell.map(|x| x as u32 >> cell_bits(level)), origin: cell.map(|x| -(x as i32)) }
    }

    /// First cell of square (x, y) of 2^`bits` cells a side, counted from where the ray starts.
    #[inline(always)]
    fn place(&self, [x, y]: [u32; 2], bits: u32) -> [i32; 2] {
        [(x << bits) as i32 + self.origin[0], (y << bits) as i32 + self.origin[1]]
    }

    /// The side that a ray leaves through along `axis`, in cells from its start; the map is `size` cells wide.
    pub(super) fn far_side(&self, axis: usize, forward: i32, size: i32) -> i32 {
        let bits = cell_bits(self.level);
        let near = (self.node[axis] << bits) as i32;
        (near + (forward << bits)).min(size) + self.origin[axis]
    }

    /// Goes to the next block along `axis`; whether that is one of the next tile of the plane.
    pub(super) fn step(&mut self, axis: usize, forward: i32, size: i32) -> bool {
        let last = (size - 1) as u32 >> cell_bits(self.level);
        let (end, first, period) = if forward == 1 { (last, 0, size) } else { (0, last, -size) };
        let wraps = self.node[axis] == end;
        if wraps {
            (self.node[axis], self.origin[axis]) = (first, self.origin[axis] + period);
        } else {
            self.node[axis] = if forward == 1 { self.node[axis] + 1 } else { self.node[axis] - 1 };
        }
        wraps
    }
}

impl Candidate {
    /// The bilinear patch, from where the ray starts.
    #[inline(always)]
    pub(super) fn patch(&self) -> Patch {
        Patch { corners: self.corners.map(f64::from), cell: self.at.map(f64::from) }
    }
}

/// log2 of the cells that a node covers along each axis.
#[inline(always)]
fn cell_bits(level: u32) -> u32 {
    NODE_BITS + 2 * level
}

/// Walks to the next tile that the ray may meet, the one it is over included: how high that tile is.
///
/// `nodes` are those of level 0, `width` of them a row. Not inlined: there is nothing here but the walk
/// itself, and all of it stays in registers.
#[inline(never)]
fn meet(nodes: &[Node], width: usize, walk: &mut Walk) -> Option<f32> {
    let mut here = *walk;
    let met = loop {
        let [x, y] = here.tile();
        let node = &nodes[(y >> 2) as usize * width + (x >> 2) as usize];
        let highest = node.0[(y & 3) as usize][(x & 3) as usize];
        if here.lowest() <= highest {
            break Some(highest);
        }
        if !here.advance() {
            break None;
        }
    };
    *walk = here;
    met
}

/// How high every tile rises, and how high the mirrored surface does; `[v][u]`.
fn tile_bounds(heights: &HeightField, [columns, rows]: [usize; 2]) -> Vec<[f32; 2]> {
    let size = heights.size();
    let bounds = |k: usize| {
        let first = [4 * (k % columns), 4 * (k / columns)];
        let last = [0, 1].map(|axis| (first[axis] + 4).min(size[axis]));
        let mut both = [f32::NEG_INFINITY; 2];
        for (j, i) in (first[1]..=last[1]).flat_map(|j| (first[0]..=last[0]).map(move |i| (j, i))) {
            let h = heights.vertex(i, j);
            both = [both[0].max(h), both[1].max(-h)];
        }
        both
    };
    (0..columns * rows).map(bounds).collect()
}
