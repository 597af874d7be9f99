//! The manifest `farfield.toml`: what is built, from what, and how; and what is drawn.
//!
//! [`Manifest::parse`] takes text and touches no file. It finds every mistake of the text in one run; a [`Mistake`]
//! knows its line and column. Lengths are metres, colours linear RGB, paths relative to the manifest.

mod bsdf;
mod fields;
mod mistake;
mod scene;
mod surface;
mod volume;

pub(crate) use fields::closest;
pub use mistake::Mistake;
pub use scene::{CameraSpec, Displacement, LightSpec, MAX_LIGHTS, ObjectSpec, PlaneSpec, Projection, SceneSpec};
pub use surface::SurfaceSpec;
pub use volume::{AlbedoSpec, AlongSpec, DensitySpec, GridSpec, Optimizer, SggxSpec, VolumeSpec};

use std::borrow::Cow;

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
    /// The volumes, by name; none has the name of a surface.
    pub volumes: Vec<VolumeSpec>,
    /// The scenes, by name; one may share its name with a surface or a volume.
    pub scenes: Vec<SceneSpec>,
}

impl Manifest {
    /// Reads the text of a manifest; all of its mistakes, in order of place, if there is one.
    pub fn parse(text: &str) -> Result<Self, Vec<Mistake>> {
        let mut mistakes = Mistakes::new(text);
        let (root, errors) = DeTable::parse_recoverable(text);
        for error in &errors {
            mistakes.push_syntax(error.span().map_or(0, |span| span.start), syntax_message(error.message()));
        }
        let manifest = read_root(root.get_ref(), &mut mistakes);
        match mistakes.finish() {
            mistakes if mistakes.is_empty() => Ok(manifest),
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
fn read_root(root: &DeTable<'_>, mistakes: &mut Mistakes<'_>) -> Manifest {
    let mut fields = Fields::new(root, fields::ROOT.into(), 0, mistakes);
    let error = fields.table("build", |build| build.number("error", ERROR_WANTED, is_error)).flatten();
    let (surfaces, scenes, volumes) = (fields.raw("surface"), fields.raw("scene"), fields.raw("volume"));
    fields.finish();
    if surfaces.is_none() && volumes.is_none() {
        let message = "the manifest has no `[surface.NAME]` and no `[volume.NAME]` table; wanted at least one";
        mistakes.push_missing(0, message.into());
    }
    let none = DeTable::default();
    let surfaces = named_tables("surface", surfaces, mistakes).unwrap_or(&none);
    let scenes = named_tables("scene", scenes, mistakes).unwrap_or(&none);
    let volumes = named_tables("volume", volumes, mistakes).unwrap_or(&none);
    check_names(surfaces, volumes, mistakes);
    let error = error.unwrap_or(DEFAULT_ERROR);
    let surface_specs = surfaces
        .iter()
        .filter_map(|(name, value)| surface::read(name.get_ref(), open("surface", name, value, mistakes)?, error));
    let surface_specs = surface_specs.collect();
    let volume_specs = volumes
        .iter()
        .filter_map(|(name, value)| volume::read(name.get_ref(), open("volume", name, value, mistakes)?, error));
    let volume_specs = volume_specs.collect();
    let scene_specs = scenes.iter().filter_map(|(name, value)| {
        scene::read(name.get_ref(), open("scene", name, value, mistakes)?, surfaces, volumes)
    });
    Manifest { surfaces: surface_specs, volumes: volume_specs, scenes: scene_specs.collect() }
}

/// The table whose entries are `[KIND.NAME]`s.
fn named_tables<'a, 'i>(
    kind: &str,
    entry: Option<(usize, &'a Spanned<DeValue<'i>>)>,
    mistakes: &mut Mistakes<'_>,
) -> Option<&'a DeTable<'i>> {
    let (start, value) = entry?;
    let table = value.get_ref().as_table();
    if table.is_none() {
        mistakes.push(start, format!("`{kind}` is not a table; wanted `[{kind}.NAME]`"));
    }
    table
}

/// Whether a number may be an `error`.
fn is_error(value: f64) -> bool {
    value > 0.0 && value <= 1.0
}

/// The keys of one `[KIND.NAME]`, its name checked.
fn open<'a, 'i, 'm, 't>(
    kind: &str,
    name: &Spanned<Cow<'_, str>>,
    value: &'a Spanned<DeValue<'i>>,
    mistakes: &'m mut Mistakes<'t>,
) -> Option<Fields<'a, 'i, 'm, 't>> {
    let start = name.span().start;
    let is_safe = is_file_safe(name.get_ref());
    let name = name.get_ref().escape_default();
    if !is_safe {
        let wanted = "1 to 64 letters, digits, `-` and `_`";
        mistakes.push(start, format!("the name `{name}` is not safe as a folder; wanted {wanted}"));
    }
    let Some(table) = value.get_ref().as_table() else {
        mistakes.push(start, format!("`{kind}.{name}` is not a table; wanted `[{kind}.{name}]`"));
        return None;
    };
    Some(Fields::new(table, format!("[{kind}.{name}]"), start, mistakes))
}

/// Whether a name can be a folder on every system.
fn is_file_safe(name: &str) -> bool {
    let safe = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    (1..=64).contains(&name.len()) && name.chars().all(safe) && !name.starts_with('-')
}

/// Names of one asset twice, and names that differ in case alone, which are one folder on some systems.
fn check_names(surfaces: &DeTable<'_>, volumes: &DeTable<'_>, mistakes: &mut Mistakes<'_>) {
    let mut seen = std::collections::BTreeMap::new();
    for name in surfaces.keys().chain(volumes.keys()) {
        let Some(other) = seen.insert(name.get_ref().to_lowercase(), name.get_ref()) else { continue };
        let message = match other == name.get_ref() {
            true => format!("`{other}` is a surface and a volume; wanted names of their own"),
            false => format!("the names `{other}` and `{}` differ in case alone", name.get_ref()),
        };
        mistakes.push(name.span().start, message);
    }
}

#[cfg(test)]
mod tests;
