//! Lights without a place: parallel rays, and the same radiance from everywhere.

use std::f32::consts::FRAC_1_PI;
use std::f64::consts::PI;

use formats::lookup::direction_of;
use glam::Vec3;

use super::{LightSample, luminance};

/// Parallel rays from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionalLight {
    /// Unit vector to the light, world frame.
    pub direction: Vec3,
    /// RGB irradiance on a plane that faces the light, W/m².
    pub irradiance: [f32; 3],
}

impl DirectionalLight {
    /// The one direction there is.
    pub(super) fn sample(&self) -> Option<LightSample> {
        debug_assert!(self.direction.is_normalized(), "a unit vector to the light");
        let Self { direction: wi, irradiance: radiance } = *self;
        Some(LightSample { wi, distance: f64::INFINITY, radiance, pdf: 1.0, is_delta: true })
    }

    /// Luminance of the irradiance on a plane that faces the light.
    pub(super) fn strength(&self) -> f64 {
        luminance(self.irradiance)
    }
}

/// The same radiance from all directions.
///
/// Sampled by the cosine over the upper hemisphere, which is exact for a point of the base plane: see the room's head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConstantLight {
    /// RGB radiance, W/(m² sr).
    pub radiance: [f32; 3],
}

impl ConstantLight {
    /// A direction with the density y/π over y > 0.
    ///
    /// The concentric map gives (√(2 − r²)·r·(cos φ, sin φ), 1 − r²), the disk point r·(cos φ, sin φ) is that over √(2
    /// − r²), and what projects onto the disk uniformly follows the cosine (Malley's method). `None` on the horizon,
    /// where the density is 0.
    pub(super) fn sample(&self, u: [f32; 2]) -> Option<LightSample> {
        let [x, y, z] = direction_of(u);
        let to_disk = 1.0 / (1.0 + z).sqrt();
        let wi = Vec3::new(x * to_disk, z.sqrt(), -y * to_disk);
        let pdf = Self::pdf(wi);
        let sample = LightSample { wi, distance: f64::INFINITY, radiance: self.radiance, pdf, is_delta: false };
        (pdf > 0.0).then_some(sample)
    }

    /// Density of [`ConstantLight::sample`], 1/sr: y/π above the horizon, 0 below.
    pub(super) fn pdf(direction: Vec3) -> f32 {
        // Below the horizon nothing is proposed: a density, not a rounding.
        direction.y.max(0.0) * FRAC_1_PI
    }

    /// Luminance of the irradiance on the base plane.
    pub(super) fn strength(&self) -> f64 {
        PI * luminance(self.radiance)
    }
}
