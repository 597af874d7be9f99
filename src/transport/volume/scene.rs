//! A scene with a volume: camera, lights, and the levels of a medium.

use glam::DVec3;

use crate::medium::Medium;
use crate::transport::camera::{Camera, CameraRay};
use crate::transport::light::Lights;
use crate::transport::scene::{Lod, level_of_footprint, vector_in_base};

/// A volume, a camera and lights.
#[derive(Debug)]
pub struct VolumeScene<'a> {
    /// The camera, in the world's frame.
    pub camera: Camera,
    /// The lights, in the world's frame.
    pub lights: Lights,
    /// The volume, around the origin.
    pub volume: VolumeObject<'a>,
    /// What camera rays see that meet no flakes.
    pub backdrop: Backdrop,
}

/// What is seen behind and through a volume.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backdrop {
    /// The lights themselves.
    #[default]
    Lights,
    /// Nothing: an image is the volume's own light.
    Black,
}

/// A volume at one or more levels of detail.
#[derive(Debug)]
pub struct VolumeObject<'a> {
    /// Fine to coarse, at least one.
    levels: Vec<VolumeLevel<'a>>,
    /// Metres of an edge of a source voxel: the geometric mean of the three.
    voxel: f64,
}

/// One level of a volume.
#[derive(Debug)]
pub struct VolumeLevel<'a> {
    /// Source voxels an edge: the geometric mean of the three axes.
    pub factor: f64,
    /// What is there.
    pub medium: &'a Medium,
}

impl<'a> VolumeObject<'a> {
    /// A volume of these levels, from fine to coarse; `voxel` is the edge of a source voxel in metres.
    ///
    /// # Panics
    /// If there is no level, or factors do not rise.
    pub fn new(levels: Vec<VolumeLevel<'a>>, voxel: f64) -> Self {
        assert!(!levels.is_empty(), "at least one level");
        assert!(levels.windows(2).all(|pair| pair[0].factor < pair[1].factor), "levels go from fine to coarse");
        Self { levels, voxel }
    }

    /// The levels, fine to coarse.
    pub fn levels(&self) -> &[VolumeLevel<'a>] {
        &self.levels
    }

    /// φ, the square root of the area that a pixel covers where its ray (frame of the volume) enters the grid, in source
    /// voxels; `None` where it does not.
    pub fn footprint_voxels(&self, ray: &CameraRay) -> Option<f64> {
        let (_, t) = self.levels[0].medium.enter(ray.origin, ray.direction)?;
        let [a, b] = ray.footprint(t, ray.direction);
        Some(a.cross(b).length().sqrt() / self.voxel)
    }

    /// The medium for a camera ray; one that misses the grid takes the coarsest.
    pub(super) fn level(&self, ray: &CameraRay, lod: Lod, u: f32) -> &'a Medium {
        let last = self.levels.len() - 1;
        let place = match lod {
            Lod::Fixed(place) => place.min(last),
            Lod::Auto if last == 0 => 0,
            Lod::Auto => self
                .footprint_voxels(ray)
                .map_or(last, |voxels| level_of_footprint(self.levels.iter().map(|level| level.factor), voxels, u)),
        };
        self.levels[place].medium
    }

    /// Half the extent of the grid, metres.
    fn half_extent(&self) -> DVec3 {
        0.5 * DVec3::from_array(self.levels[0].medium.shape().extent())
    }
}

impl VolumeScene<'_> {
    /// The camera's ray in the frame of the volume.
    pub fn camera_ray(&self, column: f64, row: f64) -> CameraRay {
        let ray = self.camera.ray(column, row);
        CameraRay {
            origin: vector_in_base(ray.origin) + self.volume.half_extent(),
            direction: vector_in_base(ray.direction),
            origin_spread: ray.origin_spread.map(vector_in_base),
            direction_spread: ray.direction_spread.map(vector_in_base),
        }
    }

    /// A point of the volume's frame in the world.
    pub(super) fn point_in_world(&self, point: DVec3) -> DVec3 {
        let from_centre = point - self.volume.half_extent();
        DVec3::new(from_centre.x, from_centre.z, -from_centre.y)
    }
}
