//! Heights in panels of 4 × 16 vertices.
//!
//! Four rows of a panel are one cache line, and a panel's neighbours along u lie beside it: a ray through a few cells stays on
//! one or two pages, where the rows of a large map would put every row of vertices on a page of its own.

use glam::Vec4;

use super::HeightField;

/// Vertices of a panel along u and v.
const PANEL: [usize; 2] = [4, 16];

/// 4 × 16 vertices, `[v][u]`.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Panel([[f32; PANEL[0]]; PANEL[1]]);

/// All vertices of a field and one more row and column: the first of the next tile of the plane, or the last again.
///
/// Beyond those, vertices are NaN: no gap over a cell that has one is below anything.
#[derive(Clone, Debug)]
pub(super) struct Panels {
    panels: Vec<Panel>,
    /// Panels a row.
    width: usize,
}

impl Panels {
    pub(super) fn new(heights: &HeightField) -> Self {
        let [nu, nv] = heights.size();
        // One panel more than the cells need: a row of cells is read together with the first vertex of the next.
        let [width, rows] = [nu.div_ceil(PANEL[0]) + 1, nv.div_ceil(PANEL[1]) + 1];
        let mut panels = vec![Panel([[f32::NAN; PANEL[0]]; PANEL[1]]); width * rows];
        for (j, i) in (0..=nv).flat_map(|j| (0..=nu).map(move |i| (j, i))) {
            panels[j / PANEL[1] * width + i / PANEL[0]].0[j % PANEL[1]][i % PANEL[0]] = heights.vertex(i, j);
        }
        Self { panels, width }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        self.panels.capacity() * size_of::<Panel>()
    }

    /// Corner heights `[h00, h10, h01, h11]` of cell (i, j).
    #[inline(always)]
    pub(super) fn corners(&self, [i, j]: [usize; 2]) -> [f32; 4] {
        let h = |i: usize, j: usize| self.row(i / PANEL[0], j)[i % PANEL[0]];
        [h(i, j), h(i + 1, j), h(i, j + 1), h(i + 1, j + 1)]
    }

    /// Corner heights `[h00, h10, h01, h11][cell]` of the cells (4x, j) to (4x + 3, j).
    #[inline(always)]
    pub(super) fn row_corners(&self, x: usize, j: usize) -> [Vec4; 4] {
        let pair = |j: usize| {
            let (left, right) = (self.row(x, j), self.row(x + 1, j));
            [Vec4::from_array(*left), Vec4::new(left[1], left[2], left[3], right[0])]
        };
        let ([h00, h10], [h01, h11]) = (pair(j), pair(j + 1));
        [h00, h10, h01, h11]
    }

    /// Vertices 4x to 4x + 3 of row j.
    #[inline(always)]
    fn row(&self, x: usize, j: usize) -> &[f32; PANEL[0]] {
        &self.panels[j / PANEL[1] * self.width + x].0[j % PANEL[1]]
    }
}
