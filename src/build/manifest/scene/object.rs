//! `objects = [{ mesh = …, surface = … }]` or `[{ volume = … }]`.

use toml::de::{DeTable, DeValue};

use super::super::fields::{Fields, closest, integer, quoted};
use super::super::{is_file_safe, surface};
use super::MAX_METRES;

/// What a scene shows.
#[derive(Clone, Debug, PartialEq)]
pub enum ObjectSpec {
    /// A plane of a surface.
    Surface(PlaneSpec),
    /// A volume around the origin, z of its grid up.
    Volume {
        /// Name of its `[volume.NAME]`.
        volume: String,
    },
}

/// A surface in a scene: a plane in the world's xz plane, centred at the origin, tiled by the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct PlaneSpec {
    /// Name of its `[surface.NAME]`.
    pub surface: String,
    /// How often the surface is repeated along u and v.
    pub tiling: [u32; 2],
    /// The large shape under the surface.
    pub displacement: Option<Displacement>,
}

/// A height map over all tiles of an object, below what is prefiltered, and never filtered itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Displacement {
    /// Its path, relative to the manifest.
    pub file: String,
    /// Metres per unit of the stored value.
    pub amplitude: f64,
    /// Metres added to every height.
    pub offset: f64,
    /// Channel of the map; `None` takes `Y` or the only one.
    pub channel: Option<String>,
}

/// The most tiles along one axis.
const MAX_TILES: u64 = 1_000_000;

/// What `mesh` may be, for messages.
const MESH: &str = "`\"plane\"`";

/// Reads an object that is one of `surfaces` or `volumes`; `None` where something is missing or wrong, which is then noted.
pub(super) fn read(
    fields: &mut Fields<'_, '_, '_, '_>,
    surfaces: &DeTable<'_>,
    volumes: &DeTable<'_>,
) -> Option<ObjectSpec> {
    if fields.has("volume") {
        return read_volume(fields, volumes).map(|volume| ObjectSpec::Volume { volume });
    }
    read_mesh(fields);
    let _ = fields.raw("volume");
    fields.require("surface", "the name of a `[surface.NAME]` of the manifest, or `volume`, that of a `[volume.NAME]`");
    let surface = read_name(fields, "surface", surfaces);
    let tiling = read_tiling(fields, surface.as_deref().and_then(|name| surfaces.get(name)?.get_ref().as_table()));
    let displacement = read_displacement(fields);
    Some(ObjectSpec::Surface(PlaneSpec { surface: surface?, tiling: tiling.unwrap_or([1, 1]), displacement }))
}

/// The name of a volume, beside which nothing stands yet.
fn read_volume(fields: &mut Fields<'_, '_, '_, '_>, volumes: &DeTable<'_>) -> Option<String> {
    fields.refuse("surface", "`surface` stands beside `volume`; wanted one of them");
    for key in ["mesh", "tiling", "displacement"] {
        fields.refuse(key, &format!("`{key}` of a volume is not supported in this version; wanted `volume` alone"));
    }
    read_name(fields, "volume", volumes)
}

/// Refuses every `mesh` but the plane, in words that fit.
fn read_mesh(fields: &mut Fields<'_, '_, '_, '_>) {
    fields.require("mesh", MESH);
    let Some(mesh) = fields.text("mesh", MESH).filter(|mesh| mesh != "plane") else { return };
    let is_file = [".glb", ".gltf"].iter().any(|ending| mesh.contains(ending));
    let mesh = mesh.escape_debug();
    let message = match is_file {
        true => format!("`mesh` `{mesh}` is not supported in this version; wanted {MESH}"),
        false => format!("`mesh` is `\"{mesh}\"`; wanted {MESH}"),
    };
    fields.mistake("mesh", message);
}

/// The name, under the key `kind`, of one of `tables`: those that the manifest has.
fn read_name(fields: &mut Fields<'_, '_, '_, '_>, kind: &'static str, tables: &DeTable<'_>) -> Option<String> {
    let name = fields.text(kind, &format!("the name of a `[{kind}.NAME]` of the manifest"))?;
    if tables.contains_key(name.as_str()) {
        return Some(name);
    }
    let known = tables.keys().map(|known| known.get_ref().as_ref());
    let known: Vec<&str> = known.filter(|known| is_file_safe(known)).collect();
    let hint = match closest(&name, &known) {
        Some(near) => format!("; did you mean `{near}`?"),
        None if known.is_empty() => String::new(),
        None => format!("; it has {}", quoted(&known)),
    };
    fields.names_nothing(kind, format!("the manifest has no {kind} `{}`{hint}", name.escape_debug()));
    None
}

/// How often the surface `surface` is repeated.
fn read_tiling(fields: &mut Fields<'_, '_, '_, '_>, surface: Option<&DeTable<'_>>) -> Option<[u32; 2]> {
    let wanted = "two integers from 1 to 1000000: tiles along u and v";
    let tiling = fields.value("tiling", wanted, read_tiles)?;
    if tiling != [1, 1] && surface.is_some_and(surface::is_clamped) {
        let message = "`tiling` repeats a surface whose `boundary` is `\"clamp\"`; wanted `[1, 1]`, or `\"repeat\"`";
        fields.mistake("tiling", message.into());
    }
    Some(tiling)
}

/// Two numbers of tiles.
fn read_tiles(value: &DeValue<'_>) -> Option<[u32; 2]> {
    let tiles = |n: u64| u32::try_from(n).ok().filter(|_| (1..=MAX_TILES).contains(&n));
    let items = value.as_array()?.iter().map(|item| integer(item.get_ref()).and_then(tiles));
    items.collect::<Option<Vec<u32>>>()?.try_into().ok()
}

/// The large shape under the surface.
fn read_displacement(fields: &mut Fields<'_, '_, '_, '_>) -> Option<Displacement> {
    let (_, value) = fields.raw("displacement")?;
    if let Some(file) = value.get_ref().as_str() {
        let file = file.escape_debug();
        let form = format!("`{{ file = \"{file}\", amplitude = … }}`, metres per unit of the stored value");
        fields.mistake("displacement", format!("`displacement` is a path alone; wanted {form}"));
        return None;
    }
    let file = "the path of an EXR, PNG, TIFF or JPEG image";
    let amplitude = "metres per unit of the stored value, at least 0";
    let displacement = fields.table("displacement", |fields| {
        fields.require("file", file);
        fields.require("amplitude", amplitude);
        let file = fields.text("file", file);
        let amplitude = fields.number("amplitude", amplitude, |n| (0.0..=MAX_METRES).contains(&n));
        let offset = fields.number("offset", "metres", |n| n.abs() <= MAX_METRES).unwrap_or(0.0);
        let channel = fields.text("channel", "the name of a channel, as in `\"R\"`");
        Some(Displacement { file: file?, amplitude: amplitude?, offset, channel })
    });
    displacement.flatten()
}
