//! T and S from the two surfaces' F: F_fine ≈ Σ_r T_r(x) S_r(ωi, ωo) F_coarse, (4.21).
//!
//! Weighted alternating least squares per colour channel, started from the ratio of averages and rescaled to zero bias.
//! Every quotient carries a prior that pulls S to 1 where neither surface reflects anything: nothing is ever divided by
//! a number near 0. The weight of a pair of directions is its solid angle, as in ε: F holds both cosines already.

pub mod rivals;
mod stored;

pub(super) use stored::part_means;
pub use stored::{deconvolve, full_table};

use super::LARGEST_STORED;
use super::reflectance::{PatchReflectance, TableDirections, pair, pair_count};
use crate::geometry::Boundary;
use rayon::prelude::*;

/// Sweeps of alternating least squares, from the ratio of averages on.
const SWEEPS: usize = 6;

/// Strength of the prior: this fraction of the mean F_coarse, added with ratio 1. Small, for the tails of a narrow NDF
/// lie four orders of magnitude under its mean and are to be fitted too.
pub(super) const PRIOR: f64 = 1e-6;

/// Cosine of the polar angle that divides "below" from "above": 75°.
pub const COS_75: f32 = 0.258_819_05;

/// The factors of the scaling function.
#[derive(Clone, Debug)]
pub struct Factors {
    /// T, `[rank][patch]`, RGB: means over patches. The first has mean 1, further ones root mean square 1.
    pub spatial: Vec<Vec<[f32; 3]>>,
    /// S, `[rank][pair]`, RGB.
    pub angular: Vec<Vec<[f32; 3]>>,
    /// ε of the factors at the table's own nodes, both directions below 75°.
    pub on_node: f64,
}

/// Fits `rank` factors. Pairs of directions that further factors would make negative keep the first one alone.
pub fn fit_scaling(
    fine: &PatchReflectance,
    coarse: &PatchReflectance,
    directions: &TableDirections,
    rank: usize,
) -> Factors {
    let weights = pair_weights(directions.len());
    // a gray surface has one channel, three times
    let channels: Vec<Channel> = (0..distinct_channels(fine, coarse))
        .into_par_iter()
        .map(|channel| {
            let data = Data {
                fine: (0..fine.patch_count()).map(|patch| fine.channel(patch, channel)).collect(),
                coarse: (0..fine.patch_count()).map(|patch| coarse.channel(patch, channel)).collect(),
                weights: &weights,
            };
            (1..=rank).rev().map(|rank| data.fit(rank)).find(Channel::has_base).unwrap_or_else(|| data.fit(1))
        })
        .collect();
    let rank = channels.iter().map(|channel| channel.spatial.len()).max().unwrap_or(1);
    let gather = |table: fn(&Channel) -> &Vec<Vec<f64>>, len: usize| -> Vec<Vec<[f32; 3]>> {
        let channel = |c: usize| table(&channels[c.min(channels.len() - 1)]);
        let value =
            |r: usize, k: usize| std::array::from_fn(|c| channel(c).get(r).map_or(0.0, |values| values[k] as f32));
        (0..rank).map(|r| (0..len).map(|k| value(r, k)).collect()).collect()
    };
    let spatial = gather(|channel| &channel.spatial, fine.patch_count());
    let angular = gather(|channel| &channel.angular, fine.pair_count());
    let on_node = node_error(fine, coarse, directions, &spatial, &angular);
    Factors { spatial, angular, on_node }
}

/// 1 where all channels of both tables are the same, else 3.
fn distinct_channels(fine: &PatchReflectance, coarse: &PatchReflectance) -> usize {
    let alike = |f: &PatchReflectance| {
        (0..f.patch_count()).all(|patch| (1..3).all(|channel| f.channel(patch, channel) == f.channel(patch, 0)))
    };
    if alike(fine) && alike(coarse) { 1 } else { 3 }
}

impl Factors {
    /// T as it is stored, deconvolved; S is changed where the stored T would make the scaling negative.
    pub fn stored_spatial(
        &mut self,
        coarse: &PatchReflectance,
        patches: [usize; 2],
        boundary: Boundary,
    ) -> Vec<Vec<[f32; 3]>> {
        let mut stored: Vec<Vec<[f32; 3]>> = self.spatial.iter().map(|t| deconvolve(t, patches, boundary)).collect();
        // a patch that is black among bright ones asks for a negative texel
        stored[0].iter_mut().flatten().for_each(|t| *t = t.max(0.0));
        for channel in 0..3 {
            let of = |tables: &[Vec<[f32; 3]>]| -> Vec<Vec<f64>> {
                tables.iter().map(|table| table.iter().map(|x| f64::from(x[channel])).collect()).collect()
            };
            let mut angular = of(&self.angular);
            let coarse: Vec<&[f32]> = (0..coarse.patch_count()).map(|patch| coarse.channel(patch, channel)).collect();
            if keep_positive(&of(&stored), &of(&self.spatial), &mut angular, &coarse) {
                for (table, values) in self.angular.iter_mut().zip(&angular) {
                    table.iter_mut().zip(values).for_each(|(s, &x)| s[channel] = x as f32);
                }
            }
        }
        stored
    }
}

