//! What the keys of a surface's actions are made of.

use std::fmt::{self, Debug, Formatter};
use std::sync::Arc;

use super::needs::size_of;
use super::steps::SurfaceStep;
use crate::build::SurfaceSpec;
use crate::build::action::Record;
use crate::build::encode::SURFACE_VERSION;
use crate::build::key::{Digest, Walk};
use crate::material::{Brdf, Conductor};
use crate::prefilter::surface::{LevelSettings, LightTransport, coarse_cells};

/// Name of the stage that puts an asset together.
pub(super) const ASSET: &str = "asset";

/// Versions of the stages: raised when one gives other bytes for the same inputs and settings. All of them are made anew
/// where [`SURFACE_VERSION`] is raised.
const VERSIONS: [(&str, u32); 13] = [
    ("heights", 1),
    ("colors", 1),
    ("downsample", 1),
    ("lobes", 1),
    ("tint", 1),
    ("choose", 1),
    ("retune", 1),
    ("fine", 1),
    ("smooth", 1),
    ("coarse", 1),
    ("fit", 1),
    ("measure", 1),
    (ASSET, 1),
];

/// The version of a stage.
pub(super) fn version_of(stage: &str) -> u32 {
    VERSIONS.iter().find(|(name, _)| *name == stage).expect("every stage is in the table").1
}

/// Everything that the artifact of `step` depends on, beside its stage: versions, inputs, settings.
pub(super) fn walk_step(step: &SurfaceStep<'_>, needs: &[Arc<Record>], walk: &mut Walk) {
    walk.setting("surface version", SURFACE_VERSION);
    let names = need_names(step);
    for (name, need) in names.iter().zip(needs).filter(|(name, _)| !name.is_empty()) {
        walk.input(name, need.digest());
    }
    walk_settings(step, size_of(needs), walk);
}

/// The settings of `step`, whose map has `size` texels, in one form whatever the manifest looked like.
fn walk_settings(step: &SurfaceStep<'_>, size: [usize; 2], walk: &mut Walk) {
    match step {
        SurfaceStep::Heights { spec, digest, .. } => walk_heights(walk, spec, *digest),
        SurfaceStep::Colors { digest, .. } => {
            walk.input("colour map", *digest);
            walk.setting("texels", size);
        }
        SurfaceStep::Downsample { settings } => walk.setting("factor", settings.factor),
        SurfaceStep::Lobes { settings } => {
            walk.setting("cells", coarse_cells(size, settings.factor));
            walk.setting("lobes", settings.lobes);
        }
        SurfaceStep::Tint { settings } => {
            walk.setting("texels", size);
            walk.setting("cells", coarse_cells(size, settings.factor));
        }
        SurfaceStep::Choose { settings, brdf } | SurfaceStep::Retune { settings, brdf } => {
            walk.setting("patches", Open(settings.patches));
            walk.setting("directions", Open(settings.directions));
            walk.setting("rank", Open(settings.rank));
            if is_fixed(settings) {
                walk.setting("cells", coarse_cells(size, settings.factor));
                return;
            }
            walk_brdf(walk, brdf);
            walk.setting("factor", settings.factor);
            walk.setting("light", settings.light);
            walk.setting("error", settings.error);
        }
        SurfaceStep::Fine { settings, brdf } => {
            walk_brdf(walk, brdf);
            walk_tables(walk, settings, coarse_cells(size, settings.factor));
            walk.setting("light", settings.light);
            if settings.light != LightTransport::Direct {
                walk.setting("error", settings.error);
                walk.setting("seed", settings.seed);
            }
        }
        SurfaceStep::Smooth { settings, brdf } => {
            walk_brdf(walk, brdf);
            walk_tables(walk, settings, coarse_cells(size, settings.factor));
            walk.setting("factor", settings.factor);
        }
        SurfaceStep::Coarse { settings, brdf } => {
            walk_brdf(walk, brdf);
            // no more than cells, which the heights tell
            walk_tables(walk, settings, [usize::MAX; 2]);
        }
        SurfaceStep::Fit { settings } => {
            // of which the warnings about noise speak
            if settings.light != LightTransport::Direct {
                walk.setting("error", settings.error);
            }
        }
        SurfaceStep::Measure { settings, spec } => {
            walk_brdf(walk, &spec.brdf);
            walk.setting("size", spec.size);
            walk.setting("light", settings.light);
            walk.setting("seed", settings.seed);
        }
        SurfaceStep::Asset { .. } => {}
    }
}

