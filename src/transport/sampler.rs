//! Sample points of paths: a function of (seed, pixel, sample, dimension), never of a thread.

use crate::math::rng::Stream;

/// How the samples of a pixel relate to each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sampling {
    /// An Owen-scrambled Sobol sequence a pixel: unbiased, and for smooth integrands the error falls faster than 1/√n.
    #[default]
    Sobol,
    /// Independent numbers, whose variance can be told from the samples: for statistical tests.
    Independent,
}

/// The numbers of one sample of one pixel, four at a time.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    sampling: Sampling,
    sample: u32,
    scramble: u32,
    stream: Stream,
}

/// Groups of four dimensions that the Sobol sequence has; deeper ones are independent numbers.
const SOBOL_GROUPS: u32 = 64;
/// Samples of one scrambling.
const SOBOL_SAMPLES: u64 = 1 << 16;
/// Groups that a sample may ask for in the independent stream.
const GROUPS_A_SAMPLE: u64 = 1 << 16;

impl Sampler {
    /// The numbers of sample `sample` of pixel `pixel`.
    pub fn new(sampling: Sampling, seed: u64, pixel: u64, sample: u64) -> Self {
        let stream = Stream::new(seed, pixel);
        let scramble = stream.u32(u64::MAX - sample / SOBOL_SAMPLES);
        Self {
            sampling,
            sample: (sample % SOBOL_SAMPLES) as u32,
            scramble,
            stream: stream.at(sample * GROUPS_A_SAMPLE),
        }
    }

    /// Four numbers in [0, 1): those of group `group`.
    #[inline]
    pub fn four(&self, group: u32) -> [f32; 4] {
        if self.sampling == Sampling::Sobol && group < SOBOL_GROUPS {
            return sobol_burley::sample_4d(self.sample, group, self.scramble);
        }
        let [a, b] = self.stream.uniform_pair(2 * u64::from(group));
        let [c, d] = self.stream.uniform_pair(2 * u64::from(group) + 1);
        [a, b, c, d]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_power_of_two_of_sobol_samples_is_stratified_in_each_dimension() {
        for pixel in 0..4 {
            for dimension in 0..8 {
                let mut seen = [0; 64];
                for sample in 0..64 {
                    let four = Sampler::new(Sampling::Sobol, 3, pixel, sample).four(dimension / 4);
                    seen[(four[dimension as usize % 4] * 64.0) as usize] += 1;
                }
                assert_eq!(seen, [1; 64], "pixel {pixel}, dimension {dimension}");
            }
        }
    }

    #[test]
    fn both_kinds_have_the_mean_of_a_product_of_uniform_numbers() {
        for sampling in [Sampling::Sobol, Sampling::Independent] {
            // deep groups, another scrambling: what long paths and long renders reach
            for (group, first) in [(0, 0), (63, 0), (70, 0), (1, SOBOL_SAMPLES - 100)] {
                let n = 20_000;
                let mean = (first..first + n)
                    .map(|sample| Sampler::new(sampling, 1, 2, sample).four(group))
                    .map(|[a, b, c, d]| f64::from(a * b * c * d))
                    .sum::<f64>()
                    / n as f64;
                // variance of the product is 3⁻⁴ − 2⁻⁸
                let error = ((1.0 / 81.0 - 1.0 / 256.0) / n as f64).sqrt();
                assert!((mean - 1.0 / 16.0).abs() < 4.0 * error, "{sampling:?}, group {group}: {mean}");
            }
        }
    }
}