/// Sets S back to its first factor at the pairs where Σ_r T_r S_r < 0 at a texel of `texels`; whether there were any.
///
/// The pair keeps what it reflects over all patches, by `means` and `coarse`. The first T must not be negative. What is
/// read between texels of T is a mean of theirs, and so is positive as well.
fn keep_positive(texels: &[Vec<f64>], means: &[Vec<f64>], angular: &mut [Vec<f64>], coarse: &[&[f32]]) -> bool {
    let mut any = false;
    for k in 0..angular[0].len() {
        let s: Vec<f64> = angular.iter().map(|s| s[k]).collect();
        let at = |tables: &[Vec<f64>], p: usize| tables.iter().zip(&s).map(|(t, s)| t[p] * s).sum::<f64>();
        if s.len() == 1 || (0..texels[0].len()).all(|p| at(texels, p) >= 0.0) {
            continue;
        }
        let [mut all, mut first] = [0.0; 2];
        for (p, coarse) in coarse.iter().enumerate() {
            all += at(means, p) * f64::from(coarse[k]);
            first += means[0][p] * f64::from(coarse[k]);
        }
        angular[0][k] = if first > 0.0 { (all / first).max(0.0) } else { 1.0 };
        angular[1..].iter_mut().for_each(|s| s[k] = 0.0);
        any = true;
    }
    any
}

/// Mean of the rows of a table.
fn mean_table(rows: &[Vec<f64>]) -> Vec<f64> {
    (0..rows[0].len()).map(|k| rows.iter().map(|row| row[k]).sum::<f64>() / rows.len() as f64).collect()
}

/// Solid-angle weight of each pair: 2 for i ≠ o, which stands for both orders.
fn pair_weights(directions: usize) -> Vec<f64> {
    let mut weights = vec![2.0; pair_count(directions)];
    (0..directions).for_each(|i| weights[pair(i, i)] = 1.0);
    weights
}

/// One channel's tables.
struct Data<'a> {
    fine: Vec<&'a [f32]>,
    coarse: Vec<&'a [f32]>,
    weights: &'a [f64],
}

/// One channel's factors: `[rank][patch]` and `[rank][pair]`.
struct Channel {
    spatial: Vec<Vec<f64>>,
    angular: Vec<Vec<f64>>,
}

impl Channel {
    /// Whether the first T is nowhere negative, so that every pair may fall back to it.
    fn has_base(&self) -> bool {
        self.spatial[0].iter().all(|&t| t >= 0.0)
    }
}

