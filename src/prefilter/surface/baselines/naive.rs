//! Averaged heights: what a texture's mipmap does to a displacement map. The base BRDF is left as it is.

use crate::geometry::{Boundary, HeightField};

/// Heights of `cells[0] × cells[1]` vertices, each the mean of the fine vertices within half a cell of it; those on the
/// rim count in proportion.
pub fn average_heights(fine: &HeightField, cells: [usize; 2]) -> HeightField {
    let size = fine.size();
    let boundary = fine.boundary();
    let along_u: Vec<Vec<(usize, f64)>> = (0..cells[0]).map(|i| neighbours(i, cells[0], size[0], boundary)).collect();
    let row_mean = |v: usize, taps: &[(usize, f64)]| -> f64 {
        taps.iter().map(|&(u, weight)| weight * f64::from(fine.heights()[v * size[0] + u])).sum()
    };
    let mut heights = Vec::with_capacity(cells[0] * cells[1]);
    for j in 0..cells[1] {
        let along_v = neighbours(j, cells[1], size[1], boundary);
        let mean =
            |taps: &[(usize, f64)]| -> f64 { along_v.iter().map(|&(v, weight)| weight * row_mean(v, taps)).sum() };
        heights.extend(along_u.iter().map(|taps| mean(taps) as f32));
    }
    let extent = fine.extent();
    let spacing = [0, 1].map(|k| extent[k] / cells[k] as f32);
    HeightField::new(heights, cells, spacing, boundary)
}

/// Fine vertices within half a cell of vertex `at` of `cells`, with weights of sum 1.
fn neighbours(at: usize, cells: usize, texels: usize, boundary: Boundary) -> Vec<(usize, f64)> {
    let width = texels as f64 / cells as f64;
    let [from, to] = [-0.5, 0.5].map(|half| (at as f64 + half) * width);
    let index = |k: i64| match boundary {
        Boundary::Repeat => k.rem_euclid(texels as i64) as usize,
        Boundary::Clamp => k.clamp(0, texels as i64 - 1) as usize,
    };
    // vertex k stands for the fine texels' length from k − ½ to k + ½
    let (first, last) = ((from + 0.5).floor() as i64, (to - 0.5).ceil() as i64);
    let overlap = |k: i64| to.min(k as f64 + 0.5) - from.max(k as f64 - 0.5);
    (first..=last).map(|k| (index(k), overlap(k).max(0.0) / width)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(size: [usize; 2], boundary: Boundary) -> HeightField {
        let heights = (0..size[0] * size[1]).map(|k| (k % size[0]) as f32).collect();
        HeightField::new(heights, size, [1.0, 1.0], boundary)
    }

    #[test]
    fn a_vertex_is_the_mean_around_it() {
        let coarse = average_heights(&ramp([12, 4], Boundary::Clamp), [3, 2]);
        // around vertex 1 (at 4) lie 2 to 6, the outer two by half
        assert_eq!(coarse.heights()[1], 4.0);
        assert_eq!(coarse.spacing(), [4.0, 2.0]);
    }

    #[test]
    fn a_repeated_map_keeps_its_mean_at_any_factor() {
        let fine = ramp([12, 10], Boundary::Repeat);
        let mean = |field: &HeightField| {
            field.heights().iter().map(|&h| f64::from(h)).sum::<f64>() / field.heights().len() as f64
        };
        for cells in [[12, 10], [6, 5], [5, 3], [1, 1]] {
            assert!((mean(&average_heights(&fine, cells)) - mean(&fine)).abs() < 1e-5, "{cells:?}");
        }
    }
}
