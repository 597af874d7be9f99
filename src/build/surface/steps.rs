//! What the actions of a surface are, what their keys are made of, and what they call.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::SurfaceFiles;
use super::assemble::{asset, measured};
use crate::build::action::{Facts, Failure, Made, Need, Record, Step};
use crate::build::artifact::Artifact;
use crate::build::encode::SURFACE_VERSION;
use crate::build::key::{Digest, Walk};
use crate::build::level::lower_aim;
use crate::build::{SurfaceSpec, input};
use crate::geometry::HeightField;
use crate::io::SourceFile;
use crate::io::color::decode_color;
use crate::material::Brdf;
use crate::prefilter::surface::coarse::CoarseSurface;
use crate::prefilter::surface::downsample::downsample;
use crate::prefilter::surface::reflectance::{PatchReflectance, pair_count};
use crate::prefilter::surface::{
    Choice, FineSurface, FineTables, LevelFit, LevelSettings, LightTransport, TableSizes, VmfLobe, base_gaussians,
    cell_colors, choose, coarse_cells, coarse_heights, coarse_table, fine_tables, fit_level, level_lobes,
};
use formats::asset::LevelError;

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

/// An action of a surface.
#[derive(Debug)]
pub enum SurfaceStep<'a> {
    /// The height map in metres.
    Heights {
        /// Whose heights.
        spec: &'a SurfaceSpec,
        /// The file.
        path: PathBuf,
        /// Its digest.
        digest: Digest,
    },
    /// The colour map on the texels of the height map.
    Colors {
        /// The file.
        path: PathBuf,
        /// Its digest.
        digest: Digest,
    },
    /// Heights of a level.
    Downsample {
        /// Of the level.
        settings: &'a LevelSettings,
    },
    /// Lobes of a level.
    Lobes {
        /// Of the level.
        settings: &'a LevelSettings,
    },
    /// Mean colours of a level's cells.
    Tint {
        /// Of the level.
        settings: &'a LevelSettings,
    },
    /// Sizes of a level's tables.
    Choose {
        /// Of the level.
        settings: &'a LevelSettings,
        /// The base BRDF.
        brdf: &'a Brdf,
    },
    /// The same once more, where the level missed the target that they were chosen for.
    Retune {
        /// Of the level.
        settings: &'a LevelSettings,
        /// The base BRDF.
        brdf: &'a Brdf,
    },
    /// F of the fine surface.
    Fine {
        /// Of the level.
        settings: &'a LevelSettings,
        /// The base BRDF.
        brdf: &'a Brdf,
    },
    /// Heights of a level, smoother where they fold.
    Smooth {
        /// Of the level.
        settings: &'a LevelSettings,
        /// The base BRDF.
        brdf: &'a Brdf,
    },
    /// F of the coarse surface.
    Coarse {
        /// The base BRDF.
        brdf: &'a Brdf,
    },
    /// T and S, and the additive term.
    Fit {
        /// Of the level.
        settings: &'a LevelSettings,
        /// The base BRDF.
        brdf: &'a Brdf,
    },
    /// The error of a level through its own bytes.
    Measure {
        /// Of the level.
        settings: &'a LevelSettings,
        /// Of the surface.
        spec: &'a SurfaceSpec,
    },
    /// The files of the asset.
    Asset {
        /// Of the surface.
        spec: &'a SurfaceSpec,
        /// Its files.
        files: SurfaceFiles,
    },
}

