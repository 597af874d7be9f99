//! The keys of a `[scene.NAME]`: what `render` draws.

mod camera;
mod light;
mod object;

pub use camera::{CameraSpec, Projection};
pub use light::LightSpec;
pub use object::{Displacement, ObjectSpec, PlaneSpec};

use toml::de::DeTable;

use super::fields::{Fields, Tables};

/// A scene to draw, as its manifest describes it.
///
/// The world is right-handed, y up, in metres; an object lies in its xz plane, centred at the origin.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneSpec {
    /// Its name, safe as a folder.
    pub name: String,
    /// Where it is seen from.
    pub camera: CameraSpec,
    /// Pixels of the image: width, height.
    pub film: [usize; 2],
    /// What lights it, 1 to [`MAX_LIGHTS`].
    pub lights: Vec<LightSpec>,
    /// What is seen: one object in this version.
    pub objects: Vec<ObjectSpec>,
}

/// The most lights of a scene: each one takes samples from the others.
pub const MAX_LIGHTS: usize = 16;

/// The array of lights.
const LIGHTS: Tables = Tables {
    key: "lights",
    item: "light",
    max: MAX_LIGHTS,
    wanted: "an array of 1 to 16 tables, as in `[{ type = \"constant\", radiance = [1, 1, 1] }]`",
};

/// The array of objects.
const OBJECTS: Tables = Tables {
    key: "objects",
    item: "object",
    max: 1,
    wanted: "an array of one table (one object a scene in this version), as in \
             `[{ mesh = \"plane\", surface = \"NAME\" }]`",
};

/// The longest side of an image in pixels: that of the largest map.
const MAX_FILM: u64 = 16384;

/// Pixels a side where the manifest names none.
const DEFAULT_FILM: u64 = 256;

/// The largest length in metres, as for surfaces.
const MAX_METRES: f64 = 1e9;

/// Reads the scene `name`, whose objects may be any of `surfaces` and `volumes`; `None` where something is missing or wrong,
/// which is then noted.
pub(super) fn read(
    name: &str,
    mut fields: Fields<'_, '_, '_, '_>,
    surfaces: &DeTable<'_>,
    volumes: &DeTable<'_>,
) -> Option<SceneSpec> {
    fields.require("camera", "a table, as in `{ position = [0, 0.3, 0.4], target = [0, 0, 0], fov = 40 }`");
    fields.require(LIGHTS.key, LIGHTS.wanted);
    fields.require(OBJECTS.key, OBJECTS.wanted);
    let camera = fields.table("camera", camera::read).flatten();
    let film = fields.table("film", read_film).unwrap_or([DEFAULT_FILM; 2]);
    let lights = fields.tables(&LIGHTS, light::read);
    let objects = fields.tables(&OBJECTS, |object| object::read(object, surfaces, volumes));
    fields.finish();
    Some(SceneSpec {
        name: name.into(),
        camera: camera?,
        film: film.map(|pixels| pixels as usize),
        lights: lights?,
        objects: objects?,
    })
}

/// Pixels of the image: width, height.
fn read_film(fields: &mut Fields<'_, '_, '_, '_>) -> [u64; 2] {
    ["width", "height"].map(|key| fields.integer(key, [1, MAX_FILM]).unwrap_or(DEFAULT_FILM))
}

#[cfg(test)]
mod tests;
