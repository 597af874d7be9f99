//! Counter-based random numbers: a function of (seed, stream, index), never of a thread.

/// One stream of random numbers: the same (seed, stream, index) gives the same number on every machine.
///
/// A stream is named by what is sampled (a patch, a texel, a bin), an index by the sample and its dimension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    key: u64,
}

/// 2^64 over the golden ratio, odd: consecutive indices land far apart.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
/// Another odd constant, so that (seed, stream) and (stream, seed) differ.
const STREAM_STEP: u64 = 0xd1b5_4a32_d192_ed03;

impl Stream {
    /// The stream of that number under `seed`.
    pub fn new(seed: u64, stream: u64) -> Self {
        Self { key: mix(mix(seed.wrapping_add(GOLDEN)) ^ stream.wrapping_mul(STREAM_STEP)) }
    }

    /// The stream that starts at `index` of this one.
    #[inline]
    pub fn at(self, index: u64) -> Self {
        Self { key: self.key.wrapping_add(index.wrapping_mul(GOLDEN)) }
    }

    /// 64 random bits.
    #[inline]
    pub fn bits(self, index: u64) -> u64 {
        mix(self.key.wrapping_add(index.wrapping_mul(GOLDEN)))
    }

    /// 32 random bits.
    #[inline]
    pub fn u32(self, index: u64) -> u32 {
        (self.bits(index) >> 32) as u32
    }

    /// Uniform in [0, 1), a multiple of 2⁻²⁴.
    #[inline]
    pub fn uniform(self, index: u64) -> f32 {
        unit(self.bits(index) >> 32)
    }

    /// Uniform in [0, 1)², from one index.
    #[inline]
    pub fn uniform_pair(self, index: u64) -> [f32; 2] {
        let bits = self.bits(index);
        [unit(bits >> 32), unit(bits & 0xffff_ffff)]
    }

    /// A jittered point of stratum `k` of `strata[0] × strata[1]` strata of the unit square, row-major.
    #[inline]
    pub fn stratified(self, strata: [usize; 2], k: usize) -> [f32; 2] {
        debug_assert!(k < strata[0] * strata[1], "a stratum of the square");
        let [jx, jy] = self.uniform_pair(k as u64);
        let [column, row] = [k % strata[0], k / strata[0]];
        [(column as f32 + jx) / strata[0] as f32, (row as f32 + jy) / strata[1] as f32].map(below_one)
    }
}

/// The numbers of a stream one after the other, for walks that do not know beforehand how many they need.
#[derive(Clone, Copy, Debug)]
pub struct Draws {
    stream: Stream,
    next: u64,
}

impl Draws {
    /// From the start of `stream`.
    #[inline]
    pub fn new(stream: Stream) -> Self {
        Self { stream, next: 0 }
    }

    /// Uniform in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f32 {
        self.pair()[0]
    }

    /// Uniform in [0, 1)².
    #[inline]
    pub fn pair(&mut self) -> [f32; 2] {
        self.next += 1;
        self.stream.uniform_pair(self.next - 1)
    }
}

/// The upper 24 of 32 bits as a fraction: every value is exact, and 1 cannot be reached.
#[inline]
fn unit(bits: u64) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// Absorbs the rounding of k + jitter up to k + 1 in the last stratum.
#[inline]
fn below_one(x: f32) -> f32 {
    x.min(1.0 - f32::EPSILON / 2.0)
}

/// The finaliser of splitmix64 (Stafford's variant 13): each input bit flips each output bit with probability 1/2.
#[inline]
fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Σ (observed − expected)² / expected over equally likely bins.
    fn chi_square(counts: &[u64]) -> f64 {
        let expected = counts.iter().sum::<u64>() as f64 / counts.len() as f64;
        counts.iter().map(|&c| (c as f64 - expected).powi(2) / expected).sum()
    }

    /// Standard score of a chi-square value with `freedom` degrees of freedom, which is near normal for 255 and more.
    fn score(chi_square: f64, freedom: f64) -> f64 {
        (chi_square - freedom) / (2.0 * freedom).sqrt()
    }

    #[test]
    fn numbers_of_a_stream_are_uniform() {
        for (seed, stream) in [(0, 0), (1, 0), (0, 1), (u64::MAX, 12345)] {
            let rng = Stream::new(seed, stream);
            let mut counts = [0; 256];
            for index in 0..65_536 {
                counts[(rng.uniform(index) * 256.0) as usize] += 1;
            }
            assert!(score(chi_square(&counts), 255.0).abs() < 4.0, "seed {seed}, stream {stream}");
        }
    }

    #[test]
    fn neighbouring_streams_and_indices_are_independent() {
        // Pairs of numbers that callers use together fill the square evenly.
        let pairs: [fn(u64) -> [f32; 2]; 4] = [
            |k| [Stream::new(7, k).uniform(0), Stream::new(7, k + 1).uniform(0)],
            |k| [Stream::new(k, 3).uniform(5), Stream::new(k + 1, 3).uniform(5)],
            |k| [Stream::new(7, 0).uniform(k), Stream::new(7, 0).uniform(k + 1)],
            |k| Stream::new(7, 1).uniform_pair(k),
        ];
        for (case, pair) in pairs.iter().enumerate() {
            let mut counts = [0; 256];
            for k in 0..65_536 {
                let [x, y] = pair(k);
                counts[(x * 16.0) as usize * 16 + (y * 16.0) as usize] += 1;
            }
            assert!(score(chi_square(&counts), 255.0).abs() < 4.0, "case {case}");
        }
    }

    #[test]
    fn swapping_seed_and_stream_gives_other_numbers() {
        assert_ne!(Stream::new(1, 2).bits(0), Stream::new(2, 1).bits(0));
    }

    #[test]
    fn each_stratum_holds_its_own_point() {
        let strata = [7, 3];
        for k in 0..21 {
            let [x, y] = Stream::new(1, 2).stratified(strata, k);
            assert_eq!([(x * 7.0) as usize, (y * 3.0) as usize], [k % 7, k / 7]);
            assert!((0.0..1.0).contains(&x) && (0.0..1.0).contains(&y));
        }
    }
}
