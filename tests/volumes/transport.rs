//! Flights, furnaces and reciprocity.

use farfield::math::rng::{Draws, Stream};
use farfield::math::warp;
use farfield::medium::{Flight, Medium};
use farfield::transport::Accumulator;
use farfield::transport::camera::{Camera, Projection};
use farfield::transport::film::Film;
use farfield::transport::light::{ConstantLight, DirectionalLight, Light, Lights, ShLight};
use farfield::transport::render::{Integrator, RenderSettings};
use farfield::transport::sampler::Sampling;
use farfield::transport::scene::Lod;
use farfield::transport::volume::render::render;
use farfield::transport::volume::{Backdrop, VolumeLevel, VolumeObject, VolumeScene};
use glam::{DVec3, Vec3};

use crate::scenes::{VOXEL, crossed, slab, tangle};

/// Deviations of an estimate that are a fault: with some 200 of them in this file a chance of 1e-3 in all.
const DEVIATIONS: f64 = 4.6;

const WHITE: [[f32; 3]; 2] = [[1.0; 3]; 2];

/// An estimate from one of the tests' media and its expectation.
fn expect_mean(name: &str, samples: impl Iterator<Item = f64>, expected: f64) {
    let mut sum = Accumulator::default();
    samples.for_each(|sample| sum.add(sample));
    let estimate = sum.estimate();
    // f32 flights: a rounding of 1e-6 beside the noise
    let off = (estimate.mean - expected).abs() - 2e-6;
    assert!(off <= DEVIATIONS * estimate.standard_error(), "{name}: {estimate:?}, wanted {expected}");
}

#[test]
fn a_slab_lets_through_what_its_closed_form_says() {
    let density = 0.21 / VOXEL as f32;
    for layers in [1, 7] {
        let lobes = crossed(WHITE);
        let medium = slab(layers, density, &lobes);
        for k in 0..6 {
            let direction = warp::sphere(Stream::new(1, 0).uniform_pair(k));
            let length = layers as f64 * VOXEL / f64::from(direction.z).abs();
            let sigma_t = density * formats::sggx::projected_area(&lobes, direction.to_array());
            let expected = (-f64::from(sigma_t) * length).exp();
            let start = DVec3::new(0.4, 0.3, if direction.z > 0.0 { -1.0 } else { 1.0 });
            let (place, _) = medium.enter(start, direction.as_dvec3()).unwrap();
            let draws = |sample: u64| Draws::new(Stream::new(2 + k, sample));
            let name = format!("{layers} layers along {direction}");
            for fly in [Medium::fly, Medium::fly_by_majorant] {
                let escapes = (0..20_000).map(|sample| {
                    let flight = fly(&medium, place, direction, &mut draws(sample));
                    if flight == Flight::Escape { 1.0 } else { 0.0 }
                });
                expect_mean(&name, escapes, expected);
            }
            let ratios = (0..20_000).map(|sample| {
                f64::from(medium.transmittance_by_majorant(place, direction, f64::INFINITY, &mut draws(sample)))
            });
            expect_mean(&name, ratios, expected);
            let half = (0..20_000).map(|sample| {
                f64::from(medium.transmittance_by_majorant(place, direction, 0.5 * length, &mut draws(sample)))
            });
            expect_mean(&name, half, expected.sqrt());
        }
    }
}

/// The optical depth along a ray, by small steps through the voxels: what tracking must agree with.
fn depth_by_steps(medium: &Medium, origin: DVec3, direction: Vec3) -> f64 {
    let step = 0.01 * VOXEL;
    let size = medium.shape().size;
    let steps = (4.0 * size.iter().sum::<usize>() as f64 * VOXEL / step) as usize;
    let at = |k: usize| origin + direction.as_dvec3() * (step * (k as f64 + 0.5));
    let inside =
        (0..steps).map(|k| (at(k) / VOXEL).floor()).filter(|p| (0..3).all(|k| p[k] >= 0.0 && p[k] < size[k] as f64));
    let sigma_t = |index: usize| {
        let voxel = medium.voxel(index);
        f64::from(voxel.density * formats::sggx::projected_area(voxel.lobes(), direction.to_array()))
    };
    inside.filter_map(|p| medium.voxel_index(p.to_array().map(|x| x as usize))).map(sigma_t).sum::<f64>() * step
}

