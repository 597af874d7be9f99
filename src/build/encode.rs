//! From coarse levels to the asset on disk: the only place where compiler types become those of `formats`.

use std::collections::BTreeMap;

use formats::asset::{DOCUMENT, Light, Source, SurfaceAsset, SurfaceLevel};
use formats::{BaseBrdf, Boundary, Error, Lobe, Specular};
use serde_json::json;

use super::{Input, SurfaceSpec};
use crate::geometry;
use crate::material::{Brdf, ggx_gaussians};
use crate::prefilter::surface::{CoarseLevel, LightTransport};

/// Raised when the compiler writes other bytes for the same input and settings.
pub const SURFACE_VERSION: &str = "4";

/// The asset of `spec` with the given levels: no time, path, thread count or host is in it.
pub fn surface_asset(spec: &SurfaceSpec, input: &Input, levels: Vec<SurfaceLevel>) -> SurfaceAsset {
    let [width, height] = input.fine.heights.size().map(|n| n as u32);
    SurfaceAsset {
        name: spec.name.clone(),
        light: light(spec.light()),
        size: spec.size,
        boundary: boundary(spec.boundary),
        source: Source { digest: input.height_digest.clone(), width, height },
        bsdf: base_brdf(&spec.brdf),
        settings: settings(spec, input),
        versions: BTreeMap::from([("surface".into(), SURFACE_VERSION.into())]),
        seed: spec.levels.first().map_or(0, |level| level.seed),
        // every copy of a kernel gives the same bits (`math::simd`), and the FFT runs its scalar code
        isa: "baseline".into(),
        levels,
    }
}

/// Level number `index` (from 1) as the asset holds it, its error not yet known.
pub fn surface_level(index: usize, fine: &geometry::HeightField, coarse: CoarseLevel) -> SurfaceLevel {
    let cells = coarse.heights.size();
    let lobe =
        |lobe: crate::prefilter::surface::VmfLobe| Lobe { mean: lobe.mean, kappa: lobe.kappa, weight: lobe.weight };
    SurfaceLevel {
        index: index as u32,
        factor: [0, 1].map(|axis| fine.size()[axis] as f64 / cells[axis] as f64),
        cells,
        heights: coarse.heights.heights().to_vec(),
        lobes: coarse.lobes.into_iter().map(|cells| cells.into_iter().map(lobe).collect()).collect(),
        base_color: coarse.base_color,
        patches: coarse.patches,
        spatial: coarse.spatial,
        directions: coarse.directions,
        angular: coarse.angular,
        error: None,
        limited_by: None,
    }
}

/// The light in the words of `formats`.
pub fn light(light: LightTransport) -> Light {
    match light {
        LightTransport::Direct => Light::Direct,
        LightTransport::Baked => Light::Baked,
    }
}

/// The boundary in the words of `formats`.
pub fn boundary(boundary: geometry::Boundary) -> Boundary {
    match boundary {
        geometry::Boundary::Repeat => Boundary::Repeat,
        geometry::Boundary::Clamp => Boundary::Clamp,
    }
}

/// The base BRDF with the spherical Gaussians of its normal distribution.
pub fn base_brdf(brdf: &Brdf) -> BaseBrdf {
    let specular = brdf.specular.map(|c| Specular { f0: c.f0, alpha: c.alpha, gaussians: ggx_gaussians(c.alpha) });
    BaseBrdf { diffuse: brdf.diffuse, specular }
}

/// The asset that the bytes of its files say.
pub fn decoded(files: &BTreeMap<String, Vec<u8>>) -> Result<SurfaceAsset, Error> {
    SurfaceAsset::decode(&mut |name| {
        let missing = || std::io::Error::from(std::io::ErrorKind::NotFound);
        files.get(name).cloned().ok_or_else(|| Error::Io { path: name.into(), source: missing() })
    })
}

/// Whether a file of an asset's folder is a payload by its name.
pub fn is_payload(name: &str) -> bool {
    name.starts_with("level") && name.ends_with(".ktx2")
}

/// Bytes of level `index` by part: `heights`, `lobes`, `base_color`, `spatial`, `angular`.
pub fn bytes_by_part(files: &BTreeMap<String, Vec<u8>>, index: u32) -> BTreeMap<String, u64> {
    let mut parts = BTreeMap::new();
    let prefix = format!("level{index}.");
    for (name, bytes) in files.iter().filter(|(name, _)| *name != DOCUMENT) {
        let Some(role) = name.strip_prefix(&prefix).and_then(|rest| rest.split('.').next()) else { continue };
        *parts.entry(part_of(role)).or_insert(0) += bytes.len() as u64;
    }
    parts
}

/// The part that a payload's role belongs to: lobes and ranks are counted together.
pub fn part_of(role: &str) -> String {
    match role.trim_end_matches(|c: char| c.is_ascii_digit()) {
        "lobe" => "lobes".into(),
        part => part.into(),
    }
}

/// The settings that the bytes depend on, in one form whatever the manifest looked like.
fn settings(spec: &SurfaceSpec, input: &Input) -> serde_json::Value {
    let tables = spec.levels.first();
    json!({
        "amplitude": spec.amplitude,
        "channel": spec.channel,
        "color": input.color_digest,
        "dequantize": spec.dequantize,
        "detrend": spec.detrend,
        "directions": tables.map(|t| t.directions),
        "error": spec.error,
        "invert": spec.invert,
        "levels": spec.levels.iter().map(|level| level.factor).collect::<Vec<_>>(),
        "lobes": tables.and_then(|t| t.lobes),
        "offset": spec.offset,
        "patches": tables.map(|t| t.patches),
        "rank": tables.map(|t| t.rank),
    })
}
