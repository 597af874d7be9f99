//! Views and lights of training and of validation. The tests of `verify` know neither.

use glam::Vec3;

use crate::transport::volume::means::{SmoothLight, View};

/// Cosine of the angle from a free axis within which a medium that repeats is seen: 75°.
const COS_STEEPEST: f32 = 0.258_819_05;

/// The views that weights are fitted to: 6 along the axes and 8 over the corners, or as many on both sides of a cloth.
pub fn training_views(repeat: &[bool; 3]) -> Vec<View> {
    let Some(free) = sides_of_cloth(repeat) else {
        let axes = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().flat_map(|axis| [axis, -axis]);
        let corner = |k: i32| Vec3::from_array([0, 1, 2].map(|a| if k >> a & 1 == 0 { 1.0 } else { -1.0 })).normalize();
        return visible(axes.chain((0..8).map(corner)), repeat);
    };
    // One from above and three each at 35° and at 65°, between each other in azimuth.
    around(free, &[(0.0, 1, 0.0), (35.0, 3, 0.0), (65.0, 3, 60.0)])
}

/// Other views, to judge a fit by.
pub fn validation_views(repeat: &[bool; 3]) -> Vec<View> {
    let Some(free) = sides_of_cloth(repeat) else {
        // Edges of the cube, turned off its symmetry.
        let views = [[0.9, 0.6, 0.1], [-0.2, 0.8, 0.7], [0.7, -0.3, 0.8], [-0.8, -0.7, 0.2]].map(Vec3::from);
        return visible(views.into_iter().flat_map(|v| [v.normalize(), -v.normalize()]), repeat);
    };
    around(free, &[(20.0, 2, 25.0), (52.0, 2, 115.0)])
}

/// Light from everywhere, and light that grows along each axis: bands 0 and 1, none of them negative.
pub fn training_lights() -> [SmoothLight; 4] {
    [SmoothLight::ONE, SmoothLight::tilted(Vec3::X), SmoothLight::tilted(Vec3::Y), SmoothLight::tilted(Vec3::Z)]
}

/// Broad lobes from the corners of a tetrahedron: light with a direction, which training lights hardly have.
pub fn validation_lights() -> [SmoothLight; 4] {
    [[1.0, 0.9, 1.1], [-1.0, -1.1, 0.8], [-0.9, 1.0, -1.2], [1.1, -0.8, -1.0]]
        .map(|axis| SmoothLight::lobe(Vec3::from(axis).normalize(), 4))
}

/// The axis across a cloth: the one that does not repeat, if the others do.
fn sides_of_cloth(repeat: &[bool; 3]) -> Option<usize> {
    let free: Vec<usize> = (0..3).filter(|&k| !repeat[k]).collect();
    match free[..] {
        [axis] => Some(axis),
        _ => None,
    }
}

/// Views on both sides of the plane across `axis`: (degrees from the axis, how many, azimuth of the first).
fn around(axis: usize, rings: &[(f32, usize, f32)]) -> Vec<View> {
    let mut views = Vec::new();
    for side in [1.0, -1.0] {
        for &(polar, count, first) in rings {
            let (sin, cos) = polar.to_radians().sin_cos();
            for k in 0..count {
                let azimuth =
                    (first + 360.0 * k as f32 / count as f32 + if side < 0.0 { 30.0 } else { 0.0 }).to_radians();
                let mut view = Vec3::ZERO;
                view[axis] = side * cos;
                view[(axis + 1) % 3] = sin * azimuth.cos();
                view[(axis + 2) % 3] = sin * azimuth.sin();
                views.push(view);
            }
        }
    }
    views
}

/// The views within 75° of an axis that does not repeat.
fn visible(views: impl Iterator<Item = Vec3>, repeat: &[bool; 3]) -> Vec<View> {
    let is_seen = |view: &Vec3| (0..3).any(|k| !repeat[k] && view[k].abs() >= COS_STEEPEST);
    views.filter(is_seen).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn training_and_validation_share_no_view_and_clothes_are_seen_from_both_sides() {
        for repeat in [[false; 3], [true, true, false], [false, true, true], [true, false, false]] {
            let [training, validation] = [training_views(&repeat), validation_views(&repeat)];
            assert!(training.len() >= 12 && validation.len() >= 8, "{repeat:?}");
            for view in training.iter().chain(&validation) {
                assert!((view.length() - 1.0).abs() < 1e-6);
                assert!((0..3).any(|k| !repeat[k] && view[k].abs() >= COS_STEEPEST - 1e-6));
            }
            let nearest = |a: &Vec3| training.iter().map(|b| a.dot(*b)).fold(-1.0, f32::max);
            assert!(validation.iter().map(nearest).all(|cosine| cosine < 0.995), "{repeat:?}");
        }
    }
}
