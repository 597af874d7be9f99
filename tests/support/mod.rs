//! Maps, directions, levels and assets that the physics suites share.
#![allow(dead_code, reason = "each suite uses its part")]

use std::collections::BTreeMap;

use farfield::build::encode::{base_brdf, boundary, decoded, surface_level};
use farfield::build::level_error::{Reference, measure};
use farfield::geometry::{Boundary, HeightField, HeightTracer, SurfacePoint};
use farfield::material::{Brdf, Conductor};
use farfield::math::rng::Stream;
use farfield::prefilter::surface::{CoarseLevel, FineSurface, LevelSettings, LightTransport, compile};
use farfield::transport::PatchSampling;
use farfield::transport::effective::for_each_point;
use formats::asset::{LevelError, Light, Source, SurfaceAsset, SurfaceLevel};
use formats::level_brdf::{LevelBrdf, LevelHit};
use formats::lookup;
use glam::Vec3;

/// cos 75°: what divides "below" from "above".
pub(crate) const COS_75: f32 = 0.258_819_05;

/// A Lambertian base.
pub(crate) fn diffuse(albedo: f32) -> Brdf {
    Brdf { diffuse: [albedo; 3], specular: None }
}

/// A GGX base without a diffuse part.
pub(crate) fn ggx(alpha: f32) -> Brdf {
    Brdf { diffuse: [0.0; 3], specular: Some(Conductor::ggx(alpha, [0.9, 0.7, 0.5])) }
}

/// Both parts.
pub(crate) fn both(alpha: f32) -> Brdf {
    Brdf { diffuse: [0.5, 0.3, 0.1], ..ggx(alpha) }
}

/// A height field from a formula; spacing in metres.
pub(crate) fn field(
    size: [usize; 2],
    spacing: [f32; 2],
    boundary: Boundary,
    height: impl Fn(usize, usize) -> f32,
) -> HeightField {
    let heights = (0..size[0] * size[1]).map(|k| height(k % size[0], k / size[0])).collect();
    HeightField::new(heights, size, spacing, boundary)
}

/// A map of `fixtures/`, lengths in texels.
pub(crate) fn fixture(path: &str, amplitude: f32) -> HeightField {
    let path = format!("{}/fixtures/{path}.png", env!("CARGO_MANIFEST_DIR"));
    let map = image::open(path).unwrap().into_luma16();
    let size = [map.width() as usize, map.height() as usize];
    let heights = map.into_raw().iter().map(|&code| f32::from(code) / 65535.0 * amplitude).collect();
    HeightField::new(heights, size, [1.0, 1.0], Boundary::Repeat)
}

/// The fixtures with their amplitudes in texels (`fixtures/heights/heights.json`, `fixtures/README.md`).
pub(crate) const FIXTURES: [(&str, f32); 7] = [
    ("heights/twill", 24.415),
    ("heights/fbm", 58.539),
    ("heights/bump", 28.0),
    ("heights/vgroove", 32.0),
    ("rocks/height", 35.9),
    ("heights/silk", 24.453),
    ("heights/cliffs", 120.0),
];

/// The corner of a map, as a map of its own.
pub(crate) fn crop(map: &HeightField, size: [usize; 2], spacing: [f32; 2], boundary: Boundary) -> HeightField {
    field(size, spacing, boundary, |i, j| map.vertex(i, j))
}

/// Smooth random heights that tile: eight waves of at least `shortest` texels, root mean square `rms`.
pub(crate) fn waves(size: [usize; 2], shortest: f32, rms: f32, seed: u64) -> impl Fn(usize, usize) -> f32 {
    let rng = Stream::new(seed, 77);
    let wave = |k: u64| {
        let random = |d: u64| rng.uniform(8 * k + d);
        let cycles = [0, 1].map(|axis| {
            let most = (size[axis] as f32 / shortest).floor();
            (random(axis as u64) * (2.0 * most + 1.0)).floor() - most
        });
        (cycles, std::f32::consts::TAU * random(2))
    };
    let waves: Vec<_> = (0..8).map(wave).collect();
    move |i, j| {
        let at = [i as f32 / size[0] as f32, j as f32 / size[1] as f32];
        let sum: f32 = waves
            .iter()
            .map(|(cycles, phase)| (std::f32::consts::TAU * (cycles[0] * at[0] + cycles[1] * at[1]) + phase).sin())
            .sum();
        0.5 * rms * sum
    }
}

