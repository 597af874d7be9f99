//! How the points of a level reflect: one choice per model, asked in the same three ways.

use glam::Vec3;

use crate::geometry::PlaneHit;
use crate::material::{Brdf, LeadrBrdf, SlopeMoments};
use formats::level_brdf::{BoundAdditive, BoundBrdf, LevelBrdf, LevelHit};

/// The materials of one level, over the map.
#[derive(Debug)]
pub enum Shading<'a> {
    /// The base BRDF at every point, with an optional colour factor a cell, `[v][u]`.
    Base {
        /// The base BRDF.
        brdf: Brdf,
        /// Factor of diffuse albedo and `f0`.
        color: Option<&'a [[f32; 3]]>,
    },
    /// A prefiltered level, as its asset says.
    Prefiltered(LevelBrdf<'a>),
    /// One Beckmann lobe a cell from its slope moments.
    Leadr {
        /// The base BRDF.
        brdf: Brdf,
        /// Factor of diffuse albedo and `f0` a cell.
        color: Option<&'a [[f32; 3]]>,
        /// Slope moments a cell, `[v][u]`.
        moments: &'a [SlopeMoments],
    },
}

/// The BRDF at one hit, for one viewer.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "lives on the stack of one hit; a box would cost an allocation a hit")]
pub(super) enum BoundShading<'a> {
    Base { brdf: Brdf, normal: Vec3, wo: Vec3 },
    Prefiltered(BoundBrdf<'a>),
    Leadr { brdf: LeadrBrdf, normal: Vec3, wo: Vec3 },
}

/// A sampled direction to the light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounce {
    pub(super) wi: Vec3,
    /// 1/sr.
    pub(super) pdf: f32,
    /// BRDF, 1/sr, no cosine.
    pub(super) value: Vec3,
}

impl Shading<'_> {
    /// The BRDF where `hit` is, on a map of `size` cells, seen from `wo`.
    pub(super) fn at(&self, hit: &PlaneHit, size: [usize; 2], wo: Vec3) -> BoundShading<'_> {
        let normal = hit.normal;
        let cell = hit.point.cell[1] * size[0] + hit.point.cell[0];
        let tinted = |brdf: &Brdf, color: &Option<&[[f32; 3]]>| color.map_or(*brdf, |color| brdf.tinted(color[cell]));
        let tilt = hit.facet.tilt.as_vec2();
        match self {
            Self::Base { brdf, color } => BoundShading::Base { brdf: tinted(brdf, color), normal, wo },
            Self::Prefiltered(level) => BoundShading::Prefiltered(level.at(&level_hit(hit, size), wo.to_array())),
            Self::Leadr { brdf, color, moments } => {
                let SlopeMoments { mean, covariance } = moments[cell];
                let mean_slope = [mean[0] + tilt.x, mean[1] + tilt.y];
                let brdf = LeadrBrdf { mean_slope, covariance, base: tinted(brdf, color) };
                BoundShading::Leadr { brdf, normal, wo }
            }
        }
    }
}

impl Shading<'_> {
    /// What the base plane reflects besides, where `hit` is: lit with its own cosine, not shadowed by the relief.
    pub(super) fn additive_at(&self, hit: &PlaneHit, size: [usize; 2], wo: Vec3) -> Option<BoundAdditive<'_>> {
        let Self::Prefiltered(level) = self else { return None };
        level.additive_at(&level_hit(hit, size), wo.to_array())
    }
}

/// A hit on a map of `size` cells in the words of `formats`.
fn level_hit(hit: &PlaneHit, size: [usize; 2]) -> LevelHit {
    let x = [0, 1].map(|k| (hit.point.cell[k] as f32 + hit.point.st[k]) / size[k] as f32);
    LevelHit { x, n_c: hit.normal.to_array(), tilt: hit.facet.tilt.as_vec2().to_array() }
}

impl BoundShading<'_> {
    /// The BRDF for light from `wi` and the density of [`Self::sample`] there, 1/sr both.
    #[inline]
    pub(super) fn eval_pdf(&self, wi: Vec3) -> (Vec3, f32) {
        match self {
            Self::Base { brdf, normal, wo } => (brdf.eval(*normal, wi, *wo).into(), brdf.pdf(*normal, wi, *wo)),
            Self::Prefiltered(level) => {
                let (value, pdf) = level.eval_pdf(wi.to_array());
                (value.into(), pdf)
            }
            Self::Leadr { brdf, normal, wo } => (brdf.eval(*normal, wi, *wo).into(), brdf.pdf(*normal, wi, *wo)),
        }
    }

    /// The BRDF for light from `wi`.
    #[inline]
    pub(super) fn eval(&self, wi: Vec3) -> Vec3 {
        match self {
            Self::Base { brdf, normal, wo } => brdf.eval(*normal, wi, *wo).into(),
            Self::Prefiltered(level) => level.eval(wi.to_array()).into(),
            Self::Leadr { brdf, normal, wo } => brdf.eval(*normal, wi, *wo).into(),
        }
    }

    /// The direction of [`Self::sample`] alone; a lost sample where its density is 0.
    #[inline]
    pub(super) fn sample_direction(&self, u: [f32; 3]) -> Option<Vec3> {
        match self {
            Self::Prefiltered(level) => level.sample_direction(u).map(Vec3::from),
            _ => self.sample(u).map(|bounce| bounce.wi),
        }
    }

    /// A direction to the light; none where the sampled one is below a horizon, which counts as black.
    #[inline]
    pub(super) fn sample(&self, u: [f32; 3]) -> Option<Bounce> {
        match self {
            Self::Base { brdf, normal, wo } => {
                let sample = brdf.sample(*normal, *wo, u)?;
                Some(Bounce { wi: sample.wi, pdf: sample.pdf, value: sample.value.into() })
            }
            Self::Prefiltered(level) => {
                let sample = level.sample(u)?;
                Some(Bounce { wi: sample.wi.into(), pdf: sample.pdf, value: sample.f.into() })
            }
            Self::Leadr { brdf, normal, wo } => {
                let sample = brdf.sample(*normal, *wo, u)?;
                Some(Bounce { wi: sample.wi, pdf: sample.pdf, value: sample.value.into() })
            }
        }
    }
}
