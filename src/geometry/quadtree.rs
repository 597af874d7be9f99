//! Height bounds of a field's cells as a quadtree, and its traversal by one ray.
//!
//! A node of level l covers 2^l × 2^l cells and holds the bounds of its four children, which are tested at once: 32
//! bytes for 4 cells, 10.7 bytes a cell with all levels. Tests run in `f32` and err on the side of visiting; what is
//! hit is decided over the cells, in `f64`.

use glam::Vec4;

use super::HeightField;
use super::patch::CellRay;

/// Bounds of a node's four children: (0, 0), (1, 0), (0, 1), (1, 1), first index along u.
///
/// Metres above the lowest vertex, widened by `HEIGHT_PADDING`. A child that reaches out of the map has a `min` of −∞, so
/// that nothing is below it there; one wholly outside has a `max` of −∞ as well and is never met.
#[derive(Clone, Copy, Debug)]
struct Node {
    max: Vec4,
    min: Vec4,
}

/// Where a level lies within the nodes.
#[derive(Clone, Copy, Debug)]
struct LevelSpan {
    offset: usize,
    width: usize,
}

/// Height bounds of all cells, coarse to fine.
#[derive(Clone, Debug)]
pub(super) struct Quadtree {
    nodes: Vec<Node>,
    /// Level l at index l − 1.
    levels: Vec<LevelSpan>,
    base: f64,
}

/// Bounds are widened by this much of the height range: z(t) in `f32` is off by at most 4 roundings of 6e-8 of it.
const HEIGHT_PADDING: f32 = 1e-6;
/// Relative widening of intervals of t: t of a plane in `f32` is off by at most 3 roundings of 6e-8 of itself.
const SPAN_PADDING: f32 = 1e-6;
/// Nodes that may wait: three a level and 24 levels.
const STACK: usize = 80;

/// A block to search: a node, and where cell (0, 0) of its tile lies from the cell that the ray starts in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Block {
    pub(super) level: u32,
    pub(super) node: [u32; 2],
    pub(super) tile: [i32; 2],
}

/// A [`CellRay`] in `f32`, with what the node test wants in four lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct NodeRay {
    start: [Vec4; 2],
    inv: [Vec4; 2],
    /// Planes where the ray enters and leaves each child, in child sizes from the node's corner; `[u, v]`.
    enter: [Vec4; 2],
    leave: [Vec4; 2],
    z: Vec4,
    dz: Vec4,
    t_end: Vec4,
    /// Child `k ^ flip` is the k-th along the ray.
    flip: u32,
}

impl NodeRay {
    pub(super) fn new(ray: &CellRay, tree: &Quadtree) -> Self {
        let columns = [Vec4::new(0.0, 1.0, 0.0, 1.0), Vec4::new(0.0, 0.0, 1.0, 1.0)];
        let forward = ray.inv.map(|inv| inv > 0.0);
        let near = [0, 1].map(|axis| if forward[axis] { columns[axis] } else { columns[axis] + 1.0 });
        let far = [0, 1].map(|axis| if forward[axis] { columns[axis] + 1.0 } else { columns[axis] });
        Self {
            start: ray.start.map(|x| Vec4::splat(x as f32)),
            inv: ray.inv.map(|x| Vec4::splat(x as f32)),
            enter: near,
            leave: far,
            z: Vec4::splat((ray.z - tree.base) as f32),
            dz: Vec4::splat(ray.dz as f32),
            t_end: Vec4::splat((ray.t_end as f32) * (1.0 + SPAN_PADDING)),
            flip: u32::from(!forward[0]) | (u32::from(!forward[1]) << 1),
        }
    }
}

impl Quadtree {
    pub(super) fn new(heights: &HeightField, range: [f32; 2]) -> Self {
        let size = heights.size();
        let base = f64::from(range[0]);
        let padding = HEIGHT_PADDING * (range[1] - range[0]);
        let mut tree = Self { nodes: Vec::new(), levels: Vec::new(), base };
        let mut bounds = cell_bounds(heights, range[0], padding);
        let mut width = size;
        loop {
            let span = LevelSpan { offset: tree.nodes.len(), width: width[0].div_ceil(2) };
            bounds = tree.push_level(&bounds, width, size);
            tree.levels.push(span);
            width = width.map(|n| n.div_ceil(2));
            if width == [1, 1] {
                return tree;
            }
        }
    }

