//! Height bounds of a field's cells as a quadtree, and its traversal by one ray.
//!
//! A node of level l covers 2^l × 2^l cells and holds the bounds of its four children, which are tested at once. Rays
//! that start anywhere wait for memory more than for arithmetic, so bounds are 16-bit codes, four siblings share a
//! cache line, and level 1 is not stored: its bounds come from the nine heights that its cells need anyway. That leaves
//! 1.4 bytes a cell. Tests run in `f32` and err on the side of visiting; what is hit is decided over the cells, in `f64`.

use std::hint::black_box;

use glam::{BVec4A, Vec4};

use super::patch::{CellRay, Patch};
use super::{Boundary, HeightField};

/// Bounds of a node's four children: (0, 0), (1, 0), (0, 1), (1, 1), first index along u; in codes.
///
/// A child that reaches out of the map has a `min` below all heights, so that nothing is below it there; one wholly
/// outside has such a `max` as well and is never met.
#[derive(Clone, Copy, Debug)]
struct Node {
    max: [u16; 4],
    min: [u16; 4],
}

/// Four siblings: one cache line.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Siblings([Node; 4]);

/// Where a level lies within the nodes, and its siblings a row.
#[derive(Clone, Copy, Debug)]
struct LevelSpan {
    offset: usize,
    width: usize,
}

/// Heights as codes: `code = FLOOR + (h − base)·scale`.
#[derive(Clone, Copy, Debug)]
struct Codes {
    base: f32,
    scale: f32,
}

/// Height bounds of all cells, coarse to fine.
#[derive(Clone, Debug)]
pub(super) struct Quadtree<'a> {
    heights: &'a HeightField,
    nodes: Vec<Siblings>,
    /// Level l at index l − 2.
    levels: Vec<LevelSpan>,
    codes: Codes,
    top: u32,
    /// What stands for a vertex index beyond the last: the first of the next tile, or the last again.
    beyond: [usize; 2],
}

/// Code of the lowest height; codes below it stand for −∞.
const FLOOR: f32 = 2.0;
/// Codes from the lowest to the highest height: with both margins within 16 bits.
const CODE_RANGE: f32 = 65_530.0;
/// Bounds are widened by this many codes: z(t) in `f32` is off by at most 8 roundings of 6e-8 of the range, 0.03 codes.
const CODE_PADDING: f32 = 0.1;
/// Relative widening of intervals of t: t of a plane in `f32` is off by at most 3 roundings of 6e-8 of itself.
const SPAN_PADDING: f32 = 1e-6;
/// Levels up to this one are too large for the nearest caches.
const TOUCHED_LEVEL: u32 = 4;
/// Nodes that may wait: three a level and 24 levels.
const STACK: usize = 80;

/// A block to search: a node, and where cell (0, 0) of its tile lies from the cell that the ray starts in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    pub(super) level: u32,
    pub(super) node: [u32; 2],
    pub(super) tile: [i32; 2],
}

/// A cell whose bounds the ray meets: the cell of the map and its bilinear patch from where the ray starts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub(super) cell: [u32; 2],
    pub(super) at: [i32; 2],
    pub(super) patch: Patch,
}

/// A [`CellRay`] in `f32`, heights in codes, with what the node test wants in four lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeRay {
    start: [f32; 2],
    inv: [f32; 2],
    /// Planes where the ray enters and leaves each child, in child sizes from the node's corner; `[u, v]`.
    enter: [Vec4; 2],
    leave: [Vec4; 2],
    z: f32,
    dz: f32,
    t_end: f32,
    /// Child `k ^ flip` is the k-th along the ray.
    flip: u32,
}

impl<'a> Quadtree<'a> {
    pub(super) fn new(heights: &'a HeightField, range: [f32; 2]) -> Self {
        let extent = range[1] - range[0];
        let scale = if extent > 0.0 { CODE_RANGE / extent } else { 0.0 };
        let codes = Codes { base: range[0], scale: if scale.is_finite() { scale } else { 0.0 } };
        let size = heights.size();
        let beyond = match heights.boundary() {
            Boundary::Repeat => [0; 2],
            Boundary::Clamp => size.map(|n| n - 1),
        };
        let mut tree = Self { heights, nodes: Vec::new(), levels: Vec::new(), codes, top: 1, beyond };
        let mut width = size.map(|n| n.div_ceil(2));
        let mut bounds = tree.quad_bounds();
        while width != [1, 1] {
            (bounds, width) = tree.push_level(&bounds, width);
        }
        tree.nodes.shrink_to_fit();
        tree
    }

    /// [min, max] codes of every 2 × 2 cells, `[v][u]`.
    fn quad_bounds(&self) -> Vec<[u16; 2]> {
        let [columns, rows] = self.heights.size().map(|n| n.div_ceil(2));
        let bounds = |k: usize| {
            let quad = self.quad((k % columns) as u32, (k / columns) as u32);
            let [min, max] = [quad.low.min_element() - CODE_PADDING, quad.high.max_element() + CODE_PADDING];
            [min.floor() as u16, max.ceil() as u16]
        };
        (0..columns * rows).map(bounds).collect()
    }

