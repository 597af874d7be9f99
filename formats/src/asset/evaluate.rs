//! What a level stands for: f_low = (Σ_r T_r(x)·S_r(ωi, ωo))·f_c on the displaced surface, T_a(x)·E(ωi, ωo) on the base.

use super::{AdditiveTerm, SurfaceAsset, SurfaceLevel};
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
        pair_weighted(&self.angular[rank], &angular_taps(wi, n), &angular_taps(wo, n), n)
    }

    /// Σ_r T_r(x)·S_r(ωi, ωo), RGB, no unit.
    #[inline]
    pub fn scaling_at(&self, x: [f32; 2], boundary: Boundary, wi: [f32; 3], wo: [f32; 3]) -> [f32; 3] {
        let place = bilinear_taps(x, self.patches, boundary);
        let [wi, wo] = [wi, wo].map(|direction| angular_taps(direction, self.directions));
        let mut sum = [0.0; 3];
        for (rank, spatial) in self.spatial.iter().enumerate() {
            let spatial = weighted(spatial, &place);
            let angular = pair_weighted(&self.angular[rank], &wi, &wo, self.directions);
            for channel in 0..3 {
                sum[channel] += spatial[channel] * angular[channel];
            }
        }
        sum
    }

    /// T_a(x)·E(ωi, ωo), 1/sr, RGB: what the base plane reflects besides; 0 without the term and below the horizon.
    ///
    /// It is lit with the cosine of the base plane and shadowed by nothing of the relief.
    pub fn additive_at(&self, x: [f32; 2], boundary: Boundary, wi: [f32; 3], wo: [f32; 3]) -> [f32; 3] {
        let Some(term) = self.additive.as_ref().filter(|_| wi[2] > 0.0 && wo[2] > 0.0) else { return [0.0; 3] };
        let (spatial, angular) = (self.additive_spatial_at(x, boundary), term.angular_at(wi, wo));
        [0, 1, 2].map(|channel| spatial[channel] * angular[channel])
    }

    /// T_a at the fraction `x` of the map, as [`Self::spatial_at`]; 0 without the term.
    #[inline]
    pub fn additive_spatial_at(&self, x: [f32; 2], boundary: Boundary) -> [f32; 3] {
        let taps = || bilinear_taps(x, self.patches, boundary);
        self.additive.as_ref().map_or([0.0; 3], |term| weighted(&term.spatial, &taps()))
    }

    /// Height in metres of the coarse surface over the fraction `x` ∈ [0, 1) of the map.
    ///
    /// Vertex (i, j) stands over the fraction (i/`cells[0]`, j/`cells[1]`); the surface is bilinear between vertices, and
    /// the vertex after the last is the first (`Repeat`) or the last again (`Clamp`).
    pub fn height_at(&self, x: [f32; 2], boundary: Boundary) -> f32 {
        let ([h00, h10, h01, h11], [s, t]) = self.corners_at(x, boundary);
        let [top, bottom] = [h00 + (h10 - h00) * s, h01 + (h11 - h01) * s];
        top + (bottom - top) * t
    }

    /// Unit normal n_c of the coarse surface over the fraction `x` ∈ [0, 1) of the map of `asset`, base frame.
    ///
    /// normalise(−∂h/∂x, −∂h/∂y, 1) of the bilinear patch, y = −v.
    pub fn normal_at(&self, asset: &SurfaceAsset, x: [f32; 2]) -> [f32; 3] {
        let ([h00, h10, h01, h11], [s, t]) = self.corners_at(x, asset.boundary);
        let spacing = [0, 1].map(|axis| (asset.size[axis] / self.cells[axis] as f64) as f32);
        let dh_dx = ((h10 - h00) * (1.0 - t) + (h11 - h01) * t) / spacing[0];
        let dh_dv = ((h01 - h00) * (1.0 - s) + (h11 - h10) * s) / spacing[1];
        let scale = 1.0 / (dh_dx * dh_dx + dh_dv * dh_dv + 1.0).sqrt();
        [-dh_dx * scale, dh_dv * scale, scale]
    }

    /// Corner heights (00, 10, 01, 11; first index along u) of the cell at `x`, and the fraction of the cell.
    fn corners_at(&self, x: [f32; 2], boundary: Boundary) -> ([f32; 4], [f32; 2]) {
        let [(i, i1, s), (j, j1, t)] = [0, 1].map(|axis| {
            let n = self.cells[axis];
            let place = x[axis] * n as f32;
            let cell = (place as usize).min(n - 1);
            let beyond = if boundary == Boundary::Repeat { 0 } else { cell };
            (cell, if cell + 1 < n { cell + 1 } else { beyond }, place - cell as f32)
        });
        let at = |i: usize, j: usize| self.heights[j * self.cells[0] + i];
        ([at(i, j), at(i1, j), at(i, j1), at(i1, j1)], [s, t])
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

impl AdditiveTerm {
    /// E(ωi, ωo), as [`SurfaceLevel::angular_at`].
    #[inline]
    pub fn angular_at(&self, wi: [f32; 3], wo: [f32; 3]) -> [f32; 3] {
        let n = self.directions;
        pair_weighted(&self.angular, &angular_taps(wi, n), &angular_taps(wo, n), n)
    }
}

/// A table of pairs, `[wo·n² + wi]`, at the taps of both directions.
#[inline]
fn pair_weighted(table: &[[f32; 3]], wi: &Taps, wo: &Taps, n: usize) -> [f32; 3] {
    let columns = n * n;
    let mut sum = [0.0; 3];
    for &(row, weight) in wo {
        let value = weighted(&table[row * columns..(row + 1) * columns], wi);
        for channel in 0..3 {
            sum[channel] += weight * value[channel];
        }
    }
    sum
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