#[test]
fn tracking_through_a_tangle_agrees_with_small_steps() {
    let medium = tangle([13, 9, 6], [1.0; 3]);
    let global = medium.with_global_majorant();
    let middle = DVec3::from_array(medium.shape().extent()) * 0.5;
    for k in 0..5 {
        let direction = warp::sphere(Stream::new(3, 0).uniform_pair(k));
        let origin = middle - direction.as_dvec3() * 30.0 * VOXEL;
        let expected = (-depth_by_steps(&medium, origin, direction)).exp();
        let (place, _) = medium.enter(origin, direction.as_dvec3()).unwrap();
        let exact = f64::from(medium.transmittance(place, direction, f64::INFINITY));
        assert!((exact / expected - 1.0).abs() < 0.01, "{exact} {expected}");
        for medium in [&medium, &global] {
            let ratio = |sample| {
                let mut draws = Draws::new(Stream::new(4 + k, sample));
                f64::from(medium.transmittance_by_majorant(place, direction, f64::INFINITY, &mut draws))
            };
            // steps of a hundredth of a voxel: 1e-3 of the depth of a voxel that is met or missed
            let mut sum = Accumulator::default();
            (0..20_000).for_each(|sample| sum.add(ratio(sample)));
            let estimate = sum.estimate();
            let off = (estimate.mean - expected).abs() - 0.01 * expected;
            assert!(off < DEVIATIONS * estimate.standard_error(), "{estimate:?} {expected}");
        }
    }
}

fn scene<'a>(medium: &'a Medium, towards: DVec3, lights: Vec<Light>, pixels: usize) -> VolumeScene<'a> {
    // The camera's frame is the world's; a view from within the silhouette of the volume, 2 voxels wide.
    let projection = Projection::Orthographic { width: 2.0 * VOXEL };
    let camera = Camera::look_at(towards * 1e-2, DVec3::ZERO, DVec3::new(0.3, 0.5, 0.8), projection, [pixels; 2]);
    let volume = VolumeObject::new(vec![VolumeLevel { factor: 1.0, medium }], VOXEL);
    VolumeScene { camera: camera.unwrap(), lights: Lights::new(lights), volume, backdrop: Backdrop::Lights }
}

fn settings(integrator: Integrator) -> RenderSettings {
    RenderSettings { integrator, lod: Lod::Fixed(0), seed: 5, sampling: Sampling::Independent }
}

/// Mean and its standard error over the pixels, red.
fn image_mean(scene: &VolumeScene<'_>, integrator: Integrator, samples: u64) -> (f64, f64) {
    let mut film = Film::new(scene.camera.size());
    render(scene, &settings(integrator), 0..samples, &mut film);
    let count = film.radiance().len() as f64;
    let mean = film.radiance().iter().map(|p| f64::from(p[0])).sum::<f64>() / count;
    let variance = film.variance().iter().map(|p| f64::from(p[0])).sum::<f64>() / (count * count);
    (mean, variance.sqrt())
}

#[test]
fn a_white_volume_in_a_white_furnace_is_not_to_be_seen() {
    let constant = Light::Constant(ConstantLight { radiance: [1.0; 3] });
    let harmonic = Light::Sh(ShLight::new(vec![[(4.0 * std::f32::consts::PI).sqrt(); 3]]));
    let cases = [tangle([12, 12, 12], [1.0; 3]), slab(8, 0.6 / VOXEL as f32, &crossed(WHITE))];
    for medium in &cases {
        for light in [&constant, &harmonic] {
            for towards in [DVec3::new(0.36, 0.48, 0.8), DVec3::new(0.1, -0.9, 0.2).normalize()] {
                let scene = scene(medium, towards, vec![light.clone()], 8);
                let (mean, error) = image_mean(&scene, Integrator::Path, 600);
                assert!((mean - 1.0).abs() < 0.005 && error < 0.0025, "{mean} ± {error}");
            }
        }
    }
}

#[test]
fn light_scattered_once_in_a_slab_is_the_closed_form() {
    let albedos = [[0.9, 0.5, 0.2], [0.3, 0.6, 1.0]];
    let lobes = crossed(albedos);
    let density = 0.3 / VOXEL as f32;
    let (layers, thickness) = (5, 5.0 * VOXEL);
    let medium = slab(layers, density, &lobes);
    for k in 0..4 {
        let in_world = |d: Vec3| Vec3::new(d.x, d.z, -d.y);
        let [mut wo, mut wi] = [0, 1].map(|j| warp::sphere(Stream::new(6, k).uniform_pair(j)));
        [wo.z, wi.z] = [wo.z.abs() + 0.2, wi.z.abs() + 0.2];
        let [wo, wi] = [wo.normalize(), wi.normalize()];
        let light = DirectionalLight { direction: in_world(wi), irradiance: [2.0; 3] };
        let scene = scene(&medium, in_world(wo).as_dvec3(), vec![Light::Directional(light)], 4);
        let (mean, error) = image_mean(&scene, Integrator::Direct, 4000);
        // ∫ ρ·scattering·E·exp(−(σo/μo + σi/μi)·ρ·z) dz/μo
        let area = |w: Vec3| f64::from(formats::sggx::projected_area(&lobes, w.to_array()));
        let rate = f64::from(density) * (area(wo) / f64::from(wo.z) + area(wi) / f64::from(wi.z));
        let scattering = f64::from(formats::sggx::scattering(&lobes, wo.to_array(), wi.to_array())[0]);
        let expected = 2.0 * scattering * f64::from(density) / f64::from(wo.z) * -(-rate * thickness).exp_m1() / rate;
        assert!((mean - expected).abs() < DEVIATIONS * error && error < 0.03 * expected, "{mean} ± {error} {expected}");
    }
}

