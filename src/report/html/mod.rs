//! `report.html`: a verification with its pictures as one file that opens from disk.
//!
//! Pictures are PNG in `data:` URIs, each once; style and script are inline, fonts those of the system. A content security
//! policy in the page forbids everything else, so that no reader's machine ever asks a network for anything. Without
//! scripts every case is there, one below the other. All text goes through `maud`, which escapes it.

mod level;
mod pictures;
mod plots;
mod settings;
mod tables;
mod viewer;
mod words;

use maud::{DOCTYPE, Markup, PreEscaped, html};

pub use pictures::{CaseKey, CasePictures, Drawn, ModelPictures, Pictures};

use super::verification::{AssetVerification, LevelVerification, Verification};

/// The looks: light and dark, wide and narrow.
const STYLE: &str = include_str!("style.css");
/// Choosers and slider.
const SCRIPT: &str = include_str!("script.js");
/// Nothing is loaded from anywhere: pictures, style and script stand in the file.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// The page.
pub fn render(verification: &Verification, pictures: &Pictures) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            (head(verification))
            body {
                main {
                    (masthead(verification))
                    (tables::overview(verification))
                    @for (i, asset) in verification.assets.iter().enumerate() {
                        (asset_section(i, asset, verification, pictures))
                    }
                    (settings::section(verification))
                }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    };
    page.into_string()
}

/// Anchor of a level, from the number of its asset.
fn anchor(asset: usize, level: &LevelVerification) -> String {
    format!("asset{asset}-level{}", level.index)
}

fn head(verification: &Verification) -> Markup {
    let names: Vec<&str> = verification.assets.iter().map(|asset| asset.name.as_str()).collect();
    html! {
        head {
            meta charset="utf-8";
            meta http-equiv="Content-Security-Policy" content=(POLICY);
            meta name="viewport" content="width=device-width, initial-scale=1";
            meta name="color-scheme" content="light dark";
            link rel="icon" href="data:,";
            title { "farfield verify: " (names.join(", ")) }
            style { (PreEscaped(STYLE)) }
            noscript { style { ".case.off { display: block } .choosers { display: none }" } }
        }
    }
}

fn masthead(verification: &Verification) -> Markup {
    let settings = &verification.settings;
    let [width, height] = settings.image_size;
    let levels: usize = verification.assets.iter().map(|asset| asset.levels.len()).sum();
    let cases: usize = verification.assets.iter().flat_map(|a| &a.levels).map(|level| level.cases.len()).sum();
    html! {
        header.masthead {
            p.kicker { "farfield verify" }
            h1 { "Levels of detail against the original" }
            p.facts {
                span { (words::counted(verification.assets.len(), "asset")) }
                span { (words::counted(levels, "level")) }
                span { (words::counted(cases, "comparison")) }
                span { (width) " × " (height) " pixels" }
                span { "2 × " (settings.samples_per_half) " samples a pixel, reference 2 × " (settings.reference_samples_per_half) }
                span { "version " (verification.farfield_version) }
            }
        }
    }
}

fn asset_section(index: usize, asset: &AssetVerification, whole: &Verification, pictures: &Pictures) -> Markup {
    html! {
        section.asset aria-labelledby=(format!("asset{index}")) {
            h2 id=(format!("asset{index}")) { (asset.name) }
            @for level in &asset.levels {
                @let key = |light, view| CaseKey { asset: asset.name.clone(), level: level.index, light, view };
                @let find = |light, view| pictures.of(&key(light, view));
                (level::section(&anchor(index, level), level, whole.settings.image_size, find))
            }
        }
    }
}
