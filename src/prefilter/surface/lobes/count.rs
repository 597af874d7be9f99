//! How many lobes a level needs.
//!
//! A count is judged by the total variation ½∫|p − q| dω between the distribution p of a cell's micro-normals and its
//! mixture q, both blurred by a vMF lobe of concentration [`BLUR`]: that of a base BRDF of roughness 0.14. Light sees
//! the normals through the BRDF only; and blurred, both are smooth functions that a table of directions resolves,
//! however narrow a lobe is. The rule: **the fewest lobes whose total variation is at most [`TOLERANCE`], or at most
//! [`NOISE_SHARE`] of what the finite number of normals explains by itself.** Where no count gets there, the fewest
//! within [`NEARLY`] of the best. Noise is what a few texels cannot be told from; at 64× there is none left. On the
//! fixtures, mean over the cells looked at (`cargo bench --bench lobes` prints it):
//!
//! | map | factor | 1 | 2 | 3 | 4 | 6 | 8 | noise | chosen |
//! |---|---|---|---|---|---|---|---|---|---|
//! | fbm | 8 | 0.246 | 0.162 | 0.119 | 0.091 | 0.061 | 0.045 | 0.127 | 4 |
//! | fbm | 64 | 0.148 | 0.128 | 0.101 | 0.075 | 0.059 | 0.052 | 0.026 | 4 |
//! | twill | 8 | 0.507 | 0.261 | 0.169 | 0.103 | 0.052 | 0.033 | 0.095 | 6 |
//! | twill | 64 | 0.317 | 0.276 | 0.244 | 0.232 | 0.167 | 0.136 | 0.029 | 8 |
//! | silk | 8 | 0.263 | 0.107 | 0.054 | 0.026 | 0.011 | 0.005 | 0.057 | 3 |
//! | bump | 8 | 0.279 | 0.061 | 0.046 | 0.032 | 0.017 | 0.012 | 0.052 | 2 |
//! | bump | 64 | 0.320 | 0.320 | 0.317 | 0.300 | 0.104 | 0.105 | 0.033 | 6 |
//! | vgroove | 8 | 0.000 | 0.000 | 0.000 | 0.000 | 0.000 | 0.000 | 0.000 | 1 |
//! | vgroove | 64 | 0.865 | 0.000 | 0.000 | 0.000 | 0.000 | 0.000 | 0.006 | 2 |
//! | cliffs | 8 | 0.214 | 0.018 | 0.006 | 0.001 | 0.000 | 0.000 | 0.007 | 2 |

use super::mixture::exp_neg;
use super::samples::{LANES, MicroNormals};
use super::{Footprints, fit_cell};
use crate::geometry::HeightField;
use crate::math::vmf::{kappa_from_one_minus_r, one_minus_resultant, peak_density};
use crate::prefilter::surface::VmfLobe;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};

/// Numbers of lobes that a level may have.
pub const LOBE_COUNTS: [usize; 6] = [1, 2, 3, 4, 6, 8];

/// Concentration of the blur: as wide as the cells of the table of directions (0.1 against 0.17 rad).
const BLUR: f32 = 100.0;

/// Directions per axis of the table: cells of the concentric equal-area map of the hemisphere.
const DIRECTIONS: usize = 15;

/// Cells and samples that are looked at, at most: they bound the time for small and for large footprints.
const MAX_CELLS: usize = 256;
const MAX_SAMPLES: usize = 1 << 16;

/// Total variation that no further lobe is spent on. The scaling factors absorb smooth errors of this size; at 0.05
/// noise at 64× would take 8 lobes instead of 4, at 0.1 twill at 8× would be within 3 % of being given 4.
const TOLERANCE: f64 = 0.08;

/// Part of the sampling noise that is accepted. Not all of it: a fitted mixture follows some of the noise itself.
const NOISE_SHARE: f64 = 0.85;

