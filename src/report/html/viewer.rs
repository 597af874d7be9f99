//! Original and model in one picture with a divider to drag, and the map of their difference beside it.
//!
//! Every picture of every case stands in the page once. An element that carries `data-light`, `data-view`, `data-model` or
//! `data-map` is shown when it agrees with what is chosen; the script only turns the class `off` on and off.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, html};

use super::pictures::{CasePictures, ModelPictures};
use super::words;
use crate::report::error_map::Colours;
use crate::report::verification::{Case, LevelVerification, Light, Model, ModelResult, View};

/// Where the divider stands at first, percent from the left.
const SPLIT: u32 = 50;

/// A case with its pictures.
type Shown<'a> = (&'a Case, &'a CasePictures);

/// The map of an error.
#[derive(Clone, Copy, PartialEq)]
enum Map {
    Flip,
    Difference,
}

impl Map {
    fn name(self) -> &'static str {
        match self {
            Self::Flip => "flip",
            Self::Difference => "difference",
        }
    }

    fn colours(self) -> Colours {
        match self {
            Self::Flip => Colours::Sequential,
            Self::Difference => Colours::Diverging,
        }
    }

    fn label(self, value: f32) -> String {
        match self {
            Self::Flip => words::round_number(value),
            Self::Difference => format!("{}\u{a0}%", words::round_number(100.0 * value)),
        }
    }

    fn meaning(self) -> &'static str {
        match self {
            Self::Flip => {
                "FLIP: how visible the difference is, from 0, not at all, to 1. One scale for all models, by the square root."
            }
            Self::Difference => {
                "Model minus original over the original's mean: blue is too dark, red too bright. One scale for all models, \
                 by the square root."
            }
        }
    }
}

/// The pictures of a level, if there are any. `find` gives those of a case.
pub(super) fn viewer<'a>(
    id: &str,
    level: &'a LevelVerification,
    size: [u32; 2],
    find: impl Fn(Light, View) -> Option<&'a CasePictures>,
) -> Markup {
    let shown: Vec<Shown> = level.cases.iter().filter_map(|case| Some((case, find(case.light, case.view)?))).collect();
    html! {
        @if let Some(&(first, pictures)) = shown.first() {
            @let models: Vec<Model> = pictures.models.iter().map(|m| m.model).collect();
            div.viewer {
                (choosers(id, &shown, &models))
                @for &(case, pictures) in &shown {
                    @let is_first = case.light == first.light && case.view == first.view;
                    div.case.off[!is_first] data-light=(case.light.name()) data-view=(case.view.name()) {
                        div.panes { (compared(case, pictures, size)) (maps(case, pictures, size)) }
                        (figures(case, &models))
                    }
                }
            }
        }
    }
}

/// What may be chosen: only lights and views that occur.
fn choosers(id: &str, shown: &[Shown], models: &[Model]) -> Markup {
    let lights = Light::ALL.into_iter().filter(|&light| shown.iter().any(|(case, _)| case.light == light));
    let views = View::ALL.into_iter().filter(|&view| shown.iter().any(|(case, _)| case.view == view));
    let lights: Vec<_> = lights.map(|light| (light.name(), light.name())).collect();
    let views: Vec<_> = views.map(|view| (view.name(), view.name())).collect();
    let models: Vec<_> = models.iter().map(|model| (model.name(), model.title())).collect();
    let maps = [(Map::Flip.name(), "FLIP"), (Map::Difference.name(), "signed")];
    html! {
        div.choosers {
            (chooser(id, "light", "Light", &lights))
            (chooser(id, "view", "View", &views))
            (chooser(id, "model", "Model", &models))
            (chooser(id, "map", "Error map", &maps))
        }
    }
}

/// A row of buttons of which one is pressed; `options` are values and their titles.
fn chooser(id: &str, key: &str, title: &str, options: &[(&str, &str)]) -> Markup {
    html! {
        fieldset.chooser {
            legend { (title) }
            div.options {
                @for (i, (value, title)) in options.iter().enumerate() {
                    label {
                        input type="radio" name=(format!("{id}-{key}")) data-choice=(key) value=(value) checked[i == 0]
                            autocomplete="off";
                        span { (title) }
                    }
                }
            }
        }
    }
}

