//! Other ways to find T and S, kept to be compared with: the compiler uses none of them.

use super::super::reflectance::PatchReflectance;
use super::{Factors, mean_table};

/// F_coarse below this share of its mean is taken as 0, and the ratio of the pair as 1: published quotients have no prior.
const DARK: f64 = 1e-9;

/// R = F_fine/F_coarse of one channel, `[patch][pair]`.
pub fn ratios(fine: &PatchReflectance, coarse: &PatchReflectance, channel: usize) -> Vec<Vec<f64>> {
    let tables = || (0..coarse.patch_count()).map(|patch| coarse.channel(patch, channel));
    let mean =
        tables().flatten().map(|&f| f64::from(f)).sum::<f64>() / (coarse.patch_count() * coarse.pair_count()) as f64;
    let ratio = |(&fine, &coarse): (&f32, &f32)| {
        let coarse = f64::from(coarse);
        if coarse > DARK * mean { f64::from(fine) / coarse } else { 1.0 }
    };
    tables()
        .enumerate()
        .map(|(patch, coarse)| fine.channel(patch, channel).iter().zip(coarse).map(ratio).collect())
        .collect()
}

/// T and S as averages of the ratio: over pairs, normalised to mean 1, and over patches (\[WU19\] 4.22–4.24).
pub fn averages_of_ratios(fine: &PatchReflectance, coarse: &PatchReflectance) -> Factors {
    per_channel(fine, coarse, |channel, weights| {
        let ratios = ratios(fine, coarse, channel);
        let total: f64 = weights.iter().sum();
        let spatial: Vec<f64> =
            ratios.iter().map(|row| row.iter().zip(weights).map(|(r, w)| r * w).sum::<f64>() / total).collect();
        let mean = spatial.iter().sum::<f64>() / spatial.len() as f64;
        (spatial.iter().map(|t| t / mean).collect(), mean_table(&ratios))
    })
}

/// T and S as ratios of averages: S of the map's mean, T of what S leaves of each patch's mean.
pub fn ratio_of_averages(fine: &PatchReflectance, coarse: &PatchReflectance) -> Factors {
    per_channel(fine, coarse, |channel, weights| {
        let table = |f: &PatchReflectance| -> Vec<Vec<f64>> {
            (0..f.patch_count()).map(|p| f.channel(p, channel).iter().map(|&x| f64::from(x)).collect()).collect()
        };
        let (fine, coarse) = (table(fine), table(coarse));
        let quotient = |a: f64, b: f64| if b > 0.0 { a / b } else { 1.0 };
        let (means, coarse_means) = (mean_table(&fine), mean_table(&coarse));
        let angular: Vec<f64> = means.iter().zip(&coarse_means).map(|(&a, &b)| quotient(a, b)).collect();
        let weighted = |row: &[f64], scale: &dyn Fn(usize) -> f64| -> f64 {
            row.iter().zip(weights).enumerate().map(|(k, (f, w))| f * w * scale(k)).sum()
        };
        let spatial = fine.iter().zip(&coarse);
        let spatial =
            spatial.map(|(fine, coarse)| quotient(weighted(fine, &|_| 1.0), weighted(coarse, &|k| angular[k])));
        (spatial.collect(), angular)
    })
}

/// T and S of every channel by `factors` of a channel and the weights of the pairs.
fn per_channel(
    fine: &PatchReflectance,
    coarse: &PatchReflectance,
    factors: impl Fn(usize, &[f64]) -> (Vec<f64>, Vec<f64>),
) -> Factors {
    debug_assert_eq!(fine.pair_count(), coarse.pair_count(), "tables of the same directions");
    let weights = super::pair_weights(fine.direction_count());
    let channels = [0, 1, 2].map(|channel| factors(channel, &weights));
    rank_one([0, 1, 2].map(|c| channels[c].0.as_slice()), [0, 1, 2].map(|c| channels[c].1.as_slice()))
}

/// Factors of rank 1 from T and S of every channel.
pub fn rank_one(spatial: [&[f64]; 3], angular: [&[f64]; 3]) -> Factors {
    let gather = |tables: [&[f64]; 3]| (0..tables[0].len()).map(|k| tables.map(|table| table[k] as f32)).collect();
    Factors { spatial: vec![gather(spatial)], angular: vec![gather(angular)], on_node: 0.0 }
}