/// Where no count is good enough, one whose error is this little above the best will do.
const NEARLY: f64 = 1.05;

/// How well mixtures of so many lobes fit, mean over the cells that were looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CountError {
    /// Lobes a cell.
    pub lobes: usize,
    /// Total variation between the blurred distributions, 0 to 1.
    pub total_variation: f64,
    /// Total variation to be expected between a smooth distribution and as many independent samples of it.
    pub sampling_noise: f64,
}

/// The number of lobes for a level; the rule stands at the top of this file.
pub fn choose_lobe_count(fine: &HeightField, coarse_cells: [usize; 2]) -> usize {
    let errors = lobe_count_errors(fine, coarse_cells);
    let best = errors.iter().map(|e| e.total_variation).fold(f64::MAX, f64::min);
    let good = |e: &&CountError| e.total_variation <= TOLERANCE.max(NOISE_SHARE * e.sampling_noise);
    let nearly_best = |e: &&CountError| e.total_variation <= NEARLY * best;
    let chosen = errors.iter().find(good).or_else(|| errors.iter().find(nearly_best));
    chosen.map_or(LOBE_COUNTS[LOBE_COUNTS.len() - 1], |e| e.lobes)
}

/// The error of each of [`LOBE_COUNTS`] on a fixed subset of cells.
pub fn lobe_count_errors(fine: &HeightField, coarse_cells: [usize; 2]) -> Vec<CountError> {
    let table = Directions::new();
    let mut cells = gather_some(fine, coarse_cells);
    let per_cell: Vec<CellErrors> = cells.par_iter_mut().map(|samples| table.errors(samples)).collect();
    let mean = |value: &dyn Fn(&CellErrors) -> f32| {
        per_cell.iter().map(|errors| f64::from(value(errors))).sum::<f64>() / per_cell.len() as f64
    };
    let sampling_noise = mean(&|errors| errors.noise);
    let error = |(k, &lobes)| CountError { lobes, total_variation: mean(&|e| e.total_variation[k]), sampling_noise };
    LOBE_COUNTS.iter().enumerate().map(error).collect()
}

/// The micro-normals of some cells, spread evenly over the map by the R2 sequence.
fn gather_some(fine: &HeightField, cells: [usize; 2]) -> Vec<MicroNormals> {
    // Inverse powers of the plastic number, the root of x³ = x + 1.
    const STEPS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053_3];
    let footprints = Footprints::new(fine, cells);
    let mut left = MAX_SAMPLES;
    let mut gathered = Vec::new();
    for k in 0..MAX_CELLS.min(cells[0] * cells[1]) {
        let along = |axis: usize| ((0.5 + k as f64 * STEPS[axis]).fract() * cells[axis] as f64) as usize;
        let mut samples = MicroNormals::default();
        footprints.gather([along(0), along(1)], &mut samples);
        samples.thin(MAX_SAMPLES);
        if samples.len() > left {
            break;
        }
        left -= samples.len();
        gathered.push(samples);
    }
    gathered
}

/// What one cell says.
struct CellErrors {
    total_variation: [f32; LOBE_COUNTS.len()],
    noise: f32,
}

/// Centres of the table's cells, component by component, padded with directions that nothing reaches.
struct Directions {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

impl Directions {
    fn new() -> Self {
        let mut table = Self { x: vec![], y: vec![], z: vec![] };
        for k in 0..DIRECTIONS * DIRECTIONS {
            let [u, v] = [k % DIRECTIONS, k / DIRECTIONS].map(|k| (2 * k + 1) as f32 / DIRECTIONS as f32 - 1.0);
            let (r, phi) = match u.abs() > v.abs() {
                true => (u, PI / 4.0 * v / u),
                false if v == 0.0 => (0.0, 0.0),
                false => (v, PI / 2.0 - PI / 4.0 * u / v),
            };
            let radius = r * (2.0 - r * r).sqrt();
            table.push([radius * phi.cos(), radius * phi.sin(), 1.0 - r * r]);
        }
        while !table.x.len().is_multiple_of(LANES) {
            table.push([0.0, 0.0, -100.0]);
        }
        table
    }

