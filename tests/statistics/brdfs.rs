//! Samplers of base BRDFs.

use farfield::material::{Brdf, Conductor};
use farfield::math::frame::Frame;
use farfield::math::rng::Stream;
use farfield::transport::Accumulator;
use glam::Vec3;

use crate::budget;
use crate::chi_square::{Bins, expect_samples_match_pdf, uniform};

/// A normal without zeros.
const NORMAL: Vec3 = Vec3::new(0.36, -0.48, 0.8);

/// Polar angles of the viewer, degrees.
const VIEWS: [f32; 4] = [0.0, 45.0, 80.0, 89.0];

/// Samples of an estimate.
const SAMPLES: u64 = 100_000;

fn cases() -> Vec<Brdf> {
    let f0 = [0.9, 0.5, 0.04];
    let conductor = |specular| Brdf { diffuse: [0.0; 3], specular: Some(specular) };
    let alphas = [0.02, 0.1, 0.3, 1.0];
    let mut cases = vec![Brdf { diffuse: [0.8, 0.3, 0.0], specular: None }];
    cases.extend(alphas.map(|alpha| conductor(Conductor::ggx(alpha, f0))));
    cases.extend(alphas.map(|alpha| conductor(Conductor::beckmann(alpha, f0))));
    // Equal parts, little gloss, no reflectance at normal incidence, little diffuse.
    cases.push(Brdf { diffuse: [0.5; 3], specular: Some(Conductor::ggx(0.3, [0.5; 3])) });
    cases.push(Brdf { diffuse: [0.8, 0.3, 0.0], specular: Some(Conductor::beckmann(0.1, [0.04; 3])) });
    cases.push(Brdf { diffuse: [0.2; 3], specular: Some(Conductor::ggx(1.0, [0.0; 3])) });
    cases.push(Brdf { diffuse: [0.01; 3], specular: Some(Conductor::beckmann(0.02, f0)) });
    cases
}

/// Chi-square and one estimate a case and view.
pub(crate) fn test_count() -> usize {
    2 * cases().len() * VIEWS.len()
}

/// Viewers around [`NORMAL`].
fn viewers() -> [Vec3; 4] {
    VIEWS.map(|degrees| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Frame::around(NORMAL).to_outer(Vec3::new(0.8 * sin, -0.6 * sin, cos))
    })
}

fn for_each_case(mut check: impl FnMut(&str, &Brdf, Vec3)) {
    for brdf in cases() {
        for (degrees, wo) in VIEWS.into_iter().zip(viewers()) {
            check(&format!("{brdf:?} from {degrees}°"), &brdf, wo);
        }
    }
}

#[test]
fn samples_of_base_brdfs_follow_their_density() {
    for_each_case(|name, brdf, wo| {
        let sample = |u| brdf.sample(NORMAL, wo, u).map(|s| s.wi);
        expect_samples_match_pdf(name, NORMAL, sample, |wi| brdf.pdf(NORMAL, wi, wo));
    });
}

#[test]
fn weighted_samples_have_the_albedo_for_their_mean_and_bounded_weights() {
    for_each_case(|name, brdf, wo| {
        let bins = Bins::new(NORMAL, 3, |u| brdf.sample(NORMAL, wo, u).map(|s| s.wi));
        let albedo = bins.integral(|wi| f64::from(brdf.eval(NORMAL, wi, wo)[0] * NORMAL.dot(wi)));
        let mut sum = Accumulator::default();
        let rng = Stream::new(4, 0);
        for k in 0..SAMPLES {
            let sample = brdf.sample(NORMAL, wo, uniform(rng, k));
            let weight = sample.map_or(0.0, |s| f64::from(s.value[0] * NORMAL.dot(s.wi) / s.pdf));
            // Each part's own weight is at most 1, its share a tenth or more.
            assert!(weight <= 10.0, "{name}: a weight of {weight}");
            sum.add(weight);
        }
        let estimate = sum.estimate();
        // A weight that never varies (diffuse) leaves rounding of f32; quadrature is good to 5e-5.
        let error = (estimate.mean - albedo).abs() - 5e-5;
        let p = if error <= 0.0 { 1.0 } else { budget::two_sided(error / estimate.standard_error()) };
        assert!(p > budget::threshold(), "{name}: {estimate:?} is {albedo}");
    });
}

#[test]
fn pdf_and_value_of_a_sample_are_those_of_its_direction() {
    for_each_case(|name, brdf, wo| {
        let rng = Stream::new(5, 0);
        for s in (0..1000).filter_map(|k| brdf.sample(NORMAL, wo, uniform(rng, k))) {
            assert_eq!((s.pdf, s.value), (brdf.pdf(NORMAL, s.wi, wo), brdf.eval(NORMAL, s.wi, wo)), "{name}");
            assert!(s.pdf > 0.0 && s.pdf.is_finite() && NORMAL.dot(s.wi) > 0.0, "{name}: {s:?}");
            assert!((s.wi.length() - 1.0).abs() < 1e-5, "{name}: {s:?}");
        }
    });
}

#[test]
fn nothing_is_sampled_from_below_nor_from_black() {
    let u = [0.3, 0.6, 0.1];
    for brdf in cases() {
        assert_eq!(brdf.sample(NORMAL, -NORMAL, u), None);
        assert_eq!(brdf.pdf(NORMAL, NORMAL, -NORMAL), 0.0);
        assert_eq!(brdf.pdf(NORMAL, -NORMAL, NORMAL), 0.0);
    }
    let black = Brdf { diffuse: [0.0; 3], specular: None };
    assert_eq!(black.sample(NORMAL, NORMAL, u), None);
    assert_eq!(black.pdf(NORMAL, NORMAL, NORMAL), 0.0);
}

#[test]
fn corners_of_the_unit_cube_give_finite_samples() {
    let below_one = 1.0 - f32::EPSILON / 2.0;
    let corners = [0.0, 1e-7, 0.5, below_one];
    for_each_case(|name, brdf, wo| {
        for k in 0..64 {
            let u = [k % 4, k / 4 % 4, k / 16].map(|i| corners[i]);
            let Some(s) = brdf.sample(NORMAL, wo, u) else { continue };
            let finite = s.wi.is_finite() && s.pdf.is_finite() && s.value.iter().all(|f| f.is_finite());
            assert!(finite && s.pdf > 0.0, "{name}, {u:?}: {s:?}");
        }
    });
}
