//! Recorded walks: means of images and their derivatives at any weights, from walks that were made once.
//!
//! Where a walk goes does not depend on albedos, only what it carries and when roulette ends it. So with p_vj the share of
//! lobe j in the flakes that reflect at meeting v, the radiance of a recorded walk under other weights is exact,
//!
//! ```text
//! I(w, s) = L · roulette · Π_v Σ_j p_vj a_j(v)      a_j = min(1, ᾱ_j w_kj s_k)
//! ∂I/∂ln w_kj = I Σ_v p_vj a_j/Σ_l p_vl a_l         over the meetings v in cluster k with a_j < 1
//! ```
//!
//! and alike for s. The same walks answer for all lights and channels: common random numbers, for which a minimum is smooth.

use glam::Vec3;
use rayon::prelude::*;

use super::clusters::Clusters;
use super::weights::Weights;
use crate::medium::{MAX_LOBES, Medium};
use crate::transport::volume::means::{Masks, Observer, SmoothLight, View, Walks, follow, shown_clusters};

/// Flakes of an occupied voxel reflect in these shares.
#[derive(Clone, Copy, Debug)]
struct Reflection {
    voxel: u32,
    posterior: [f32; MAX_LOBES],
}

/// A walk that left: the clusters that its cell shows, where to, one over the chances of roulette, and its reflections.
#[derive(Clone, Copy, Debug)]
struct Leaving {
    mask: u32,
    direction: Vec3,
    survival: f32,
    /// End of its reflections in those of the batch; they begin where the walk before ends.
    end: u32,
}

/// The walks of a batch.
#[derive(Clone, Debug)]
struct Recorder<'m> {
    masks: &'m Masks,
    clusters: usize,
    reflections: Vec<Reflection>,
    walks: Vec<Leaving>,
    /// Walks that began, by cluster shown; the foreground last.
    started: Vec<u64>,
}

impl Observer for Recorder<'_> {
    fn reflects(&mut self, voxel: usize, posterior: [f32; MAX_LOBES]) {
        self.reflections.push(Reflection { voxel: voxel as u32, posterior });
    }

    fn leaves(&mut self, cell: usize, direction: Vec3, _throughput: Vec3, survival: f32) {
        let mask = self.masks.clusters[cell];
        self.count(mask);
        if mask == 0 {
            return self.forget();
        }
        self.walks.push(Leaving { mask, direction, survival, end: self.reflections.len() as u32 });
    }

    fn ends(&mut self, cell: usize) {
        self.count(self.masks.clusters[cell]);
        self.forget();
    }
}

impl Recorder<'_> {
    fn count(&mut self, mask: u32) {
        shown_clusters(mask, self.clusters).for_each(|k| self.started[k] += 1);
    }

    /// Drops the reflections of a walk that brings nothing.
    fn forget(&mut self) {
        self.reflections.truncate(self.walks.last().map_or(0, |walk| walk.end as usize));
    }
}

/// The recorded walks of all training views.
#[derive(Clone, Debug)]
pub struct Recording<'m> {
    coarse: &'m Medium,
    clusters: &'m Clusters,
    /// `[view][batch]`.
    views: Vec<Vec<Recorder<'m>>>,
}

/// Means and their derivatives, in rows (view, cluster, light, channel), the channel fastest.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// `[row]`: mean radiance over the cells that show the cluster; the last cluster stands for the foreground.
    pub means: Vec<f64>,
    /// `[row][unknown]`: derivatives of these by the logarithms of the weights.
    pub derivatives: Vec<Vec<f64>>,
    /// Effective share of the walks: (ΣW)²/(n ΣW²) with W what a walk brings over what it brought when it was recorded.
    pub effective_share: f64,
}

/// Sums of one view.
struct Sums {
    means: Vec<f64>,
    derivatives: Vec<Vec<f64>>,
    /// ΣW, ΣW², n.
    weights: [f64; 3],
}

impl<'m> Recording<'m> {
    /// Records `walks` in each view; roulette goes by the albedos of `weights`.
    pub fn new(
        coarse: &'m Medium,
        clusters: &'m Clusters,
        weights: &Weights,
        views: &'m [(View, Masks)],
        walks: Walks,
    ) -> Self {
        let weighted = weights.apply(coarse, clusters);
        let record = |(number, (view, masks)): (usize, &'m (View, Masks))| {
            let empty = || Recorder {
                masks,
                clusters: clusters.count,
                reflections: Vec::new(),
                walks: Vec::new(),
                started: vec![0; clusters.count + 1],
            };
            let seed = view_seed(walks.seed, number);
            follow(&weighted, *view, Walks { seed, ..walks }, empty)
        };
        Self { coarse, clusters, views: views.par_iter().enumerate().map(record).collect() }
    }

