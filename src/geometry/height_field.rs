//! A grid of height vertices over the base plane, bilinear between them.

use std::sync::Arc;

/// What lies beyond the last vertex of a height field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boundary {
    /// The map tiles the plane: vertex `n` is vertex 0.
    Repeat,
    /// The map is one finite piece: vertex `n` repeats vertex `n − 1`, and outside of the map there is nothing.
    Clamp,
}

/// Heights above the base plane: `size[0] × size[1]` vertices and as many cells (texels).
///
/// Vertex (i, j) stands at x = i·`spacing[0]`, y = −j·`spacing[1]`; row-major, j (v) runs down. Heights and spacing
/// are metres. Cell (i, j) is the bilinear patch between vertices (i, j) and (i + 1, j + 1). Clones share the heights.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightField {
    heights: Arc<[f32]>,
    size: [usize; 2],
    spacing: [f32; 2],
    boundary: Boundary,
}

impl HeightField {
    /// A field of `size[0] × size[1]` cells, each `spacing` metres wide and high.
    ///
    /// # Panics
    /// If the number of heights is not `size[0]·size[1]`, or a spacing is not positive: `io` refuses such input.
    pub fn new(heights: Vec<f32>, size: [usize; 2], spacing: [f32; 2], boundary: Boundary) -> Self {
        assert_eq!(heights.len(), size[0] * size[1], "one height a vertex");
        assert!(!heights.is_empty(), "at least one vertex");
        assert!(spacing[0] > 0.0 && spacing[1] > 0.0, "spacing in metres, greater than 0");
        Self { heights: heights.into(), size, spacing, boundary }
    }

    /// Heights of all vertices in metres, `[v][u]`.
    pub fn heights(&self) -> &[f32] {
        &self.heights
    }

    /// Cells (and vertices) along u and v.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Metres between vertices along u and v.
    pub fn spacing(&self) -> [f32; 2] {
        self.spacing
    }

    /// What lies beyond the last vertex.
    pub fn boundary(&self) -> Boundary {
        self.boundary
    }

    /// Extent of the map along x and −y in metres.
    pub fn extent(&self) -> [f32; 2] {
        [self.size[0] as f32 * self.spacing[0], self.size[1] as f32 * self.spacing[1]]
    }

    /// Height of vertex (i, j) for 0 <= i <= `size[0]`, 0 <= j <= `size[1]`: the last index wraps or repeats.
    #[inline]
    pub fn vertex(&self, i: usize, j: usize) -> f32 {
        let [i, j] = [self.index(i, 0), self.index(j, 1)];
        self.heights[j * self.size[0] + i]
    }

    #[inline]
    fn index(&self, i: usize, axis: usize) -> usize {
        let n = self.size[axis];
        debug_assert!(i <= n, "vertex index at most the cell count");
        match self.boundary {
            _ if i < n => i,
            Boundary::Repeat => 0,
            Boundary::Clamp => n - 1,
        }
    }

    /// The four corner heights of cell (i, j): `[h00, h10, h01, h11]`, first index along u.
    #[inline]
    pub fn corners(&self, i: usize, j: usize) -> [f32; 4] {
        [self.vertex(i, j), self.vertex(i + 1, j), self.vertex(i, j + 1), self.vertex(i + 1, j + 1)]
    }

    /// Slopes (∂h/∂x, ∂h/∂y) of cell (i, j) at the fraction (s, t) ∈ [0, 1]² of it; dimensionless, y = −v.
    ///
    /// The normal there is normalise(−∂h/∂x, −∂h/∂y, 1).
    #[inline]
    pub fn slope(&self, i: usize, j: usize, s: f32, t: f32) -> [f32; 2] {
        self.corner_slope(self.corners(i, j), [s, t])
    }

    /// The same from the corner heights of a cell.
    #[inline]
    pub(super) fn corner_slope(&self, [h00, h10, h01, h11]: [f32; 4], [s, t]: [f32; 2]) -> [f32; 2] {
        let du = (h10 - h00) * (1.0 - t) + (h11 - h01) * t;
        let dv = (h01 - h00) * (1.0 - s) + (h11 - h10) * s;
        [du / self.spacing[0], -dv / self.spacing[1]]
    }

    /// Smallest and largest height in metres.
    pub fn range(&self) -> [f32; 2] {
        self.heights.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[lo, hi], &h| [lo.min(h), hi.max(h)])
    }
}
