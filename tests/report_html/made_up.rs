//! A verification that nobody rendered: a weave drawn by formula, four stand-ins for it, noise. Its figures are computed
//! from these pictures as real ones are.

use std::io::Cursor;

use farfield::math::rng::Stream;
use farfield::report::equal_time::{EqualTime, EqualTimePoint, LevelTiming};
use farfield::report::flip::{Flip, PIXELS_PER_DEGREE, exposure, flip};
use farfield::report::html::Drawn;
use farfield::report::metrics::Halves;
use farfield::report::summary::summaries;
use farfield::report::verification::{
    AssetVerification, Case, Cost, LevelVerification, Light, LightSetting, Model, ModelResult, SCHEMA, Settings,
    SourceFile, Verification, View, ViewSetting,
};
use farfield::report::{CaseKey, CasePictures, Pictures};
use formats::asset::Figure;

type Image = Vec<[f32; 3]>;

/// Levels of the asset.
const FACTORS: [f64; 2] = [8.0, 16.0];
/// Pictures of the page: original, and three of each model, in every case.
pub(crate) const PICTURES: usize = FACTORS.len() * Light::ALL.len() * View::ALL.len() * (1 + 3 * Model::ALL.len());

const SAMPLES: u32 = 64;
const REFERENCE_SAMPLES: u32 = 1024;

/// How a model goes wrong.
struct Fault {
    /// Factor on radiance, at normal and at grazing view.
    gain: [f32; 2],
    /// Contrast of the weave against that of the original.
    contrast: f32,
    /// Noise of a sample.
    noise: f32,
}

fn fault(model: Option<Model>) -> Fault {
    match model {
        None => Fault { gain: [1.0, 1.0], contrast: 1.0, noise: 0.8 },
        Some(Model::Farfield) => Fault { gain: [0.988, 0.968], contrast: 0.9, noise: 0.35 },
        Some(Model::Lobes) => Fault { gain: [1.06, 0.82], contrast: 0.8, noise: 0.35 },
        Some(Model::Leadr) => Fault { gain: [0.91, 1.17], contrast: 0.6, noise: 0.3 },
        Some(Model::Naive) => Fault { gain: [1.42, 0.55], contrast: 1.7, noise: 0.5 },
    }
}

/// Radiance of the weave at a point of the picture, its contrast changed.
fn weave(light: Light, view: View, [x, y]: [f32; 2], contrast: f32) -> [f32; 3] {
    let tilt = (view.degrees() as f32).to_radians();
    let depth = (y - 0.5) / (0.35 + 0.65 * tilt.cos());
    let [u, v] = [14.0 * (x - 0.5) * (1.0 + 0.4 * tilt.sin() * (y - 0.5)), 14.0 * depth];
    let thread = (u + v).sin() * 0.35 + (3.0 * (u - v)).sin() * 0.2;
    let broad = match light {
        Light::Area => 0.9 - 0.8 * ((x - 0.4).powi(2) + (y - 0.45).powi(2)),
        Light::Image => 0.7 + 0.25 * (4.0 * x + 1.0).sin(),
        Light::Grazing => 0.35 + 0.5 * x,
    };
    let glint = (0.5 + thread).max(0.0).powi(if light == Light::Grazing { 5 } else { 2 });
    let shade = broad * (1.0 + contrast * (glint - 0.45));
    [0.85, 0.55, 0.35].map(|k| k * shade.max(0.02))
}

/// A half of an image with `samples` a pixel.
fn half(light: Light, view: View, model: Option<Model>, size: [u32; 2], samples: u32, stream: u64) -> Image {
    let fault = fault(model);
    let grazing = (view.degrees() / 80.0) as f32;
    let gain = fault.gain[0] + (fault.gain[1] - fault.gain[0]) * grazing * grazing;
    let stream = Stream::new(5, stream);
    let deviation = fault.noise / (samples as f32).sqrt();
    let pixel = |i: u32| {
        let place = [(i % size[0]) as f32 / size[0] as f32, (i / size[0]) as f32 / size[1] as f32];
        let colour = weave(light, view, place, fault.contrast);
        // Four uniforms make a bell of deviation 1/√3.
        let bell = (0..4).map(|k| stream.uniform(u64::from(4 * i + k))).sum::<f32>() - 2.0;
        colour.map(|c| gain * c * (1.0 + deviation * 3f32.sqrt() * bell))
    };
    (0..size[0] * size[1]).map(pixel).collect()
}

/// PNG of linear RGB times a factor.
fn png(pixels: &[[f32; 3]], factor: f32, size: [u32; 2]) -> Vec<u8> {
    let code = |linear: f32| {
        let linear = (linear * factor).clamp(0.0, 1.0);
        let coded = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
        (coded * 255.0).round() as u8
    };
    let bytes = pixels.iter().flat_map(|c| c.map(code)).collect();
    let image = image::RgbImage::from_raw(size[0], size[1], bytes).unwrap();
    let mut out = Cursor::new(Vec::new());
    image.write_to(&mut out, image::ImageFormat::Png).unwrap();
    out.into_inner()
}

