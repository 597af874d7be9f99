//! Prefiltering of volumes: a fine medium in, a coarse one out that looks the same from afar.
//!
//! [`compile`] averages density and SGGX matrices ([`coarsen`](coarsen::coarsen)), lobe by lobe of prototypes that hold for
//! the whole object ([`Prototypes`]), and finds weight factors a cluster of voxels and lobe that give images of the coarse
//! level the means of the fine one ([`fit`]). A level that does not beat the plain averages in views and lights that the fit
//! has not seen stays with these. Averages close the gaps that light leaks through; what weights cannot mend of that is
//! taken from the density ([`Density`]). Equations are those of \[WU19\]. [`orientation`] finds the fibres of CT.

pub mod baselines;
mod clusters;
pub mod coarsen;
pub mod fit;
mod gradient;
mod kmeans;
mod levenberg;
mod objective;
pub mod orientation;
mod prototypes;
mod record;
mod thinning;
pub mod views;
mod weights;

pub use clusters::Clusters;
pub use fit::{Diagnostics, Optimizer, Problem};
pub use objective::{RowWeights, view_means};
pub use prototypes::Prototypes;
pub use record::{Evaluation, Recording};
pub use weights::Weights;

use crate::medium::Medium;

/// How the density of a level is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Density {
    /// Whichever of the others errs least in unseen views and lights.
    #[default]
    Auto,
    /// The average, (3.6).
    Average,
    /// The average times one factor, which is fitted with the weights.
    Factor,
    /// The density whose transmittance through a voxel is the mean of that through its footprint, times a fitted factor.
    Transmittance,
}

/// What a level should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VolumeSettings {
    /// Fine voxels an edge of a coarse one, at least 1.
    pub factor: f64,
    /// Lobes a voxel; `None` chooses.
    pub lobes: Option<usize>,
    /// Voxel clusters; `None` chooses.
    pub clusters: Option<usize>,
    /// How weights are found.
    pub optimizer: Optimizer,
    /// How density is found.
    pub density: Density,
    /// Walks a view for the means of the fine volume and for each recording of the coarse one.
    pub walks: usize,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for VolumeSettings {
    /// 4096 walks: errors of a view's mean of 1 to 2 %, of a weight, which 14 views determine, of under ½ %.
    fn default() -> Self {
        Self {
            factor: 4.0,
            lobes: None,
            clusters: None,
            optimizer: Optimizer::LevenbergMarquardt,
            density: Density::default(),
            walks: 4096,
            seed: 1,
        }
    }
}

/// A coarse level.
#[derive(Clone, Debug)]
pub struct CoarseVolume {
    /// The level, weights in its albedos.
    pub medium: Medium,
    /// Which voxels share weights.
    pub clusters: Clusters,
    /// The weights that `medium` holds.
    pub weights: Weights,
    /// Prototypes of its lobes.
    pub prototypes: Prototypes,
    /// How the fit went.
    pub diagnostics: Diagnostics,
}

/// Compiles a level of `fine`.
///
/// A volume without flakes, and `Optimizer::None`, give plain averages.
pub fn compile(fine: &Medium, settings: &VolumeSettings) -> CoarseVolume {
    let prototypes = Prototypes::new(fine, settings.factor, settings.lobes, settings.seed);
    let average = baselines::naive::level(fine, settings.factor, &prototypes);
    let clusters = Clusters::new(&average, settings.clusters, settings.seed);
    let ones = Weights::ones(clusters.count, average.lobe_count());
    if settings.optimizer == Optimizer::None || average.occupied() == 0 || average.shape().repeat == [true; 3] {
        let diagnostics = Diagnostics::default();
        return CoarseVolume { medium: average, clusters, weights: ones, prototypes, diagnostics };
    }
    let problem = Problem::new(fine, &average, clusters, settings.walks, settings.seed);
    let families = families(fine, &average, &prototypes, settings);
    let (medium, weights, diagnostics) = problem.best(&families, settings.optimizer);
    CoarseVolume { medium, clusters: problem.into_clusters(), weights, prototypes, diagnostics }
}

/// Factors of the density that are tried, falling; a fit stops where they no longer help.
const FACTORS: [f32; 5] = [1.0, 0.8, 0.64, 0.51, 0.41];

/// Media with the densities that may be chosen from, and the factors that they were thinned by.
fn families(
    fine: &Medium,
    average: &Medium,
    prototypes: &Prototypes,
    settings: &VolumeSettings,
) -> Vec<Vec<(Medium, f32)>> {
    let thinned = |base: &Medium| FACTORS.iter().map(|&factor| (base.with_density_times(factor), factor)).collect();
    let transmitting = || {
        let kept = thinning::kept_density(fine, average);
        coarsen::coarsen(fine, settings.factor, &prototypes.shapes, kept)
    };
    let plain = || vec![(average.clone(), 1.0)];
    match settings.density {
        Density::Average => vec![plain()],
        Density::Factor => vec![thinned(average)],
        Density::Transmittance => vec![thinned(&transmitting())],
        Density::Auto => vec![plain(), thinned(average), thinned(&transmitting())],
    }
}