impl Step for SurfaceStep<'_> {
    fn stage(&self) -> &'static str {
        match self {
            Self::Heights { .. } => "heights",
            Self::Colors { .. } => "colors",
            Self::Downsample { .. } => "downsample",
            Self::Lobes { .. } => "lobes",
            Self::Tint { .. } => "tint",
            Self::Choose { .. } => "choose",
            Self::Retune { .. } => "retune",
            Self::Fine { .. } => "fine",
            Self::Smooth { .. } => "smooth",
            Self::Coarse { .. } => "coarse",
            Self::Fit { .. } => "fit",
            Self::Measure { .. } => "measure",
            Self::Asset { .. } => ASSET,
        }
    }

    fn version(&self) -> u32 {
        version_of(self.stage())
    }

    fn walk(&self, needs: &[Arc<Record>], walk: &mut Walk) {
        if let Self::Asset { spec, files } = self {
            // Not of what it needs: see the room's door.
            *walk = super::walk_asset(spec, *files);
            return;
        }
        walk.setting("surface version", SURFACE_VERSION);
        let names = self.need_names();
        for (name, need) in names.iter().zip(needs).filter(|(name, _)| !name.is_empty()) {
            walk.input(name, need.digest());
        }
        match self {
            Self::Heights { spec, digest, .. } => walk_heights(walk, spec, *digest),
            Self::Colors { digest, .. } => {
                walk.input("colour map", *digest);
                walk.setting("texels", size_of(needs));
            }
            Self::Downsample { settings } => walk.setting("factor", settings.factor),
            Self::Lobes { settings } => {
                walk.setting("cells", coarse_cells(size_of(needs), settings.factor));
                walk.setting("lobes", settings.lobes);
            }
            Self::Tint { settings } => {
                walk.setting("texels", size_of(needs));
                walk.setting("cells", coarse_cells(size_of(needs), settings.factor));
            }
            Self::Choose { settings, brdf } | Self::Retune { settings, brdf } => {
                walk.setting("patches", settings.patches);
                walk.setting("directions", settings.directions);
                walk.setting("rank", settings.rank);
                if settings.fixed_sizes([1, 1]).is_some() {
                    walk.setting("cells", coarse_cells(size_of(needs), settings.factor));
                    return;
                }
                walk_brdf(walk, brdf);
                walk.setting("factor", settings.factor);
                walk.setting("light", settings.light);
                walk.setting("error", settings.error);
            }
            Self::Fine { settings, brdf } => {
                walk_brdf(walk, brdf);
                walk.setting("light", settings.light);
                if settings.light != LightTransport::Direct {
                    walk.setting("error", settings.error);
                    walk.setting("seed", settings.seed);
                }
            }
            Self::Smooth { settings, brdf } => {
                walk_brdf(walk, brdf);
                walk.setting("factor", settings.factor);
            }
            Self::Coarse { brdf } => walk_brdf(walk, brdf),
            Self::Fit { settings, brdf } => {
                walk_brdf(walk, brdf);
                walk.setting("error", settings.error);
            }
            Self::Measure { settings, spec } => {
                walk_brdf(walk, &spec.brdf);
                walk.setting("size", spec.size);
                walk.setting("light", settings.light);
                walk.setting("seed", settings.seed);
            }
            Self::Asset { .. } => {}
        }
    }

    fn working_bytes(&self, needs: &[Arc<Record>]) -> u64 {
        let product = |size: [usize; 2]| (size[0] * size[1]) as u64;
        let texels = product(size_of(needs));
        let cells = |settings: &LevelSettings| product(coarse_cells(size_of(needs), settings.factor));
        let tables = |settings: &LevelSettings| match settings.fixed_sizes([usize::MAX; 2]) {
            Some(TableSizes { patches, directions, .. }) => {
                3 * 4 * (patches[0] * patches[1]) as u64 * pair_count(directions * directions) as u64
            }
            None => MOST_CHOSEN,
        };
        match self {
            Self::Heights { path, .. } => DECODE * file_bytes(path),
            Self::Colors { path, .. } => 12 * texels + DECODE * file_bytes(path),
            Self::Downsample { settings } => 4 * texels + DOWNSAMPLE * cells(settings),
            Self::Lobes { settings } => 4 * texels + LOBES * cells(settings),
            Self::Tint { settings } => 24 * cells(settings),
            Self::Choose { settings, .. } if settings.fixed_sizes([1, 1]).is_some() => 1 << 10,
            Self::Choose { settings, .. } | Self::Retune { settings, .. } | Self::Fine { settings, .. } => {
                let directions = settings.directions.unwrap_or(LARGEST_CHOSEN);
                let bits = (directions * directions) as u64;
                // and a colour map is copied
                let color = if needs.len() > 2 { 12 } else { 0 };
                (FINE + color) * texels + bits * texels / 8 + 4 * tables(settings) + LOBES * cells(settings)
            }
            Self::Smooth { settings, .. } => {
                (16 << 20) + 2 * (DOWNSAMPLE + LOBES) * cells(settings) + 2 * tables(settings)
            }
            Self::Coarse { .. } => {
                (16 << 20) + 4 * needs.iter().map(|need| need.bytes()).sum::<u64>() + 4 * MOST_CHOSEN
            }
            Self::Fit { settings, .. } => (16 << 20) + 8 * tables(settings),
            Self::Measure { settings, .. } => (32 << 20) + MEASURE * texels + 2 * LOBES * cells(settings),
            Self::Asset { .. } => (16 << 20) + 2 * needs.iter().map(|need| need.bytes()).sum::<u64>(),
        }
    }

    fn run(&self, needs: &[Need], on_stage: &mut dyn FnMut(&'static str)) -> Result<Made, Failure> {
        match self {
            Self::Heights { spec, path, digest } => {
                on_stage("read");
                return read_heights(spec, path, *digest);
            }
            Self::Asset { spec, files } => return asset(spec, *files, needs),
            _ => {}
        }
        let artifact = match self {
            Self::Colors { path, digest } => {
                on_stage("read");
                read_colors(path, *digest, need_size(needs)?)?
            }
            Self::Downsample { settings } => {
                on_stage("downsample");
                Artifact::Heights(downsample(heights(&needs[0])?, settings.factor))
            }
            Self::Lobes { settings } => {
                on_stage("lobes");
                let fine = heights(&needs[0])?;
                Artifact::Lobes(level_lobes(fine, coarse_cells(fine.size(), settings.factor), settings.lobes))
            }
            Self::Tint { settings } => {
                on_stage("lobes");
                let size = need_size(needs)?;
                let colors = colors(needs.get(1))?.unwrap_or_default();
                Artifact::Colors(Some(cell_colors(colors, size, coarse_cells(size, settings.factor))))
            }
            Self::Choose { settings, brdf } => {
                match settings.fixed_sizes(coarse_cells(need_size(needs)?, settings.factor)) {
                    Some(sizes) => Artifact::Choice(Choice::fixed(sizes)),
                    None => Artifact::Choice(chosen(settings, brdf, needs, [3, 4], on_stage)?),
                }
            }
            Self::Retune { settings, brdf } => {
                let (before, reached) = (choice(&needs[3])?, error(&needs[4])?.below_75.value);
                match lower_aim(settings.error, before.predicted, reached) {
                    None => Artifact::Choice(before.clone()),
                    Some(aim) => {
                        let lower = LevelSettings { error: aim, ..**settings };
                        Artifact::Choice(chosen(&lower, brdf, needs, [5, 6], on_stage)?)
                    }
                }
            }
            Self::Fine { settings, brdf } => {
                let surface = fine_surface(&needs[0], needs.get(2), brdf)?;
                Artifact::Fine(fine_tables(&surface, choice(&needs[1])?, settings, on_stage))
            }
            Self::Smooth { settings, brdf } => {
                let gaussians = base_gaussians(brdf);
                let surface = coarse_surface([&needs[1], &needs[2]], needs.get(5), brdf, &gaussians)?;
                let (choice, f_fine) = (choice(&needs[3])?, fine_f(&needs[4])?);
                Artifact::Heights(coarse_heights(heights(&needs[0])?, choice, settings, &surface, f_fine, on_stage))
            }
            Self::Coarse { brdf } => {
                let gaussians = base_gaussians(brdf);
                let surface = coarse_surface([&needs[0], &needs[1]], needs.get(3), brdf, &gaussians)?;
                Artifact::Reflectance(coarse_table(choice(&needs[2])?, &surface, on_stage))
            }
            Self::Fit { settings, brdf } => {
                on_stage("fit");
                let (heights, sizes) = (heights(&needs[0])?, choice(&needs[3])?.sizes);
                Artifact::Fit(fit_level(fine_f(&needs[1])?, table(&needs[2])?, heights, sizes, settings.error, brdf))
            }
            Self::Measure { settings, spec } => measured(spec, settings, needs, on_stage)?,
            Self::Heights { .. } | Self::Asset { .. } => unreachable!("handled above"),
        };
        Ok(artifact.into())
    }

    fn loads(&self, need: usize, needs: &[Arc<Record>]) -> bool {
        match self {
            // Only the size of the map is wanted, which is among the facts.
            Self::Colors { .. } => false,
            Self::Tint { .. } => need > 0,
            Self::Choose { settings, .. } => settings.fixed_sizes([1, 1]).is_none(),
            Self::Asset { spec, .. } => super::assemble::is_loaded(spec, need, needs.len()),
            _ => true,
        }
    }

    fn is_shared(&self) -> bool {
        !matches!(self, Self::Heights { .. } | Self::Colors { .. })
    }
}

