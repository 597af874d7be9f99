//! `lights = [{ type = … }, …]`.

use super::super::fields::Fields;
use super::MAX_METRES;
use super::camera::{Pose, read_direction, read_pose};

/// What lights a scene; radiance in W/(m² sr) or any unit that all lights share, linear RGB with Rec. 709 primaries.
#[derive(Clone, Debug, PartialEq)]
pub enum LightSpec {
    /// Parallel light.
    Directional {
        /// To the light; of unit length, y greater than 0.
        direction: [f64; 3],
        /// Irradiance of a plane that faces the light.
        irradiance: [f32; 3],
    },
    /// A rectangle that shines to one side, the one of `target`.
    Area {
        /// Its centre in metres.
        position: [f64; 3],
        /// The point that it faces; not `position`.
        target: [f64; 3],
        /// What its height points along, as far as its plane allows; of unit length, not along its normal.
        up: [f64; 3],
        /// Metres: width, height.
        size: [f64; 2],
        /// Radiance of its front.
        radiance: [f32; 3],
    },
    /// The same light from everywhere.
    Constant {
        /// Radiance of every direction.
        radiance: [f32; 3],
    },
    /// An equirectangular image around the scene.
    Image {
        /// Its path, relative to the manifest.
        file: String,
        /// Radiance per unit of the stored value.
        scale: f64,
        /// Degrees that the image is turned by about the world's y.
        rotation_degrees: f64,
    },
}

/// The types of light that are rendered.
const TYPES: [&str; 4] = ["directional", "area", "constant", "image"];

/// The types that are not rendered yet.
const LATER_TYPES: [&str; 2] = ["point", "sh"];

/// The brightest light, in its own unit: single precision holds what is summed of it, and its square.
const MAX_BRIGHTNESS: f64 = 1e9;

/// What a colour of light may be, for messages.
const BRIGHTNESS: &str = "three numbers from 0 to 1e9 (linear RGB)";

/// The y of a unit vector to a light under which the light counts as below the plane: no cosine is left in single
/// precision, whose rounding is 6e-8.
const MIN_ELEVATION: f64 = 1e-6;

/// Reads a light; `None` where something is missing or wrong, which is then noted.
pub(super) fn read(fields: &mut Fields<'_, '_, '_, '_>) -> Option<LightSpec> {
    let wanted = format!("one of {}", TYPES.map(|name| format!("`\"{name}\"`")).join(", "));
    fields.require("type", &wanted);
    let kind = fields.text("type", &wanted);
    match kind.as_deref() {
        Some("directional") => read_directional(fields),
        Some("area") => read_area(fields),
        Some("constant") => brightness(fields, "radiance").map(|radiance| LightSpec::Constant { radiance }),
        Some("image") => read_image(fields),
        unknown => {
            fields.excuse_keys();
            let found = match unknown? {
                later if LATER_TYPES.contains(&later) => format!("`type` `{later}` is not supported in this version"),
                other => format!("`type` is `\"{}\"`", other.escape_debug()),
            };
            fields.mistake("type", format!("{found}; wanted {wanted}"));
            None
        }
    }
}

/// Parallel light.
fn read_directional(fields: &mut Fields<'_, '_, '_, '_>) -> Option<LightSpec> {
    let wanted = "three numbers that point to the light, y greater than 0: from below the plane nothing is lit";
    fields.require("direction", wanted);
    let direction = read_direction(fields, "direction", wanted, |[_, y, _]| y >= MIN_ELEVATION);
    let irradiance = brightness(fields, "irradiance");
    Some(LightSpec::Directional { direction: direction?, irradiance: irradiance? })
}

/// A rectangle.
fn read_area(fields: &mut Fields<'_, '_, '_, '_>) -> Option<LightSpec> {
    let wanted = "metres: width and height, each greater than 0";
    let pose = read_pose(fields);
    fields.require("size", wanted);
    let size = fields.numbers::<2>("size", wanted, |n| n > 0.0 && n <= MAX_METRES);
    let radiance = brightness(fields, "radiance");
    let Pose { position, target, up } = pose?;
    Some(LightSpec::Area { position, target, up, size: size?, radiance: radiance? })
}

/// An environment map.
fn read_image(fields: &mut Fields<'_, '_, '_, '_>) -> Option<LightSpec> {
    let wanted = "the path of an equirectangular EXR or HDR image";
    fields.require("file", wanted);
    let file = fields.text("file", wanted);
    let scale = fields.number("scale", "a number from 0 to 1e9", |n| (0.0..=MAX_BRIGHTNESS).contains(&n));
    let rotation = fields.number("rotation", "degrees from -360 to 360", |n| n.abs() <= 360.0);
    Some(LightSpec::Image { file: file?, scale: scale.unwrap_or(1.0), rotation_degrees: rotation.unwrap_or(0.0) })
}

/// A required colour of light.
fn brightness(fields: &mut Fields<'_, '_, '_, '_>, key: &'static str) -> Option<[f32; 3]> {
    fields.require(key, BRIGHTNESS);
    let rgb = fields.numbers::<3>(key, BRIGHTNESS, |n| (0.0..=MAX_BRIGHTNESS).contains(&n))?;
    Some(rgb.map(|n| n as f32))
}
