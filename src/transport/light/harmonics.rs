//! Light as spherical harmonics.

use glam::Vec3;

use super::luminance;
use crate::math::sh;

/// An environment of real spherical harmonics, in the order l(l + 1) + m of [`sh::basis`], world frame.
///
/// Where the sum is negative the radiance is 0. Directions are proposed as by a
/// [`ConstantLight`](super::ConstantLight): the light is smooth.
#[derive(Clone, Debug, PartialEq)]
pub struct ShLight {
    /// RGB, W/(m² sr), one a basis function.
    coefficients: Vec<[f32; 3]>,
    max_band: usize,
}

impl ShLight {
    /// The light of these coefficients, of which there are (bands)².
    ///
    /// # Panics
    /// If their number is no square or more than [`sh::MAX_BAND`] + 1 squared, or one is not finite.
    pub fn new(coefficients: Vec<[f32; 3]>) -> Self {
        let bands = coefficients.len().isqrt();
        assert!(
            bands * bands == coefficients.len() && (1..=sh::MAX_BAND + 1).contains(&bands),
            "(bands)² coefficients"
        );
        assert!(coefficients.as_flattened().iter().all(|c| c.is_finite()), "finite coefficients");
        Self { coefficients, max_band: bands - 1 }
    }

    /// Radiance from the direction (unit), RGB.
    pub fn radiance(&self, direction: Vec3) -> [f32; 3] {
        let mut sum = [0.0_f64; 3];
        sh::basis(self.max_band, direction, |k, value| {
            (0..3).for_each(|c| sum[c] += f64::from(self.coefficients[k][c]) * value);
        });
        // A truncated series may ring below 0; there is no negative light.
        sum.map(|value| value.max(0.0) as f32)
    }

    /// Luminance of about the irradiance on the base plane: of the mean radiance and the share that falls in from above.
    pub(super) fn strength(&self) -> f64 {
        let size = |k: usize| self.coefficients.get(k).map_or(0.0, |c| luminance(c.map(f32::abs)));
        // Never 0 unless all coefficients are: the choice among lights must be able to find it.
        (0..self.coefficients.len()).map(size).sum()
    }
}