    /// Appends the nodes above `bounds` (of `width` columns and rows); returns their own bounds and width.
    fn push_level(&mut self, bounds: &[[u16; 2]], width: [usize; 2]) -> (Vec<[u16; 2]>, [usize; 2]) {
        let size = self.heights.size();
        let child_cells = 1usize << self.top;
        let [columns, rows] = width.map(|n| n.div_ceil(2));
        let span = LevelSpan { offset: self.nodes.len(), width: columns.div_ceil(2) };
        let none = Siblings([Node { max: [0; 4], min: [0; 4] }; 4]);
        self.nodes.resize(span.offset + span.width * rows.div_ceil(2), none);
        let mut own = Vec::with_capacity(columns * rows);
        for (y, x) in (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x))) {
            let mut node = Node { max: [0; 4], min: [0; 4] };
            let mut all = [u16::MAX, 0];
            for k in 0..4 {
                let [i, j] = [2 * x + (k & 1), 2 * y + (k >> 1)];
                if i < width[0] && j < width[1] {
                    let [min, max] = bounds[j * width[0] + i];
                    let inside = (i + 1) * child_cells <= size[0] && (j + 1) * child_cells <= size[1];
                    (node.min[k], node.max[k]) = (if inside { min } else { 0 }, max);
                    all = [all[0].min(min), all[1].max(max)];
                }
            }
            own.push(all);
            self.nodes[span.offset + (y >> 1) * span.width + (x >> 1)].0[(y & 1) << 1 | (x & 1)] = node;
        }
        self.levels.push(span);
        self.top += 1;
        (own, [columns, rows])
    }

    /// The level that one node covers the whole map at.
    pub(super) fn top(&self) -> u32 {
        self.top
    }

    /// Bytes held beside the heights.
    pub(super) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Siblings>()
    }

    /// `ray` as [`Self::search`] wants it.
    #[inline]
    pub(super) fn prepare(&self, ray: &CellRay) -> NodeRay {
        let columns = [Vec4::new(0.0, 1.0, 0.0, 1.0), Vec4::new(0.0, 0.0, 1.0, 1.0)];
        let forward = ray.inv.map(|inv| inv > 0.0);
        let step = forward.map(|forward| if forward { 0.0 } else { 1.0 });
        let scale = f64::from(self.codes.scale);
        NodeRay {
            start: ray.start.map(|x| x as f32),
            inv: ray.inv.map(|x| x as f32),
            enter: [columns[0] + step[0], columns[1] + step[1]],
            leave: [columns[0] + (1.0 - step[0]), columns[1] + (1.0 - step[1])],
            z: ((ray.z - f64::from(self.codes.base)) * scale) as f32 + FLOOR,
            dz: (ray.dz * scale) as f32,
            t_end: ray.t_end as f32 * (1.0 + SPAN_PADDING),
            flip: u32::from(!forward[0]) | (u32::from(!forward[1]) << 1),
        }
    }

    /// Asks for the nodes above `cell` and the heights around it at once; the search would wait for them one by one.
    ///
    /// At random points of 1024² this is worth a third of the speed, at neighbouring points nothing.
    #[inline(always)]
    pub(super) fn touch(&self, cell: [usize; 2]) {
        for level in 2..=self.top.min(TOUCHED_LEVEL) {
            let [x, y] = cell.map(|x| (x >> level) as u32);
            black_box(self.node(level, x, y).max[0]);
        }
        let size = self.heights.size();
        // The rows of vertices of the finest stored node's 4 × 4 cells.
        for row in 0..5 {
            let j = (cell[1] & !3) + row;
            let j = if j < size[1] { j } else { self.beyond[1] };
            black_box(self.heights.heights()[j * size[0] + cell[0]]);
        }
    }

    /// The first `Some` that `leaf` gives for the cells under `block` whose bounds the ray meets, front to back.
    ///
    /// Where the ray is certainly below the surface, `buried` may end the search at once.
    #[inline(always)]
    pub(super) fn search<R>(
        &self,
        ray: &NodeRay,
        block: Block,
        buried: impl Fn() -> Option<R>,
        leaf: impl Fn(&Candidate) -> Option<R>,
    ) -> Option<R> {
        let mut stack = [[0u32; 3]; STACK];
        let mut waiting = 1;
        stack[0] = [block.level, block.node[0], block.node[1]];
        while waiting > 0 {
            waiting -= 1;
            let [level, x, y] = stack[waiting];
            let corner = [(x << level) as i32 + block.tile[0], (y << level) as i32 + block.tile[1]];
            let spans = ray.spans(corner, (1u32 << (level - 1)) as f32);
            if level > 1 {
                let (meets, below) = spans.test(self.node(level, x, y).bounds());
                if below && let Some(found) = buried() {
                    return Some(found);
                }
                for k in (0..4).rev() {
                    let child = k ^ ray.flip;
                    stack[waiting] = [level - 1, 2 * x + (child & 1), 2 * y + (child >> 1)];
                    waiting += ((meets >> child) & 1) as usize;
                }
                continue;
            }
            let quad = self.quad(x, y);
            let (meets, below) = spans.test([quad.low - CODE_PADDING, quad.high + CODE_PADDING]);
            if below && let Some(found) = buried() {
                return Some(found);
            }
            for k in (0..4).map(|k| k ^ ray.flip) {
                if (meets >> k) & 1 == 1 {
                    let cell = [2 * x + (k & 1), 2 * y + (k >> 1)];
                    let at = [corner[0] + (k & 1) as i32, corner[1] + (k >> 1) as i32];
                    let corners = quad.corners.map(|h| f64::from(h[k as usize]));
                    let found = leaf(&Candidate { cell, at, patch: Patch { corners, cell: at.map(f64::from) } });
                    if found.is_some() {
                        return found;
                    }
                }
            }
        }
        None
    }

    #[inline(always)]
    fn node(&self, level: u32, x: u32, y: u32) -> &Node {
        let span = self.levels[level as usize - 2];
        let siblings = &self.nodes[span.offset + (y >> 1) as usize * span.width + (x >> 1) as usize];
        &siblings.0[((y & 1) << 1 | (x & 1)) as usize]
    }

    /// The cells (2x, 2y) to (2x + 1, 2y + 1) from their nine heights.
    #[inline(always)]
    fn quad(&self, x: u32, y: u32) -> Quad {
        let size = self.heights.size();
        let first = [2 * x as usize, 2 * y as usize];
        let index =
            |k: usize, axis: usize| if first[axis] + k < size[axis] { first[axis] + k } else { self.beyond[axis] };
        let column = [0, 1, 2].map(|k| index(k, 0));
        let heights = self.heights.heights();
        let rows = [0, 1, 2].map(|k| {
            let start = index(k, 1) * size[0];
            column.map(|i| heights[start + i])
        });
        let corner = |i: usize, j: usize| Vec4::new(rows[j][i], rows[j][i + 1], rows[j + 1][i], rows[j + 1][i + 1]);
        let corners = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        let low = corners[0].min(corners[1]).min(corners[2].min(corners[3]));
        let high = corners[0].max(corners[1]).max(corners[2].max(corners[3]));
        let codes = |h: Vec4| (h - self.codes.base) * self.codes.scale + FLOOR;
        let mut quad = Quad { corners, low: codes(low), high: codes(high) };
        let outside = [first[0] + 1 >= size[0], first[1] + 1 >= size[1]];
        if outside != [false; 2] {
            quad.remove(outside);
        }
        quad
    }
}

