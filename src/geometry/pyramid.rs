//! Height bounds over 4 × 4 squares of 4 × 4 squares of … of cells, and their search by one ray.
//!
//! A node of level l covers 16·4^l cells a side and holds the bounds of its 4 × 4 children, which are tested at once; the
//! children of level 0 are the tiles of 4 × 4 cells. Rays that start anywhere wait for memory more than for arithmetic:
//! a node and a tile, one cache line each, are what a short ray reads.

use std::hint::black_box;

use super::HeightField;
use super::panels::Panels;
use super::patch::{Patch, Side};
use super::wide_ray::{Walk, WideRay};

/// Bounds of a node's 4 × 4 children, a row each: the highest heights, and those of the mirrored surface.
///
/// Children outside of the map have −∞ and are never met.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Node([[[f32; 4]; 4]; 2]);

/// Where a level lies within the nodes, and its nodes a row.
#[derive(Clone, Copy, Debug)]
struct LevelSpan {
    offset: usize,
    width: usize,
}

/// Height bounds of all cells and the heights themselves.
#[derive(Clone, Debug)]
pub(super) struct Pyramid {
    panels: Panels,
    nodes: Vec<Node>,
    levels: Vec<LevelSpan>,
    /// Cells along u and v.
    size: [i32; 2],
}

/// How a walk ended.
pub(super) enum Walked<R> {
    Found(R),
    Missed,
    /// Nothing met before t.
    Unfinished(f32),
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

impl Block {
    /// The block of `level` with `cell`, for a ray that starts in that cell.
    #[inline(always)]
    pub(super) fn new(level: u32, cell: [usize; 2]) -> Self {
        let [i, j] = [cell[0] as i32, cell[1] as i32];
        Self { level, node: [i as u32 >> cell_bits(level), j as u32 >> cell_bits(level)], tile: [-i, -j] }
    }

    /// The side that a ray leaves through along `axis`, in cells from its first; the map is `size` cells wide.
    #[inline(always)]
    pub(super) fn far_side(&self, axis: usize, forward: bool, size: i32) -> i32 {
        let near = (self.node[axis] << cell_bits(self.level)) as i32;
        (near + (i32::from(forward) << cell_bits(self.level))).min(size) + self.tile[axis]
    }

    /// Goes to the next block along `axis`; whether that is one of the next tile of the map.
    #[inline(always)]
    pub(super) fn step(&mut self, axis: usize, forward: bool, size: i32) -> bool {
        let last = (size - 1) as u32 >> cell_bits(self.level);
        let (end, first, period) = if forward { (last, 0, size) } else { (0, last, -size) };
        let wraps = self.node[axis] == end;
        if wraps {
            (self.node[axis], self.tile[axis]) = (first, self.tile[axis] + period);
        } else {
            self.node[axis] = if forward { self.node[axis] + 1 } else { self.node[axis] - 1 };
        }
        wraps
    }
}

/// A cell that the ray may meet: of the map, and counted from where the ray starts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub(super) cell: [u32; 2],
    pub(super) at: [i32; 2],
    corners: [f32; 4],
}

impl Candidate {
    /// The bilinear patch, from where the ray starts.
    #[inline(always)]
    pub(super) fn patch(&self) -> Patch {
        Patch { corners: self.corners.map(f64::from), cell: self.at.map(f64::from) }
    }
}

impl Pyramid {
    pub(super) fn new(heights: &HeightField) -> Self {
        let mut pyramid = Self { panels: Panels::new(heights), nodes: Vec::new(), levels: Vec::new(), size: heights.size().map(|n| n as i32) };
        let mut width = heights.size().map(|n| n.div_ceil(4));
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
            let mut node = Node([[[f32::NEG_INFINITY; 4]; 4]; 2]);
            for (j, i) in (0..4).flat_map(|j| (0..4).map(move |i| (j, i))) {
                if 4 * x + i < width[0] && 4 * y + j < width[1] {
                    let both = bounds[(4 * y + j) * width[0] + 4 * x + i];
                    (node.0[0][j][i], node.0[1][j][i]) = (both[0], both[1]);
                }
            }
            own.push(node.0.map(|rows| rows.into_iter().flatten().fold(f32::NEG_INFINITY, f32::max)));
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
        self.panels.bytes() + self.nodes.capacity() * size_of::<Node>()
    }

    /// Corner heights `[h00, h10, h01, h11]` of a cell.
    #[inline(always)]
    pub(super) fn corners(&self, cell: [usize; 2]) -> [f32; 4] {
        self.panels.corners(cell)
    }

