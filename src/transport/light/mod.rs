//! What illuminates a scene: directional, area, constant, spherical-harmonic and image lights.
//!
//! World frame: right-handed, y up, metres. Directions are unit vectors that point away from the lit point, to the
//! light. A [`Light`] answers three questions: which direction to try ([`Light::sample`]), with which density that
//! happens ([`Light::pdf`]), and what a ray that leaves the scene meets ([`Light::emitted`]). [`Lights`] answers them
//! for several at once, so that a renderer weighs its own directions against theirs with one density.
//!
//! Lights that surround the scene are *sampled* over the upper hemisphere (y > 0) alone: objects lie in the xz plane,
//! and what a height field sees of the sky is above it. They *emit* from below as well: a ray that leaves a piece of
//! surface across its rim meets them, and there its own density counts alone.

mod area;
mod distant;
mod environment;
mod harmonics;
mod lights;

use glam::{DVec3, Vec3};

pub use area::AreaLight;
pub use distant::{ConstantLight, DirectionalLight};
pub use environment::ImageLight;
pub use harmonics::ShLight;
pub use lights::Lights;

/// A source of light.
#[derive(Clone, Debug)]
pub enum Light {
    /// Parallel rays from one direction, as from the sun.
    Directional(DirectionalLight),
    /// A rectangle that shines to one side.
    Area(AreaLight),
    /// The same radiance from everywhere.
    Constant(ConstantLight),
    /// An environment map.
    Image(ImageLight),
    /// An environment of spherical harmonics.
    Sh(ShLight),
}

/// A direction to a light and what comes from there, if nothing is between.
///
/// Whatever the light, `radiance · cosθ / pdf` is an unbiased sample of the irradiance on a plane at the lit point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// Unit vector from the lit point to the light, world frame.
    pub wi: Vec3,
    /// Metres to the light along `wi`; infinite for distant ones.
    pub distance: f64,
    /// RGB, W/(m² sr); of a delta light the irradiance on a plane that faces it, W/m².
    pub radiance: [f32; 3],
    /// Density of `wi`, 1/sr, greater than 0; of a delta light the probability that it was chosen (1 if it is alone).
    pub pdf: f32,
    /// Whether no other way of choosing a direction can find this light.
    pub is_delta: bool,
}

impl Light {
    /// A direction from which `from` (metres) is lit; `None` where this `u` gives none.
    ///
    /// `u` is uniform in [0, 1)². Directions follow [`Light::pdf`]. The light is taken as alone: what hides it is the
    /// caller's to find.
    pub fn sample(&self, from: DVec3, u: [f32; 2]) -> Option<LightSample> {
        match self {
            Self::Directional(light) => light.sample(),
            Self::Area(light) => light.sample(from, u),
            Self::Constant(light) => light.sample(u),
            Self::Image(light) => light.sample(u),
            Self::Sh(light) => {
                let sample = ConstantLight { radiance: [0.0; 3] }.sample(u)?;
                Some(LightSample { radiance: light.radiance(sample.wi), ..sample })
            }
        }
    }

    /// What reaches `origin` from `direction` if nothing is between, and the metres to it (infinite for distant
    /// lights).
    ///
    /// `None` where the ray misses the light or sees its dark side, and always for delta lights.
    pub fn emitted(&self, origin: DVec3, direction: Vec3) -> Option<(f64, [f32; 3])> {
        match self {
            Self::Directional(_) => None,
            Self::Area(light) => light.emitted(origin, direction),
            Self::Constant(light) => Some((f64::INFINITY, light.radiance)),
            Self::Image(light) => Some((f64::INFINITY, light.radiance(direction))),
            Self::Sh(light) => Some((f64::INFINITY, light.radiance(direction))),
        }
    }

    /// Density with which [`Light::sample`] at `origin` proposes `direction`, 1/sr; 0 for delta lights.
    pub fn pdf(&self, origin: DVec3, direction: Vec3) -> f32 {
        match self {
            Self::Directional(_) => 0.0,
            Self::Area(light) => light.pdf(origin, direction),
            Self::Constant(_) | Self::Sh(_) => ConstantLight::pdf(direction),
            Self::Image(light) => light.pdf(direction),
        }
    }

    /// Whether only [`Light::sample`] can find this light.
    pub fn is_delta(&self) -> bool {
        matches!(self, Self::Directional(_))
    }

    /// Luminance of about the irradiance that the light gives at `from`, W/m²: what a choice among lights goes by.
    ///
    /// Greater than 0 wherever the light can be sampled with a radiance greater than 0.
    fn strength(&self, from: DVec3) -> f64 {
        match self {
            Self::Directional(light) => light.strength(),
            Self::Area(light) => light.strength(from),
            Self::Constant(light) => light.strength(),
            Self::Image(light) => light.strength(),
            Self::Sh(light) => light.strength(),
        }
    }

    /// Whether the light is infinitely far away.
    fn is_distant(&self) -> bool {
        !matches!(self, Self::Area(_))
    }
}

/// Luminance of linear Rec. 709 colour, in the unit of the colour; greater than 0 where any channel is.
fn luminance(rgb: [f32; 3]) -> f64 {
    0.2126 * f64::from(rgb[0]) + 0.7152 * f64::from(rgb[1]) + 0.0722 * f64::from(rgb[2])
}
