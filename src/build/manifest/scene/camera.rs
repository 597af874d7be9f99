//! `camera = { … }`, and the placing of things that look at a target.

use super::super::fields::{Fields, numbers};
use super::MAX_METRES;

/// Where a scene is seen from; lengths in metres, in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraSpec {
    /// The eye of a perspective camera, the centre of an orthographic one's film.
    pub position: [f64; 3],
    /// The point in the middle of the image; not `position`.
    pub target: [f64; 3],
    /// What points up in the image; of unit length, not along the view.
    pub up: [f64; 3],
    /// How the world comes onto the film.
    pub projection: Projection,
}

/// How the world comes onto the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Rays through one point.
    Perspective {
        /// Degrees between the upper and the lower edge of the image, in (0, 180).
        fov_degrees: f64,
    },
    /// Parallel rays.
    Orthographic {
        /// Metres across the width of the film, greater than 0.
        width: f64,
    },
}

/// Something at `position` that looks at `target`, turned so that `up` points up.
pub(super) struct Pose {
    pub(super) position: [f64; 3],
    pub(super) target: [f64; 3],
    pub(super) up: [f64; 3],
}

/// Metres between `position` and `target` under which they count as one point: a nanometre, far below any texel.
const MIN_DISTANCE: f64 = 1e-9;

/// Sine of the angle between two directions under which they count as parallel: less does not survive in single
/// precision, whose rounding is 6e-8.
const MIN_SINE: f64 = 1e-6;

/// What a point may be, for messages.
const POINT: &str = "three numbers (metres; y is up)";

/// Reads a camera; `None` where something is missing or wrong, which is then noted.
pub(super) fn read(fields: &mut Fields<'_, '_, '_, '_>) -> Option<CameraSpec> {
    let pose = read_pose(fields);
    let projection = read_projection(fields);
    let Pose { position, target, up } = pose?;
    Some(CameraSpec { position, target, up, projection: projection? })
}

/// One of `fov` and `width`.
fn read_projection(fields: &mut Fields<'_, '_, '_, '_>) -> Option<Projection> {
    let fov = "vertical degrees, greater than 0 and less than 180";
    let width = "metres across the film's width, greater than 0";
    let fov_degrees = fields.number("fov", fov, |n| n > 0.0 && n < 180.0);
    let metres = fields.number("width", width, |n| n > 0.0 && n <= MAX_METRES);
    match (fields.has("fov"), fields.has("width")) {
        (true, true) => {
            let message = "`width` stands beside `fov`; wanted `fov` (perspective) or `width` (orthographic)";
            fields.mistake("width", message.into());
            None
        }
        (false, false) => {
            fields.mistake_here(|title| {
                format!("`{title}` has no `fov` and no `width`; wanted `fov`, {fov}, or `width`, {width}")
            });
            None
        }
        (true, false) => fov_degrees.map(|fov_degrees| Projection::Perspective { fov_degrees }),
        (false, true) => metres.map(|width| Projection::Orthographic { width }),
    }
}

/// `position`, `target` and `up`. Without `up`, y is up, and −z where the view is along y, as on a map.
pub(super) fn read_pose(fields: &mut Fields<'_, '_, '_, '_>) -> Option<Pose> {
    fields.require("position", POINT);
    fields.require("target", POINT);
    let position = fields.numbers::<3>("position", POINT, |n| n.abs() <= MAX_METRES);
    let target = fields.numbers::<3>("target", POINT, |n| n.abs() <= MAX_METRES);
    let given_up = read_direction(fields, "up", "three numbers, not all 0", |_| true);
    let (position, target) = (position?, target?);
    let view = [0, 1, 2].map(|i| target[i] - position[i]);
    if length(view) < MIN_DISTANCE {
        fields.mistake("target", "`target` is where `position` is; wanted another point, to look at".into());
        return None;
    }
    let view = unit(view);
    let up = match (fields.has("up"), given_up) {
        (true, up) => up?,
        (false, _) if sine(view, [0.0, 1.0, 0.0]) < MIN_SINE => [0.0, 0.0, -1.0],
        (false, _) => [0.0, 1.0, 0.0],
    };
    if sine(view, up) < MIN_SINE {
        fields.mistake("up", "`up` points along the view; wanted another direction, or leave it out".into());
        return None;
    }
    Some(Pose { position, target, up })
}

/// A direction that `accept` likes, given in any length, as a unit vector.
pub(super) fn read_direction(
    fields: &mut Fields<'_, '_, '_, '_>,
    key: &'static str,
    wanted: &str,
    accept: impl Fn([f64; 3]) -> bool,
) -> Option<[f64; 3]> {
    fields.value(key, wanted, |value| {
        let vector: [f64; 3] = numbers(value)?.try_into().ok()?;
        let is_zero = vector.iter().all(|&n| n == 0.0);
        (!is_zero).then(|| unit(vector)).filter(|&direction| accept(direction))
    })
}

/// The unit vector along one that is not zero. Its largest component is divided out first: squares neither overflow
/// nor vanish.
fn unit(vector: [f64; 3]) -> [f64; 3] {
    let largest = vector.iter().fold(0.0_f64, |largest, n| largest.max(n.abs()));
    let scaled = vector.map(|n| n / largest);
    let length = length(scaled);
    scaled.map(|n| n / length)
}

/// Length of a vector.
fn length([x, y, z]: [f64; 3]) -> f64 {
    (x * x + y * y + z * z).sqrt()
}

/// Sine of the angle between two unit vectors.
fn sine(a: [f64; 3], b: [f64; 3]) -> f64 {
    length([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
}
