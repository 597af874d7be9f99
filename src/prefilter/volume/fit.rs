//! The fit of a level's weights: record walks, minimise by reweighting, record again, and ask unseen views.

use super::clusters::Clusters;
use super::gradient;
use super::levenberg::{Linearised, minimise};
use super::objective::{RowWeights, Target, masked, view_means};
use super::record::{Evaluation, Recording};
use super::views::{training_lights, training_views, validation_lights, validation_views};
use super::weights::Weights;
use crate::medium::Medium;
use crate::transport::volume::means::{Masks, SmoothLight, View, ViewMeans, Walks};

/// How weights are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Optimizer {
    /// Not at all: plain averages.
    None,
    /// Levenberg-Marquardt on recorded walks.
    #[default]
    LevenbergMarquardt,
    /// Gradient descent on fresh walks.
    StochasticGradient,
}

/// How a fit went.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Diagnostics {
    /// (3.16) of plain averages and of the weights found, on the walks that they were found with.
    pub objective: [f64; 2],
    /// Effective share of recorded walks at the weights found.
    pub effective_share: f64,
    /// Eigenvalues of JᵀJ there, rising.
    pub eigenvalues: Vec<f64>,
    /// Mean relative error of image means in unseen views and lights: plain averages and weights found.
    pub validation: [f64; 2],
    /// Whether the weights were kept, because the latter is smaller.
    pub is_accepted: bool,
    /// What the density of the level was multiplied with, beside what its transmittance asks for.
    pub density_factor: f32,
}

/// Recordings of a fit: after each the weights have moved, and roulette with them.
const ROUNDS: usize = 3;
/// Effective share of the walks under which they are recorded again.
const LEAST_SHARE: f64 = 0.5;
/// How far a weight may move in one round, as a logarithm.
const RADIUS: f64 = 1.4;
/// Walks a view that say which cells show which clusters, and those of a validation over those of a fit.
const MASK_WALKS: usize = 12_288;
const VALIDATION_SHARE: usize = 2;
/// What another density must lower the objective to.
const WORTH_THINNING: f64 = 0.97;

/// Everything that a fit compares with: views with their masks, lights, and the means of the fine volume.
#[derive(Debug)]
pub struct Problem<'a> {
    fine: &'a Medium,
    average: &'a Medium,
    clusters: Clusters,
    views: Vec<(View, Masks)>,
    lights: Vec<SmoothLight>,
    target: Target,
    walks: Walks,
}

impl<'a> Problem<'a> {
    /// The training views and lights of `fine`, with the means that its level `average` should have.
    pub fn new(fine: &'a Medium, average: &'a Medium, clusters: Clusters, walks: usize, seed: u64) -> Self {
        let views = training_views(&fine.shape().repeat);
        Self::with_views(fine, average, clusters, (views, RowWeights::Area), Walks { count: walks, seed })
    }

    /// The same with other views and row weights.
    pub fn with_views(
        fine: &'a Medium,
        average: &'a Medium,
        clusters: Clusters,
        (views, weights): (Vec<View>, RowWeights),
        walks: Walks,
    ) -> Self {
        let mask_walks = Walks { count: MASK_WALKS, seed: walks.seed.wrapping_add(10) };
        let views = masked(views, average, &clusters, mask_walks);
        let lights = training_lights().to_vec();
        let reference = Walks { seed: walks.seed.wrapping_add(11), ..walks };
        let target = Target::new(fine, &views, clusters.count, &lights, weights, reference);
        Self { fine, average, clusters, views, lights, target, walks }
    }

    /// The clusters.
    pub fn clusters(&self) -> &Clusters {
        &self.clusters
    }

    /// The clusters, of a problem that is done with.
    pub fn into_clusters(self) -> Clusters {
        self.clusters
    }

    /// The fine volume.
    pub fn fine(&self) -> &Medium {
        self.fine
    }

    /// What is to be reached.
    pub fn target(&self) -> &Target {
        &self.target
    }

    /// The views with their masks.
    pub fn views(&self) -> &[(View, Masks)] {
        &self.views
    }

    /// The training lights.
    pub fn lights(&self) -> &[SmoothLight] {
        &self.lights
    }

    /// (3.16) of `medium` with these weights, from two independent halves of `walks` a view each.
    pub fn objective(&self, medium: &Medium, weights: &Weights, walks: Walks) -> f64 {
        let evaluate = |seed: u64| {
            let recording = Recording::new(medium, &self.clusters, weights, &self.views, Walks { seed, ..walks });
            recording.evaluate(weights, weights, &self.lights)
        };
        let [a, b] = [walks.seed, walks.seed.wrapping_add(1 << 32)].map(evaluate);
        self.target.objective_of_halves([&a, &b])
    }

    /// The best of the media with their best weights, or plain averages if unseen views like these better.
    pub fn best(&self, candidates: &[(Medium, f32)], optimizer: Optimizer) -> (Medium, Weights, Diagnostics) {
        let ones = Weights::ones(self.clusters.count, self.average.lobe_count());
        let mut best: Option<(usize, Weights, Diagnostics)> = None;
        for (place, (medium, factor)) in candidates.iter().enumerate() {
            let (weights, diagnostics) = match optimizer {
                Optimizer::StochasticGradient => self.descend(medium, &ones),
                _ => self.minimise(medium, &ones),
            };
            let before = best.as_ref().map_or(f64::INFINITY, |best| best.2.objective[1]);
            if diagnostics.objective[1] >= WORTH_THINNING * before {
                break;
            }
            best = Some((place, weights, Diagnostics { density_factor: *factor, ..diagnostics }));
        }
        let (place, weights, mut diagnostics) = best.expect("at least one candidate");
        let fitted = weights.apply(&candidates[place].0, &self.clusters);
        diagnostics.validation = self.validate([self.average, &fitted]);
        diagnostics.is_accepted = diagnostics.validation[1] < diagnostics.validation[0];
        if diagnostics.is_accepted { (fitted, weights, diagnostics) } else { (self.average.clone(), ones, diagnostics) }
    }

