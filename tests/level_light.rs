//! Levels in images: baked ones under direct light and global ones under all light, beside what they stand for.

mod support;

use farfield::build::key::Digest;
use farfield::build::{Input, ModelData};
use farfield::geometry::{Boundary, HeightField, LargeShape};
use farfield::prefilter::surface::{FineSurface, LevelSettings, LightTransport};
use farfield::transport::camera::{Camera, Projection};
use farfield::transport::film::Film;
use farfield::transport::light::{ConstantLight, DirectionalLight, Light, Lights};
use farfield::transport::render::{Integrator, RenderSettings, render};
use farfield::transport::sampler::Sampling;
use farfield::transport::scene::{Lod, Scene};
use formats::asset::{Light as AssetLight, SurfaceAsset};
use glam::{DVec3, Vec3};
use support::{at, compiled, crop, diffuse, fixture, through_bytes, towards};

/// Texels per axis of a map.
const SIZE: usize = 256;

/// A corner of a fixture; its seams are steps.
fn corner(name: &str, amplitude: f32) -> HeightField {
    crop(&fixture(name, amplitude), [SIZE; 2], [1.0; 2], Boundary::Repeat)
}

/// The asset of one level at 8× with interreflection, for the integrator that `light` is for.
fn level(fine: &FineSurface, light: AssetLight) -> SurfaceAsset {
    let settings = LevelSettings { patches: Some(2), light: LightTransport::Baked, ..at(8.0) };
    SurfaceAsset { light, ..through_bytes(fine, compiled(fine, &settings)) }
}

/// From the base frame to the world's: x, height, −y.
fn world(w: Vec3) -> DVec3 {
    DVec3::new(f64::from(w.x), f64::from(w.z), f64::from(-w.y))
}

/// What is looked at.
struct View<'a> {
    data: &'a ModelData,
    kind: AssetLight,
    tiles: u32,
    large: Option<&'a LargeShape>,
    light: Light,
    /// Towards the viewer.
    wo: Vec3,
    /// Tiles that the film is wide.
    width: f64,
}

/// Mean radiance and its standard error over a film as high as it is wide on the base, drawn as an asset of its kind is.
fn seen(view: &View<'_>, samples: u64) -> [f64; 2] {
    let rows = (48.0 * f64::from(view.wo.z)).round().max(1.0) as usize;
    let projection = Projection::Orthographic { width: view.width * SIZE as f64 };
    let camera = Camera::look_at(world(view.wo) * 2e4, DVec3::ZERO, DVec3::Y, projection, [48, rows]).expect("a view");
    let surface = view.data.object([view.tiles; 2], view.large);
    let scene = Scene { camera, lights: Lights::new(vec![view.light.clone()]), surface };
    let integrator = view.data.integrator(view.kind);
    let settings = RenderSettings { integrator, lod: Lod::Fixed(0), seed: 4, sampling: Sampling::Independent };
    let mut film = Film::new(scene.camera.size());
    render(&scene, &settings, 0..samples, &mut film);
    let (radiance, variance) = (film.radiance(), film.variance());
    let n = radiance.len() as f64;
    let mean = radiance.iter().map(|rgb| f64::from(rgb[1])).sum::<f64>() / n;
    [mean, variance.iter().map(|rgb| f64::from(rgb[1])).sum::<f64>().sqrt() / n]
}

#[test]
fn white_levels_are_invisible_in_a_white_sky() {
    // the bars: 0.5 % in the mean over views below 75°, cliffs 1.5 %; above 1.5 %. Single views are off by up to 2 %, and
    // hemispheres miss the bar above with 1.025: held where they are
    for (name, amplitude, below, above) in [
        ("heights/twill", 24.415, 0.005, 0.015),
        ("heights/fbm", 58.539, 0.005, 0.015),
        ("heights/bump", 28.0, 0.005, 0.025),
        ("heights/vgroove", 32.0, 0.005, 0.015),
        ("rocks/height", 35.9, 0.005, 0.015),
        ("heights/cliffs", 120.0, 0.015, 0.015),
    ] {
        let fine = FineSurface { heights: corner(name, amplitude), brdf: diffuse(1.0), color: None };
        let data = ModelData::farfield(level(&fine, AssetLight::Baked));
        let means = [10.0_f32, 35.0, 55.0, 70.0, 82.0].map(|degrees| {
            let around = [0.0, 1.3, 2.4, 4.4].map(|azimuth| {
                let wo = towards(degrees.to_radians(), azimuth);
                let light = Light::Constant(ConstantLight { radiance: [1.0; 3] });
                let view = View { data: &data, kind: AssetLight::Baked, tiles: 80, large: None, light, wo, width: 2.0 };
                seen(&view, 64)
            });
            [0, 1].map(|k| around.iter().map(|of| of[k]).sum::<f64>() / 4.0)
        });
        println!("{name}: {means:.4?}");
        let mean = means[..4].iter().map(|[mean, _]| mean).sum::<f64>() / 4.0;
        // three standard errors: of sixteen views four times smaller than of one, of four twice
        println!("  {mean:.4} {:.4}", means[4][0]);
        assert!((mean - 1.0).abs() < below + 0.75 * means[3][1], "{name}: {mean}");
        assert!((means[4][0] - 1.0).abs() < above + 1.5 * means[4][1], "{name}: {:?}", means[4]);
    }
}

/// Hills of slopes up to 0.3, 20 tiles wide. With slopes of 1 the level is 4 % too bright (direct light alone 0.4 %): a
/// sheared relief is flatter over its own base and reflects less within itself, which the additive term does not know.
fn hills() -> LargeShape {
    let n = 64;
    let wave = |k: usize| (k as f32 * std::f32::consts::TAU * 5.0 / n as f32).sin();
    let heights = (0..n * n).map(|k| 48.0 * wave(k % n) * wave(k / n)).collect();
    LargeShape::new(HeightField::new(heights, [n; 2], [20.0 * SIZE as f32 / n as f32; 2], Boundary::Clamp))
}

#[test]
fn a_global_level_on_a_large_shape_is_the_original_in_all_light() {
    let large = hills();
    let fine = FineSurface { heights: corner("heights/twill", 24.415), brdf: diffuse(0.8), color: None };
    let asset = level(&fine, AssetLight::Global);
    let input = Input { fine, height_digest: Digest::of(b""), color_digest: None, warnings: Vec::new() };
    let models = [ModelData::full(&input), ModelData::farfield(asset)];
    assert_eq!(models[1].integrator(AssetLight::Global), Integrator::Path);
    for (polar, azimuth, view) in [(20.0_f32, 2.0_f32, 5.0_f32), (50.0, 1.0, 30.0), (40.0, 4.0, 45.0)] {
        let direction = world(towards(polar.to_radians(), azimuth)).as_vec3();
        let sun = Light::Directional(DirectionalLight { direction, irradiance: [1.0; 3] });
        let wo = towards(view.to_radians(), 0.3);
        let [full, level] = [0, 1].map(|k| {
            let view = View {
                data: &models[k],
                kind: AssetLight::Global,
                tiles: 20,
                large: Some(&large),
                light: sun.clone(),
                wo,
                width: 10.0,
            };
            seen(&view, 128)
        });
        let difference = level[0] / full[0] - 1.0;
        let error = (full[1].hypot(level[1])) / full[0];
        println!(
            "{polar}° {view}°: {full:.5?}, level {level:.5?}: {:+.2} ± {:.2} %",
            100.0 * difference,
            100.0 * error
        );
        // the bar of the mean in all light
        assert!(difference.abs() < 0.01 + 3.0 * error, "{polar}° {view}°: {difference} ± {error}");
    }
}