impl Data<'_> {
    fn fit(&self, rank: usize) -> Channel {
        let prior = PRIOR * self.mean_coarse();
        let mut channel =
            Channel { spatial: vec![vec![1.0; self.fine.len()]], angular: vec![self.ratio_of_averages(prior)] };
        for _ in 0..SWEEPS {
            self.update_spatial(&mut channel, prior);
            self.update_angular(&mut channel, prior);
        }
        while channel.spatial.len() < rank.min(self.fine.len()) {
            channel.spatial.push(self.residual_direction(&channel));
            channel.angular.push(vec![0.0; self.weights.len()]);
            for _ in 0..SWEEPS {
                self.update_angular(&mut channel, prior);
                self.update_spatial(&mut channel, prior);
            }
        }
        if channel.has_base() {
            let means = &channel.spatial;
            keep_positive(means, means, &mut channel.angular, &self.coarse);
        }
        self.normalise(&mut channel);
        channel
    }

    fn mean_coarse(&self) -> f64 {
        let total: f64 =
            self.coarse.iter().map(|f| f.iter().zip(self.weights).map(|(&f, w)| f64::from(f) * w).sum::<f64>()).sum();
        total / (self.weights.iter().sum::<f64>() * self.coarse.len() as f64)
    }

    fn ratio_of_averages(&self, prior: f64) -> Vec<f64> {
        let patches = self.fine.len() as f64;
        (0..self.weights.len())
            .map(|k| {
                let mean = |tables: &[&[f32]]| tables.iter().map(|table| f64::from(table[k])).sum::<f64>() / patches;
                (mean(&self.fine) + prior) / (mean(&self.coarse) + prior)
            })
            .collect()
    }

    /// The factors' sum without rank r, for one patch and pair.
    fn model(&self, channel: &Channel, patch: usize, k: usize) -> f64 {
        channel.spatial.iter().zip(&channel.angular).map(|(t, s)| t[patch] * s[k]).sum()
    }

    /// Least squares for all S_r of every pair, given T.
    fn update_angular(&self, channel: &mut Channel, prior: f64) {
        let rank = channel.spatial.len();
        let patches = self.fine.len();
        let ridge = prior * prior * patches as f64;
        for k in 0..self.weights.len() {
            let mut system = Normal::new(rank);
            for p in 0..patches {
                let coarse = f64::from(self.coarse[p][k]);
                system.add(|r| channel.spatial[r][p] * coarse, f64::from(self.fine[p][k]), 1.0);
            }
            // the prior: S_1 = 1, further factors 0
            let solution = system.solve(ridge, |r| f64::from(u8::from(r == 0)));
            for (s, x) in channel.angular.iter_mut().zip(solution) {
                s[k] = if rank == 1 { x.max(0.0) } else { x };
            }
        }
    }

    /// Least squares for all T_r of every patch, given S.
    fn update_spatial(&self, channel: &mut Channel, prior: f64) {
        let rank = channel.spatial.len();
        let ridge = prior * prior;
        for p in 0..self.fine.len() {
            let mut system = Normal::new(rank);
            for (k, &weight) in self.weights.iter().enumerate() {
                let coarse = f64::from(self.coarse[p][k]);
                system.add(|r| channel.angular[r][k] * coarse, f64::from(self.fine[p][k]), weight);
            }
            let solution = system.solve(ridge, |r| f64::from(u8::from(r == 0)));
            for (t, x) in channel.spatial.iter_mut().zip(solution) {
                t[p] = if rank == 1 { x.max(0.0) } else { x };
            }
        }
    }

    /// The strongest direction over patches that the factors leave, by power iteration on the residual's Gram matrix.
    fn residual_direction(&self, channel: &Channel) -> Vec<f64> {
        let patches = self.fine.len();
        let mut gram = vec![0.0; patches * patches];
        let mut residual = vec![0.0; patches];
        for (k, &weight) in self.weights.iter().enumerate() {
            for (p, r) in residual.iter_mut().enumerate() {
                *r = f64::from(self.fine[p][k]) - self.model(channel, p, k) * f64::from(self.coarse[p][k]);
            }
            for p in 0..patches {
                (0..patches).for_each(|q| gram[p * patches + q] += weight * residual[p] * residual[q]);
            }
        }
        let mut vector: Vec<f64> = (0..patches).map(|p| 1.0 / (1.0 + p as f64)).collect();
        for _ in 0..64 {
            let product: Vec<f64> =
                gram.chunks(patches).map(|row| row.iter().zip(&vector).map(|(a, b)| a * b).sum()).collect();
            let length = product.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length == 0.0 {
                break;
            }
            vector = product.into_iter().map(|x| x * (patches as f64).sqrt() / length).collect();
        }
        vector
    }

    /// T_1 to mean 1, further T to root mean square 1, and the whole to zero bias.
    fn normalise(&self, channel: &mut Channel) {
        for (r, (t, s)) in channel.spatial.iter_mut().zip(&mut channel.angular).enumerate() {
            let n = t.len() as f64;
            let scale =
                if r == 0 { t.iter().sum::<f64>() / n } else { (t.iter().map(|x| x * x).sum::<f64>() / n).sqrt() };
            if scale > 0.0 {
                t.iter_mut().for_each(|x| *x /= scale);
                s.iter_mut().for_each(|x| *x *= scale);
            }
        }
        let [mut fine, mut model] = [0.0; 2];
        for p in 0..self.fine.len() {
            for (k, weight) in self.weights.iter().enumerate() {
                fine += weight * f64::from(self.fine[p][k]);
                model += weight * self.model(channel, p, k) * f64::from(self.coarse[p][k]);
            }
        }
        if model > 0.0 && fine > 0.0 {
            channel.angular.iter_mut().flatten().for_each(|s| *s *= fine / model);
        }
        // where F_coarse all but misses what F_fine reflects; the caller reports S above 64
        let limit = f64::from(LARGEST_STORED);
        let factors = channel.spatial.iter_mut().chain(&mut channel.angular);
        factors.flatten().for_each(|x| *x = x.clamp(-limit, limit));
    }
}

/// Normal equations of up to three unknowns.
struct Normal {
    rank: usize,
    matrix: [[f64; 3]; 3],
    right: [f64; 3],
}

impl Normal {
    fn new(rank: usize) -> Self {
        Self { rank, matrix: [[0.0; 3]; 3], right: [0.0; 3] }
    }

