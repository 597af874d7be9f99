//! The maps with their materials, compiled; cameras and lights.

use std::path::Path;

use farfield::build::encode::{decoded, surface_asset, surface_level};
use farfield::build::key::Digest;
use farfield::build::{Input, Manifest, ModelData};
use farfield::geometry::{Boundary, HeightField};
use farfield::prefilter::surface::{FineSurface, compile};
use farfield::transport::camera::{Camera, Projection};
use farfield::transport::film::Film;
use farfield::transport::light::{AreaLight, Light, Lights};
use farfield::transport::render::{Integrator, RenderSettings, render};
use farfield::transport::sampler::Sampling;
use farfield::transport::scene::{Lod, Scene};
use formats::SurfaceAsset;
use glam::DVec3;

/// Metres a texel.
pub(crate) const TEXEL: f64 = 1e-3;

pub(crate) const DIFFUSE: &str = r#"{ type = "diffuse", albedo = [0.5, 0.5, 0.5] }"#;
pub(crate) const GGX_03: &str = r#"{ type = "conductor", roughness = 0.3, specular = [0.9, 0.9, 0.9] }"#;
pub(crate) const GGX_01: &str = r#"{ type = "conductor", roughness = 0.1, specular = [0.9, 0.9, 0.9] }"#;

/// A map with its material: the original, its asset, and the grids of its levels.
pub(crate) struct Subject {
    pub(crate) input: Input,
    pub(crate) asset: SurfaceAsset,
    pub(crate) cells: Vec<[usize; 2]>,
}

impl Subject {
    /// Compiles `fixtures/heights/NAME.png` at these factors.
    pub(crate) fn new(name: &str, bsdf: &str, factors: &[u32]) -> Self {
        Self::with_patches(name, bsdf, factors, 4)
    }

    /// [`Subject::new`] with another M.
    pub(crate) fn with_patches(name: &str, bsdf: &str, factors: &[u32], patches: usize) -> Self {
        let heights = heights(name);
        let text = format!(
            "[surface.{name}]\nheight = \"{name}.png\"\nsize = [1.024, 1.024]\namplitude = 1.0\nbsdf = {bsdf}\nlevels = {factors:?}\n\
             patches = {patches}\ndirections = 15\nrank = 1\n"
        );
        let manifest = Manifest::parse(&text).unwrap_or_else(|mistakes| panic!("{mistakes:?}"));
        let spec = &manifest.surfaces[0];
        let fine = FineSurface { heights, brdf: spec.brdf, color: None };
        let input = Input { fine, height_digest: Digest::of(b""), color_digest: None, warnings: Vec::new() };
        let levels = spec.levels.iter().enumerate().map(|(k, settings)| {
            surface_level(k + 1, &input.fine.heights, compile(&input.fine, settings, &mut |_| ()))
        });
        let asset = surface_asset(spec, &input.sources(), levels.collect());
        let asset = asset.encode().and_then(|files| decoded(&files)).expect("what was encoded decodes");
        let cells = asset.levels.iter().map(|level| level.cells).collect();
        Self { input, asset, cells }
    }

    pub(crate) fn full(&self) -> ModelData {
        ModelData::full(&self.input)
    }

    pub(crate) fn farfield(&self) -> ModelData {
        ModelData::farfield(self.asset.clone())
    }

    /// Farfield, lobes, LEADR, naive.
    pub(crate) fn models(&self) -> [(&'static str, ModelData); 4] {
        [
            ("farfield", self.farfield()),
            ("lobes", ModelData::lobes(&self.asset)),
            ("leadr", ModelData::leadr(&self.input, &self.cells)),
            ("naive", ModelData::naive(&self.input, &self.cells)),
        ]
    }
}

/// A map of the fixtures in metres.
pub(crate) fn heights(name: &str) -> HeightField {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/heights");
    let path = folder.join(format!("{name}.png"));
    let map = image::open(&path).unwrap_or_else(|error| panic!("`{}`: {error}", path.display())).into_luma16();
    let table: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("heights.json")).expect("heights.json")).expect("JSON");
    let amplitude = table[name]["amplitude_texels"].as_f64().expect("an amplitude") * TEXEL;
    let size = [map.width() as usize, map.height() as usize];
    let metres = map.into_raw().into_iter().map(|code| (f64::from(code) / 65535.0 * amplitude) as f32).collect();
    HeightField::new(metres, size, [TEXEL as f32; 2], Boundary::Repeat)
}

/// A camera in parallel, `degrees` from the normal, for which a pixel is `texels` source texels (the root of its area).
pub(crate) fn parallel(degrees: f64, texels: f64, pixels: usize) -> Camera {
    let polar = degrees.to_radians();
    let width = pixels as f64 * texels * TEXEL * polar.cos().sqrt();
    let away = DVec3::new(polar.sin() * 0.77, polar.cos(), polar.sin() * 0.638);
    let up = if degrees == 0.0 { DVec3::NEG_Z } else { DVec3::Y };
    Camera::look_at(away * 500.0, DVec3::ZERO, up, Projection::Orthographic { width }, [pixels; 2]).expect("a view")
}

/// A square light above `width` metres around the origin.
pub(crate) fn area_light(width: f64) -> Lights {
    let centre = DVec3::new(-0.9, 1.3, 0.5) * width;
    Lights::new(vec![Light::Area(AreaLight::facing(centre, DVec3::ZERO, Some(DVec3::Z), [0.8 * width; 2], [6.0; 3]))])
}

/// An image, direct light.
pub(crate) fn film(scene: &Scene<'_>, lod: Lod, seed: u64, samples: u32) -> Film {
    let settings = RenderSettings { integrator: Integrator::Direct, lod, seed, sampling: Sampling::Sobol };
    let mut film = Film::new(scene.camera.size());
    render(scene, &settings, 0..u64::from(samples), &mut film);
    film
}

/// Two independent halves.
pub(crate) fn halves(scene: &Scene<'_>, lod: Lod, seed: u64, samples: u32) -> [Vec<[f32; 3]>; 2] {
    [0, 1].map(|half| film(scene, lod, 2 * seed + half, samples).radiance())
}

/// CPU seconds of this process.
pub(crate) fn cpu_seconds() -> f64 {
    cpu_time::ProcessTime::now().as_duration().as_secs_f64()
}