/// 2 × 2 cells: their corner heights `[h00, h10, h01, h11][cell]` and their bounds in codes.
struct Quad {
    corners: [Vec4; 4],
    low: Vec4,
    high: Vec4,
}

impl Quad {
    /// Empties the cells of the second column or row.
    #[cold]
    fn remove(&mut self, outside: [bool; 2]) {
        for k in (0..4).filter(|k| (outside[0] && k & 1 == 1) || (outside[1] && k >> 1 == 1)) {
            (self.low[k], self.high[k]) = (0.0, 0.0);
        }
    }
}

impl Node {
    #[inline(always)]
    fn bounds(&self) -> [Vec4; 2] {
        [self.min, self.max].map(|codes| Vec4::from_array(codes.map(f32::from)))
    }
}

/// A ray over the four children of a node: when it is over each, and its lowest and highest code there.
struct Spans {
    over: BVec4A,
    surely_over: BVec4A,
    low: Vec4,
    high: Vec4,
}

impl NodeRay {
    /// The ray over the children of `child_size` cells of the node at `corner`.
    #[inline(always)]
    fn spans(&self, corner: [i32; 2], child_size: f32) -> Spans {
        let plane = |axis: usize, planes: [Vec4; 2]| {
            (planes[axis] * child_size + corner[axis] as f32 - self.start[axis]) * self.inv[axis]
        };
        let t_in = plane(0, self.enter).max(plane(1, self.enter)).max(Vec4::ZERO);
        let t_out = plane(0, self.leave).min(plane(1, self.leave)).min(Vec4::splat(self.t_end));
        let [z_in, z_out] = [t_in * self.dz + self.z, t_out * self.dz + self.z];
        Spans {
            over: t_in.cmple(t_out * (1.0 + SPAN_PADDING)),
            surely_over: (t_in * (1.0 + SPAN_PADDING)).cmplt(t_out),
            low: z_in.min(z_out),
            high: z_in.max(z_out),
        }
    }
}

impl Spans {
    /// Bits of the children whose bounds the ray may meet, and whether it is certainly below one of them.
    #[inline(always)]
    fn test(&self, [min, max]: [Vec4; 2]) -> (u32, bool) {
        let meets = self.over & self.low.cmple(max) & self.high.cmpge(min);
        let below = self.surely_over & self.low.cmplt(min);
        (meets.bitmask(), below.any())
    }
}
