//! Importance sampling of a base BRDF: cosine-weighted directions for the diffuse part, visible normals for the other.

use glam::Vec3;

use super::brdf::Brdf;
use crate::math::frame::Frame;
use crate::math::warp;

/// A sampled direction to the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrdfSample {
    /// Unit direction to the light, above the horizon.
    pub wi: Vec3,
    /// Density of `wi`, 1/sr, greater than 0.
    pub pdf: f32,
    /// The BRDF, 1/sr, RGB, cosine not included.
    pub value: [f32; 3],
}

/// Each part that is there gets this share of the samples or more: the shares come from albedos that are estimates, and a
/// weight f cos/pdf is at most the part's own over its share.
const LEAST_SHARE: f32 = 0.1;

impl Brdf {
    /// A direction to the light for the viewer in `wo`, from uniform numbers in [0, 1); `None` where it falls below the
    /// horizon of `normal`, where `wo` lies there and where nothing is reflected.
    ///
    /// `u[2]` chooses the part, the others the direction in it. A `None` is a sample of weight 0: [`Self::pdf`] integrates
    /// to 1 minus the fraction of them. All directions are unit, in one frame, and point away from the surface.
    pub fn sample(&self, normal: Vec3, wo: Vec3, u: [f32; 3]) -> Option<BrdfSample> {
        let cos_o = normal.dot(wo);
        if cos_o <= 0.0 {
            return None;
        }
        let share = self.specular_share(cos_o)?;
        let wi = match self.specular {
            Some(conductor) if u[2] < share => conductor.sample(normal, wo, [u[0], u[1]])?,
            _ => Frame::around(normal).to_outer(warp::cosine_hemisphere([u[0], u[1]])),
        };
        let pdf = self.pdf(normal, wi, wo);
        (pdf > 0.0).then(|| BrdfSample { wi, pdf, value: self.eval(normal, wi, wo) })
    }

    /// Density of [`Self::sample`] at `wi` for the viewer in `wo`, 1/sr; 0 where either is not above the horizon.
    pub fn pdf(&self, normal: Vec3, wi: Vec3, wo: Vec3) -> f32 {
        let [cos_i, cos_o] = [normal.dot(wi), normal.dot(wo)];
        if cos_i <= 0.0 || cos_o <= 0.0 {
            return 0.0;
        }
        let Some(share) = self.specular_share(cos_o) else { return 0.0 };
        let specular = self.specular.map_or(0.0, |conductor| conductor.pdf(normal, wi, wo));
        (1.0 - share) * warp::cosine_hemisphere_pdf(cos_i) + share * specular
    }

    /// Fraction of samples for the specular part, by albedos: the diffuse one, and Fresnel's for a mirror; `None` for black.
    pub(super) fn specular_share(&self, cos_o: f32) -> Option<f32> {
        let mean = |rgb: [f32; 3]| rgb.iter().sum::<f32>() / 3.0;
        let diffuse = mean(self.diffuse);
        match self.specular {
            None => (diffuse > 0.0).then_some(0.0),
            Some(_) if diffuse <= 0.0 => Some(1.0),
            Some(conductor) => {
                let specular = mean(conductor.fresnel(cos_o));
                // The least share keeps weights bounded where the estimate is far off, as for f0 = 0.
                Some((specular / (specular + diffuse)).clamp(LEAST_SHARE, 1.0 - LEAST_SHARE))
            }
        }
    }
}
