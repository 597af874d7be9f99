//! Micro-normals of one cell with the micro-area that each stands for.

use crate::geometry::HeightField;

/// Samples that a kernel takes at once; lists are padded to a multiple with samples of weight 0.
pub(super) const LANES: usize = 8;

/// Most sub-samples of a texel along an axis. A wall of slope 64 stands for 64 times its base area.
const MAX_SPLIT: f32 = 8.0;

/// Unit normals in the base frame and their weights (micro-area per base area of the cell), component by component.
///
/// Σ weight · z = 1 and Σ weight · (x, y) = minus the mean slopes of the cell, both exact but for rounding.
#[derive(Default)]
pub(super) struct MicroNormals {
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) z: Vec<f32>,
    pub(super) weight: Vec<f32>,
}

impl MicroNormals {
    /// Replaces the samples by those of the rectangle between `ends[axis]`: whole texels and the fraction beyond.
    pub(super) fn gather(&mut self, fine: &HeightField, ends: [[(usize, f64); 2]; 2]) {
        self.clear();
        let length = |[(first, s0), (last, s1)]: [(usize, f64); 2]| (last - first) as f64 + s1 - s0;
        let per_area = (1.0 / (length(ends[0]) * length(ends[1]))) as f32;
        for (j, t) in texels(ends[1]) {
            for (i, s) in texels(ends[0]) {
                self.gather_texel(fine, [i, j], [s, t], per_area);
            }
        }
        self.pad();
    }

    /// The part `[from, to]` of a texel along u and v, in about 1/⟨ωm, ωg⟩ sub-samples.
    ///
    /// A sub-sample takes the slope in its middle, which is its mean: slopes of a bilinear patch are linear.
    fn gather_texel(&mut self, fine: &HeightField, texel: [usize; 2], part: [[f32; 2]; 2], per_area: f32) {
        let corners = fine.corners(texel[0], texel[1]);
        let split = split(corners, fine.spacing());
        let step = part.map(|[from, to]| (to - from) / split as f32);
        let area = step[0] * step[1] * per_area;
        for k in 0..split * split {
            let s = part[0][0] + (0.5 + (k % split) as f32) * step[0];
            let t = part[1][0] + (0.5 + (k / split) as f32) * step[1];
            let [du, dv] = slope(corners, fine.spacing(), s, t);
            let stretch = (1.0 + du * du + dv * dv).sqrt();
            let z = 1.0 / stretch;
            self.push([-du * z, -dv * z, z], area * stretch);
        }
    }

    fn push(&mut self, normal: [f32; 3], weight: f32) {
        self.x.push(normal[0]);
        self.y.push(normal[1]);
        self.z.push(normal[2]);
        self.weight.push(weight);
    }

    fn clear(&mut self) {
        self.x.clear();
        self.y.clear();
        self.z.clear();
        self.weight.clear();
    }

    fn pad(&mut self) {
        while !self.len().is_multiple_of(LANES) {
            self.push([0.0, 0.0, 1.0], 0.0);
        }
    }

    /// Keeps `most` of the samples, evenly chosen, where there are more.
    pub(super) fn thin(&mut self, most: usize) {
        let len = self.len();
        if len > most {
            let kept = |values: &[f32]| (0..most).map(|k| values[k * len / most]).collect();
            *self = Self { x: kept(&self.x), y: kept(&self.y), z: kept(&self.z), weight: kept(&self.weight) };
            self.pad();
        }
    }

    /// Number of samples, padding included.
    pub(super) fn len(&self) -> usize {
        self.weight.len()
    }

    /// Exchanges two samples.
    pub(super) fn swap(&mut self, a: usize, b: usize) {
        self.x.swap(a, b);
        self.y.swap(a, b);
        self.z.swap(a, b);
        self.weight.swap(a, b);
    }

    /// Normal and weight of sample `k`.
    pub(super) fn get(&self, k: usize) -> ([f32; 3], f32) {
        ([self.x[k], self.y[k], self.z[k]], self.weight[k])
    }
}

/// Texels between two places and the part of each, as fractions of the texel.
fn texels([(first, start), (last, end)]: [(usize, f64); 2]) -> impl Iterator<Item = (usize, [f32; 2])> {
    let part = move |k: usize| {
        let from = if k == first { start } else { 0.0 };
        let to = if k == last { end } else { 1.0 };
        (k, [from as f32, to as f32])
    };
    (first..=last).map(part).filter(|(_, [from, to])| to > from)
}

/// Slopes (∂h/∂x, ∂h/∂y) at (s, t) of the bilinear patch over `corners`; [`HeightField::slope`] with corners in hand.
fn slope([h00, h10, h01, h11]: [f32; 4], spacing: [f32; 2], s: f32, t: f32) -> [f32; 2] {
    let du = (h10 - h00) * (1.0 - t) + (h11 - h01) * t;
    let dv = (h01 - h00) * (1.0 - s) + (h11 - h10) * s;
    [du / spacing[0], -dv / spacing[1]]
}

/// Sub-samples per axis: split² ≈ 1/⟨ωm, ωg⟩ at the steepest corner.
fn split([h00, h10, h01, h11]: [f32; 4], spacing: [f32; 2]) -> usize {
    let du = (h10 - h00).abs().max((h11 - h01).abs()) / spacing[0];
    let dv = (h01 - h00).abs().max((h11 - h10).abs()) / spacing[1];
    let stretch = (1.0 + du * du + dv * dv).sqrt();
    (stretch.sqrt().min(MAX_SPLIT) + 0.5) as usize
}
