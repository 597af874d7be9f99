//! Relative mean square error without noise, and the error of the image's mean, of every model.

use farfield::build::ModelData;
use farfield::report::metrics::{Halves, mean_error, relative_mse};
use farfield::transport::camera::Camera;
use farfield::transport::light::{DirectionalLight, ImageLight, Light, Lights};
use farfield::transport::scene::{Lod, Scene};
use glam::Vec3;

use super::subjects::{GGX_01, GGX_03, Subject, area_light, halves, parallel};

const TILES: [u32; 2] = [100, 100];
const PIXELS: usize = 32;
const SAMPLES: u32 = 128;
/// Source texels a pixel: all of the tiles in an image of 512².
const DISTANCES: [f64; 1] = [200.0];

fn lights(width: f64) -> [(&'static str, Lights); 3] {
    let sky = |k: usize| {
        let polar = (k / 64) as f32 / 32.0 * std::f32::consts::PI;
        let azimuth = (k % 64) as f32 / 64.0 * std::f32::consts::TAU;
        let key = (30.0 * (polar.sin() * (azimuth - 1.0).cos() * 0.7 + polar.cos() * 0.7 - 1.0)).exp();
        if k < 64 * 16 { [0.3 + 8.0 * key; 3] } else { [0.0; 3] }
    };
    let image = ImageLight::new((0..64 * 32).map(sky).collect(), [64, 32], 1.0, 0.0);
    let grazing = DirectionalLight { direction: Vec3::new(-0.8, 0.27, 0.53).normalize(), irradiance: [4.0; 3] };
    [
        ("area", area_light(width)),
        ("image", Lights::new(vec![Light::Image(image)])),
        ("grazing", Lights::new(vec![Light::Directional(grazing)])),
    ]
}

fn scene<'a>(data: &'a ModelData, camera: Camera, lights: &Lights) -> Scene<'a> {
    Scene { camera, lights: lights.clone(), surface: data.object(TILES, None) }
}

/// Prints the table, of the maps that are named or of all; without baselines where the word `farfield` is among them.
pub(crate) fn run(words: &[String]) {
    let is_named = |name: &str| words.iter().any(|word| word == name);
    let all = !["twill", "silk"].iter().any(|map| is_named(map));
    let count = if is_named("farfield") { 1 } else { 4 };
    println!(
        "bias: {PIXELS}² pixels, 2 × {SAMPLES} samples; tiled 100²; relative MSE without noise (± its standard error), error of the mean in %"
    );
    println!(
        "| map | base | level | view | light | φ | farfield | lobes | leadr | naive | /leadr | /naive | mean: farfield | lobes | leadr | naive |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    for (map, base, bsdf) in [
        ("twill", "GGX 0.3", GGX_03),
        ("twill", "GGX 0.1", GGX_01),
        ("silk", "GGX 0.3", GGX_03),
        ("silk", "GGX 0.1", GGX_01),
    ] {
        if !all && !is_named(map) {
            continue;
        }
        let subject = Subject::new(map, bsdf, &[8, 16]);
        let full = subject.full();
        let models = subject.models();
        for (place, factor) in [8, 16].into_iter().enumerate() {
            for degrees in [0.0, 45.0, 80.0] {
                for distance in DISTANCES {
                    let camera = parallel(degrees, distance, PIXELS);
                    let width = PIXELS as f64 * distance * super::subjects::TEXEL;
                    for (light, lights) in lights(width) {
                        let reference = halves(&scene(&full, camera, &lights), Lod::Fixed(0), 1, SAMPLES);
                        let reference = Halves::new(&reference[0], &reference[1]);
                        let results: Vec<_> = models[..count]
                            .iter()
                            .enumerate()
                            .map(|(k, (_, data))| {
                                let image =
                                    halves(&scene(data, camera, &lights), Lod::Fixed(place), 10 + k as u64, SAMPLES);
                                let image = Halves::new(&image[0], &image[1]);
                                (relative_mse(reference, image).unwrap().bias, mean_error(reference, image).unwrap())
                            })
                            .collect();
                        let bias: Vec<String> = results
                            .iter()
                            .map(|(bias, _)| format!("{:.2e} ± {:.0e}", bias.value, bias.standard_error()))
                            .collect();
                        let means: Vec<String> = results
                            .iter()
                            .map(|(_, mean)| {
                                format!("{:+.2} ± {:.2}", 100.0 * mean.value, 100.0 * mean.standard_error())
                            })
                            .collect();
                        let over = |k: usize| {
                            results
                                .get(k)
                                .map_or(String::new(), |model| format!("{:.3}", results[0].0.value / model.0.value))
                        };
                        println!(
                            "| {map} | {base} | {factor} | {degrees} | {light} | {distance} | {} | {} | {} | {} |",
                            bias.join(" | "),
                            over(2),
                            over(3),
                            means.join(" | ")
                        );
                    }
                }
            }
        }
    }
}