/// Bytes that a stage holds beside its inputs, measured at 2048² and 4096² and rounded up: of decoding, for a byte of
/// the file (16 bits a texel, hardly compressed, become two copies in 32).
const DECODE: u64 = 8;
/// For a cell of the level: two spectra in double precision, and what they are made from.
const DOWNSAMPLE: u64 = 128;
/// For a cell of the level: eight lobes twice, and the normals under it.
const LOBES: u64 = 512;
/// For a texel of the map, visibility bits apart: slots, keys and normals while texels are sorted.
const FINE: u64 = 28;
/// For a texel of the map: bounds of heights, and a colour map's copy.
const MEASURE: u64 = 20;

/// Bytes of a table of F whose size is chosen, at most, and the most direction cells that are chosen.
const MOST_CHOSEN: u64 = 24 << 20;
const LARGEST_CHOSEN: usize = 21;

impl SurfaceStep<'_> {
    /// What the needed actions are called in the key; none where only a fact of theirs counts.
    fn need_names(&self) -> &'static [&'static str] {
        match self {
            Self::Heights { .. } | Self::Colors { .. } | Self::Asset { .. } => &[],
            Self::Downsample { .. } | Self::Lobes { .. } => &["heights"],
            Self::Tint { .. } => &["", "colors"],
            Self::Choose { settings, .. } if settings.fixed_sizes([1, 1]).is_some() => &[""],
            Self::Choose { .. } => &["heights", "downsample", "lobes", "colors", "tint"],
            Self::Retune { .. } => &["heights", "downsample", "lobes", "sizes", "measure", "colors", "tint"],
            Self::Fine { .. } => &["heights", "sizes", "colors"],
            Self::Smooth { .. } => &["heights", "downsample", "lobes", "sizes", "fine", "tint"],
            Self::Coarse { .. } => &["smooth", "lobes", "sizes", "tint"],
            Self::Fit { .. } => &["smooth", "fine", "coarse", "sizes"],
            Self::Measure { .. } => &["heights", "smooth", "lobes", "sizes", "fit", "colors", "tint"],
        }
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
        Some(crate::material::Conductor { alpha, f0, distribution }) => {
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

/// Texels of the map that the first need read.
fn size_of(needs: &[Arc<Record>]) -> [usize; 2] {
    needs.first().and_then(|need| need.facts.size).unwrap_or([1, 1])
}

fn need_size(needs: &[Need]) -> Result<[usize; 2], Failure> {
    needs.first().and_then(|need| need.record.facts.size).ok_or_else(of_another_kind)
}

fn file_bytes(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |metadata| metadata.len())
}

/// The file at `path`, if it still is what its digest says.
fn unchanged(path: &Path, digest: Digest) -> Result<SourceFile, Failure> {
    let file = SourceFile::read(path).map_err(|error| Failure::Refused(error.to_string()))?;
    if Digest::of(file.bytes()) == digest { Ok(file) } else { Err(Failure::InputChanged) }
}

fn read_heights(spec: &SurfaceSpec, path: &Path, digest: Digest) -> Result<Made, Failure> {
    let refused = |error: input::InputError| Failure::Refused(error.to_string());
    let (heights, warnings) = input::heights(spec, unchanged(path, digest)?).map_err(refused)?;
    let facts = Facts { size: Some(heights.size()), warnings, ..Facts::default() };
    Ok(Made { artifact: Artifact::Heights(heights), facts })
}

fn read_colors(path: &Path, digest: Digest, size: [usize; 2]) -> Result<Artifact, Failure> {
    let colors = decode_color(&unchanged(path, digest)?, size);
    colors.map(|colors| Artifact::Colors(Some(colors))).map_err(|error| Failure::Refused(error.to_string()))
}

/// What is chosen for `settings`; `colors` and `tint` are the needs of these numbers, if there are any.
fn chosen(
    settings: &LevelSettings,
    brdf: &Brdf,
    needs: &[Need],
    [colors, tint]: [usize; 2],
    on_stage: &mut dyn FnMut(&'static str),
) -> Result<Choice, Failure> {
    let (fine, gaussians) = (fine_surface(&needs[0], needs.get(colors), brdf)?, base_gaussians(brdf));
    let surface = coarse_surface([&needs[1], &needs[2]], needs.get(tint), brdf, &gaussians)?;
    Ok(choose(&fine, settings, &surface, on_stage))
}

/// The fine surface of its heights and colours.
pub(super) fn fine_surface(map: &Need, color: Option<&Need>, brdf: &Brdf) -> Result<FineSurface, Failure> {
    let color = colors(color)?.map(<[_]>::to_vec);
    Ok(FineSurface { heights: heights(map)?.clone(), brdf: *brdf, color })
}

fn coarse_surface<'n>(
    [map, distributions]: [&'n Need; 2],
    tint: Option<&'n Need>,
    brdf: &'n Brdf,
    gaussians: &'n [[f32; 2]],
) -> Result<CoarseSurface<'n>, Failure> {
    let (heights, lobes, base_color) = (heights(map)?, lobes(distributions)?, colors(tint)?);
    Ok(CoarseSurface { heights, lobes, base_color, brdf, gaussians })
}

/// An artifact is not what its stage makes: no store of ours gives such a thing.
pub(super) fn of_another_kind() -> Failure {
    Failure::Refused("a stored result is of another kind than its stage makes; empty the cache, and build again".into())
}

pub(super) fn heights(need: &Need) -> Result<&HeightField, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Heights(heights)) => Ok(heights),
        _ => Err(of_another_kind()),
    }
}

