//! What was asked for, and the digests that say of what.

use maud::{Markup, html};

use super::words;
use crate::report::verification::{AssetVerification, Settings, Verification};

/// The last part of the page.
pub(super) fn section(verification: &Verification) -> Markup {
    html! {
        section.settings aria-labelledby="settings" {
            h2 id="settings" { "Settings and digests" }
            (asked_for(verification))
            @for asset in &verification.assets { (origin(asset)) }
            p.note {
                "Every figure but the times follows from inputs, settings and version: the number of threads and the machine \
                 do not enter. The same figures are in report.json beside this file."
            }
        }
    }
}

fn asked_for(verification: &Verification) -> Markup {
    let settings = &verification.settings;
    let [width, height] = settings.image_size;
    html! {
        dl.table {
            (row("Version", html! { (verification.farfield_version) }))
            (row("Images", html! { (width) " × " (height) " pixels" }))
            (row("Samples a pixel", html! {
                "2 × " (settings.samples_per_half) " of a model, 2 × " (settings.reference_samples_per_half) " of the original"
            }))
            (row("Seed", html! { (settings.seed) }))
            (row("Levels", html! { (levels(settings)) }))
            @for light in &settings.lights { (row(&format!("{} light", words::capital(light.light.name())), html! { (light.description) })) }
            @for view in &settings.views { (row(&format!("View {}", view.view.name()), html! { (view.description) })) }
            (row("FLIP", html! { (format!("{:.1}", settings.flip_pixels_per_degree)) " pixels a degree" }))
            (row("CPU time", html! { (words::seconds(verification.timing.cpu_seconds)) " s" }))
        }
    }
}

fn levels(settings: &Settings) -> String {
    settings
        .levels
        .as_ref()
        .map_or("all".into(), |levels| levels.iter().map(u32::to_string).collect::<Vec<_>>().join(", "))
}

/// What an asset was made from.
fn origin(asset: &AssetVerification) -> Markup {
    html! {
        h3 { (asset.name) }
        dl.table {
            (row("asset.json", html! { code { (asset.asset_digest) } }))
            @for source in &asset.sources {
                @let [width, height] = source.size;
                (row(&words::capital(&source.role), html! { (width) " × " (height) " texels, " code { (source.digest) } }))
            }
            (row("Light", html! { (asset.light) }))
            (row("Built with", html! { code { (asset.surface_settings.to_string()) } }))
        }
        p.note { "Digests are BLAKE3." }
    }
}

fn row(title: &str, content: Markup) -> Markup {
    html! { div { dt { (title) } dd { (content) } } }
}
