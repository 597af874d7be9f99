//! The manifest `farfield.toml`: what is built, from what, and how.
//!
//! [`Manifest::parse`] takes text and touches no file. It finds every mistake of the text in one run; a [`Mistake`]
//! knows its line and column. Lengths are metres, colours linear RGB, paths relative to the manifest.

mod bsdf;
mod fields;
mod mistake;
mod surface;

pub(crate) use fields::closest;
pub use mistake::Mistake;
pub use surface::SurfaceSpec;

use fields::{Fields, Mistakes};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// ε below 75° that is aimed at where the manifest names none: what the default tables reach on woven cloth.
pub const DEFAULT_ERROR: f64 = 0.03;

/// What `error` may be, for messages.
const ERROR_WANTED: &str = "a number greater than 0 and at most 1";

/// A manifest without mistakes.
#[derive(Clone, Debug, PartialEq)]
pub struct Manifest {
    /// The surfaces, by name.
    pub surfaces: Vec<SurfaceSpec>,
}

impl Manifest {
    /// Reads the text of a manifest; all of its mistakes, in order of place, if there is one.
    pub fn parse(text: &str) -> Result<Self, Vec<Mistake>> {
        let mut mistakes = Mistakes::new(text);
        let (root, errors) = DeTable::parse_recoverable(text);
        for error in &errors {
            mistakes.push_syntax(error.span().map_or(0, |span| span.start), syntax_message(error.message()));
        }
        let surfaces = read_root(root.get_ref(), &mut mistakes);
        match mistakes.finish() {
            mistakes if mistakes.is_empty() => Ok(Self { surfaces }),
            mistakes => Err(mistakes),
        }
    }
}

/// The parser's words on one line, in our style.
fn syntax_message(message: &str) -> String {
    let line = message.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.as_str() {
        "duplicate key" => "the key is given twice; wanted it once".into(),
        _ => line,
    }
}

/// The tables of the document.
fn read_root(root: &DeTable<'_>, mistakes: &mut Mistakes<'_>) -> Vec<SurfaceSpec> {
    let mut fields = Fields::new(root, "manifest".into(), 0, mistakes);
    let error = fields.table("build", |build| build.number("error", ERROR_WANTED, is_error)).flatten();
    let surfaces = fields.raw("surface").and_then(|(_, value)| value.get_ref().as_table());
    let has_surfaces = fields.has("surface");
    fields.refuse("volume", "volumes are not supported in this version; wanted `[surface.NAME]` tables");
    fields.refuse("scene", "scenes are not supported in this version; wanted `[surface.NAME]` tables");
    fields.finish();
    if !has_surfaces {
        mistakes.push_missing(0, "the manifest has no `[surface.NAME]` table; wanted at least one".into());
    }
    let Some(surfaces) = surfaces else {
        if let Some((key, _)) = root.get_key_value("surface") {
            mistakes.push(key.span().start, "`surface` is not a table; wanted `[surface.NAME]`".into());
        }
        return Vec::new();
    };
    check_case(surfaces, mistakes);
    let error = error.unwrap_or(DEFAULT_ERROR);
    surfaces.iter().filter_map(|(name, value)| read_surface(name, value, error, mistakes)).collect()
}

/// Whether a number may be an `error`.
fn is_error(value: f64) -> bool {
    value > 0.0 && value <= 1.0
}

/// One `[surface.NAME]`.
fn read_surface(
    name: &Spanned<std::borrow::Cow<'_, str>>,
    value: &Spanned<DeValue<'_>>,
    error: f64,
    mistakes: &mut Mistakes<'_>,
) -> Option<SurfaceSpec> {
    let start = name.span().start;
    let name = name.get_ref();
    if !is_file_safe(name) {
        let message = format!(
            "the name `{}` is not safe as a folder; wanted 1 to 64 letters, digits, `-` and `_`",
            name.escape_default()
        );
        mistakes.push(start, message);
    }
    let Some(table) = value.get_ref().as_table() else {
        mistakes.push(start, format!("`surface.{name}` is not a table; wanted `[surface.{name}]`"));
        return None;
    };
    surface::read(name, Fields::new(table, format!("[surface.{name}]"), start, mistakes), error)
}

/// Whether a name can be a folder on every system.
fn is_file_safe(name: &str) -> bool {
    let safe = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    (1..=64).contains(&name.len()) && name.chars().all(safe) && !name.starts_with('-')
}

/// Names that differ in case alone are one folder on some systems.
fn check_case(surfaces: &DeTable<'_>, mistakes: &mut Mistakes<'_>) {
    let mut seen = std::collections::BTreeMap::new();
    for name in surfaces.keys() {
        if let Some(other) = seen.insert(name.get_ref().to_lowercase(), name.get_ref()) {
            let message = format!("the names `{other}` and `{}` differ in case alone", name.get_ref());
            mistakes.push(name.span().start, message);
        }
    }
}

#[cfg(test)]
mod tests;
