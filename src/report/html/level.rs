//! One level: verdict, pictures, plots, tables.

use maud::{Markup, html};

use super::pictures::CasePictures;
use super::{plots, tables, viewer, words};
use crate::report::equal_time::COMPARED_SAMPLES;
use crate::report::summary::{ModelSummary, WorstCase};
use crate::report::verification::{LevelVerification, Light, Model, View};

/// A level's part of the page. `find` gives the pictures of a case.
pub(super) fn section<'a>(
    id: &str,
    level: &'a LevelVerification,
    image_size: [u32; 2],
    find: impl Fn(Light, View) -> Option<&'a CasePictures>,
) -> Markup {
    let heading = format!("{id}-heading");
    html! {
        section.level id=(id) aria-labelledby=(heading) {
            (title(&heading, level))
            div.verdict { @for sentence in words::verdict(level) { p { (sentence) } } }
            (tiles(level))
            (viewer::viewer(id, level, image_size, find))
            (plots::mean_errors(level))
            (plots::equal_times(level))
            (tables::models(level))
            (tables::cases(level))
            (tables::equal_times(level))
        }
    }
}

fn title(heading: &str, level: &LevelVerification) -> Markup {
    let [u, v] = level.cells;
    html! {
        h3 id=(heading) { "Level " (level.index) }
        p.facts {
            span { "factor " (words::pair(level.factor)) }
            span { (u) " × " (v) " cells" }
            @if let Some(epsilon) = level.epsilon_below_75 {
                span { "ε below 75° as built " (format!("{:.2} ± {:.2}", 100.0 * epsilon.value, 100.0 * epsilon.standard_error)) "\u{a0}%" }
            }
        }
    }
}

/// The figures that the verdict rests on.
fn tiles(level: &LevelVerification) -> Markup {
    let ours = level.summary.iter().find(|summary| summary.model == Model::Farfield);
    html! {
        @if let Some(ours) = ours {
            dl.tiles {
                (worst_tile("Mean error below 75°", ours.worst_mean_error_below_75))
                (worst_tile("Mean error at 80°", ours.worst_mean_error_above_75))
                (bias_tile(ours, &level.summary))
                (time_tile(level))
            }
        }
    }
}

fn worst_tile(label: &str, worst: Option<WorstCase>) -> Markup {
    html! {
        @if let Some(worst) = worst {
            @let [value, range] = words::percent_interval(worst.mean_error);
            @let place = words::case(worst.light, worst.view);
            (tile(label, &value, &[range, format!("worst: {place}")]))
        }
    }
}

fn bias_tile(ours: &ModelSummary, all: &[ModelSummary]) -> Markup {
    let of = |model: Model| all.iter().find(|summary| summary.model == model)?.relative_mse_bias;
    let others = [Model::Lobes, Model::Leadr, Model::Naive].into_iter();
    let others = others.filter_map(|m| Some(format!("{} {}", m.title(), words::error(of(m)?.value))));
    html! {
        @if let Some(bias) = ours.relative_mse_bias {
            (tile("Relative MSE, noise aside", &words::error(bias.value), &others.collect::<Vec<_>>()))
        }
    }
}

fn time_tile(level: &LevelVerification) -> Markup {
    let details =
        ["of the original's squared error".into(), format!("in its time for {COMPARED_SAMPLES} samples a pixel")];
    html! {
        @if let Some(ratio) = level.timing.equal_time_ratio {
            (tile("At equal time", &format!("× {}", words::factor(ratio)), &details))
        }
    }
}

/// A figure with what it is above it and a few lines on it below.
fn tile(label: &str, value: &str, details: &[String]) -> Markup {
    html! { div.tile { dt { (label) } dd { strong { (value) } @for detail in details { small { (detail) } } } } }
}