    /// Weights of `medium` by Levenberg-Marquardt on recorded walks.
    pub fn minimise(&self, medium: &Medium, start: &Weights) -> (Weights, Diagnostics) {
        let mut weights = start.clone();
        let mut diagnostics = Diagnostics { density_factor: 1.0, ..Diagnostics::default() };
        for round in 0..ROUNDS {
            let walks = Walks { seed: self.walks.seed.wrapping_add(20 + round as u64), ..self.walks };
            let recorded = weights.clone();
            let recording = Recording::new(medium, &self.clusters, &recorded, &self.views, walks);
            if round == 0 {
                diagnostics.objective[0] = self.target.objective(&recording.evaluate(start, &recorded, &self.lights));
            }
            let linearise =
                |x: &[f64]| self.linearised(&recording.evaluate(&recorded.from_logarithms(x), &recorded, &self.lights));
            let fit = minimise(&recorded.logarithms(), RADIUS, linearise);
            weights = recorded.from_logarithms(&fit.unknowns);
            diagnostics.effective_share = recording.evaluate(&weights, &recorded, &self.lights).effective_share;
            diagnostics.objective[1] = fit.objective;
            diagnostics.eigenvalues = fit.eigenvalues;
            if round > 0 && diagnostics.effective_share >= LEAST_SHARE {
                break;
            }
        }
        (weights, diagnostics)
    }

    /// Weights of `medium` by stochastic gradient descent.
    pub fn descend(&self, medium: &Medium, start: &Weights) -> (Weights, Diagnostics) {
        // Together the iterations have some eight times the walks of a recording.
        let count = (self.walks.count / 16).max(64);
        let halves = |x: &[f64], t: usize| {
            let weights = start.from_logarithms(x);
            [0, 1].map(|half| {
                let seed = self.walks.seed.wrapping_add(1000 + 2 * t as u64 + half);
                let walks = Walks { count, seed };
                let recording = Recording::new(medium, &self.clusters, &weights, &self.views, walks);
                self.linearised(&recording.evaluate(&weights, &weights, &self.lights))
            })
        };
        let found = start.from_logarithms(&gradient::minimise(&start.logarithms(), halves));
        let walks = Walks { seed: self.walks.seed.wrapping_add(20), ..self.walks };
        let recording = Recording::new(medium, &self.clusters, start, &self.views, walks);
        let objective = |weights: &Weights| {
            let evaluation = recording.evaluate(weights, start, &self.lights);
            (self.target.objective(&evaluation), evaluation.effective_share)
        };
        let (before, (after, effective_share)) = (objective(start).0, objective(&found));
        let diagnostics =
            Diagnostics { objective: [before, after], effective_share, density_factor: 1.0, ..Diagnostics::default() };
        (found, diagnostics)
    }

    /// Weighed residuals and derivatives, without the rows that weigh nothing.
    fn linearised(&self, evaluation: &Evaluation) -> Linearised {
        let residuals = self.target.residuals(evaluation);
        let scales = &self.target.scales;
        let rows = || (0..residuals.len()).filter(|&row| scales[row] > 0.0);
        let jacobian =
            rows().map(|row| evaluation.derivatives[row].iter().map(|slope| slope * scales[row]).collect()).collect();
        Linearised { residuals: rows().map(|row| residuals[row]).collect(), jacobian }
    }

    /// Mean relative error of the image means of `media` in views and lights that no fit sees.
    fn validate(&self, media: [&Medium; 2]) -> [f64; 2] {
        let seed = self.walks.seed.wrapping_add(30);
        let walks = Walks { count: self.walks.count.div_ceil(VALIDATION_SHARE), seed };
        let views = validation_views(&self.fine.shape().repeat);
        let views = masked(views, self.average, &self.clusters, Walks { count: MASK_WALKS, seed });
        let lights = validation_lights();
        let means = |medium: &Medium, seed: u64| {
            view_means(medium, &views, self.clusters.count, &lights, Walks { seed, ..walks })
        };
        let reference = means(self.fine, seed);
        // Both with the same numbers: what they share of the noise does not decide.
        media.map(|medium| relative_error(&means(medium, seed + 1), &reference, self.clusters.count))
    }
}

/// Mean over views, lights and channels of |mean − reference|/reference, of the foreground.
fn relative_error(means: &[ViewMeans], reference: &[ViewMeans], foreground: usize) -> f64 {
    let mut sum = [0.0; 2];
    for (view, reference) in means.iter().zip(reference) {
        for (lit, reference) in view.means[foreground].iter().zip(&reference.means[foreground]) {
            for c in (0..3).filter(|&c| reference[c] > 0.0) {
                sum = [sum[0] + (lit[c] - reference[c]).abs() / reference[c], sum[1] + 1.0];
            }
        }
    }
    if sum[1] > 0.0 { sum[0] / sum[1] } else { 0.0 }
}
