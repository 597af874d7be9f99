//! What the actions of a surface are, what they call, and how much memory they need.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::SurfaceFiles;
use super::assemble::{asset, is_loaded, measured};
use super::needs::{coarse_surface, colors, fine_surface, heights, need_size, size_of, table};
use super::settings::{ASSET, patches, version_of, walk_step};
use crate::build::action::{Facts, Failure, Made, Need, Record, Step};
use crate::build::artifact::Artifact;
use crate::build::key::{Digest, Walk};
use crate::build::{SurfaceSpec, input};
use crate::io::SourceFile;
use crate::io::color::decode_color;
use crate::material::Brdf;
use crate::prefilter::surface::coarse::coarse_reflectance;
use crate::prefilter::surface::reflectance::{TableDirections, pair_count};
use crate::prefilter::surface::{
    LevelSettings, base_gaussians, cell_colors, coarse_cells, fit_level, level_heights, level_lobes, patch_counts,
    reflectance, smoothed,
};

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
        /// Of the level.
        settings: &'a LevelSettings,
        /// The base BRDF.
        brdf: &'a Brdf,
    },
    /// T and S.
    Fit {
        /// Of the level.
        settings: &'a LevelSettings,
        /// Of the surface.
        spec: &'a SurfaceSpec,
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
        walk_step(self, needs, walk);
    }

    fn working_bytes(&self, needs: &[Arc<Record>]) -> u64 {
        let product = |size: [usize; 2]| (size[0] * size[1]) as u64;
        let texels = product(size_of(needs));
        let cells = |settings: &LevelSettings| product(coarse_cells(size_of(needs), settings.factor));
        let tables = |settings: &LevelSettings| {
            let patches = (settings.patches * settings.patches) as u64;
            3 * 4 * patches * pair_count(settings.directions * settings.directions) as u64
        };
        match self {
            Self::Heights { path, .. } => DECODE * file_bytes(path),
            Self::Colors { path, .. } => 12 * texels + DECODE * file_bytes(path),
            Self::Downsample { settings } => 4 * texels + DOWNSAMPLE * cells(settings),
            Self::Lobes { settings } => 4 * texels + LOBES * cells(settings),
            Self::Tint { settings } => 24 * cells(settings),
            Self::Fine { settings, .. } => {
                let bits = (settings.directions * settings.directions) as u64;
                // and a colour map is copied
                let color = if needs.len() > 1 { 12 } else { 0 };
                (FINE + color) * texels + bits * texels / 8 + 4 * tables(settings)
            }
            Self::Smooth { settings, .. } => {
                (16 << 20) + 2 * (DOWNSAMPLE + LOBES) * cells(settings) + 2 * tables(settings)
            }
            // Its first need is of the size of the level.
            Self::Coarse { settings, .. } => {
                let cells = needs.first().map_or(0, |heights| heights.bytes() / 4);
                (16 << 20) + LOBES * cells + 4 * tables(settings)
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
                Artifact::Heights(level_heights(heights(&needs[0])?, settings.factor))
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
            Self::Fine { settings, brdf } => fine(settings, brdf, needs, on_stage)?,
            Self::Smooth { settings, brdf } => {
                on_stage("smooth");
                let (gaussians, directions) = (base_gaussians(brdf), TableDirections::new(settings.directions));
                let surface = coarse_surface([&needs[1], &needs[2]], needs.get(4), brdf, &gaussians)?;
                let (f_fine, _) = table(&needs[3])?;
                Artifact::Heights(smoothed(heights(&needs[0])?, settings.factor, &surface, f_fine, &directions))
            }
            Self::Coarse { settings, brdf } => {
                on_stage("coarse");
                let (gaussians, directions) = (base_gaussians(brdf), TableDirections::new(settings.directions));
                let surface = coarse_surface([&needs[0], &needs[1]], needs.get(2), brdf, &gaussians)?;
                let patches = patch_counts(surface.heights.size(), settings.patches);
                Artifact::Reflectance(coarse_reflectance(&surface, patches, &directions), 0.0)
            }
            Self::Fit { settings, spec } => {
                on_stage("fit");
                let patches = patch_counts(heights(&needs[0])?.size(), settings.patches);
                let ((f_fine, noise), (f_coarse, _)) = (table(&needs[1])?, table(&needs[2])?);
                let directions = TableDirections::new(settings.directions);
                let fit = fit_level([f_fine, f_coarse], noise, patches, &directions, settings.rank, spec.boundary);
                Artifact::Fit(fit)
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
            Self::Asset { spec, .. } => is_loaded(spec, need, needs.len()),
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

fn fine(
    settings: &LevelSettings,
    brdf: &Brdf,
    needs: &[Need],
    on_stage: &mut dyn FnMut(&'static str),
) -> Result<Artifact, Failure> {
    let surface = fine_surface(&needs[0], needs.get(1), brdf)?;
    let patches = patches(settings, surface.heights.size());
    let directions = TableDirections::new(settings.directions);
    let (table, noise) = reflectance(&surface, patches, &directions, settings, on_stage);
    Ok(Artifact::Reflectance(table, noise))
}
