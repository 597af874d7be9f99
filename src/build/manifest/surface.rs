//! The keys of a `[surface.NAME]`.

use toml::de::{DeTable, DeValue};

use super::fields::{Fields, numbers};
use super::{ERROR_WANTED, bsdf, is_error};
use crate::geometry::Boundary;
use crate::material::Brdf;
use crate::prefilter::surface::{LevelSettings, LightTransport};

/// A surface to build, as its manifest describes it.
#[derive(Clone, Debug, PartialEq)]
pub struct SurfaceSpec {
    /// Its name, safe as a folder.
    pub name: String,
    /// Height map, relative to the manifest.
    pub height: String,
    /// Channel of the height map; `None` takes `Y` or the only one.
    pub channel: Option<String>,
    /// Whether stored values are depths.
    pub invert: bool,
    /// Metres covered by the map along u and v.
    pub size: [f64; 2],
    /// Metres per unit of the stored value.
    pub amplitude: f64,
    /// Metres added to every height.
    pub offset: f64,
    /// What lies beyond the map.
    pub boundary: Boundary,
    /// Base BRDF.
    pub brdf: Brdf,
    /// Colour map, relative to the manifest.
    pub color: Option<String>,
    /// Whether the mean plane is removed.
    pub detrend: bool,
    /// Whether the steps of integer codes are smoothed away.
    pub dequantize: bool,
    /// How each level is compiled, finest first.
    pub levels: Vec<LevelSettings>,
}

/// The largest factor: nothing is left of the largest map.
const MAX_FACTOR: f64 = 16384.0;

/// The most levels that an asset holds.
const MAX_LEVELS: usize = formats::asset::MAX_LEVELS;

/// Reads the surface `name`; `None` where something is missing or wrong, which is then noted.
pub(super) fn read(name: &str, mut fields: Fields<'_, '_, '_, '_>, default_error: f64) -> Option<SurfaceSpec> {
    let height = "the path of an EXR, PNG, TIFF or JPEG image";
    let size = "the metres covered by the map along u and v, as in `[0.01, 0.01]`";
    let amplitude = "metres per unit of the stored value, at least 0";
    let levels = "increasing downsampling factors from 1 to 16384, as in `[8, 64]`";
    let bsdf = "a BRDF, as in `{ type = \"diffuse\", albedo = [0.5, 0.5, 0.5] }`";
    fields.require("height", height);
    fields.require("size", size);
    fields.require("amplitude", amplitude);
    fields.require("bsdf", bsdf);
    fields.require("levels", levels);

    let height = fields.text("height", height);
    let channel = fields.text("channel", "the name of a channel, as in `\"R\"`");
    let invert = fields.flag("invert");
    let size = fields.numbers::<2>("size", size, |n| n > 0.0 && n <= 1e9);
    let amplitude = fields.number("amplitude", amplitude, |n| (0.0..=1e9).contains(&n));
    let offset = fields.number("offset", "metres", |n| n.abs() <= 1e9).unwrap_or(0.0);
    let boundary = fields.value("boundary", "`\"repeat\"` or `\"clamp\"`", read_boundary);
    let brdf = fields.table("bsdf", bsdf::read).flatten();
    let color = fields.text("color", "the path of an image");
    let light = read_light(&mut fields);
    let detrend = fields.flag("detrend");
    let dequantize = fields.flag("dequantize");
    let error = fields.number("error", ERROR_WANTED, is_error).unwrap_or(default_error);
    let factors = read_factors(&mut fields, levels);
    let tables = read_tables(&mut fields);
    fields.finish();
    Some(SurfaceSpec {
        name: name.into(),
        height: height?,
        channel,
        invert,
        size: size?,
        amplitude: amplitude?,
        offset,
        boundary: boundary.unwrap_or(Boundary::Repeat),
        brdf: brdf?,
        color,
        detrend,
        dequantize,
        levels: factors?
            .into_iter()
            .map(|factor| LevelSettings { factor: factor as f32, light, error, ..tables })
            .collect(),
    })
}

impl SurfaceSpec {
    /// ε below 75° that its levels aim at.
    pub fn error(&self) -> f64 {
        self.levels.first().map_or(0.0, |level| level.error)
    }

    /// The light that its levels hold.
    pub fn light(&self) -> LightTransport {
        self.levels.first().map_or(LightTransport::Direct, |level| level.light)
    }
}

/// Whether a `[surface.NAME]` asks for `clamp`, whatever else is wrong with it.
pub(super) fn is_clamped(surface: &DeTable<'_>) -> bool {
    surface.get("boundary").and_then(|value| read_boundary(value.get_ref())) == Some(Boundary::Clamp)
}

/// `repeat` or `clamp`.
fn read_boundary(value: &DeValue<'_>) -> Option<Boundary> {
    match value.as_str()? {
        "repeat" => Some(Boundary::Repeat),
        "clamp" => Some(Boundary::Clamp),
        _ => None,
    }
}

/// The light that the levels hold.
fn read_light(fields: &mut Fields<'_, '_, '_, '_>) -> LightTransport {
    const WANTED: &str = "`\"direct\"`, `\"baked\"` or `\"global\"`";
    match fields.text("light", WANTED).as_deref() {
        None | Some("direct") => return LightTransport::Direct,
        Some("baked") => return LightTransport::Baked,
        Some("global") => return LightTransport::Global,
        Some(light) => fields.mistake("light", format!("`light` is `\"{light}\"`; wanted {WANTED}")),
    }
    LightTransport::Direct
}

/// The factors of `levels`.
fn read_factors(fields: &mut Fields<'_, '_, '_, '_>, wanted: &str) -> Option<Vec<f64>> {
    let (_, value) = fields.raw("levels")?;
    if value.get_ref().as_str() == Some("auto") {
        let message = format!("`levels` `\"auto\"` is not supported in this version; wanted {wanted}");
        fields.mistake("levels", message);
        return None;
    }
    fields.value("levels", wanted, |value| {
        let factors = numbers(value)?;
        let admissible = factors.iter().all(|f| (1.0..=MAX_FACTOR).contains(f));
        let increasing = factors.windows(2).all(|pair| pair[0] < pair[1]);
        ((1..=MAX_LEVELS).contains(&factors.len()) && admissible && increasing).then_some(factors)
    })
}

/// What all levels share: the sizes of their tables.
fn read_tables(fields: &mut Fields<'_, '_, '_, '_>) -> LevelSettings {
    let patches = auto_or_integer(fields, "patches", [1, 64]);
    let directions = auto_or_integer(fields, "directions", [5, 25]);
    let rank = auto_or_integer(fields, "rank", [1, 3]);
    let lobes = auto_or_integer(fields, "lobes", [1, 8]);
    let seed = fields.integer("seed", [0, i64::MAX as u64]).unwrap_or(0);
    LevelSettings { factor: 1.0, patches, directions, rank, lobes, light: LightTransport::Direct, error: 0.0, seed }
}

/// An integer from `min` to `max`; `None` where it is `auto` or not given.
fn auto_or_integer(fields: &mut Fields<'_, '_, '_, '_>, key: &'static str, [min, max]: [u64; 2]) -> Option<usize> {
    let wanted = format!("`\"auto\"` or an integer from {min} to {max}");
    let read = fields.value(key, &wanted, |value| match value.as_str() {
        Some("auto") => Some(None),
        Some(_) => None,
        None => super::fields::integer(value).filter(|n| (min..=max).contains(n)).map(|n| Some(n as usize)),
    });
    read.flatten()
}
