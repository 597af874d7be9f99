//! The camera: from a place on the film to a ray, and how rays spread from pixel to pixel.

use glam::{DVec3, Vec3};

/// How a camera projects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// From one point; the tangent of half the vertical angle of view.
    Perspective {
        /// tan(fov / 2).
        tan_half_fov: f64,
    },
    /// In parallel; metres across the width of the film.
    Orthographic {
        /// Metres.
        width: f64,
    },
}

/// A pinhole or parallel camera in the frame of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    position: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    projection: Projection,
    size: [usize; 2],
    /// Pixels to the right and down that the film is moved by.
    shift: [f64; 2],
}

/// A ray of the camera and its derivatives by the film's column and row, a pixel each (Igehy 1999).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRay {
    /// Start.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
    /// ∂origin/∂(column, row).
    pub origin_spread: [DVec3; 2],
    /// ∂direction/∂(column, row).
    pub direction_spread: [DVec3; 2],
}

impl Camera {
    /// A camera at `position` that looks at `target` with `up` upward, for a film of `size` columns and rows.
    ///
    /// `None` where `position` is `target` or `up` runs along the view.
    pub fn look_at(
        position: DVec3,
        target: DVec3,
        up: DVec3,
        projection: Projection,
        size: [usize; 2],
    ) -> Option<Self> {
        let forward = (target - position).try_normalize()?;
        let right = forward.cross(up.try_normalize()?);
        let right = if right.length() > MIN_SINE { right.normalize() } else { return None };
        Some(Self { position, right, up: right.cross(forward), forward, projection, size, shift: [0.0; 2] })
    }

    /// Columns and rows of the film.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// This camera with its film moved by that part of a pixel to the right and down; the rays turn or move with it.
    pub fn shifted(&self, columns: f64, rows: f64) -> Self {
        Self { shift: [self.shift[0] + columns, self.shift[1] + rows], ..*self }
    }

    /// Where the camera stands; for a parallel one the centre of its film.
    pub fn position(&self) -> DVec3 {
        self.position
    }

    /// The ray through the place (`column`, `row`) of the film, in pixels from its upper left corner.
    pub fn ray(&self, column: f64, row: f64) -> CameraRay {
        let [width, height] = self.size.map(|n| n as f64);
        let place = [column + self.shift[0] - 0.5 * width, 0.5 * height - row - self.shift[1]];
        match self.projection {
            Projection::Perspective { tan_half_fov } => {
                let pixel = 2.0 * tan_half_fov / height;
                let [right, up] = [self.right * pixel, self.up * pixel];
                let far = self.forward + place[0] * right + place[1] * up;
                let length = far.length();
                let direction = far / length;
                let spread = |step: DVec3| (step - direction * direction.dot(step)) / length;
                CameraRay {
                    origin: self.position,
                    direction,
                    origin_spread: [DVec3::ZERO; 2],
                    direction_spread: [spread(right), spread(-up)],
                }
            }
            Projection::Orthographic { width: metres } => {
                let pixel = metres / width;
                let [right, up] = [self.right * pixel, self.up * pixel];
                CameraRay {
                    origin: self.position + place[0] * right + place[1] * up,
                    direction: self.forward,
                    origin_spread: [right, -up],
                    direction_spread: [DVec3::ZERO; 2],
                }
            }
        }
    }
}

/// Sine between view and `up` below which the latter says nothing.
const MIN_SINE: f64 = 1e-6;

impl CameraRay {
    /// Change of the place where the ray meets the plane of unit normal `normal` at distance `t`, by column and row, a
    /// pixel each; infinite where the ray runs along the plane.
    pub fn footprint(&self, t: f64, normal: DVec3) -> [DVec3; 2] {
        let across = self.direction.dot(normal);
        [0, 1].map(|k| {
            let moved = self.origin_spread[k] + t * self.direction_spread[k];
            moved - self.direction * (moved.dot(normal) / across)
        })
    }

    /// The unit direction in single precision.
    pub fn direction_f32(&self) -> Vec3 {
        self.direction.as_vec3().normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(projection: Projection) -> Camera {
        let [position, target] = [DVec3::new(0.3, 1.0, 0.5), DVec3::new(0.1, 0.0, -0.2)];
        Camera::look_at(position, target, DVec3::Y, projection, [40, 20]).unwrap()
    }

    #[test]
    fn the_centre_of_the_film_looks_at_the_target_and_rows_run_down() {
        for projection in [Projection::Perspective { tan_half_fov: 0.5 }, Projection::Orthographic { width: 0.4 }] {
            let camera = camera(projection);
            let ray = camera.ray(20.0, 10.0);
            let to_target = (DVec3::new(0.1, 0.0, -0.2) - ray.origin).normalize();
            assert!((ray.direction - to_target).length() < 1e-12);
            let upper = camera.ray(20.0, 0.0);
            assert!((upper.origin + upper.direction).y > (ray.origin + ray.direction).y);
        }
        let edge = camera(Projection::Perspective { tan_half_fov: 0.5 }).ray(20.0, 0.0);
        let centre = camera(Projection::Perspective { tan_half_fov: 0.5 }).ray(20.0, 10.0);
        assert!((edge.direction.angle_between(centre.direction).tan() - 0.5).abs() < 1e-12);
    }

    #[test]
    fn footprints_are_the_differences_of_neighbouring_rays() {
        let normal = DVec3::new(0.2, 1.0, -0.1).normalize();
        let meets = |ray: CameraRay| ray.origin + ray.direction * (-ray.origin.dot(normal) / ray.direction.dot(normal));
        for projection in [Projection::Perspective { tan_half_fov: 0.5 }, Projection::Orthographic { width: 0.4 }] {
            let camera = camera(projection);
            let ray = camera.ray(12.0, 7.0);
            let t = -ray.origin.dot(normal) / ray.direction.dot(normal);
            let footprint = ray.footprint(t, normal);
            let h = 1e-5;
            for (spread, step) in footprint.into_iter().zip([[h, 0.0], [0.0, h]]) {
                let ahead = meets(camera.ray(12.0 + step[0], 7.0 + step[1]));
                let behind = meets(camera.ray(12.0 - step[0], 7.0 - step[1]));
                let difference = (ahead - behind) / (2.0 * h);
                assert!((difference - spread).length() < 1e-7 * spread.length(), "{difference} {spread}");
            }
        }
    }

    #[test]
    fn a_camera_without_a_view_is_refused() {
        let projection = Projection::Orthographic { width: 1.0 };
        assert!(Camera::look_at(DVec3::Y, DVec3::Y, DVec3::Z, projection, [1, 1]).is_none());
        assert!(Camera::look_at(DVec3::Y, DVec3::ZERO, DVec3::Y, projection, [1, 1]).is_none());
    }
}
