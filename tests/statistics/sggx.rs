//! Samplers of SGGX lobes and of flake mixtures.

use farfield::math::rng::Stream;
use farfield::math::{sggx, warp};
use formats::sggx::Sggx;
use glam::Vec3;

use crate::chi_square::expect_samples_match_pdf;

/// A fibre without zeros.
const AXIS: Vec3 = Vec3::new(0.36, -0.48, 0.8);

/// σ² along the axis.
const SQUARED_AREAS: [f32; 5] = [1e-4, 1e-3, 1e-2, 0.1, 1.0];

/// Viewers a lobe.
const VIEWS: u64 = 3;

/// Fibres along an axis, flakes across one, and no symmetry.
fn lobes() -> Vec<Sggx> {
    let fibres = SQUARED_AREAS.map(|area| Sggx::fibre(AXIS.to_array(), area.sqrt()));
    // λ = (a, a, 1): S = a + (1 − a) n nᵀ
    let flakes = SQUARED_AREAS.map(|a| {
        let [x, y, z] = AXIS.to_array();
        let s = |i: f32, j: f32, one: f32| a * one + (1.0 - a) * i * j;
        let matrix = [s(x, x, 1.0), s(y, y, 1.0), s(z, z, 1.0), s(x, y, 0.0), s(x, z, 0.0), s(y, z, 0.0)];
        Sggx::from_matrix(matrix).unwrap()
    });
    let uneven = Sggx::from_factor([0.7, 0.3, 0.2, -0.1, 0.05, 0.02]);
    fibres.into_iter().chain(flakes).chain([uneven]).collect()
}

/// Chi-square a lobe and view.
pub(crate) fn test_count() -> usize {
    lobes().len() * VIEWS as usize
}

#[test]
fn visible_normals_follow_their_density() {
    for lobe in lobes() {
        for view in 0..VIEWS {
            let w = warp::sphere(Stream::new(6, 0).uniform_pair(view));
            let sample = |u: [f32; 3]| Some(sggx::visible_normal(&lobe, w, [u[0], u[1]]));
            let pdf = |m: Vec3| sggx::visible_normal_pdf(&lobe, w, m);
            expect_samples_match_pdf(&format!("{lobe:?} from {w}"), w, sample, pdf);
        }
    }
}