    /// Asks for what a ray from `cell` reads first at once; the search would wait for it piece by piece.
    #[inline(always)]
    pub(super) fn touch(&self, cell: [usize; 2]) {
        black_box(self.node(0, [cell[0] as u32 >> NODE_BITS, cell[1] as u32 >> NODE_BITS]).0[0][0][0]);
    }

    #[inline(always)]
    fn node(&self, level: u32, [x, y]: [u32; 2]) -> &Node {
        let span = self.levels[level as usize];
        &self.nodes[span.offset + y as usize * span.width + x as usize]
    }

    /// The first `Some` that `leaf` gives for the cells under `block` that the ray may meet, front to back.
    #[inline(always)]
    pub(super) fn search<R>(
        &self,
        ray: &WideRay,
        block: Block,
        leaf: impl Fn(&Candidate) -> Option<R>,
    ) -> Option<R> {
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
            let [column, row];
            (met, [column, row]) = ray.first_square(met);
            let child = [4 * x + column, 4 * y + row];
            if level > 0 {
                waiting[level as usize] = met;
                (level, [x, y]) = (level - 1, child);
                met = self.children(ray, level, child, place(x, y, cell_bits(level)));
                continue;
            }
            let highest = self.bounds(ray, 0, [x, y])[row as usize][column as usize];
            let found = self.search_tile(ray, child, place(child[0], child[1], 2), highest, &leaf);
            if found.is_some() {
                return found;
            }
        }
    }

    /// Walks from tile to tile from that of `cell`, for as long as that is quick.
    #[inline(always)]
    pub(super) fn walk<R>(
        &self,
        ray: &WideRay,
        cell: [usize; 2],
        leaf: impl Fn(&Candidate) -> Option<R>,
    ) -> Walked<R> {
        let first = [cell[0] as i32, cell[1] as i32];
        let mut walk = ray.walk(first, self.size);
        let nodes = &self.nodes[..self.levels.get(1).map_or(self.nodes.len(), |level| level.offset)];
        while let Some(highest) = meet(nodes, self.levels[0].width, usize::from(ray.side() == Side::Below), &mut walk) {
            let [x, y] = walk.tile;
            let corner = [4 * x - first[0], 4 * y - first[1]];
            let found = self.search_tile(ray, [x as u32, y as u32], corner, highest, &leaf);
            if let Some(found) = found {
                return Walked::Found(found);
            }
            if !walk.advance() {
                break;
            }
        }
        if ray.ends_with(&walk) { Walked::Missed } else { Walked::Unfinished(walk.t_in) }
    }

    /// The children of a node that the ray may meet.
    #[inline(always)]
    fn children(&self, ray: &WideRay, level: u32, node: [u32; 2], corner: [i32; 2]) -> u32 {
        let slabs = ray.slabs(corner, (1u32 << (cell_bits(level) - 2)) as f32);
        ray.meets(&slabs, self.bounds(ray, level, node))
    }

    /// How high the children of a node rise against the ray.
    #[inline(always)]
    fn bounds(&self, ray: &WideRay, level: u32, node: [u32; 2]) -> &[[f32; 4]; 4] {
        &self.node(level, node).0[usize::from(ray.side() == Side::Below)]
    }

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
            let k = rows.trailing_zeros() & 3;
            rows &= rows - 1;
            let row = ray.row(k);
            let at = [corner[0], corner[1] + row as i32];
            let rows_of_corners = self.panels.row_corners(tile[0] as usize, (4 * tile[1] + row) as usize);
            let mut columns = ray.dips(&slabs, k as usize, at, rows_of_corners);
            while columns != 0 {
                let column = ray.first_column(columns);
                columns ^= 1 << column;
                let cell = [4 * tile[0] + column, 4 * tile[1] + row];
                let at = [at[0] + column as i32, at[1]];
                let corners = rows_of_corners.map(|h| h.to_array()[column as usize & 3]);
                let found = leaf(&Candidate { cell, at, corners });
                if found.is_some() {
                    return found;
                }
            }
        }
        None
    }
}

/// Walks to the next tile that the ray may meet, the one it is over included; how high that tile is.
///
/// A function of its own: all of it stays in registers.
#[inline(never)]
fn meet(nodes: &[Node], width: usize, side: usize, walk: &mut Walk) -> Option<f32> {
    let mut here = *walk;
    let met = loop {
        let [x, y] = here.tile;
        let node = &nodes[(y >> 2) as usize * width + (x >> 2) as usize];
        let highest = node.0[side & 1][(y & 3) as usize][(x & 3) as usize];
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

/// Highest height over every 4 × 4 cells, and that of the mirrored surface; `[v][u]`.
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
