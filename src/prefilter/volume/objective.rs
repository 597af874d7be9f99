//! What a fit minimises: (3.16) of \[WU19\], restricted means of all training images, weighted by area.

use rayon::prelude::*;

use super::clusters::Clusters;
use super::record::{Evaluation, view_seed};
use crate::medium::Medium;
use crate::transport::volume::means::{Masks, SmoothLight, View, ViewMeans, Walks};

/// Least mean of an image that errors are divided by (\[WU19\] 3.15).
const LEAST_MEAN: f64 = 0.05;

/// How restricted means are weighed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowWeights {
    /// By the share of the foreground that shows the cluster.
    Area,
    /// All alike, as published.
    Unit,
}

/// The means that a level should have, and how much each counts.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// `[row]`: (view, cluster, light, channel), the channel fastest; as in [`Evaluation`].
    pub means: Vec<f64>,
    /// c_r times the root of the area, `[row]`; 0 for the rows of the foreground.
    pub scales: Vec<f64>,
}

impl Target {
    /// Means of `fine` in the cells that `views` name, by `walks` a view.
    pub fn new(
        fine: &Medium,
        views: &[(View, Masks)],
        clusters: usize,
        lights: &[SmoothLight],
        weights: RowWeights,
        walks: Walks,
    ) -> Self {
        let view_means = view_means(fine, views, clusters, lights, walks);
        let mut target = Self { means: Vec::new(), scales: Vec::new() };
        for view in &view_means {
            for (k, lit) in view.means.iter().enumerate() {
                let area = if weights == RowWeights::Unit { 1.0 } else { view.shares[k] };
                for (l, mean) in lit.iter().enumerate() {
                    for (mean, whole) in mean.iter().zip(view.means[clusters][l]) {
                        let whole = whole.max(LEAST_MEAN);
                        target.means.push(*mean);
                        target.scales.push(if k < clusters { area.sqrt() / whole } else { 0.0 });
                    }
                }
            }
        }
        target
    }

    /// Weighed differences of means from those wanted, `[row]`.
    pub fn residuals(&self, evaluation: &Evaluation) -> Vec<f64> {
        let off = evaluation.means.iter().zip(&self.means).zip(&self.scales);
        off.map(|((mean, wanted), scale)| scale * (mean - wanted)).collect()
    }

    /// (3.16).
    pub fn objective(&self, evaluation: &Evaluation) -> f64 {
        self.residuals(evaluation).iter().map(|r| r * r).sum()
    }

    /// (3.16) from two independent evaluations at the same weights: their noise does not add up.
    pub fn objective_of_halves(&self, [a, b]: [&Evaluation; 2]) -> f64 {
        self.residuals(a).iter().zip(self.residuals(b)).map(|(a, b)| a * b).sum()
    }
}

/// The means of all views, in their order.
pub fn view_means(
    medium: &Medium,
    views: &[(View, Masks)],
    clusters: usize,
    lights: &[SmoothLight],
    walks: Walks,
) -> Vec<ViewMeans> {
    let view_means = |(number, (view, masks)): (usize, &(View, Masks))| {
        let walks = Walks { seed: view_seed(walks.seed, number), ..walks };
        ViewMeans::new(medium, *view, lights, (masks, clusters), walks)
    };
    views.par_iter().enumerate().map(view_means).collect()
}

/// The views with the cells in which they show the clusters of `coarse`.
pub(super) fn masked(views: Vec<View>, coarse: &Medium, clusters: &Clusters, walks: Walks) -> Vec<(View, Masks)> {
    let mask = |(number, view): (usize, View)| {
        let walks = Walks { seed: view_seed(walks.seed, number), ..walks };
        (view, Masks::new(coarse, &clusters.of_voxel, view, walks))
    };
    views.into_par_iter().enumerate().map(mask).collect()
}
