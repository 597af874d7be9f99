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
    /// (3.16) of the level without weights (of its thinned density, if it is thinned) and with the weights found, on the
    /// walks that they were found with.
    pub objective: [f64; 2],
    /// Effective share of recorded walks at the weights found.
    pub effective_share: f64,
    /// Eigenvalues of JᵀJ there, rising.
    pub eigenvalues: Vec<f64>,
    /// Relative error of image means in unseen views and lights: of plain averages, and of what was chosen.
    pub validation: [f64; 2],
    /// Whether the weights were kept, because the latter is smaller.
    pub is_accepted: bool,
    /// What the density of the level was multiplied with, beside what its transmittance asks for.
    pub density_factor: f32,
}

/// Recordings of a fit: after each the weights have moved, and roulette with them.
const ROUNDS: usize = 3;
/// Walks of later rounds over those of the first: a fit takes up the noise of the walks that it sees (`mixed` at 4×: 1.5 %
/// of the gap with 16 384 a view).
const REFINED: usize = 4;
/// Effective share of the walks under which they are recorded again.
const LEAST_SHARE: f64 = 0.5;
/// How far a weight may move in one round, as a logarithm.
const RADIUS: f64 = 1.4;
/// Walks a view that say which cells show which clusters.
const MASK_WALKS: usize = 12_288;
/// Weight of the bias of all views together over that of the views one by one.
const BIAS_WEIGHT: f64 = 4.0;
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
    /// Weight of the bias of all views together over that of the views one by one.
    bias_weight: f64,
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
        // What is published has no such rows.
        let bias_weight = if weights == RowWeights::Area { BIAS_WEIGHT } else { 0.0 };
        Self { fine, average, clusters, views, lights, target, bias_weight, walks }
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

    /// The best level of these families of media with their best weights, or plain averages if unseen views like these
    /// better.
    ///
    /// Within a family, of one medium in falling densities, (3.16) decides, between families the validation.
    pub fn best(&self, families: &[Vec<(Medium, f32)>], optimizer: Optimizer) -> (Medium, Weights, Diagnostics) {
        let validation = Validation::new(self);
        let naive = validation.error(self.average);
        let ones = Weights::ones(self.clusters.count, self.average.lobe_count());
        let mut best = (self.average.clone(), ones, Diagnostics { validation: [naive; 2], ..Diagnostics::default() });
        for family in families {
            let (place, weights, diagnostics) = self.best_density(family, optimizer);
            let medium = weights.apply(&family[place].0, &self.clusters);
            let error = validation.error(&medium);
            let is_better = error < best.2.validation[1];
            let is_first = best.2.objective == [0.0; 2];
            let diagnostics = Diagnostics { validation: [naive, error], is_accepted: is_better, ..diagnostics };
            if is_better {
                best = (medium, weights, diagnostics);
            } else if is_first {
                // Refused; what was tried is said all the same.
                best.2 = Diagnostics { validation: [naive; 2], ..diagnostics };
            }
        }
        best
    }

    /// The place of the medium whose best weights give the least (3.16), these, and how their fit went.
    fn best_density(&self, family: &[(Medium, f32)], optimizer: Optimizer) -> (usize, Weights, Diagnostics) {
        let ones = Weights::ones(self.clusters.count, self.average.lobe_count());
        let mut best: Option<(usize, Weights, Diagnostics)> = None;
        for (place, (medium, factor)) in family.iter().enumerate() {
            let start = best.as_ref().map_or(&ones, |best| &best.1);
            let (weights, diagnostics) = match optimizer {
                Optimizer::StochasticGradient => self.descend(medium, start),
                _ => self.minimise(medium, start),
            };
            let [naive, before] = best.as_ref().map_or([f64::NAN, f64::INFINITY], |best| best.2.objective);
            let [first, found] = diagnostics.objective;
            if found >= WORTH_THINNING * before {
                break;
            }
            let objective = [if best.is_none() { first } else { naive }, found];
            best = Some((place, weights, Diagnostics { density_factor: *factor, objective, ..diagnostics }));
        }
        best.expect("at least one medium")
    }

    /// Weights of `medium` by Levenberg-Marquardt on recorded walks.
    pub fn minimise(&self, medium: &Medium, start: &Weights) -> (Weights, Diagnostics) {
        let mut weights = start.clone();
        let mut diagnostics = Diagnostics { density_factor: 1.0, ..Diagnostics::default() };
        for round in 0..ROUNDS {
            let count = if round == 0 { self.walks.count } else { REFINED * self.walks.count };
            let walks = Walks { count, seed: self.walks.seed.wrapping_add(20 + round as u64) };
            let recorded = weights.clone();
            let recording = Recording::new(medium, &self.clusters, &recorded, &self.views, walks);
            if round == 0 {
                diagnostics.objective[0] = self.target.objective(&recording.evaluate(start, &recorded, &self.lights));
            }
            let linearise =
                |x: &[f64]| self.linearised(&recording.evaluate(&recorded.from_logarithms(x), &recorded, &self.lights));
            let fit = minimise(&recorded.logarithms(), RADIUS, linearise);
            weights = recorded.from_logarithms(&fit.unknowns);
            let evaluation = recording.evaluate(&weights, &recorded, &self.lights);
            diagnostics.effective_share = evaluation.effective_share;
            diagnostics.objective[1] = self.target.objective(&evaluation);
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

    /// Weighed residuals and derivatives, without the rows that weigh nothing, and with rows of the bias.
    fn linearised(&self, evaluation: &Evaluation) -> Linearised {
        let residuals = self.target.residuals(evaluation);
        let scales = &self.target.scales;
        let rows = || (0..residuals.len()).filter(|&row| scales[row] > 0.0);
        let scaled = |row: usize| evaluation.derivatives[row].iter().map(move |slope| slope * scales[row]).collect();
        let mut linearised = Linearised {
            residuals: rows().map(|row| residuals[row]).collect(),
            jacobian: rows().map(scaled).collect(),
        };
        self.add_bias_rows(evaluation, &mut linearised);
        linearised
    }

    /// Appends a row a light and channel: the relative error of the sum of image means over all views.
    ///
    /// Least squares of relative errors is biased dark by the square of their spread, a fifth or more at 8×: a view that is
    /// too bright weighs more than one that is as much too dark. What a level must not be, before all, is darker or
    /// brighter than the original as a whole.
    fn add_bias_rows(&self, evaluation: &Evaluation, linearised: &mut Linearised) {
        let channels = 3 * self.lights.len();
        let rows_a_view = channels * (self.clusters.count + 1);
        let weight = (self.bias_weight * self.views.len() as f64).sqrt();
        for channel in 0..channels {
            // The foreground is the last cluster of a view.
            let rows = (1..=self.views.len()).map(|view| view * rows_a_view - channels + channel);
            let wanted: f64 = rows.clone().map(|row| self.target.means[row]).sum();
            if weight <= 0.0 || wanted <= 0.0 {
                continue;
            }
            let scale = weight / wanted;
            let mut slopes = vec![0.0; evaluation.derivatives.first().map_or(0, Vec::len)];
            let mut found = 0.0;
            for row in rows {
                found += evaluation.means[row];
                for (slope, derivative) in slopes.iter_mut().zip(&evaluation.derivatives[row]) {
                    *slope += scale * derivative;
                }
            }
            linearised.residuals.push(scale * (found - wanted));
            linearised.jacobian.push(slopes);
        }
    }
}

/// Views and lights that no fit sees, with the means of the fine volume there.
struct Validation {
    /// The number of the foreground among the clusters.
    foreground: usize,
    views: Vec<(View, Masks)>,
    lights: [SmoothLight; 4],
    walks: Walks,
    reference: Vec<ViewMeans>,
}

impl Validation {
    fn new(problem: &Problem<'_>) -> Self {
        let seed = problem.walks.seed.wrapping_add(30);
        let views = validation_views(&problem.fine.shape().repeat);
        let views = masked(views, problem.average, &problem.clusters, Walks { count: MASK_WALKS, seed });
        let lights = validation_lights();
        let foreground = problem.clusters.count;
        let reference = view_means(problem.fine, &views, foreground, &lights, Walks { seed, ..problem.walks });
        // All levels with the same numbers: what they share of the noise does not decide.
        Self { foreground, views, lights, walks: Walks { seed: seed + 1, ..problem.walks }, reference }
    }

    /// The error of the image means of `medium`: the mean over views, lights and channels of |off|/wanted, and the same of
    /// the sums over views; half of each.
    fn error(&self, medium: &Medium) -> f64 {
        let found = view_means(medium, &self.views, self.foreground, &self.lights, self.walks);
        let [mut single, mut together, mut count] = [0.0; 3];
        for (l, c) in (0..self.lights.len()).flat_map(|l| (0..3).map(move |c| (l, c))) {
            let pairs =
                || found.iter().zip(&self.reference).map(|(a, b)| [a, b].map(|view| view.means[self.foreground][l][c]));
            let sums = pairs().fold([0.0; 2], |sum, pair| [sum[0] + pair[0], sum[1] + pair[1]]);
            if sums[1] <= 0.0 {
                continue;
            }
            let seen = pairs().filter(|pair| pair[1] > 0.0);
            single += seen.map(|[a, b]| (a - b).abs() / b).sum::<f64>() / self.views.len() as f64;
            together += (sums[0] - sums[1]).abs() / sums[1];
            count += 1.0;
        }
        if count > 0.0 { 0.5 * (single + together) / count } else { 0.0 }
    }
}
