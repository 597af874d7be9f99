//! Tables: the levels at a glance, the models of a level, every figure of every case.

use maud::{Markup, html};

use super::{anchor, words};
use crate::report::metrics::Interval;
use crate::report::summary::{ModelSummary, WorstCase};
use crate::report::verification::{AssetVerification, Case, LevelVerification, Model, ModelResult, Verification};

/// All levels, a row each, that leads to them.
pub(super) fn overview(verification: &Verification) -> Markup {
    let header =
        ["Asset", "Level", "Factor", "Mean < 75°", "Mean at 80°", "Rel. MSE", "vs naive", "vs LEADR", "Equal time"];
    let levels = verification.assets.iter().enumerate().flat_map(|(i, a)| a.levels.iter().map(move |l| (i, a, l)));
    html! {
        nav aria-label="Levels" {
            (table("Levels at a glance", &header, html! {
                @for (i, asset, level) in levels { (overview_row(i, asset, level)) }
            }))
            p.note {
                "Mean: the largest error of the image mean over lights and views. Rel. MSE: squared error over squared radiance, \
                 noise taken out. vs: ours over theirs. Equal time: squared error over that of the original in the same time."
            }
        }
    }
}

fn overview_row(index: usize, asset: &AssetVerification, level: &LevelVerification) -> Markup {
    let of = |model: Model| level.summary.iter().find(|summary| summary.model == model);
    let ours = of(Model::Farfield);
    let mean = |worst: Option<WorstCase>| worst.map(|worst| words::signed_percent(worst.mean_error.value));
    let bias = ours.and_then(|s| s.relative_mse_bias).map(|bias| words::error(bias.value));
    let against = |model: Model| of(model).and_then(|summary| summary.farfield_ratio).map(words::factor);
    html! {
        tr {
            th scope="row" { a href=(format!("#{}", anchor(index, level))) { (asset.name) } }
            (cell(Some(level.index.to_string())))
            (cell(Some(words::pair(level.factor))))
            (cell(mean(ours.and_then(|s| s.worst_mean_error_below_75))))
            (cell(mean(ours.and_then(|s| s.worst_mean_error_above_75))))
            (cell(bias))
            (cell(against(Model::Naive)))
            (cell(against(Model::Leadr)))
            (cell(level.timing.equal_time_ratio.map(words::factor)))
        }
    }
}

/// The models of a level over all cases.
pub(super) fn models(level: &LevelVerification) -> Markup {
    let header = [
        "Model",
        "Worst mean error < 75°",
        "Worst mean error at 80°",
        "Relative MSE, noise aside",
        "Farfield over it",
        "FLIP",
    ];
    html! {
        h4 { "Models over all lights and views" }
        (table("Models over all lights and views", &header, html! {
            @for summary in &level.summary { (model_row(summary)) }
        }))
    }
}

fn model_row(summary: &ModelSummary) -> Markup {
    let worst = |worst: Option<WorstCase>| {
        worst.map(|worst| (words::percent_interval(worst.mean_error), words::case(worst.light, worst.view)))
    };
    html! {
        tr {
            th scope="row" { (summary.model.title()) }
            @for worst in [summary.worst_mean_error_below_75, summary.worst_mean_error_above_75].map(worst) {
                td {
                    @if let Some(([value, range], place)) = worst { (value) small { (range) } small { (place) } }
                    @else { (words::NONE) }
                }
            }
            (interval_cell(summary.relative_mse_bias, words::error_interval))
            (cell(summary.farfield_ratio.map(words::factor)))
            (cell(Some(words::three_digits(summary.flip))))
        }
    }
}

/// Every figure of every case.
pub(super) fn cases(level: &LevelVerification) -> Markup {
    let rows: usize = level.cases.iter().map(|case| case.models.len()).sum();
    let header = [
        "Light, view",
        "Model",
        "Mean",
        "Mean error",
        "Rel. MSE",
        "without noise",
        "noise",
        "FLIP",
        "Samples",
        "CPU s",
    ];
    html! {
        details {
            summary { "All figures (" (words::counted(rows, "row")) ")" }
            (table("All figures", &header, html! { @for case in &level.cases { (case_rows(case)) } }))
        }
    }
}