    #[inline(always)]
    fn add(&mut self, row: impl Fn(usize) -> f64, target: f64, weight: f64) {
        for a in 0..self.rank {
            let scaled = weight * row(a);
            self.right[a] += scaled * target;
            (0..self.rank).for_each(|b| self.matrix[a][b] += scaled * row(b));
        }
    }

    /// Solves (A + ridge·I) x = b + ridge·prior by elimination; A is positive semi-definite, ridge > 0 or A > 0.
    fn solve(mut self, ridge: f64, prior: impl Fn(usize) -> f64) -> Vec<f64> {
        let n = self.rank;
        // f64::MIN_POSITIVE: an all-black channel gives 0/0 otherwise
        let ridge = ridge.max(f64::MIN_POSITIVE);
        for r in 0..n {
            self.matrix[r][r] += ridge;
            self.right[r] += ridge * prior(r);
        }
        for c in 0..n {
            for r in c + 1..n {
                let factor = self.matrix[r][c] / self.matrix[c][c];
                (c..n).for_each(|k| self.matrix[r][k] -= factor * self.matrix[c][k]);
                self.right[r] -= factor * self.right[c];
            }
        }
        let mut x = vec![0.0; n];
        for r in (0..n).rev() {
            let known: f64 = (r + 1..n).map(|k| self.matrix[r][k] * x[k]).sum();
            x[r] = (self.right[r] - known) / self.matrix[r][r];
        }
        x
    }
}

/// Which pairs of directions an error is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Polar {
    /// Both directions below 75°.
    Below75,
    /// At least one of them above.
    Above75,
}

/// ε at the nodes: √(Σ(ΣTS·F_coarse − F_fine)² / ΣF_fine²) over patches, channels and pairs below 75°.
pub(super) fn node_error(
    fine: &PatchReflectance,
    coarse: &PatchReflectance,
    directions: &TableDirections,
    spatial: &[Vec<[f32; 3]>],
    angular: &[Vec<[f32; 3]>],
) -> f64 {
    node_figures(fine, coarse, directions, [spatial, angular], Polar::Below75)[0]
}

/// ε at the nodes over some pairs, and the bias Σ(ΣTS·F_coarse − F_fine) / ΣF_fine; T and S are the `factors`.
pub fn node_figures(
    fine: &PatchReflectance,
    coarse: &PatchReflectance,
    directions: &TableDirections,
    [spatial, angular]: [&[Vec<[f32; 3]>]; 2],
    polar: Polar,
) -> [f64; 2] {
    let below: Vec<bool> = directions.vectors.iter().map(|w| w[2] > COS_75).collect();
    let [mut square, mut squares, mut difference, mut total] = [0.0; 4];
    for patch in 0..fine.patch_count() {
        for channel in 0..3 {
            let (f, c) = (fine.channel(patch, channel), coarse.channel(patch, channel));
            for i in 0..directions.len() {
                for o in (0..=i).filter(|&o| (below[i] && below[o]) == (polar == Polar::Below75)) {
                    let k = pair(i, o);
                    let weight = if i == o { 1.0 } else { 2.0 };
                    let scale: f32 = spatial.iter().zip(angular).map(|(t, s)| t[patch][channel] * s[k][channel]).sum();
                    let off = f64::from(scale * c[k] - f[k]);
                    square += weight * off.powi(2);
                    difference += weight * off;
                    squares += weight * f64::from(f[k]).powi(2);
                    total += weight * f64::from(f[k]);
                }
            }
        }
    }
    if squares > 0.0 { [(square / squares).sqrt(), difference / total] } else { [0.0; 2] }
}

/// Root mean square of an error over that of F, over patches, channels and pairs below 75°; `value(patch, channel, pair)`
/// gives both.
pub(super) fn error_below_75(
    patches: usize,
    directions: &TableDirections,
    value: impl Fn(usize, usize, usize) -> [f32; 2],
) -> f64 {
    let below: Vec<bool> = directions.vectors.iter().map(|w| w[2] > COS_75).collect();
    let mut sums = [0.0; 2];
    for (patch, channel) in (0..3 * patches).map(|k| (k / 3, k % 3)) {
        for i in (0..directions.len()).filter(|&i| below[i]) {
            for o in (0..=i).filter(|&o| below[o]) {
                let weight = if i == o { 1.0 } else { 2.0 };
                let both = value(patch, channel, pair(i, o));
                (0..2).for_each(|k| sums[k] += weight * f64::from(both[k]).powi(2));
            }
        }
    }
    let [error, total] = sums;
    if total > 0.0 { (error / total).sqrt() } else { 0.0 }
}
