//! The report of a verification: `report.json` as documented, `report.html` whole, escaped and without a network.

mod made_up;

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use farfield::report::html::render;
use farfield::report::{Pictures, Verification};
use serde_json::Value;

/// Small enough for a debug build, large enough for FLIP's filters.
const SIZE: [u32; 2] = [48, 48];

/// A verification with everything in it; times are `speed` times as long.
fn verification(speed: f64) -> (Verification, Pictures) {
    made_up::verification(SIZE, speed)
}

/// The document without what depends on the machine.
fn without_timing(value: &mut Value) {
    match value {
        Value::Object(members) => {
            members.remove("timing");
            members.values_mut().for_each(without_timing);
        }
        Value::Array(items) => items.iter_mut().for_each(without_timing),
        _ => {}
    }
}

/// The names of all members at any depth; what is inside of `surface_settings` belongs to the asset.
fn keys(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(members) => {
            for (key, value) in members {
                found.insert(key.clone());
                if key != "surface_settings" {
                    keys(value, found);
                }
            }
        }
        Value::Array(items) => items.iter().for_each(|item| keys(item, found)),
        _ => {}
    }
}

fn json(verification: &Verification) -> Value {
    serde_json::from_str(&verification.to_json()).unwrap()
}

#[test]
fn times_stand_under_timing_and_nowhere_else() {
    let [mut slow, mut fast] = [3.0, 1.0].map(|speed| json(&verification(speed).0));
    assert_ne!(slow, fast);
    without_timing(&mut slow);
    without_timing(&mut fast);
    assert_eq!(slow, fast);
    let mut found = BTreeSet::new();
    keys(&fast, &mut found);
    assert!(found.iter().all(|key| !key.contains("seconds")), "{found:?}");
}

#[test]
fn every_key_of_the_document_is_documented_and_no_other() {
    let text = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/report.md")).unwrap();
    let row = |line: &str| line.strip_prefix("| `").and_then(|rest| rest.split('`').next()).map(String::from);
    let documented: BTreeSet<String> = text.lines().filter_map(row).collect();
    let mut found = BTreeSet::new();
    keys(&json(&verification(1.0).0), &mut found);
    assert_eq!(found, documented);
}

#[test]
fn keys_stand_in_a_fixed_order() {
    let text = verification(1.0).0.to_json();
    let order = [
        "\"schema\": 1",
        "\"farfield_version\"",
        "\"settings\"",
        "\"assets\"",
        "\"asset_digest\"",
        "\"summary\"",
        "\"cases\"",
    ];
    let places = order.map(|key| text.find(key).unwrap_or_else(|| panic!("{key} is in the document")));
    assert!(places.is_sorted(), "{places:?}");
    assert!(text.ends_with("}\n"));
}

#[test]
fn the_page_asks_no_network_for_anything() {
    let (verification, pictures) = verification(1.0);
    let page = render(&verification, &pictures);
    // The name of SVG is no address; in a drawing of CSS it stands in quotes of the other kind.
    let foreign = page.replace("http://www.w3.org/2000/svg", "");
    for address in ["http:", "https:", "//cdn", "@import", "<link rel=\"stylesheet\"", " src=\"/", "file:"] {
        assert!(!foreign.contains(address), "{address}");
    }
    assert!(page.contains("Content-Security-Policy"));
    let [images, embedded] = ["<img", "src=\"data:image/png;base64,"].map(|text| page.matches(text).count());
    assert_eq!((images, embedded), (made_up::PICTURES, made_up::PICTURES));
}

#[test]
fn every_picture_has_an_alternative_text_and_every_element_an_end() {
    let (verification, pictures) = verification(1.0);
    let page = render(&verification, &pictures);
    assert_eq!(page.matches("<img").count(), page.matches(" alt=\"").count());
    assert!(!page.contains(" alt=\"\""));
    let elements = [
        "html",
        "head",
        "body",
        "main",
        "header",
        "nav",
        "section",
        "div",
        "figure",
        "figcaption",
        "table",
        "tr",
        "td",
        "th",
    ];
    for element in
        elements.into_iter().chain(["svg", "g", "text", "details", "fieldset", "label", "dl", "dt", "dd", "p"])
    {
        let opened = page.matches(&format!("<{element} ")).count() + page.matches(&format!("<{element}>")).count();
        assert_eq!(opened, page.matches(&format!("</{element}>")).count(), "{element}");
    }
}

#[test]
fn names_and_settings_are_escaped() {
    let (mut verification, pictures) = verification(1.0);
    verification.assets[0].name = "<script>alert(1)</script>".into();
    verification.assets[0].surface_settings = serde_json::json!({ "height": "\"><img src=x onerror=alert(2)>" });
    verification.settings.lights[0].description = "</dd><b>bold</b> & \"quoted\"".into();
    let page = render(&verification, &pictures);
    for raw in ["<script>alert", "<img src=x", "<b>bold"] {
        assert!(!page.contains(raw), "{raw}");
    }
    assert!(page.contains("&lt;script&gt;alert(1)&lt;/script&gt;"));
}

#[test]
fn a_case_without_pictures_and_a_level_without_cases_still_make_a_page() {
    let (mut verification, _) = verification(1.0);
    let page = render(&verification, &Pictures::default());
    assert!(!page.contains("<img") && page.contains("All figures"));
    let level = &mut verification.assets[0].levels[0];
    (level.cases, level.summary, level.equal_time) = (Vec::new(), Vec::new(), Vec::new());
    assert!(render(&verification, &Pictures::default()).contains("The level itself was not compared."));
    verification.assets.clear();
    assert!(render(&verification, &Pictures::default()).contains("0 assets"));
}

#[test]
fn the_same_figures_make_the_same_page() {
    let pages = [1.0, 1.0].map(|speed| {
        let (verification, pictures) = verification(speed);
        render(&verification, &pictures)
    });
    assert!(pages[0] == pages[1]);
}

/// A page to look at and for `tests/report_browser/run`: `target/tmp/report.html`, with pictures of a usual size.
#[test]
fn the_page_is_left_where_a_browser_finds_it() {
    let (verification, pictures) = made_up::verification([128, 128], 1.0);
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    fs::write(folder.join("report.html"), render(&verification, &pictures)).unwrap();
    fs::write(folder.join("report.json"), verification.to_json()).unwrap();
}