/// Original and models over each other.
fn compared(case: &Case, pictures: &CasePictures, size: [u32; 2]) -> Markup {
    let place = words::case(case.light, case.view);
    html! {
        figure.pane {
            div.compare {
                (image(&pictures.reference, &format!("The original, {place}"), size, "original", None))
                @for (i, model) in pictures.models.iter().enumerate() {
                    @let alt = format!("{} in place of the original, {place}", words::capital(model.model.title()));
                    (image(&model.image, &alt, size, if i == 0 { "model" } else { "model off" }, Some((model.model, None))))
                }
                span.tag.left { "original" }
                (each_model(&pictures.models, |model, class| html! {
                    span class=(format!("tag right{class}")) data-model=(model.name()) { (model.title()) }
                }))
                span.divider {}
                input type="range" min="0" max="100" step="0.5" value=(SPLIT) autocomplete="off"
                    aria-label="Divider between original, left, and model, right"
                    aria-valuetext=(format!("{SPLIT} percent original"));
            }
            figcaption { "Drag the divider, or focus it and use the arrow keys. Both at exposure " (words::three_digits(case.exposure)) "." }
        }
    }
}

/// The maps of all models, and their scales.
fn maps(case: &Case, pictures: &CasePictures, size: [u32; 2]) -> Markup {
    let place = words::case(case.light, case.view);
    html! {
        figure.pane {
            div.map {
                @for (i, model) in pictures.models.iter().enumerate() {
                    @let title = words::capital(model.model.title());
                    @let [flip, difference] = [format!("FLIP of {title}, {place}"), format!("{title} minus original, {place}")];
                    @let class = if i == 0 { "" } else { "off" };
                    (image(&model.flip, &flip, size, class, Some((model.model, Some(Map::Flip)))))
                    (image(&model.difference, &difference, size, "off", Some((model.model, Some(Map::Difference)))))
                }
            }
            figcaption {
                (scale_bar(Map::Flip, pictures.flip_scale))
                (scale_bar(Map::Difference, pictures.difference_scale))
            }
        }
    }
}

/// The colours of a map, the values that some of them stand for, and what these mean.
fn scale_bar(map: Map, scale: f32) -> Markup {
    let colours = map.colours();
    let stops: Vec<String> = colours.stops().iter().map(|[r, g, b]| format!("rgb({r} {g} {b})")).collect();
    let gradient = format!("background:linear-gradient(to right,{})", stops.join(","));
    html! {
        div.scale.off[map != Map::Flip] data-map=(map.name()) {
            div.bar style=(gradient) {}
            div.ticks {
                @for (place, value) in colours.ticks(scale) {
                    span style=(format!("left:{}%", 100.0 * place)) { (map.label(value)) }
                }
            }
            p { (map.meaning()) }
        }
    }
}

/// The figures of a case for the chosen model.
fn figures(case: &Case, models: &[Model]) -> Markup {
    let results = |model: Model| case.models.iter().find(move |result| result.model == model);
    html! {
        @for (i, &model) in models.iter().enumerate() {
            @if let Some(result) = results(model) {
                dl.figures.off[i > 0] data-model=(model.name()) { (figure_rows(case, result)) }
            }
        }
    }
}

fn figure_rows(case: &Case, result: &ModelResult) -> Markup {
    let mean = result.mean_error.map(words::percent_interval);
    html! {
        div { dt { "Mean error" } dd { @if let Some([value, range]) = mean { (value) " " small { (range) } } @else { (words::NONE) } } }
        @if let Some(mse) = result.relative_mse {
            div { dt { "Relative MSE" } dd { (words::error(mse.bias.value)) " " small { "+ noise " (words::error(mse.noise)) } } }
        }
        div { dt { "FLIP" } dd { (words::three_digits(result.flip)) } }
        div { dt { "Footprint" } dd { (words::three_digits(case.footprint_texels)) " " small { "texels a pixel" } } }
    }
}

/// `draw` for every model, with the class that hides all but the first.
fn each_model(models: &[ModelPictures], draw: impl Fn(Model, &str) -> Markup) -> Markup {
    html! { @for (i, model) in models.iter().enumerate() { (draw(model.model, if i == 0 { "" } else { " off" })) } }
}

/// A picture inside of the page; `of` is what it is shown with.
fn image(png: &[u8], alt: &str, [width, height]: [u32; 2], class: &str, of: Option<(Model, Option<Map>)>) -> Markup {
    let source = format!("data:image/png;base64,{}", STANDARD.encode(png));
    let model = of.map(|(model, _)| model.name());
    let map = of.and_then(|(_, map)| map).map(Map::name);
    html! {
        img class=(class) src=(source) alt=(alt) width=(width) height=(height) draggable="false" data-model=[model] data-map=[map];
    }
}