    fn push(&mut self, [x, y, z]: [f32; 3]) {
        self.x.push(x);
        self.y.push(y);
        self.z.push(z);
    }

    /// Total variations of the mixtures of each count, and the expected one of as many independent normals.
    fn errors(&self, samples: &mut MicroNormals) -> CellErrors {
        let density = self.density_of(samples);
        // Both distributions as shares of the micro-area.
        let per_share = 0.5 * TAU / (DIRECTIONS * DIRECTIONS) as f32 / density.area;
        let total_variation = LOBE_COUNTS.map(|count| {
            let mut mixture = vec![0.0; self.x.len()];
            let lobes = fit_cell(samples, count);
            lobes.iter().filter(|lobe| lobe.weight > 0.0).for_each(|lobe| self.add_blurred(lobe, &mut mixture));
            per_share * density.mean.iter().zip(&mixture).map(|(p, q)| (p - q).abs()).sum::<f32>()
        });
        // Mean absolute value of a normal deviate: √(2/π) of its standard deviation.
        let noise = per_share * (2.0 / PI).sqrt() * density.variance.iter().map(|v| v.sqrt()).sum::<f32>();
        CellErrors { total_variation, noise }
    }

    /// Σ_k w_k γ(n_k) at the table's directions with its variance Σ (w_k γ(n_k))² − (Σ w_k γ(n_k))²/n.
    fn density_of(&self, samples: &MicroNormals) -> BlurredDensity {
        let mut mean = vec![0.0; self.x.len()];
        let mut variance = vec![0.0; self.x.len()];
        let peak = peak_density(BLUR);
        let [mut area, mut area_square] = [0.0; 2];
        for k in 0..samples.len() {
            let ([nx, ny, nz], w) = samples.get(k);
            area += w;
            area_square += w * w;
            let sums = mean.iter_mut().zip(&mut variance);
            for ((((sum, square), x), y), z) in sums.zip(&self.x).zip(&self.y).zip(&self.z) {
                let [dx, dy, dz] = [x - nx, y - ny, z - nz];
                let density = w * peak * exp_neg(-0.5 * BLUR * (dx * dx + dy * dy + dz * dz));
                *sum += density;
                *square += density * density;
            }
        }
        // n by Kish: samples of unequal weights count for fewer. max: rounding where all normals are equal.
        let per_sample = area_square / (area * area);
        variance.iter_mut().zip(&mean).for_each(|(v, m)| *v = (*v - m * m * per_sample).max(0.0));
        BlurredDensity { mean, variance, area }
    }

    /// Adds a lobe blurred: mean resultant lengths multiply, so 1 − r = a + b − ab.
    fn add_blurred(&self, lobe: &VmfLobe, sum: &mut [f32]) {
        let [a, b] = [one_minus_resultant(lobe.kappa), one_minus_resultant(BLUR)];
        self.add_lobe(lobe.mean, kappa_from_one_minus_r(a + b - a * b), lobe.weight, sum);
    }

    fn add_lobe(&self, mean: [f32; 3], kappa: f32, weight: f32, sum: &mut [f32]) {
        let peak = weight * peak_density(kappa);
        for (((sum, x), y), z) in sum.iter_mut().zip(&self.x).zip(&self.y).zip(&self.z) {
            let [dx, dy, dz] = [x - mean[0], y - mean[1], z - mean[2]];
            *sum += peak * exp_neg(-0.5 * kappa * (dx * dx + dy * dy + dz * dz));
        }
    }
}

/// The blurred distribution of a cell's normals at the table's directions, times its micro-area.
struct BlurredDensity {
    mean: Vec<f32>,
    variance: Vec<f32>,
    area: f32,
}
