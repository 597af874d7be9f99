//! Levels in images: baked ones under direct light and global ones under all light, beside what they stand for.

mod support;

use farfield::build::key::Digest;
use farfield::build::{Input, ModelData};
use farfield::geometry::{Boundary, HeightField};
use farfield::prefilter::surface::{FineSurface, LevelSettings, LightTransport};
use farfield::transport::camera::{Camera, Projection};
use farfield::transport::film::Film;
use farfield::transport::light::{ConstantLight, DirectionalLight, Light, Lights};
use farfield::transport::render::{Integrator, RenderSettings, render};
use farfield::transport::sampler::Sampling;
use farfield::transport::scene::{Lod, Scene};
use formats::asset::{Light as AssetLight, SurfaceAsset};
use glam::{DVec3, Vec3};
use support::{at, compiled, crop, diffuse, fixture, ggx, measured, through_bytes, towards};

/// A corner of a fixture, 256² texels; its seams are steps, as the cliffs have them.
fn corner(name: &str, amplitude: f32) -> HeightField {
    crop(&fixture(name, amplitude), [256; 2], [1.0; 2], Boundary::Repeat)
}

/// The maps of the furnace, with their amplitudes in texels.
const MAPS: [(&str, f32); 6] = [
    ("heights/twill", 24.415),
    ("heights/fbm", 58.539),
    ("heights/bump", 28.0),
    ("heights/vgroove", 32.0),
    ("rocks/height", 35.9),
    ("heights/cliffs", 120.0),
];

/// The asset of one level at 8× that holds `light`.
fn level(fine: &FineSurface, light: LightTransport) -> SurfaceAsset {
    let mut asset = through_bytes(fine, compiled(fine, &LevelSettings { patches: Some(2), light, ..at(8.0) }));
    asset.light = match light {
        LightTransport::Direct => AssetLight::Direct,
        LightTransport::Baked => AssetLight::Baked,
        LightTransport::Global => AssetLight::Global,
    };
    asset
}

/// Where world and base frame part: x, height, −y.
fn world(w: Vec3) -> DVec3 {
    DVec3::new(f64::from(w.x), f64::from(w.z), f64::from(-w.y))
}

/// Mean radiance and its standard error of 80 × 80 tiles seen from `wo`, as the model of an asset of `kind` is drawn; the
/// film covers whole tiles.
fn seen(data: &ModelData, kind: AssetLight, light: &Light, wo: Vec3, samples: u64) -> [f64; 2] {
    let surface = data.object([80, 80], None);
    let extent = 256.0;
    let projection = Projection::Orthographic { width: 2.0 * extent };
    // 2 tiles across; along the view, cos θ shortens as many as make the film's height
    let rows = (64.0 * f64::from(wo.z)).round().max(1.0) as usize;
    let camera = Camera::look_at(world(wo) * 5000.0, DVec3::ZERO, DVec3::Y, projection, [64, rows]).expect("a view");
    let scene = Scene { camera, lights: Lights::new(vec![light.clone()]), surface };
    let settings = RenderSettings {
        integrator: data.integrator(kind),
        lod: Lod::Fixed(0),
        seed: 4,
        sampling: Sampling::Independent,
    };
    let mut film = Film::new(scene.camera.size());
    render(&scene, &settings, 0..samples, &mut film);
    let (radiance, variance) = (film.radiance(), film.variance());
    let n = radiance.len() as f64;
    let mean = radiance.iter().map(|rgb| f64::from(rgb[1])).sum::<f64>() / n;
    [mean, (variance.iter().map(|rgb| f64::from(rgb[1])).sum::<f64>()).sqrt() / n]
}

#[test]
fn white_levels_are_invisible_in_a_white_sky() {
    let sky = Light::Constant(ConstantLight { radiance: [1.0; 3] });
    for (name, amplitude) in MAPS {
        let fine = FineSurface { heights: corner(name, amplitude), brdf: diffuse(1.0), color: None };
        for light in [LightTransport::Baked, LightTransport::Global] {
            let asset = level(&fine, light);
            let kind = asset.light;
            let data = ModelData::farfield(asset);
            let integrator = data.integrator(kind);
            assert_eq!(integrator == Integrator::Path, light == LightTransport::Global);
            for degrees in [10.0_f32, 35.0, 55.0, 70.0, 82.0] {
                let [mean, error] = seen(&data, kind, &sky, towards(degrees.to_radians(), 0.0), 64);
                println!("{name} {light:?} {degrees}°: {mean:.4} ± {error:.4}");
            }
        }
    }
}

#[test]
fn a_global_level_is_the_original_in_all_light() {
    for (name, amplitude, brdf) in [
        ("heights/twill", 24.415, diffuse(0.8)),
        ("heights/twill", 24.415, ggx(0.3)),
        ("heights/cliffs", 120.0, diffuse(0.8)),
    ] {
        let fine = FineSurface { heights: corner(name, amplitude), brdf, color: None };
        let asset = level(&fine, LightTransport::Global);
        let error = measured(&fine, &asset, 7);
        println!("{name}: ε {:?} bias {:?} reciprocity {:?}", error.below_75, error.bias, error.reciprocity);
        let input = Input { fine, height_digest: Digest::of(b""), color_digest: None, warnings: Vec::new() };
        let models = [ModelData::full(&input), ModelData::farfield(asset)];
        for (light, view) in [(0.0_f32, 20.0_f32), (45.0, 0.0), (60.0, 60.0)] {
            let sun =
                DirectionalLight { direction: world(towards(light.to_radians(), 2.0)).as_vec3(), irradiance: [1.0; 3] };
            let [full, level] = [0, 1].map(|k| {
                seen(&models[k], AssetLight::Global, &Light::Directional(sun), towards(view.to_radians(), 0.0), 64)
            });
            println!(
                "{name} {light}° {view}°: {:.5} ± {:.5}, level {:.5} ± {:.5}: {:+.2} %",
                full[0],
                full[1],
                level[0],
                level[1],
                100.0 * (level[0] / full[0] - 1.0)
            );
        }
    }
}