    /// Appends the nodes above `bounds` (of `width` columns and rows, a map of `size` cells) and returns their own bounds.
    fn push_level(&mut self, bounds: &[[f32; 2]], width: [usize; 2], size: [usize; 2]) -> Vec<[f32; 2]> {
        let cells = 1 << self.levels.len();
        let [columns, rows] = width.map(|n| n.div_ceil(2));
        let empty = [f32::INFINITY, f32::NEG_INFINITY];
        let mut own = Vec::with_capacity(columns * rows);
        self.nodes.reserve(columns * rows);
        for y in 0..rows {
            for x in 0..columns {
                let places = [0, 1, 2, 3].map(|k: usize| [2 * x + (k & 1), 2 * y + (k >> 1)]);
                let child = places.map(|[i, j]| if i < width[0] && j < width[1] { bounds[j * width[0] + i] } else { empty });
                let [min, max] = [0, 1].map(|end| Vec4::from_array(child.map(|c| c[end])));
                own.push([min.min_element(), max.max_element()]);
                let inside = places.map(|[i, j]| (i + 1) * cells <= size[0] && (j + 1) * cells <= size[1]);
                let min = Vec4::from_array([0, 1, 2, 3].map(|k| if inside[k] { min[k] } else { f32::NEG_INFINITY }));
                self.nodes.push(Node { max, min });
            }
        }
        own
    }

    /// The level that one node covers the whole map at.
    pub(super) fn top(&self) -> u32 {
        self.levels.len() as u32
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>()
    }

    /// The first `Some` that `leaf` gives for the cells under `block` whose bounds the ray meets, front to back.
    ///
    /// `leaf` takes the cell of the map and where it lies from the ray's first cell. Where the ray is certainly below
    /// the surface, `buried` may end the search at once.
    #[inline(always)]
    pub(super) fn search<R>(
        &self,
        ray: &NodeRay,
        block: Block,
        buried: impl Fn() -> Option<R>,
        leaf: impl Fn([u32; 2], [i32; 2]) -> Option<R>,
    ) -> Option<R> {
        let mut stack = [(0u32, [0u32; 2]); STACK];
        let mut waiting = 1;
        stack[0] = (block.level, block.node);
        while waiting > 0 {
            waiting -= 1;
            let (level, [x, y]) = stack[waiting];
            let span = self.levels[level as usize - 1];
            let node = &self.nodes[span.offset + y as usize * span.width + x as usize];
            let corner = [(x << level) as i32 + block.tile[0], (y << level) as i32 + block.tile[1]];
            let (meets, below) = ray.test(node, corner, (1u32 << (level - 1)) as f32);
            if below
                && let Some(found) = buried()
            {
                return Some(found);
            }
            if level > 1 {
                for k in (0..4).rev() {
                    let child = k ^ ray.flip;
                    stack[waiting] = (level - 1, [2 * x + (child & 1), 2 * y + (child >> 1)]);
                    waiting += ((meets >> child) & 1) as usize;
                }
            } else if meets != 0 {
                for k in 0..4 {
                    let child = k ^ ray.flip;
                    if (meets >> child) & 1 == 1 {
                        let [du, dv] = [child & 1, child >> 1];
                        let found = leaf([2 * x + du, 2 * y + dv], [corner[0] + du as i32, corner[1] + dv as i32]);
                        if found.is_some() {
                            return found;
                        }
                    }
                }
            }
        }
        None
    }
}

impl NodeRay {
    /// Bits of the children that the ray may meet, and whether it is certainly below the surface over one of them.
    #[inline(always)]
    fn test(&self, node: &Node, corner: [i32; 2], child_size: f32) -> (u32, bool) {
        let size = Vec4::splat(child_size);
        let plane = |axis: usize, planes: [Vec4; 2]| {
            (planes[axis] * size + Vec4::splat(corner[axis] as f32) - self.start[axis]) * self.inv[axis]
        };
        let t_in = plane(0, self.enter).max(plane(1, self.enter)).max(Vec4::ZERO);
        let t_out = plane(0, self.leave).min(plane(1, self.leave)).min(self.t_end);
        let [z_in, z_out] = [self.z + self.dz * t_in, self.z + self.dz * t_out];
        let [low, high] = [z_in.min(z_out), z_in.max(z_out)];
        let over = t_in.cmple(t_out * (1.0 + SPAN_PADDING));
        let meets = over & low.cmple(node.max) & high.cmpge(node.min);
        let below = (t_in * (1.0 + SPAN_PADDING)).cmplt(t_out) & low.cmplt(node.min);
        (meets.bitmask(), below.any())
    }
}

/// [min, max] of every cell, `[v][u]`, in metres above `base` and widened by `padding`.
fn cell_bounds(heights: &HeightField, base: f32, padding: f32) -> Vec<[f32; 2]> {
    let [columns, rows] = heights.size();
    let mut bounds = Vec::with_capacity(columns * rows);
    for j in 0..rows {
        for i in 0..columns {
            let h = heights.corners(i, j);
            let low = h[0].min(h[1]).min(h[2].min(h[3]));
            let high = h[0].max(h[1]).max(h[2].max(h[3]));
            bounds.push([low - base - padding, high - base + padding]);
        }
    }
    bounds
}