/// The sizes of the tables of F, where the manifest names them: what `sizes` says beside them is no matter for F.
fn walk_tables(walk: &mut Walk, settings: &LevelSettings, cells: [usize; 2]) {
    if let Some(sizes) = settings.fixed_sizes(cells) {
        walk.setting("patches", sizes.patches);
        walk.setting("directions", sizes.directions);
    }
}

/// Whether the manifest names all sizes.
pub(super) fn is_fixed(settings: &LevelSettings) -> bool {
    settings.fixed_sizes([1, 1]).is_some()
}

/// A size that may be left open, as the manifest writes it.
pub(super) struct Open(pub(super) Option<usize>);

impl Debug for Open {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(size) => write!(f, "{size}"),
            None => f.write_str("auto"),
        }
    }
}

/// What the needed actions are called in the key; none where only a fact of theirs counts.
fn need_names(step: &SurfaceStep<'_>) -> &'static [&'static str] {
    match step {
        SurfaceStep::Heights { .. } | SurfaceStep::Colors { .. } | SurfaceStep::Asset { .. } => &[],
        SurfaceStep::Downsample { .. } | SurfaceStep::Lobes { .. } => &["heights"],
        SurfaceStep::Tint { .. } => &["", "colors"],
        SurfaceStep::Choose { settings, .. } if is_fixed(settings) => &[""],
        SurfaceStep::Choose { .. } => &["heights", "downsample", "lobes", "colors", "tint"],
        SurfaceStep::Retune { .. } => &["heights", "downsample", "lobes", "sizes", "measure", "colors", "tint"],
        SurfaceStep::Fine { settings, .. } if is_fixed(settings) => &["heights", "", "colors"],
        SurfaceStep::Smooth { settings, .. } if is_fixed(settings) => {
            &["heights", "downsample", "lobes", "", "fine", "tint"]
        }
        SurfaceStep::Coarse { settings, .. } if is_fixed(settings) => &["smooth", "lobes", "", "tint"],
        SurfaceStep::Fine { .. } => &["heights", "sizes", "colors"],
        SurfaceStep::Smooth { .. } => &["heights", "downsample", "lobes", "sizes", "fine", "tint"],
        SurfaceStep::Coarse { .. } => &["smooth", "lobes", "sizes", "tint"],
        SurfaceStep::Fit { .. } => &["smooth", "fine", "coarse", "sizes"],
        SurfaceStep::Measure { .. } => &["heights", "smooth", "lobes", "sizes", "fit", "colors", "tint"],
    }
}

/// Everything that the heights of `spec` depend on.
fn walk_heights(walk: &mut Walk, spec: &SurfaceSpec, digest: Digest) {
    walk.input("height map", digest);
    walk.setting("channel", &spec.channel);
    walk.setting("invert", spec.invert);
    walk.setting("size", spec.size);
    walk.setting("amplitude", spec.amplitude);
    walk.setting("offset", spec.offset);
    walk.setting("boundary", spec.boundary);
    walk.setting("detrend", spec.detrend);
    walk.setting("dequantize", spec.dequantize);
}

/// A base BRDF, part by part.
pub(super) fn walk_brdf(walk: &mut Walk, brdf: &Brdf) {
    let Brdf { diffuse, specular } = brdf;
    walk.setting("bsdf diffuse", diffuse);
    match specular {
        None => walk.setting("bsdf specular", ()),
        Some(Conductor { alpha, f0, distribution }) => {
            walk.setting("bsdf roughness", alpha);
            walk.setting("bsdf specular", f0);
            walk.setting("bsdf distribution", distribution);
        }
    }
}

/// The versions of all stages, for what depends on all.
pub(super) fn walk_versions(walk: &mut Walk) {
    walk.setting("surface version", SURFACE_VERSION);
    VERSIONS.iter().for_each(|(stage, version)| walk.setting(&format!("version of {stage}"), version));
}
