//! Voxel clusters: which coarse voxels share one set of weight factors.
//!
//! K-means on the coarse albedo (\[WU19\] 3.6.2); voxels between two centres are dealt to both, against seams. Clusters that are hardly seen tell an optimiser
//! nothing and join their nearest neighbour.

use super::kmeans::{centres, nearest, squared_distance};
use super::views::training_views;
use crate::math::rng::Stream;
use crate::medium::Medium;
use crate::transport::volume::means::{MAX_CLUSTERS, Masks, Walks};

/// Voxels that centres are found from, at most.
const MAX_POINTS: usize = 16_384;
/// Most clusters of an automatic choice (\[WU19\] 3.6.2: two to five).
const MOST: usize = 5;
/// Root mean square distance of albedos from their centre that another cluster need not lower.
const GOOD_ENOUGH: f64 = 0.08;
/// Share of the seen area under which a cluster joins another.
const LEAST_SEEN: f64 = 0.05;
/// Walks a view that say what is seen.
const WALKS: usize = 1024;

/// Clusters of the occupied voxels.
#[derive(Clone, Debug, PartialEq)]
pub struct Clusters {
    /// Cluster of each occupied voxel, below `count`.
    pub of_voxel: Vec<u8>,
    /// How many there are, at least 1.
    pub count: usize,
}

impl Clusters {
    /// `count` clusters of the voxels of `coarse`, or as many as their albedos ask for.
    pub fn new(coarse: &Medium, count: Option<usize>, seed: u64) -> Self {
        let albedos: Vec<_> = (0..coarse.occupied()).map(|index| mean_albedo(coarse, index)).collect();
        let step = albedos.len().div_ceil(MAX_POINTS).max(1);
        let points: Vec<_> = albedos.iter().step_by(step).copied().collect();
        let mut found = centres(&points, count.unwrap_or(1).clamp(1, MAX_CLUSTERS), seed);
        if found.is_empty() {
            return Self { of_voxel: Vec::new(), count: 1 };
        }
        while count.is_none() && found.len() < MOST && spread(&points, &found) > GOOD_ENOUGH {
            let more = centres(&points, found.len() + 1, seed);
            if more.len() == found.len() {
                break;
            }
            found = more;
        }
        let seen = seen(coarse, &blended(&albedos, &found, seed), found.len(), seed);
        let kept: Vec<_> = found.iter().zip(&seen).filter(|(_, seen)| **seen >= LEAST_SEEN).map(|(c, _)| *c).collect();
        // Something is always seen most; a volume without a view keeps all.
        let kept = if kept.is_empty() { found } else { kept };
        Self { of_voxel: blended(&albedos, &kept, seed), count: kept.len() }
    }
}

/// Mean albedo of a voxel's flakes and their area.
fn mean_albedo(medium: &Medium, index: usize) -> ([f64; 3], f64) {
    let voxel = medium.voxel(index);
    let mut sum = [0.0; 3];
    for lobe in voxel.lobes() {
        (0..3).for_each(|c| sum[c] += f64::from(lobe.area * lobe.albedo[c]));
    }
    (sum, f64::from(voxel.density))
}

/// Root mean square distance of the points from their centres.
fn spread(points: &[([f64; 3], f64)], centres: &[[f64; 3]]) -> f64 {
    let off = |(point, weight): &([f64; 3], f64)| weight * squared_distance(&centres[nearest(centres, point)], point);
    let total: f64 = points.iter().map(|(_, weight)| weight).sum();
    (points.iter().map(off).sum::<f64>() / total).sqrt()
}

/// The golden ratio less one.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// One of the two centres nearest to each albedo, by turns.
///
/// The second is taken with the probability t at which the albedo lies on the way from the first to it: on a gradient the
/// mean of the factors runs linearly from centre to centre, and at a centre all voxels are its own. Multiples of the golden
/// ratio instead of random numbers keep neighbourhoods even: a layer of 64 voxels is a hundredth off, not a sixteenth.
fn blended(albedos: &[([f64; 3], f64)], centres: &[[f64; 3]], seed: u64) -> Vec<u8> {
    let start = f64::from(Stream::new(seed, 2).uniform(0));
    let assign = |(index, (albedo, _)): (usize, &([f64; 3], f64))| {
        let first = nearest(centres, albedo);
        let distance = |k: &usize| squared_distance(&centres[*k], albedo);
        let others = (0..centres.len()).filter(|&k| k != first);
        let Some(second) = others.min_by(|a, b| distance(a).total_cmp(&distance(b))) else { return first as u8 };
        let [a, b] = [&centres[first], &centres[second]];
        let along: f64 = (0..3).map(|c| (albedo[c] - a[c]) * (b[c] - a[c])).sum();
        let t = along / squared_distance(a, b);
        let u = (start + index as f64 * GOLDEN).fract();
        (if u < t { second } else { first }) as u8
    };
    albedos.iter().enumerate().map(assign).collect()
}

/// Share of each cluster in what the training views see.
fn seen(coarse: &Medium, of_voxel: &[u8], count: usize, seed: u64) -> Vec<f64> {
    let mut cells = vec![0_usize; count];
    let mut total = 0_usize;
    for (k, view) in training_views(&coarse.shape().repeat).into_iter().enumerate() {
        let masks = Masks::new(coarse, of_voxel, view, Walks { count: WALKS, seed: seed ^ (k as u64 + 1) });
        for mask in masks.clusters {
            (0..count).filter(|k| mask >> k & 1 == 1).for_each(|k| cells[k] += 1);
            total += usize::from(mask != 0);
        }
    }
    cells.into_iter().map(|seen| seen as f64 / total.max(1) as f64).collect()
}
