//! What a level stands for: f_low = (Σ_r T_r(x)·S_r(ωi, ωo))·f_c.

use super::{SurfaceAsset, SurfaceLevel};
use crate::cell_brdf::{BaseBrdf, CellBrdf};
use crate::lookup::{Boundary, angular_taps, bilinear_taps};

/// Four texels of a bilinear lookup and their weights.
type Taps = [(usize, f32); 4];

impl SurfaceLevel {
    /// T_r at the fraction `x` of the map along u and v: bilinear between patch centres, with the boundary's wrap.
    ///
    /// (0, 0) is the outer corner of the first texel of the source.
    #[inline]
    pub fn spatial_at(&self, rank: usize, x: [f32; 2], boundary: Boundary) -> [f32; 3] {
        weighted(&self.spatial[rank], &bilinear_taps(x, self.patches, boundary))
    }

    /// S_r(ωi, ωo): multilinear in the concentric squares of both directions; beyond the outermost centres the
    /// nearest hold.
    #[inline]
    pub fn angular_at(&self, rank: usize, wi: [f32; 3], wo: [f32; 3]) -> [f32; 3] {
        let n = self.directions;
        self.angular_with(rank, &angular_taps(wi, n), &angular_taps(wo, n))
    }

    #[inline]
    fn angular_with(&self, rank: usize, wi: &Taps, wo: &Taps) -> [f32; 3] {
        let columns = self.directions * self.directions;
        let table = &self.angular[rank];
        let mut sum = [0.0; 3];
        for &(row, weight) in wo {
            let value = weighted(&table[row * columns..(row + 1) * columns], wi);
            for channel in 0..3 {
                sum[channel] += weight * value[channel];
            }
        }
        sum
    }

    /// Σ_r T_r(x)·S_r(ωi, ωo), RGB, no unit.
    #[inline]
    pub fn scaling_at(&self, x: [f32; 2], boundary: Boundary, wi: [f32; 3], wo: [f32; 3]) -> [f32; 3] {
        let place = bilinear_taps(x, self.patches, boundary);
        let [wi, wo] = [wi, wo].map(|direction| angular_taps(direction, self.directions));
        let mut sum = [0.0; 3];
        for (rank, spatial) in self.spatial.iter().enumerate() {
            let spatial = weighted(spatial, &place);
            let angular = self.angular_with(rank, &wi, &wo);
            for channel in 0..3 {
                sum[channel] += spatial[channel] * angular[channel];
            }
        }
        sum
    }

    /// Index of the cell that holds the fraction `x` ∈ [0, 1) of the map: floor(x·cells) along u and v.
    #[inline]
    pub fn cell_at(&self, x: [f32; 2]) -> usize {
        // x just under 1 may round up to `cells`.
        let [i, j] = [0, 1].map(|axis| ((x[axis] * self.cells[axis] as f32) as usize).min(self.cells[axis] - 1));
        j * self.cells[0] + i
    }

    /// f_c of a cell.
    pub fn cell_brdf<'a>(&self, cell: usize, bsdf: &'a BaseBrdf) -> CellBrdf<'a> {
        let color = self.base_color.as_ref().map_or([1.0; 3], |colors| colors[cell]);
        CellBrdf::new(self.lobes.iter().map(|lobe| lobe[cell]), bsdf, color)
    }

    /// The BRDF that this level of `asset` stands for; 1/sr, RGB, cosine not included.
    ///
    /// `x` is the fraction of the map along u and v in [0, 1), `n_c` the unit normal of the displaced coarse surface
    /// there, ωi and ωo are unit, point away from the surface and lie, like `n_c`, in the base frame: x = +u, y = −v,
    /// z out. Linear in T and S, symmetric in ωi and ωo as far as S is.
    pub fn f_low(&self, asset: &SurfaceAsset, x: [f32; 2], n_c: [f32; 3], wi: [f32; 3], wo: [f32; 3]) -> [f32; 3] {
        let f_c = self.cell_brdf(self.cell_at(x), &asset.bsdf).eval(n_c, wi, wo);
        let scaling = self.scaling_at(x, asset.boundary, wi, wo);
        [0, 1, 2].map(|channel| scaling[channel] * f_c[channel])
    }
}

#[inline]
fn weighted(table: &[[f32; 3]], taps: &Taps) -> [f32; 3] {
    let mut sum = [0.0; 3];
    for &(index, weight) in taps {
        for channel in 0..3 {
            sum[channel] += weight * table[index][channel];
        }
    }
    sum
}
