//! Σ over paths of a ⊗ b: a matrix product, blocked for registers, without fused multiply-add.

use super::vectors::{LANES, Vectors};
use crate::math::simd;

/// Rows that a block of registers holds.
const ROWS: usize = 4;

/// Paths of a block: their vectors fit the second cache, a block of columns of them the first.
const PATHS: usize = 128;

/// Σ a(ωi) b(ωo) of one patch and channel, `[i][o]`.
pub(super) struct Products {
    directions: usize,
    /// Directions, padded to a multiple of [`LANES`].
    row: usize,
    sums: Vec<f64>,
}

impl Products {
    /// Of no path yet.
    pub(super) fn new(directions: usize) -> Self {
        let row = directions.next_multiple_of(LANES);
        Self { directions, row, sums: vec![0.0; row * row] }
    }

    /// Number of directions.
    pub(super) fn directions(&self) -> usize {
        self.directions
    }

    /// The sum for one pair.
    pub(super) fn at(&self, i: usize, o: usize) -> f64 {
        self.sums[i * self.row + o]
    }

    /// Adds the paths of `vectors`: [`PATHS`] terms at a time in f32, then in f64.
    pub(super) fn add(&mut self, vectors: &Vectors, channel: usize) {
        let (light, view) = (&vectors.light[channel], &vectors.view[channel]);
        simd::run(Multiply { light, view, row: self.row, sums: &mut self.sums });
    }
}

struct Multiply<'a> {
    light: &'a [f32],
    view: &'a [f32],
    row: usize,
    sums: &'a mut [f64],
}

impl simd::Kernel for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (light, view) in self.light.chunks(PATHS * self.row).zip(self.view.chunks(PATHS * self.row)) {
            multiply(light, view, self.row, self.sums);
        }
    }
}

/// Adds one block of paths.
#[inline(always)]
fn multiply(light: &[f32], view: &[f32], row: usize, sums: &mut [f64]) {
    for i in (0..row).step_by(ROWS) {
        for o in (0..row).step_by(LANES) {
            let mut block = [[0.0_f32; LANES]; ROWS];
            for (light, view) in light.chunks_exact(row).zip(view.chunks_exact(row)) {
                let light = light[i..].first_chunk::<ROWS>().expect("a multiple of the rows");
                let view = view[o..].first_chunk::<LANES>().expect("a multiple of the lanes");
                for (block, &a) in block.iter_mut().zip(light) {
                    for (sum, &b) in block.iter_mut().zip(view) {
                        *sum += a * b;
                    }
                }
            }
            for (r, block) in block.iter().enumerate() {
                let sums = &mut sums[(i + r) * row + o..][..LANES];
                sums.iter_mut().zip(block).for_each(|(sum, &block)| *sum += f64::from(block));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Stream;

    #[test]
    fn products_are_the_sum_of_outer_products() {
        // more paths than a block, a number of directions that is no multiple of the lanes
        let (directions, paths) = (25_usize, 300);
        let row = directions.next_multiple_of(LANES);
        let table = |stream: u64| {
            let rng = Stream::new(1, stream);
            (0..paths * row)
                .map(|k| if k % row < directions { rng.uniform(k as u64) } else { 0.0 })
                .collect::<Vec<f32>>()
        };
        let vectors = Vectors { light: vec![table(0)], view: vec![table(1)] };
        let mut products = Products::new(directions);
        products.add(&vectors, 0);
        products.add(&vectors, 0);
        for (i, o) in [(0, 0), (3, 24), (24, 3), (17, 16)] {
            let term = |k: usize| f64::from(vectors.light[0][k * row + i]) * f64::from(vectors.view[0][k * row + o]);
            let expected = 2.0 * (0..paths).map(term).sum::<f64>();
            assert!((products.at(i, o) / expected - 1.0).abs() < 1e-6, "{i}, {o}: {} {expected}", products.at(i, o));
        }
    }
}