/// A case's figures and pictures; `level` shifts the random numbers.
fn case(light: Light, view: View, level: u64, size: [u32; 2], speed: f64) -> (Case, CasePictures) {
    let stream = level * 1000 + light as u64 * 100 + view as u64 * 20;
    let reference = [0, 1].map(|k| half(light, view, None, size, REFERENCE_SAMPLES, stream + k));
    let reference = Halves::new(&reference[0], &reference[1]);
    let picture = reference.image();
    let exposure = exposure(&picture);
    let mut drawn: Vec<(Model, Image, Flip)> = Vec::new();
    let mut models = Vec::new();
    for (i, model) in Model::ALL.into_iter().enumerate() {
        let images = [2, 3].map(|k| half(light, view, Some(model), size, SAMPLES, stream + k + 2 * i as u64));
        let image = Halves::new(&images[0], &images[1]);
        let seen = flip(&picture, &image.image(), size, exposure);
        let timing = Cost { cpu_seconds: speed * (1.1 + 0.2 * i as f64) };
        models.push(ModelResult::measured(model, SAMPLES, [reference, image], seen.mean, timing));
        drawn.push((model, image.image(), seen));
    }
    let drawn: Vec<Drawn> = drawn.iter().map(|(model, image, flip)| Drawn { model: *model, image, flip }).collect();
    let pictures = CasePictures::draw(&picture, &drawn, exposure, |rgb, factor| png(rgb, factor, size));
    let case = Case {
        light,
        view,
        footprint_texels: 8.0 / view.degrees().to_radians().cos().sqrt(),
        reference_mean: reference.mean(),
        reference_noise: reference.relative_noise(),
        exposure: f64::from(exposure),
        models,
        timing: Cost { cpu_seconds: 41.5 * speed },
    };
    (case, pictures)
}

/// Curves of 1/n noise, and a bias in the level's.
fn equal_time(light: Light, view: View, factor: f64, speed: f64) -> EqualTime {
    let counts = [4, 8, 16, 32, 64, 128, 256, 512, 1024];
    let point = |samples: u32| {
        let wobble = 1.0 + 0.05 * (f64::from(samples) + factor).sin();
        let noise = 2.4 / f64::from(samples) * wobble;
        EqualTimePoint { samples, mse_full: noise, mse_farfield: 0.19 * noise + 4e-5 * factor }
    };
    let full: Vec<f64> = counts.iter().map(|&n| speed * (0.02 + 0.011 * f64::from(n))).collect();
    let farfield = full.iter().map(|t| 1.3 * t).collect();
    EqualTime::timed((light, view), 8.0 * factor, 8192, counts.map(point).to_vec(), [full, farfield])
}

fn level(index: usize, size: [u32; 2], speed: f64, pictures: &mut Pictures) -> LevelVerification {
    let pairs = Light::ALL.into_iter().flat_map(|light| View::ALL.map(|view| (light, view)));
    let mut cases = Vec::new();
    for (light, view) in pairs {
        let (figures, drawn) = case(light, view, index as u64, size, speed);
        pictures.insert(CaseKey { asset: "twill".into(), level: index as u32, light, view }, drawn);
        cases.push(figures);
    }
    let factor = FACTORS[index - 1];
    let equal_time = vec![
        equal_time(Light::Area, View::Oblique, factor, speed),
        equal_time(Light::Image, View::Normal, 2.0 * factor, speed),
        equal_time(Light::Grazing, View::Oblique, 4.0 * factor, speed),
    ];
    LevelVerification {
        index: index as u32,
        factor: [factor; 2],
        cells: [(1024.0 / factor) as usize; 2],
        epsilon_below_75: Some(Figure { value: 0.0147, standard_error: 0.0014 }),
        summary: summaries(&cases),
        timing: LevelTiming::of(&equal_time),
        cases,
        equal_time,
    }
}

/// Two levels of one asset under all lights and views; times are `speed` times as long.
pub(crate) fn verification(size: [u32; 2], speed: f64) -> (Verification, Pictures) {
    let mut pictures = Pictures::default();
    let levels = (1..=FACTORS.len()).map(|index| level(index, size, speed, &mut pictures)).collect();
    let asset = AssetVerification {
        name: "twill".into(),
        asset_digest: "8f1d".repeat(16),
        light: "direct".into(),
        surface_settings: serde_json::json!({
            "amplitude": 0.0004, "boundary": "repeat", "bsdf": { "type": "conductor", "roughness": 0.3 }, "height": "twill.exr",
        }),
        sources: vec![SourceFile { role: "height".into(), digest: "03ac".repeat(16), size: [1024, 1024] }],
        levels,
    };
    let verification = Verification {
        schema: SCHEMA,
        farfield_version: "0.1.0".into(),
        settings: settings(size),
        assets: vec![asset],
        timing: Cost { cpu_seconds: 412.7 * speed },
    };
    (verification, pictures)
}

fn settings(image_size: [u32; 2]) -> Settings {
    let lights =
        ["3 × 3 m, 2 m above the plane, radiance 4", "sky.hdr, sun at 40°", "10° above the horizon, irradiance π"];
    let views = Light::ALL.into_iter().zip(lights);
    Settings {
        image_size,
        samples_per_half: SAMPLES,
        reference_samples_per_half: REFERENCE_SAMPLES,
        seed: 0,
        levels: None,
        lights: views.map(|(light, text)| LightSetting { light, description: text.into() }).collect(),
        views: View::ALL
            .into_iter()
            .map(|view| ViewSetting {
                view, description: format!("orthographic, {}° from the normal", view.degrees())
            })
            .collect(),
        flip_pixels_per_degree: f64::from(PIXELS_PER_DEGREE),
    }
}
