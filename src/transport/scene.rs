//! What is rendered: a camera, lights, and a displaced plane with its levels.
//!
//! World: right-handed, y up, metres. The plane lies in the xz plane around the origin: a point (x, y, z) of its base
//! frame (x = +u, y = −v, z out, origin at the first tile's corner) is at (x − width/2, z, −y − height/2).

use glam::{DVec3, Vec3};

use super::camera::{Camera, CameraRay};
use super::light::Lights;
use super::shading::Shading;
use crate::geometry::{DisplacedPlane, Ray};

/// A scene, ready to be rendered.
#[derive(Debug)]
pub struct Scene<'a> {
    /// The camera, in the world's frame.
    pub camera: Camera,
    /// The lights, in the world's frame.
    pub lights: Lights,
    /// The surface.
    pub surface: SurfaceObject<'a>,
}

/// A displaced plane at one or more levels of detail.
#[derive(Debug)]
pub struct SurfaceObject<'a> {
    /// Fine to coarse, at least one.
    levels: Vec<RenderLevel<'a>>,
    /// Metres of a texel of the source along u and v.
    texel: [f64; 2],
}

/// One level of a surface.
#[derive(Debug)]
pub struct RenderLevel<'a> {
    /// Source texels a cell: the geometric mean of both axes.
    pub factor: f64,
    /// Its geometry.
    pub plane: DisplacedPlane<'a>,
    /// Its materials.
    pub shading: Shading<'a>,
}

/// Which level a path meets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lod {
    /// By the footprint of its pixel, blended at random between two neighbours.
    #[default]
    Auto,
    /// Always the one at this place of the list.
    Fixed(usize),
}

/// The most that the major axis of a footprint counts, in minor axes.
const MAX_ANISOTROPY: f64 = 8.0;

impl<'a> SurfaceObject<'a> {
    /// A surface of these levels, from fine to coarse; `texel` is the size of a source texel in metres.
    ///
    /// # Panics
    /// If there is no level, or factors do not rise.
    pub fn new(levels: Vec<RenderLevel<'a>>, texel: [f64; 2]) -> Self {
        assert!(!levels.is_empty(), "at least one level");
        assert!(levels.windows(2).all(|pair| pair[0].factor < pair[1].factor), "levels go from fine to coarse");
        Self { levels, texel }
    }

    /// The levels, fine to coarse.
    pub fn levels(&self) -> &[RenderLevel<'a>] {
        &self.levels
    }

    /// φ, the square root of the area of a pixel's footprint on the base surface in source texels, its major axis counted
    /// as at most 8 minor ones; `None` where the ray does not meet the base.
    pub fn footprint_texels(&self, ray: &CameraRay) -> Option<f64> {
        let (facet, t) = self.levels[0].plane.base_under(ray.origin, ray.direction)?;
        let normal = DVec3::new(-facet.tilt.x, -facet.tilt.y, 1.0).normalize();
        let [a, b] = ray.footprint(t, normal).map(|step| [step.x / self.texel[0], step.y / self.texel[1]]);
        // singular values of the matrix with columns a and b
        let squares = a[0] * a[0] + a[1] * a[1] + b[0] * b[0] + b[1] * b[1];
        let area = (a[0] * b[1] - a[1] * b[0]).abs();
        let root = (squares * squares - 4.0 * area * area).max(0.0).sqrt();
        let major = (0.5 * (squares + root)).sqrt();
        let minor = area / major;
        Some((major.min(MAX_ANISOTROPY * minor) * minor).sqrt())
    }

    /// The level for a camera ray (base frame). A ray that misses the base takes the coarsest.
    pub(super) fn level(&self, ray: &CameraRay, lod: Lod, u: f32) -> &RenderLevel<'a> {
        let place = match lod {
            Lod::Fixed(place) => place.min(self.levels.len() - 1),
            Lod::Auto if self.levels.len() == 1 => 0,
            Lod::Auto => {
                let factors = self.levels.iter().map(|level| level.factor);
                let texels = self.footprint_texels(ray);
                texels.map_or(self.levels.len() - 1, |texels| level_of_footprint(factors, texels, u))
            }
        };
        &self.levels[place]
    }
}

/// The level that a path with the random number `u` draws for the footprint φ: between factors a <= φ <= b the coarser has
/// the weight (ln φ − ln a)/(ln b − ln a). `factors` rise.
pub(super) fn level_of_footprint(factors: impl Iterator<Item = f64> + Clone, footprint: f64, u: f32) -> usize {
    let next = factors.clone().take_while(|&factor| factor <= footprint).count();
    let mut around = factors.skip(next.saturating_sub(1));
    match (next, around.next(), around.next()) {
        (0, ..) | (_, _, None) => next.saturating_sub(1),
        (_, Some(a), Some(b)) if f64::from(u) < (footprint / a).ln() / (b / a).ln() => next,
        _ => next - 1,
    }
}

impl Scene<'_> {
    /// Whether the camera is outside of the surface at every level.
    pub fn camera_is_outside(&self) -> bool {
        let position = self.point_in_base(self.camera.position());
        self.surface.levels.iter().all(|level| level.plane.is_outside(position))
    }

    /// φ at the middle of the film.
    pub fn central_footprint(&self) -> Option<f64> {
        let [width, height] = self.camera.size().map(|n| n as f64);
        self.surface.footprint_texels(&self.camera_ray(0.5 * width, 0.5 * height))
    }

    /// The camera's ray in the base frame.
    pub(super) fn camera_ray(&self, column: f64, row: f64) -> CameraRay {
        let ray = self.camera.ray(column, row);
        CameraRay {
            origin: self.point_in_base(ray.origin),
            direction: vector_in_base(ray.direction),
            origin_spread: ray.origin_spread.map(vector_in_base),
            direction_spread: ray.direction_spread.map(vector_in_base),
        }
    }

    fn point_in_base(&self, world: DVec3) -> DVec3 {
        let [width, height] = self.surface.levels[0].plane.extent();
        vector_in_base(world) + DVec3::new(0.5 * width, -0.5 * height, 0.0)
    }

    /// A point of the base frame in the world.
    pub(super) fn point_in_world(&self, base: DVec3) -> DVec3 {
        let [width, height] = self.surface.levels[0].plane.extent();
        DVec3::new(base.x - 0.5 * width, base.z, -base.y - 0.5 * height)
    }
}

impl CameraRay {
    /// The ray alone, its direction in single precision.
    pub(super) fn ray(&self) -> Ray {
        Ray { origin: self.origin, direction: self.direction_f32() }
    }
}

/// A vector of the world in the base frame.
pub(super) fn vector_in_base(world: DVec3) -> DVec3 {
    DVec3::new(world.x, -world.z, world.y)
}

/// A direction of the world in the base frame.
#[inline]
pub(super) fn direction_in_base(world: Vec3) -> Vec3 {
    Vec3::new(world.x, -world.z, world.y)
}

/// A direction of the base frame in the world.
#[inline]
pub(super) fn direction_in_world(base: Vec3) -> Vec3 {
    Vec3::new(base.x, base.z, -base.y)
}
