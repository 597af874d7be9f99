//! Coarse heights whose cells keep the mean slopes of the fine surface.
//!
//! With s̃ the mean slope of a coarse bilinear cell, s̃* that of the fine surface under it and Δ the Laplacian, the
//! coarse heights minimise Σ_cells ‖s̃ − s̃*‖² + w Σ_vertices |Δh|² (\[WU19\] 4.9 and 4.10).
//!
//! - *Units.* s̃ are true slopes: for cells `a × b` metres, s̃_u = ½(h10 + h11 − h00 − h01)/a and s̃_v =
//!   ½(h01 + h11 − h00 − h10)/b (v runs down; a common sign does not matter here). Δ is taken in cell units, as the
//!   change of slope from one cell to the next: Δh = δ²_u h/a + δ²_v h/b. For square cells this is the usual one times
//!   the cell's side; for others neither direction is smoothed more than it would be alone.
//! - *Reference.* The mean of a gradient depends on the boundary only, so s̃* is exact from the heights along the four
//!   edges of a cell, at fractional positions where the factor does not divide the map.
//! - *Repeat.* Everything is a convolution on the torus: one division in the frequency domain.
//! - *Clamp.* The last coarse vertex is repeated, so the last cell of an axis is flat whatever we choose. The *real*
//!   cells are the others (the single one, where an axis has only one). The sum runs over real cells; beyond its end
//!   vertices h is mirrored for Δ, and |Δh|² counts ½ at an end vertex of an axis (¼ in a corner). That is a quarter of
//!   the periodic objective on the map mirrored about its end vertices, whose minimiser is even: a DCT-I.
//! - *Null space.* The constant is set from the mean height of the fine bilinear surface (repeated vertices included).
//!   The checkerboard has no mean slope in any cell; the Laplacian, or we for w = 0, set it to zero.

mod slopes;
mod spectral;

use crate::geometry::{Boundary, HeightField};
use rayon::prelude::*;
use slopes::MeanSlopes;
use spectral::Spectrum;

/// Weight of the squared Laplacian, \[WU19\] section 4.4.1; dimensionless, as both terms are slopes.
const LAPLACIAN_WEIGHT: f64 = 0.01;

/// Cells per axis of the level that is `factor` times coarser: max(1, round(n / factor)).
pub fn coarse_cells(size: [usize; 2], factor: f32) -> [usize; 2] {
    debug_assert!(factor > 0.0, "factor is positive");
    size.map(|n| ((n as f64 / f64::from(factor)).round() as usize).max(1))
}

/// One axis of `fine` texels cut into `coarse` equal cells; the lines between them may cut through texels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cut {
    pub(super) fine: usize,
    pub(super) coarse: usize,
}

impl Cut {
    /// Where cut `line` lies: whole texels and the fraction beyond, exact in integers.
    pub(super) fn place(self, line: usize) -> (usize, f64) {
        let scaled = line * self.fine;
        (scaled / self.coarse, (scaled % self.coarse) as f64 / self.coarse as f64)
    }
}

/// The height field `factor` times coarser whose cells have, as nearly as possible, the mean slopes of `fine`.
///
/// The result covers the same extent with [`coarse_cells`] cells, keeps the boundary and the mean height, and is
/// exactly constant where `fine` is. The true factor, n over the number of cells, may be fractional.
pub fn downsample(fine: &HeightField, factor: f32) -> HeightField {
    downsample_with(fine, factor, LAPLACIAN_WEIGHT)
}

/// [`downsample`] with another weight of the Laplacian.
pub(super) fn downsample_with(fine: &HeightField, factor: f32, laplacian_weight: f64) -> HeightField {
    downsample_to(fine, coarse_cells(fine.size(), factor), laplacian_weight)
}

fn downsample_to(fine: &HeightField, cells: [usize; 2], laplacian_weight: f64) -> HeightField {
    let spacing = [0, 1].map(|axis| coarse_spacing(fine, cells, axis));
    let slopes = MeanSlopes::of(fine, cells, spacing);
    let mut spectrum = Spectrum::of_adjoint(&slopes, cells, spacing, fine.boundary());
    spectrum.divide(spacing, laplacian_weight);
    let mut heights = spectrum.into_heights();

    let boundary = fine.boundary();
    let fine_heights = fine.heights();
    let stride = fine.size()[0];
    let shift = mean_height(fine.size(), boundary, |i, j| f64::from(fine_heights[j * stride + i]))
        - mean_height(cells, boundary, |i, j| heights[j * cells[0] + i]);
    heights.iter_mut().for_each(|h| *h += shift);
    let heights = heights.iter().map(|&h| h as f32).collect();
    HeightField::new(heights, cells, spacing.map(|s| s as f32), boundary)
}

fn coarse_spacing(fine: &HeightField, cells: [usize; 2], axis: usize) -> f64 {
    f64::from(fine.spacing()[axis]) * fine.size()[axis] as f64 / cells[axis] as f64
}

/// Mean height of the bilinear surface over its whole extent, for heights given per vertex.
///
/// Heights are taken relative to the first one, so that a constant map has exactly its own mean.
fn mean_height(size: [usize; 2], boundary: Boundary, height: impl Fn(usize, usize) -> f64 + Sync) -> f64 {
    let origin = height(0, 0);
    let row_mean = |j: usize| {
        let sum: f64 = (0..size[0]).map(|i| vertex_weight(i, size[0], boundary) * (height(i, j) - origin)).sum();
        vertex_weight(j, size[1], boundary) * sum / size[0] as f64
    };
    let rows: Vec<f64> = (0..size[1]).into_par_iter().map(row_mean).collect();
    origin + rows.iter().sum::<f64>() / size[1] as f64
}

/// Extent of the bilinear hat of vertex `i` in cells: 1, but ½ and 1½ at the ends of a clamped axis.
fn vertex_weight(i: usize, n: usize, boundary: Boundary) -> f64 {
    match boundary {
        Boundary::Clamp if n > 1 && i == 0 => 0.5,
        Boundary::Clamp if n > 1 && i == n - 1 => 1.5,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests;