    /// The means at `weights` under `lights`; with derivatives if `derivatives` are wanted. `recorded` are the weights at
    /// which the walks were recorded.
    pub fn evaluate(&self, weights: &Weights, recorded: &Weights, lights: &[SmoothLight]) -> Evaluation {
        let albedos: Vec<_> = (0..self.coarse.occupied()).map(|index| self.coarse.voxel(index)).collect();
        let views: Vec<Sums> =
            self.views.par_iter().map(|view| self.view_sums(view, weights, recorded, lights, &albedos)).collect();
        let mut evaluation = Evaluation { means: Vec::new(), derivatives: Vec::new(), effective_share: 0.0 };
        let mut weighed = [0.0; 3];
        for sums in views {
            evaluation.means.extend(sums.means);
            evaluation.derivatives.extend(sums.derivatives);
            (0..3).for_each(|k| weighed[k] += sums.weights[k]);
        }
        let [sum, squares, count] = weighed;
        evaluation.effective_share = if squares > 0.0 { sum * sum / (count * squares) } else { 1.0 };
        evaluation
    }

    fn view_sums(
        &self,
        batches: &[Recorder<'_>],
        weights: &Weights,
        recorded: &Weights,
        lights: &[SmoothLight],
        voxels: &[crate::medium::Voxel],
    ) -> Sums {
        let rows = (self.clusters.count + 1) * lights.len() * 3;
        let unknowns = weights.unknowns();
        let mut sums = Sums { means: vec![0.0; rows], derivatives: vec![vec![0.0; unknowns]; rows], weights: [0.0; 3] };
        let mut slopes = vec![[0.0; 3]; unknowns];
        for batch in batches {
            let mut start = 0;
            for walk in &batch.walks {
                let reflections = &batch.reflections[start..walk.end as usize];
                start = walk.end as usize;
                slopes.iter_mut().for_each(|slope| *slope = [0.0; 3]);
                let carried = self.carried(reflections, weights, voxels, &mut slopes);
                let before = self.carried(reflections, recorded, voxels, &mut []);
                sums.add_walk(walk, carried, &slopes, lights, self.clusters.count);
                let ratio = carried.iter().sum::<f64>() / before.iter().sum::<f64>().max(f64::MIN_POSITIVE);
                sums.weights = [sums.weights[0] + ratio, sums.weights[1] + ratio * ratio, sums.weights[2] + 1.0];
            }
        }
        let started = |k: usize| batches.iter().map(|batch| batch.started[k]).sum::<u64>().max(1) as f64;
        let rows_a_cluster = lights.len() * 3;
        for (row, mean) in sums.means.iter_mut().enumerate() {
            let count = started(row / rows_a_cluster);
            *mean /= count;
            sums.derivatives[row].iter_mut().for_each(|slope| *slope /= count);
        }
        sums
    }

    /// Π_v Σ_j p_vj a_j in each channel, and its logarithmic derivatives added to `slopes` unless that is empty.
    fn carried(
        &self,
        reflections: &[Reflection],
        weights: &Weights,
        voxels: &[crate::medium::Voxel],
        slopes: &mut [[f64; 3]],
    ) -> [f64; 3] {
        let mut product = [1.0; 3];
        for reflection in reflections {
            let index = reflection.voxel as usize;
            let cluster = usize::from(self.clusters.of_voxel[index]);
            let mut parts = [[0.0; 3]; MAX_LOBES];
            let mut open = [[false; 3]; MAX_LOBES];
            let mut sum = [0.0; 3];
            for (j, lobe) in voxels[index].lobes().iter().enumerate() {
                let (albedo, below) = weights.albedo(cluster, j, lobe.albedo);
                open[j] = below;
                parts[j] = albedo.map(|a| a * f64::from(reflection.posterior[j]));
                (0..3).for_each(|c| sum[c] += parts[j][c]);
            }
            (0..3).for_each(|c| product[c] *= sum[c]);
            if slopes.is_empty() {
                continue;
            }
            for j in 0..weights.lobe_count {
                for c in (0..3).filter(|&c| open[j][c] && sum[c] > 0.0) {
                    let share = parts[j][c] / sum[c];
                    slopes[weights.factor_place(cluster, j)][c] += share;
                    slopes[weights.colour_place(cluster, c)][c] += share;
                }
            }
        }
        product
    }
}

impl Sums {
    fn add_walk(
        &mut self,
        walk: &Leaving,
        carried: [f64; 3],
        slopes: &[[f64; 3]],
        lights: &[SmoothLight],
        clusters: usize,
    ) {
        for (l, light) in lights.iter().enumerate() {
            let radiance = f64::from(walk.survival * light.radiance(walk.direction));
            for k in shown_clusters(walk.mask, clusters) {
                for c in 0..3 {
                    let row = (k * lights.len() + l) * 3 + c;
                    let value = radiance * carried[c];
                    self.means[row] += value;
                    for (sum, slope) in self.derivatives[row].iter_mut().zip(slopes) {
                        *sum += value * slope[c];
                    }
                }
            }
        }
    }
}

/// Seed of a view's walks.
pub(crate) fn view_seed(seed: u64, view: usize) -> u64 {
    seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (view as u64 + 1)
}
