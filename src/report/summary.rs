//! A model over all lights and views of a level: the figures that a verdict names.

use serde::Serialize;

use super::metrics::Interval;
use super::verification::{Case, Light, Model, ModelResult, View};

/// Degrees from which on a view counts as grazing, as in the error that an asset records.
const GRAZING_DEGREES: f64 = 75.0;

/// One model over all cases of a level.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelSummary {
    /// The model.
    pub model: Model,
    /// The mean error of the largest size among the views below 75°.
    pub worst_mean_error_below_75: Option<WorstCase>,
    /// The same among the views above 75°.
    pub worst_mean_error_above_75: Option<WorstCase>,
    /// Relative mean square error without noise, mean over the cases.
    pub relative_mse_bias: Option<Interval>,
    /// `relative_mse_bias` of farfield over that of this model; `None` where either is not above 0.
    pub farfield_ratio: Option<f64>,
    /// FLIP, mean over the cases.
    pub flip: f64,
}

/// The case that a figure is worst in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WorstCase {
    /// The light.
    pub light: Light,
    /// The view.
    pub view: View,
    /// Relative error of the mean.
    pub mean_error: Interval,
}

/// Every model that occurs in the cases, in the order of [`Model::ALL`].
pub fn summaries(cases: &[Case]) -> Vec<ModelSummary> {
    let farfield = bias(&results(cases, Model::Farfield));
    Model::ALL.iter().filter_map(|&model| summary(cases, model, farfield)).collect()
}

/// One model, if it occurs; `farfield` is ours to compare with.
fn summary(cases: &[Case], model: Model, farfield: Option<Interval>) -> Option<ModelSummary> {
    let results = results(cases, model);
    let relative_mse_bias = bias(&results);
    let above_zero = |bias: Option<Interval>| bias.map(|bias| bias.value).filter(|&value| value > 0.0);
    (!results.is_empty()).then(|| ModelSummary {
        model,
        worst_mean_error_below_75: worst(&results, |view| view.degrees() < GRAZING_DEGREES),
        worst_mean_error_above_75: worst(&results, |view| view.degrees() >= GRAZING_DEGREES),
        relative_mse_bias,
        farfield_ratio: above_zero(farfield).zip(above_zero(relative_mse_bias)).map(|(ours, theirs)| ours / theirs),
        flip: results.iter().map(|(_, result)| result.flip).sum::<f64>() / results.len() as f64,
    })
}

/// A model's result in each case.
fn results(cases: &[Case], model: Model) -> Vec<(&Case, &ModelResult)> {
    cases.iter().flat_map(|case| case.models.iter().filter(|m| m.model == model).map(move |m| (case, m))).collect()
}

/// The largest mean error by size, of the views that count.
fn worst(results: &[(&Case, &ModelResult)], counts: impl Fn(View) -> bool) -> Option<WorstCase> {
    let errors = results.iter().filter(|(case, _)| counts(case.view)).filter_map(|(case, result)| {
        result.mean_error.map(|mean_error| WorstCase { light: case.light, view: case.view, mean_error })
    });
    errors.max_by(|a, b| a.mean_error.value.abs().total_cmp(&b.mean_error.value.abs()))
}

/// Mean of the bias over the cases that have one; cases are rendered with random numbers of their own.
fn bias(results: &[(&Case, &ModelResult)]) -> Option<Interval> {
    let parts: Vec<Interval> = results.iter().filter_map(|(_, r)| r.relative_mse).map(|mse| mse.bias).collect();
    let n = parts.len() as f64;
    let value = parts.iter().map(|bias| bias.value).sum::<f64>() / n;
    let variance: f64 = parts.iter().map(|bias| bias.standard_error().powi(2)).sum();
    (!parts.is_empty()).then(|| Interval::about(value, variance.sqrt() / n))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::metrics::RelativeMse;
    use crate::report::verification::Cost;

    fn result(model: Model, error: f64, bias: f64) -> ModelResult {
        let relative_mse = RelativeMse { total: bias + 1e-3, bias: Interval::about(bias, 1e-5), noise: 1e-3 };
        ModelResult {
            model,
            samples_per_half: 64,
            mean: Interval::about(1.0 + error, 0.001),
            mean_error: Some(Interval::about(error, 0.001)),
            relative_mse: Some(relative_mse),
            flip: 0.1,
            timing: Cost::default(),
        }
    }

    fn case(view: View, models: Vec<ModelResult>) -> Case {
        let reference_mean = Interval::about(1.0, 0.001);
        Case {
            light: Light::Area,
            view,
            footprint_texels: 8.0,
            reference_mean,
            reference_noise: Some(1e-4),
            exposure: 1.0,
            models,
            timing: Cost::default(),
        }
    }

    #[test]
    fn the_worst_mean_error_is_the_largest_by_size_on_either_side_of_75_degrees() {
        let errors = [(View::Normal, 0.002), (View::Oblique, -0.004), (View::Grazing, 0.02)];
        let cases = errors.map(|(view, error)| case(view, vec![result(Model::Farfield, error, 1e-4)]));
        let [summary] = summaries(&cases).try_into().unwrap();
        assert_eq!(summary.worst_mean_error_below_75.unwrap().mean_error.value, -0.004);
        assert_eq!(summary.worst_mean_error_below_75.unwrap().view, View::Oblique);
        assert_eq!(summary.worst_mean_error_above_75.unwrap().view, View::Grazing);
    }

    #[test]
    fn a_ratio_needs_an_error_that_noise_did_not_drown() {
        let models = |ours: f64| vec![result(Model::Farfield, 0.0, ours), result(Model::Naive, 0.1, 1e-2)];
        let drowned = summaries(&[case(View::Normal, models(-1e-7))]);
        assert_eq!(drowned.iter().map(|s| s.farfield_ratio).collect::<Vec<_>>(), [None, None]);
        let found = summaries(&[case(View::Normal, models(1e-4)), case(View::Oblique, models(3e-4))]);
        assert!((found[1].farfield_ratio.unwrap() - 0.02).abs() < 1e-12);
        assert_eq!(found[0].farfield_ratio, Some(1.0));
        // Two independent errors of 1e-5 in a mean of two.
        let spread = found[0].relative_mse_bias.unwrap().standard_error();
        assert!((spread - 1e-5 / 2f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn no_model_is_summed_up_that_was_not_drawn() {
        assert!(summaries(&[]).is_empty());
    }
}