/// The reference of a case, then its models.
fn case_rows(case: &Case) -> Markup {
    html! {
        tr.first {
            th scope="rowgroup" rowspan=(case.models.len() + 1) {
                (words::case(case.light, case.view))
                small { "φ " (words::three_digits(case.footprint_texels)) " texels" }
            }
            th scope="row" { "original" }
            (interval_cell(Some(case.reference_mean), radiance))
            (cell(None)) (cell(None)) (cell(None))
            (cell(case.reference_noise.map(words::error)))
            (cell(None)) (cell(None))
            (cell(Some(words::seconds(case.timing.cpu_seconds))))
        }
        @for result in &case.models { (result_row(result)) }
    }
}

fn result_row(result: &ModelResult) -> Markup {
    let mse = result.relative_mse;
    html! {
        tr {
            th scope="row" { (result.model.title()) }
            (interval_cell(Some(result.mean), radiance))
            (interval_cell(result.mean_error, words::percent_interval))
            (cell(mse.map(|mse| words::error(mse.total))))
            (interval_cell(mse.map(|mse| mse.bias), words::error_interval))
            (cell(mse.map(|mse| words::error(mse.noise))))
            (cell(Some(words::three_digits(result.flip))))
            (cell(Some(format!("2 × {}", result.samples_per_half))))
            (cell(Some(words::seconds(result.timing.cpu_seconds))))
        }
    }
}

/// Every point of the equal-time curves.
pub(super) fn equal_times(level: &LevelVerification) -> Markup {
    let header = ["Light, view", "Samples", "Original: MSE", "CPU s", "Farfield: MSE", "CPU s"];
    html! {
        @if !level.equal_time.is_empty() {
            details {
                summary { "Error against time, point by point" }
                (table("Error against time", &header, html! {
                    @for comparison in &level.equal_time {
                        @for (i, point) in comparison.points.iter().enumerate() {
                            tr.first[i == 0] {
                                @if i == 0 {
                                    th scope="rowgroup" rowspan=(comparison.points.len()) {
                                        (words::case(comparison.light, comparison.view))
                                        small { "φ " (words::three_digits(comparison.footprint_texels)) " texels, reference " (comparison.reference_samples) " samples" }
                                    }
                                }
                                (cell(Some(point.samples.to_string())))
                                (cell(Some(words::error(point.mse_full))))
                                (cell(Some(words::seconds(comparison.timing.full_cpu_seconds[i]))))
                                (cell(Some(words::error(point.mse_farfield))))
                                (cell(Some(words::seconds(comparison.timing.farfield_cpu_seconds[i]))))
                            }
                        }
                    }
                }))
            }
        }
    }
}

/// A table in a box of its own to scroll in; names stand left, numbers right.
fn table(title: &str, header: &[&str], rows: Markup) -> Markup {
    html! {
        div.scroll role="region" tabindex="0" aria-label=(title) {
            table {
                thead { tr { @for title in header { th.start[*title == "Model"] scope="col" { (title) } } } }
                tbody { (rows) }
            }
        }
    }
}

fn cell(text: Option<String>) -> Markup {
    html! { td { (text.as_deref().unwrap_or(words::NONE)) } }
}

/// A figure above its interval.
fn interval_cell(interval: Option<Interval>, words: impl Fn(Interval) -> [String; 2]) -> Markup {
    html! {
        td {
            @if let Some([value, range]) = interval.map(words) { (value) small { (range) } }
            @else { (words::NONE) }
        }
    }
}

/// A mean radiance with its interval.
fn radiance(interval: Interval) -> [String; 2] {
    let digits = |value: f64| words::three_digits(value);
    [digits(interval.value), format!("± {:.1e}", 0.5 * (interval.high - interval.low))]
}
