//! Slope moments of every cell: what LEADR mapping knows of the micro-surface (Dupuy et al. 2013).

use crate::geometry::HeightField;
use crate::material::SlopeMoments;

/// Mean and covariance of the slopes of the bilinear surface within each cell, `[v][u]`, weighted by base area.
///
/// Within a texel ∂h/∂x runs linearly along v alone and ∂h/∂y along u alone, so both moments are exact.
pub fn slope_moments(fine: &HeightField, cells: [usize; 2]) -> Vec<SlopeMoments> {
    let size = fine.size();
    (0..cells[0] * cells[1])
        .map(|cell| {
            let at = [cell % cells[0], cell / cells[0]];
            let [along_u, along_v] = [0, 1].map(|k| spans(at[k], cells[k], size[k]));
            let mut sums = Sums::default();
            for &(v, t) in &along_v {
                for &(u, s) in &along_u {
                    sums.add(fine, [u, v], [s, t]);
                }
            }
            sums.moments()
        })
        .collect()
}

/// Weighted sums of slopes and their products: x, y, xx, xy, yy.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    weight: f64,
    first: [f64; 2],
    second: [f64; 3],
}

impl Sums {
    /// Adds the part [s₀, s₁] × [t₀, t₁] of a texel.
    fn add(&mut self, fine: &HeightField, [u, v]: [usize; 2], [s, t]: [[f64; 2]; 2]) {
        let weight = (s[1] - s[0]) * (t[1] - t[0]);
        // ∂h/∂x at the upper and lower edge of the part, ∂h/∂y at its left and right one
        let corner = |k: usize| fine.slope(u, v, s[k] as f32, t[k] as f32).map(f64::from);
        let [low, high] = [corner(0), corner(1)];
        let mean = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
        let square = [0, 1].map(|k| (low[k] * low[k] + low[k] * high[k] + high[k] * high[k]) / 3.0);
        self.weight += weight;
        (0..2).for_each(|k| self.first[k] += weight * mean[k]);
        let products = [square[0], mean[0] * mean[1], square[1]];
        (0..3).for_each(|k| self.second[k] += weight * products[k]);
    }

    fn moments(&self) -> SlopeMoments {
        let [x, y] = self.first.map(|sum| sum / self.weight);
        let [xx, xy, yy] = self.second.map(|sum| sum / self.weight);
        // rounding may leave a hair below 0 where a cell is a plane
        let covariance = [(xx - x * x).max(0.0), xy - x * y, (yy - y * y).max(0.0)];
        SlopeMoments { mean: [x as f32, y as f32], covariance: covariance.map(|c| c as f32) }
    }
}

/// Texels that cell `at` of `cells` covers along an axis of `texels`, and the part of each: from where to where, 0 to 1.
fn spans(at: usize, cells: usize, texels: usize) -> Vec<(usize, [f64; 2])> {
    let bound = |k: usize| k as f64 * texels as f64 / cells as f64;
    let (start, end) = (bound(at), bound(at + 1));
    let part = |texel: usize| [(start - texel as f64).max(0.0), (end - texel as f64).min(1.0)];
    (start.floor() as usize..(end.ceil() as usize).min(texels)).map(|texel| (texel, part(texel))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Boundary;

    #[test]
    fn moments_are_those_of_many_points_of_the_surface() {
        let heights = (0..48).map(|k| ((k * k * 7 % 31) as f32) * 0.1).collect();
        let fine = HeightField::new(heights, [8, 6], [0.5, 1.5], Boundary::Repeat);
        let moments = slope_moments(&fine, [3, 2]);
        let n = 480;
        for (cell, moments) in moments.iter().enumerate() {
            let (mut mean, mut second) = ([0.0; 2], [0.0; 3]);
            for k in 0..n * n {
                let fraction = [k % n, k / n].map(|i| (i as f64 + 0.5) / n as f64);
                let place = [(fraction[0] + (cell % 3) as f64) * 8.0 / 3.0, (fraction[1] + (cell / 3) as f64) * 3.0];
                let [u, v] = place.map(|x| x as usize);
                let [x, y] = fine.slope(u, v, place[0].fract() as f32, place[1].fract() as f32).map(f64::from);
                let weight = 1.0 / (n * n) as f64;
                mean = [mean[0] + weight * x, mean[1] + weight * y];
                second = [second[0] + weight * x * x, second[1] + weight * x * y, second[2] + weight * y * y];
            }
            let covariance =
                [second[0] - mean[0] * mean[0], second[1] - mean[0] * mean[1], second[2] - mean[1] * mean[1]];
            // midpoints that no border of a texel divides: what is left is the curvature of squares, 1e-5
            (0..2).for_each(|k| assert!((f64::from(moments.mean[k]) - mean[k]).abs() < 1e-3));
            (0..3).for_each(|k| {
                assert!((f64::from(moments.covariance[k]) - covariance[k]).abs() < 1e-3 * (1.0 + covariance[k].abs()))
            });
        }
    }
}