#[test]
fn viewer_and_sun_may_change_places() {
    // The whole of a volume: light from ωi seen from ωo, integrated over the silhouette, is symmetric.
    let medium = tangle([10, 8, 12], [0.9; 3]);
    let two = crossed([[0.9, 0.5, 0.2], [0.4, 0.9, 1.0]]);
    let mixed = slab(6, 0.5 / VOXEL as f32, &two);
    let [a, b] = [DVec3::new(0.36, 0.48, 0.8), DVec3::new(-0.48, 0.8, 0.36)];
    for (medium, is_slab) in [(&medium, false), (&mixed, true)] {
        let seen = |from: DVec3, sun: DVec3| {
            let light = DirectionalLight { direction: sun.as_vec3(), irradiance: [1.0; 3] };
            let mut scene = scene(medium, from, vec![Light::Directional(light)], 16);
            if !is_slab {
                let projection = Projection::Orthographic { width: 24.0 * VOXEL };
                scene.camera = Camera::look_at(from * 1e-2, DVec3::ZERO, DVec3::Y, projection, [16; 2]).unwrap();
            }
            let (mean, error) = image_mean(&scene, Integrator::Path, 1000);
            // what a slab shows is per area of the slab: y is its normal
            let area = if is_slab { from.y } else { 1.0 };
            (mean * area, error * area)
        };
        let ((there, e), (back, f)) = (seen(a, b), seen(b, a));
        assert!((there - back).abs() < DEVIATIONS * e.hypot(f) && e < 0.02 * there, "{there} ± {e}, {back} ± {f}");
    }
}

#[test]
fn no_direction_sees_more_light_than_there_is() {
    // Crossed fibres of unequal albedos: the albedo seen from any direction is a mean of the two.
    let lobes = crossed([[1.0, 0.2, 0.0], [0.1, 1.0, 0.0]]);
    let medium = slab(1, 1.0 / VOXEL as f32, &lobes);
    for k in 0..200 {
        let w = warp::sphere(Stream::new(7, 0).uniform_pair(k));
        let flakes = medium.flakes(0, w);
        for sample in 0..50 {
            let scatter = flakes.sample(Stream::new(8, k).uniform_pair(sample));
            assert!(scatter.weight[0] <= 1.0 && scatter.weight[1] <= 1.0 && scatter.weight[2] == 0.0, "{scatter:?}");
            let [eval, pdf] = [flakes.eval(scatter.wi)[0], flakes.pdf(scatter.wi)];
            // the same quotient by two roads, h anew from the rounded wi
            assert!((eval / pdf - scatter.weight[0]).abs() < 0.02, "{eval} {pdf} {scatter:?}");
        }
    }
}

#[test]
fn a_turned_medium_lets_through_as_much_along_the_turned_ray() {
    let lobes = crossed(WHITE);
    let turned = lobes.map(|lobe| {
        let [xx, yy, zz, xy, xz, yz] = lobe.shape.matrix();
        // x → y → z → x
        formats::sggx::FlakeLobe { shape: formats::sggx::Sggx::from_matrix([zz, xx, yy, xz, yz, xy]).unwrap(), ..lobe }
    });
    for k in 0..50 {
        let w = warp::sphere(Stream::new(10, 0).uniform_pair(2 * k));
        let wi = warp::sphere(Stream::new(10, 0).uniform_pair(2 * k + 1));
        let turn = |v: Vec3| [v.z, v.x, v.y];
        let before = formats::sggx::phase(&lobes, w.to_array(), wi.to_array())[0];
        let after = formats::sggx::phase(&turned, turn(w), turn(wi))[0];
        assert!((before - after).abs() < 1e-4 * before, "{before} {after}");
    }
}
