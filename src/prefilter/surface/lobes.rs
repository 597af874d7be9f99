//! Normal distributions of cells as mixtures of von Mises-Fisher lobes.
//!
//! The distribution of a cell's micro-normals counts micro-area per base area, D(ω) = ⟨δ(ω − ωm)/⟨ωm, ωg⟩⟩ (\[WU19\]
//! 4.2), and is fitted by D ≈ Σ_j w_j γ(ω; κ_j, μ_j) (4.4) with expectation maximisation. Each maximisation keeps
//! Σ_j w_j r_j μ_j = ∫ω D dω, hence ∫D cosθ dω = 1 (4.3), the projected area of the cell, and its mean slope.

mod count;
mod mixture;
mod samples;
mod start;

use super::VmfLobe;
use super::downsample::Cut;
use crate::geometry::HeightField;
use rayon::prelude::*;
use samples::MicroNormals;

pub use count::{CountError, LOBE_COUNTS, choose_lobe_count, lobe_count_errors};

/// Most lobes that a cell may have.
pub const MAX_LOBES: usize = 8;

/// Lobes of the normal distributions of `coarse_cells[0] × coarse_cells[1]` cells, `[lobe][cell]`.
///
/// Lobes fall in weight within a cell; a cell that needs fewer than the level has fills up with weight 0. `count` is
/// 1 to [`MAX_LOBES`]; `None` chooses one for the whole level, see [`choose_lobe_count`]. A texel that straddles the
/// border of two cells belongs to each by its area there.
pub fn fit_lobes(fine: &HeightField, coarse_cells: [usize; 2], count: Option<usize>) -> Vec<Vec<VmfLobe>> {
    let count = count.unwrap_or_else(|| choose_lobe_count(fine, coarse_cells)).clamp(1, MAX_LOBES);
    let footprints = Footprints::new(fine, coarse_cells);
    let cells = coarse_cells[0] * coarse_cells[1];
    let mut by_cell = vec![[UNUSED; MAX_LOBES]; cells];
    by_cell.par_chunks_mut(coarse_cells[0]).enumerate().for_each_init(MicroNormals::default, |samples, (j, row)| {
        for (i, lobes) in row.iter_mut().enumerate() {
            footprints.gather([i, j], samples);
            *lobes = fit_cell(samples, count);
        }
    });
    (0..count).map(|lobe| by_cell.iter().map(|lobes| lobes[lobe]).collect()).collect()
}

/// A lobe that is not there: what fills up a cell with few.
const UNUSED: VmfLobe = VmfLobe { mean: [0.0, 0.0, 1.0], kappa: 0.0, weight: 0.0 };

/// The cells of a level over the texels of its fine map.
struct Footprints<'a> {
    fine: &'a HeightField,
    cuts: [Cut; 2],
}

impl<'a> Footprints<'a> {
    fn new(fine: &'a HeightField, cells: [usize; 2]) -> Self {
        let cuts = [0, 1].map(|axis| Cut { fine: fine.size()[axis], coarse: cells[axis] });
        Self { fine, cuts }
    }

    fn gather(&self, cell: [usize; 2], samples: &mut MicroNormals) {
        samples.gather(self.fine, [0, 1].map(|axis| [0, 1].map(|end| self.cuts[axis].place(cell[axis] + end))));
    }
}

/// The mixture of at most `count` lobes for one cell, by falling weight.
fn fit_cell(samples: &mut MicroNormals, count: usize) -> [VmfLobe; MAX_LOBES] {
    let mut mixture = start::split(samples, count);
    mixture.refine(samples);
    let mut lobes = mixture.into_lobes();
    lobes.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    lobes
}

#[cfg(test)]
mod tests;
