//! A Monte Carlo result: mean, variance of the mean, sample count.

/// A mean with the variance of that mean and the number of samples behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Mean of the samples.
    pub mean: f64,
    /// Variance of `mean`, not of one sample; of stratified samples an upper bound, as if they were independent.
    pub variance: f64,
    /// Samples taken.
    pub count: u64,
}

/// Sums samples towards an [`Estimate`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Accumulator {
    count: u64,
    mean: f64,
    /// Σ (x − mean)², updated by Welford's recurrence: Σx² − n·mean² would cancel where samples are alike.
    deviation: f64,
}

impl Accumulator {
    /// Adds one sample.
    #[inline]
    pub fn add(&mut self, sample: f64) {
        self.count += 1;
        let off = sample - self.mean;
        self.mean += off / self.count as f64;
        self.deviation += off * (sample - self.mean);
    }

    /// What the samples so far say; the variance of fewer than two is infinite.
    pub fn estimate(&self) -> Estimate {
        let n = self.count as f64;
        let variance = if self.count < 2 { f64::INFINITY } else { self.deviation / (n * (n - 1.0)) };
        Estimate { mean: self.mean, variance, count: self.count }
    }
}

impl Estimate {
    /// Square root of the variance of the mean.
    pub fn standard_error(&self) -> f64 {
        self.variance.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_variance_of_the_mean_are_the_textbook_ones() {
        let samples = [1e8 + 1.0, 1e8 + 2.0, 1e8 + 6.0];
        let mut sum = Accumulator::default();
        samples.iter().for_each(|&x| sum.add(x));
        let estimate = sum.estimate();
        assert_eq!((estimate.mean, estimate.count), (1e8 + 3.0, 3));
        assert!((estimate.variance - 14.0 / 6.0).abs() < 1e-7);
        assert!((estimate.standard_error().powi(2) - estimate.variance).abs() < 1e-12);
    }

    #[test]
    fn one_sample_says_nothing_about_its_error() {
        let mut sum = Accumulator::default();
        sum.add(1.0);
        assert_eq!(sum.estimate().variance, f64::INFINITY);
    }
}
