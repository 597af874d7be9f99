//! What a render gives: mean, variance of the mean and sample count of every pixel.

use super::estimate::Accumulator;

/// An image under way: samples are added pass by pass.
#[derive(Clone, Debug)]
pub struct Film {
    size: [usize; 2],
    /// `[row][column][rgb]`.
    pub(super) pixels: Vec<[Accumulator; 3]>,
}

impl Film {
    /// An empty film of `size[0]` columns and `size[1]` rows.
    pub fn new(size: [usize; 2]) -> Self {
        Self { size, pixels: vec![[Accumulator::default(); 3]; size[0] * size[1]] }
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Samples a pixel so far; every pixel has as many.
    pub fn samples(&self) -> u64 {
        self.pixels.first().map_or(0, |pixel| pixel[0].estimate().count)
    }

    /// Mean radiance of the pixels, `[row][column]`, RGB, row 0 at the top.
    pub fn radiance(&self) -> Vec<[f32; 3]> {
        self.pixels.iter().map(|pixel| pixel.map(|sum| sum.estimate().mean as f32)).collect()
    }

    /// Variance of these means, as if samples were independent; infinite for fewer than two samples.
    ///
    /// For [`Sampling::Sobol`](super::sampler::Sampling) that is an upper bound, as its samples are spread more evenly.
    pub fn variance(&self) -> Vec<[f32; 3]> {
        self.pixels.iter().map(|pixel| pixel.map(|sum| sum.estimate().variance as f32)).collect()
    }
}
