//! The same bits, whatever the threads and passes.

use farfield::transport::film::Film;
use farfield::transport::light::{ConstantLight, Light};
use farfield::transport::render::{Integrator, RenderSettings, render};
use farfield::transport::sampler::Sampling;

use super::scenes::{SETTINGS, camera, image, lambert, object, rough, scene};
use super::statistics::mean;

const SKY: Light = Light::Constant(ConstantLight { radiance: [1.0; 3] });

#[test]
fn threads_and_passes_change_no_bit() {
    let heights = rough();
    let settings = RenderSettings { integrator: Integrator::Path, sampling: Sampling::Sobol, ..SETTINGS };
    let scene = scene(object(&heights, lambert(0.8), 41), SKY, camera(0.7, 20.0, 9));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| image(&scene, &settings, 20))
    };
    let one = on(1);
    let mut passes = Film::new([9, 9]);
    render(&scene, &settings, 0..7, &mut passes);
    render(&scene, &settings, 7..20, &mut passes);
    for other in [on(2), on(5), passes] {
        assert_eq!(one.radiance(), other.radiance());
        assert_eq!(one.variance(), other.variance());
        assert_eq!(one.samples(), other.samples());
    }
}

#[test]
fn the_variance_of_an_image_is_that_of_its_repetitions() {
    let heights = rough();
    let scene = scene(object(&heights, lambert(0.8), 41), SKY, camera(0.7, 20.0, 4));
    for sampling in [Sampling::Independent, Sampling::Sobol] {
        let films: Vec<Film> =
            (0..200).map(|seed| image(&scene, &RenderSettings { seed, sampling, ..SETTINGS }, 32)).collect();
        let told: f64 = films.iter().map(|film| f64::from(film.variance()[5][1])).sum::<f64>() / 200.0;
        let values: Vec<f64> = films.iter().map(|film| f64::from(film.radiance()[5][1])).collect();
        let middle = values.iter().sum::<f64>() / 200.0;
        let seen = values.iter().map(|value| (value - middle).powi(2)).sum::<f64>() / 199.0;
        // the ratio of a variance from 200 values is within 1 ± 3.3·√(2/199)
        match sampling {
            Sampling::Independent => assert!((seen / told - 1.0).abs() < 0.33, "{seen} {told}"),
            Sampling::Sobol => assert!(seen < 0.8 * told, "{seen} {told}: an upper bound, and a better image"),
        }
        assert!(mean(&films[0]).0 > 0.1);
    }
}
