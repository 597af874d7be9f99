//! Mean slopes of the fine surface over coarse cells, exact from the heights along the cells' edges.

use super::Cut;
use crate::geometry::{Boundary, HeightField};
use rayon::prelude::*;

/// Mean slopes along u and v, dimensionless (v down), of the cells that the objective counts.
pub(super) struct MeanSlopes {
    /// Number of cells along u and v.
    pub(super) cells: [usize; 2],
    /// ⟨∂h/∂u⟩ per cell, row-major.
    pub(super) u: Vec<f64>,
    /// ⟨∂h/∂v⟩ per cell, row-major.
    pub(super) v: Vec<f64>,
}

impl MeanSlopes {
    /// Mean slopes of `fine` over the real cells of a map of `coarse` cells, `spacing` metres each.
    ///
    /// By the divergence theorem ⟨∂h/∂u⟩ = (mean of h on the right edge − mean on the left edge) / width.
    pub(super) fn of(fine: &HeightField, coarse: [usize; 2], spacing: [f64; 2]) -> Self {
        let cuts = [0, 1].map(|axis| Cut { fine: fine.size()[axis], coarse: coarse[axis] });
        let cells = coarse.map(|n| real_cells(n, fine.boundary()));
        let columns: Vec<EdgeMean> = (0..cells[0]).map(|i| cuts[0].edge_mean(i)).collect();
        let mut u = vec![0.0; cells[0] * cells[1]];
        let mut v = u.clone();
        let rows = u.par_chunks_mut(cells[0]).zip(v.par_chunks_mut(cells[0])).enumerate();
        rows.for_each(|(j, (u, v))| {
            cell_row_u(fine, &cuts, j, u);
            let [top, bottom] = [j, j + 1].map(|line| row_edges(fine, &columns, cuts[1].place(line)));
            for (v, (bottom, top)) in v.iter_mut().zip(bottom.iter().zip(&top)) {
                *v = bottom - top;
            }
            u.iter_mut().for_each(|s| *s /= spacing[0]);
            v.iter_mut().for_each(|s| *s /= spacing[1]);
        });
        Self { cells, u, v }
    }
}

/// Cells of an axis that can have a slope: all but the last of a clamped axis, and at least one.
pub(super) fn real_cells(n: usize, boundary: Boundary) -> usize {
    match boundary {
        Boundary::Repeat => n,
        Boundary::Clamp => (n - 1).max(1),
    }
}

/// The mean of a piecewise linear function over one cell: Σ `weights[k]` · value at vertex `first` + k.
struct EdgeMean {
    first: usize,
    weights: Vec<f64>,
}

impl Cut {
    /// Weights of the vertices in the mean over `cell`.
    ///
    /// Over a part [s0, s1] of a texel a linear function integrates to (s1 − s0) times its value in the middle.
    fn edge_mean(&self, cell: usize) -> EdgeMean {
        let [(first, start), (last, end)] = [self.place(cell), self.place(cell + 1)];
        let mut weights = vec![0.0; last - first + 2];
        let length = (last - first) as f64 + end - start;
        for texel in first..=last {
            let s0 = if texel == first { start } else { 0.0 };
            let s1 = if texel == last { end } else { 1.0 };
            let (part, middle) = ((s1 - s0) / length, 0.5 * (s0 + s1));
            weights[texel - first] += part * (1.0 - middle);
            weights[texel - first + 1] += part * middle;
        }
        // A cell that ends on a vertex needs nothing beyond it; the map may have nothing there.
        let used = weights.iter().rposition(|&w| w != 0.0).map_or(0, |k| k + 1);
        weights.truncate(used);
        EdgeMean { first, weights }
    }
}

/// Height differences between right and left edges of the cells of row `j`, in metres.
fn cell_row_u(fine: &HeightField, cuts: &[Cut; 2], j: usize, differences: &mut [f64]) {
    let edge = cuts[1].edge_mean(j);
    let places: Vec<(usize, f64)> = (0..=differences.len()).map(|line| cuts[0].place(line)).collect();
    let mut lines = vec![0.0; places.len()];
    for (k, weight) in edge.weights.iter().enumerate() {
        for (line, &(i, s)) in lines.iter_mut().zip(&places) {
            let left = f64::from(fine.vertex(i, edge.first + k));
            let right = if s > 0.0 { f64::from(fine.vertex(i + 1, edge.first + k)) } else { left };
            *line += weight * (left + s * (right - left));
        }
    }
    for (difference, pair) in differences.iter_mut().zip(lines.windows(2)) {
        *difference = pair[1] - pair[0];
    }
}

/// Mean heights of the horizontal cell edges on the cut at row `j` + `t`, in metres.
fn row_edges(fine: &HeightField, columns: &[EdgeMean], (j, t): (usize, f64)) -> Vec<f64> {
    let height = |i: usize| {
        let upper = f64::from(fine.vertex(i, j));
        let lower = if t > 0.0 { f64::from(fine.vertex(i, j + 1)) } else { upper };
        upper + t * (lower - upper)
    };
    let mean = |edge: &EdgeMean| edge.weights.iter().enumerate().map(|(k, w)| w * height(edge.first + k)).sum();
    columns.iter().map(mean).collect()
}
