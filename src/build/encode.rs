//! From coarse levels to the asset on disk: the only place where compiler types become those of `formats`.

use std::collections::BTreeMap;

use formats::asset::{AdditiveTerm, Alternative, DOCUMENT, Light, Source, SurfaceAsset, SurfaceLevel};
use formats::{BaseBrdf, Boundary, Error, Lobe, Specular};
use serde_json::json;

use super::SurfaceSpec;
use super::key::{Digest, ISA};
use crate::geometry;
use crate::material::{Brdf, ggx_gaussians};
use crate::prefilter::surface::{self, CoarseLevel, LightTransport};

/// Raised when the compiler writes other bytes for the same input and settings.
pub const SURFACE_VERSION: &str = "5";

/// The same for what interreflection adds; direct light knows nothing of it.
pub const INTERREFLECTION_VERSION: &str = "2";

/// The files that an asset is made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sources {
    /// BLAKE3 of the height map's bytes.
    pub height: Digest,
    /// Texels of the height map along u and v.
    pub size: [usize; 2],
    /// BLAKE3 of the colour map's bytes.
    pub color: Option<Digest>,
}

/// The asset of `spec` with the given levels: no time, path, thread count or host is in it.
pub fn surface_asset(spec: &SurfaceSpec, sources: &Sources, levels: Vec<SurfaceLevel>) -> SurfaceAsset {
    let [width, height] = sources.size.map(|n| n as u32);
    SurfaceAsset {
        name: spec.name.clone(),
        light: light(spec.light()),
        size: spec.size,
        boundary: boundary(spec.boundary),
        source: Source { digest: sources.height.to_string(), width, height },
        bsdf: base_brdf(&spec.brdf),
        settings: settings(spec, sources),
        versions: versions(spec.light()),
        seed: spec.levels.first().map_or(0, |level| level.seed),
        isa: ISA.into(),
        levels,
    }
}

/// Level number `index` (from 1) of `fine` as the asset holds it, its error not yet known.
pub fn surface_level(index: usize, fine: &geometry::HeightField, coarse: CoarseLevel) -> SurfaceLevel {
    level_of_map(index, fine.size(), coarse)
}

/// [`surface_level`] of a map of `fine_size` texels.
pub(super) fn level_of_map(index: usize, fine_size: [usize; 2], coarse: CoarseLevel) -> SurfaceLevel {
    let cells = coarse.heights.size();
    let lobe =
        |lobe: crate::prefilter::surface::VmfLobe| Lobe { mean: lobe.mean, kappa: lobe.kappa, weight: lobe.weight };
    SurfaceLevel {
        index: index as u32,
        factor: [0, 1].map(|axis| fine_size[axis] as f64 / cells[axis] as f64),
        cells,
        heights: coarse.heights.heights().to_vec(),
        lobes: coarse.lobes.into_iter().map(|cells| cells.into_iter().map(lobe).collect()).collect(),
        base_color: coarse.base_color,
        patches: coarse.patches,
        spatial: coarse.spatial,
        directions: coarse.directions,
        angular: coarse.angular,
        additive: coarse.additive.map(|term| AdditiveTerm {
            directions: term.directions,
            spatial: term.spatial,
            angular: term.angular,
        }),
        skipped_interreflection: coarse.skipped_interreflection,
        error: None,
        limited_by: None,
        alternatives: coarse.alternatives.into_iter().map(alternative).collect(),
    }
}

/// An alternative in the words of `formats`.
fn alternative(considered: surface::Alternative) -> Alternative {
    let surface::Alternative { sizes, error } = considered;
    let surface::TableSizes { patches, directions, rank } = sizes;
    Alternative { patches, directions, rank, error, bytes: sizes.bytes() }
}

/// Version of each stage that light of this kind passes.
fn versions(light: LightTransport) -> BTreeMap<String, String> {
    let interreflection = (light != LightTransport::Direct).then_some(("interreflection", INTERREFLECTION_VERSION));
    let stages = [("surface", SURFACE_VERSION)].into_iter().chain(interreflection);
    stages.map(|(stage, version)| (stage.into(), version.into())).collect()
}

/// The light in the words of `formats`.
pub fn light(light: LightTransport) -> Light {
    match light {
        LightTransport::Direct => Light::Direct,
        LightTransport::Baked => Light::Baked,
        LightTransport::Global => Light::Global,
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

/// Bytes of level `index` by part: `heights`, `lobes`, `base_color`, `spatial`, `angular`, `additive_spatial`, `additive_angular`.
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
fn settings(spec: &SurfaceSpec, sources: &Sources) -> serde_json::Value {
    let tables = spec.levels.first();
    json!({
        "amplitude": spec.amplitude,
        "channel": spec.channel,
        "color": sources.color,
        "dequantize": spec.dequantize,
        "detrend": spec.detrend,
        "directions": tables.map(|t| t.directions),
        "error": spec.error(),
        "invert": spec.invert,
        "levels": spec.levels.iter().map(|level| level.factor).collect::<Vec<_>>(),
        "lobes": tables.and_then(|t| t.lobes),
        "offset": spec.offset,
        "patches": tables.map(|t| t.patches),
        "rank": tables.map(|t| t.rank),
    })
}