/// A unit direction of polar angle `theta` and azimuth `phi`, radians.
pub(crate) fn towards(theta: f32, phi: f32) -> Vec3 {
    Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

/// A direction uniform over the hemisphere.
pub(crate) fn random_direction(rng: Stream, index: u64) -> Vec3 {
    Vec3::from(lookup::direction_of(rng.uniform_pair(index)))
}

/// The centre of texel (i, j).
pub(crate) fn centre(i: usize, j: usize) -> SurfacePoint {
    SurfacePoint { cell: [i, j], st: [0.5; 2] }
}

/// The default tables with a factor.
pub(crate) fn at(factor: f32) -> LevelSettings {
    LevelSettings {
        factor,
        patches: Some(4),
        directions: Some(15),
        rank: Some(1),
        lobes: None,
        light: LightTransport::Direct,
        error: 0.02,
        seed: 1,
    }
}

/// A level as the compiler gives it.
pub(crate) fn compiled(fine: &FineSurface, settings: &LevelSettings) -> CoarseLevel {
    compile(fine, settings, &mut |_| {})
}

/// An asset of levels that were compiled from `fine`.
pub(crate) fn asset(fine: &FineSurface, levels: Vec<SurfaceLevel>) -> SurfaceAsset {
    let [width, height] = fine.heights.size();
    SurfaceAsset {
        name: "physics".into(),
        light: Light::Direct,
        size: [0, 1].map(|k| fine.heights.size()[k] as f64 * f64::from(fine.heights.spacing()[k])),
        boundary: boundary(fine.heights.boundary()),
        source: Source { digest: "0".repeat(64), width: width as u32, height: height as u32 },
        bsdf: base_brdf(&fine.brdf),
        settings: serde_json::Value::Null,
        versions: BTreeMap::new(),
        seed: 1,
        isa: "any".into(),
        levels,
    }
}

/// The asset of one compiled level as its reader sees it: through the bytes of its files.
pub(crate) fn through_bytes(fine: &FineSurface, coarse: CoarseLevel) -> SurfaceAsset {
    let files = asset(fine, vec![surface_level(1, &fine.heights, coarse)]).encode().unwrap();
    decoded(&files).unwrap()
}

/// What the first level of `asset` reflects from `wi` to `wo`, mean over the map, RGB, both cosines included; exact casts
/// from the centres of `strata²` parts of it.
pub(crate) fn level_reflectance(asset: &SurfaceAsset, [wi, wo]: [Vec3; 2], strata: usize) -> [f64; 3] {
    let level = &asset.levels[0];
    let spacing = [0, 1].map(|k| (asset.size[k] / level.cells[k] as f64) as f32);
    let coarse = HeightField::new(level.heights.clone(), level.cells, spacing, Boundary::Repeat);
    let tracer = HeightTracer::new(&coarse);
    let brdf = LevelBrdf::new(asset, level);
    let mut sum = [0.0; 3];
    for_each_point(&tracer, &PatchSampling::of_grid([1, 1], 0, strata, 3), &[wi, wo], |point| {
        if point.sees(1) {
            let hit = LevelHit { x: point.uv.map(|x| x as f32), n_c: point.normal.to_array(), tilt: [0.0; 2] };
            let shown = point.shown_area(wo);
            let lit = if point.sees(0) { point.normal.dot(wi) } else { 0.0 };
            let f = brdf.at(&hit, wo.to_array()).eval(wi.to_array());
            let additive = brdf.additive_at(&hit, wo.to_array()).map_or([0.0; 3], |term| term.eval(wi.to_array()));
            (0..3).for_each(|c| sum[c] += f64::from(shown * (f[c] * lit + additive[c] * wi.z)));
        }
    });
    sum.map(|x| x / (strata * strata) as f64)
}

/// The measured error of the first level of `asset`.
pub(crate) fn measured(fine: &FineSurface, asset: &SurfaceAsset, seed: u64) -> LevelError {
    let reference = Reference {
        fine,
        bsdf: &asset.bsdf,
        light: asset.light,
        size: asset.size,
        boundary: asset.boundary,
        on_node: 0.0,
        seed,
    };
    measure(&reference, &asset.levels[0])
}
