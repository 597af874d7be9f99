//! An orthonormal frame around a normal.

use glam::Vec3;

/// A right-handed orthonormal frame; local z is the normal.
///
/// Where x and y point is a function of the normal alone, without a meaning: only isotropic things may live in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Local x in the outer frame, unit.
    pub x: Vec3,
    /// Local y in the outer frame, unit.
    pub y: Vec3,
    /// Local z in the outer frame, unit.
    pub z: Vec3,
}

impl Frame {
    /// The frame around `normal`, unit.
    ///
    /// Duff et al., Building an Orthonormal Basis, Revisited (2017), as glam has it: no branch but a sign, exact at ±z.
    #[inline]
    pub fn around(normal: Vec3) -> Self {
        let (x, y) = normal.any_orthonormal_pair();
        Self { x, y, z: normal }
    }

    /// A vector of the outer frame in local coordinates.
    #[inline]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.x.dot(v), self.y.dot(v), self.z.dot(v))
    }

    /// A local vector in the outer frame.
    #[inline]
    pub fn to_outer(&self, v: Vec3) -> Vec3 {
        v.x * self.x + v.y * self.y + v.z * self.z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Stream;
    use crate::math::warp;

    #[test]
    fn frames_are_orthonormal_right_handed_and_take_vectors_there_and_back() {
        let rng = Stream::new(1, 0);
        let axes = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::Z, Vec3::new(1e-4, 0.0, -1.0).normalize()];
        let random = (0..1000).map(|k| warp::sphere(rng.uniform_pair(k)));
        for (k, normal) in axes.into_iter().chain(random).enumerate() {
            let frame = Frame::around(normal);
            // A few units in the last place of 1.
            let close = |a: Vec3, b: Vec3| (a - b).abs().max_element() < 1e-6;
            assert!(close(frame.x.cross(frame.y), normal) && (frame.x.length() - 1.0).abs() < 1e-6, "{normal}");
            assert!(frame.x.dot(frame.y).abs() < 1e-6 && frame.x.dot(normal).abs() < 1e-6, "{normal}");
            let v = warp::sphere(rng.uniform_pair(5000 + k as u64));
            assert!(close(frame.to_outer(frame.to_local(v)), v), "{normal}");
            assert!(close(frame.to_local(normal), Vec3::Z), "{normal}");
        }
    }
}
