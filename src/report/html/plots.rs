//! The plots of a level.

use maud::{Markup, html};

use super::words;
use crate::report::equal_time::EqualTime;
use crate::report::metrics::Interval;
use crate::report::svg::{Axis, Legend, Line, Mark, Plot, Point, Scale, Series, Style, swatch};
use crate::report::verification::{Case, LevelVerification, Light, Model, View};

/// Distance of two models at one view, as a share of the distance of two views.
const MODEL_STEP: f64 = 0.14;
/// Mean error that is marked as background, percent on both sides.
const BAND: f64 = 1.0;

/// How a model is drawn, wherever it is.
fn style(model: Model) -> Style {
    match model {
        Model::Farfield => Style::First,
        Model::Lobes => Style::Second,
        Model::Leadr => Style::Third,
        Model::Naive => Style::Fourth,
    }
}

/// Mean error by view, a plot a light, all on one scale.
pub(super) fn mean_errors(level: &LevelVerification) -> Markup {
    let lights = Light::ALL.into_iter().filter(|&light| level.cases.iter().any(|case| case.light == light));
    let models: Vec<Model> = level.summary.iter().map(|summary| summary.model).collect();
    let intervals = level.cases.iter().flat_map(|case| &case.models).filter_map(|result| result.mean_error);
    let extent: Vec<f64> = intervals.flat_map(|error| [100.0 * error.low, 100.0 * error.high]).collect();
    html! {
        section.plots {
            h4 { "Error of the mean" }
            p.note {
                "Relative to the original, with intervals of 95 %. The axis is linear within the band of ±" (BAND) "\u{a0}% and \
                 logarithmic beyond it."
            }
            ul.legend { @for &model in &models { li { (swatch(style(model))) (model.title()) } } }
            div.grid {
                @for light in lights {
                    figure {
                        figcaption { (words::capital(light.name())) " light" }
                        (mean_error_plot(level, light, &models, &extent).draw())
                    }
                }
            }
        }
    }
}

/// Mean error by view under one light; `extent` is what the y axis holds.
fn mean_error_plot(level: &LevelVerification, light: Light, models: &[Model], extent: &[f64]) -> Plot {
    let views: Vec<View> = View::ALL.into_iter().filter(|view| level.cases.iter().any(|c| c.view == *view)).collect();
    let names = views.iter().map(|view| view.name().to_owned()).collect();
    let of_model = |(i, &model): (usize, &Model)| {
        let offset = (i as f64 - 0.5 * (models.len() as f64 - 1.0)) * MODEL_STEP;
        let points = views.iter().enumerate().filter_map(|(x, &view)| {
            let error = mean_error(&level.cases, light, view, model)?;
            let [value, low, high] = [error.value, error.low, error.high].map(|e| 100.0 * e);
            Some(Point { x: x as f64 + offset, y: value, interval: Some([low, high]) })
        });
        Series { name: model.title().into(), style: style(model), line: Line::None, points: points.collect() }
    };
    Plot {
        description: format!(
            "Error of the mean by view under the {} light; the figures are in the tables",
            light.name()
        ),
        x: Axis::covering("view", Scale::Categories(names), []),
        y: Axis::covering("mean error, %", Scale::Symmetric { linear: BAND }, extent.iter().copied()),
        band: Some([-BAND, BAND]),
        mark: None,
        series: models.iter().enumerate().map(of_model).collect(),
        legend: Legend::Outside,
    }
}

fn mean_error(cases: &[Case], light: Light, view: View, model: Model) -> Option<Interval> {
    let case = cases.iter().find(|case| case.light == light && case.view == view)?;
    case.models.iter().find(|result| result.model == model)?.mean_error
}

/// Error against time, a plot a case.
pub(super) fn equal_times(level: &LevelVerification) -> Markup {
    html! {
        @if !level.equal_time.is_empty() {
            section.plots {
                h4 { "Error against time" }
                p.note { "Relative mean square error, noise included, at " (samples(&level.equal_time[0])) " samples a pixel." }
                div.grid {
                    @for comparison in &level.equal_time {
                        figure {
                            figcaption { (words::capital(&words::case(comparison.light, comparison.view))) }
                            (equal_time_plot(comparison).draw())
                            p.note { (ratio(comparison)) }
                        }
                    }
                }
            }
        }
    }
}

/// `4 … 1024`.
fn samples(comparison: &EqualTime) -> String {
    let counts: Vec<u32> = comparison.points.iter().map(|point| point.samples).collect();
    match counts.as_slice() {
        [first, .., last] => format!("{first} … {last}"),
        other => other.iter().map(u32::to_string).collect(),
    }
}

/// What the mark of a plot says.
fn ratio(comparison: &EqualTime) -> String {
    comparison.timing.at_equal_time.map_or("The curves do not meet in time; no ratio.".into(), |at| {
        let [ratio, seconds] = [words::factor(at.ratio), words::seconds(at.cpu_seconds)];
        format!("× {ratio} of the original's error in its {seconds} s for {} samples.", at.samples)
    })
}

fn equal_time_plot(comparison: &EqualTime) -> Plot {
    let timing = &comparison.timing;
    let curve = |seconds: &[f64], error: &dyn Fn(usize) -> f64| -> Vec<Point> {
        seconds.iter().enumerate().map(|(i, &x)| Point { x, y: error(i), interval: None }).collect()
    };
    let full = curve(&timing.full_cpu_seconds, &|i| comparison.points[i].mse_full);
    let level = curve(&timing.farfield_cpu_seconds, &|i| comparison.points[i].mse_farfield);
    let both = || full.iter().chain(&level);
    let mark = timing.at_equal_time.map(|at| Mark { x: at.cpu_seconds, label: format!("{} samples", at.samples) });
    Plot {
        description: format!("Squared error against CPU time, {}", words::case(comparison.light, comparison.view)),
        x: Axis::covering("CPU seconds", Scale::Log, both().map(|p| p.x).collect::<Vec<_>>()),
        y: Axis::covering("relative MSE", Scale::Log, both().map(|p| p.y).collect::<Vec<_>>()),
        band: None,
        mark,
        series: vec![
            Series { name: "original".into(), style: Style::Baseline, line: Line::Joined, points: full.clone() },
            Series { name: "farfield".into(), style: Style::First, line: Line::Joined, points: level.clone() },
        ],
        legend: Legend::Inside,
    }
}
