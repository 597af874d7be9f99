//! Slope moments of every cell: what LEADR mapping knows of the micro-surface (Dupuy et al. 2013).

use super::super::overlaps;
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
            let [along_u, along_v] = [0, 1].map(|k| overlaps(at[k], cells[k], size[k]));
            let mut sums = Sums::default();
            for &(v, wv) in &along_v {
                for &(u, wu) in &along_u {
                    sums.add(fine, [u, v], wu * wv);
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
    fn add(&mut self, fine: &HeightField, [u, v]: [usize; 2], weight: f64) {
        // ∂h/∂x at the upper and lower edge, ∂h/∂y at the left and right one
        let [low, high] = [fine.slope(u, v, 0.0, 0.0), fine.slope(u, v, 1.0, 1.0)].map(|slope| slope.map(f64::from));
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
            // midpoint rule with 480 points an axis: jumps between texels cost 1/480
            (0..2).for_each(|k| assert!((f64::from(moments.mean[k]) - mean[k]).abs() < 1e-2));
            (0..3).for_each(|k| {
                assert!((f64::from(moments.covariance[k]) - covariance[k]).abs() < 1e-2 * (1.0 + covariance[k].abs()))
            });
        }
    }
}