pub(super) fn lobes(need: &Need) -> Result<&Vec<Vec<VmfLobe>>, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Lobes(lobes)) => Ok(lobes),
        _ => Err(of_another_kind()),
    }
}

/// Colours, where there is such an action.
pub(super) fn colors(need: Option<&Need>) -> Result<Option<&[[f32; 3]]>, Failure> {
    match need.map(|need| need.artifact.as_deref()) {
        None => Ok(None),
        Some(Some(Artifact::Colors(colors))) => Ok(colors.as_deref()),
        Some(_) => Err(of_another_kind()),
    }
}

pub(super) fn fit(need: &Need) -> Result<&LevelFit, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Fit(fit)) => Ok(fit),
        _ => Err(of_another_kind()),
    }
}

pub(super) fn choice(need: &Need) -> Result<&Choice, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Choice(choice)) => Ok(choice),
        _ => Err(of_another_kind()),
    }
}

pub(super) fn error(need: &Need) -> Result<LevelError, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Error(error)) => Ok(*error),
        _ => Err(of_another_kind()),
    }
}

fn fine_f(need: &Need) -> Result<&FineTables, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Fine(tables)) => Ok(tables),
        _ => Err(of_another_kind()),
    }
}

fn table(need: &Need) -> Result<&PatchReflectance, Failure> {
    match need.artifact.as_deref() {
        Some(Artifact::Reflectance(table)) => Ok(table),
        _ => Err(of_another_kind()),
    }
}
