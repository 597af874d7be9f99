//! What the actions of a surface are, what they call, and how much memory they need.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::SurfaceFiles;
use super::assemble::{asset, is_loaded, measured};
use super::needs::{choice, coarse_surface, colors, error, fine_f, fine_surface, heights, need_size, size_of, table};
use super::settings::{ASSET, is_fixed, version_of, walk_step};
use crate::build::action::{Facts, Failure, Made, Need, Record, Step};
use crate::build::artifact::Artifact;
use crate::build::key::{Digest, Walk};
use crate::build::level::lower_aim;
use crate::build::{SurfaceSpec, input};
use crate::io::SourceFile;
use crate::io::color::decode_color;
use crate::material::Brdf;
use crate::prefilter::surface::reflectance::pair_count;
use crate::prefilter::surface::{
    Choice, LevelSettings, TableSizes, base_gaussians, cell_colors, choose, coarse_cells, coarse_heights, coarse_table,
    fine_tables, fit_level, level_heights, level_lobes,
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
        /// Of the level.
        settings: &'a LevelSettings,
        /// The base BRDF.
        brdf: &'a Brdf,
    },
    /// T and S, and the additive term.
    Fit {
        /// Of the level.
        settings: &'a LevelSettings,
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
        walk_step(self, needs, walk);
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
            Self::Choose { settings, .. } if is_fixed(settings) => 1 << 10,
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
            Self::Coarse { brdf, .. } => {
                let gaussians = base_gaussians(brdf);
                let surface = coarse_surface([&needs[0], &needs[1]], needs.get(3), brdf, &gaussians)?;
                Artifact::Reflectance(coarse_table(choice(&needs[2])?, &surface, on_stage))
            }
            Self::Fit { settings } => {
                on_stage("fit");
                let (heights, sizes) = (heights(&needs[0])?, choice(&needs[3])?.sizes);
                Artifact::Fit(fit_level(fine_f(&needs[1])?, table(&needs[2])?, heights, sizes, settings.error))
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
            Self::Choose { settings, .. } => !is_fixed(settings),
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

/// Bytes of a table of F whose size is chosen, at most, and the most direction cells that are chosen.
const MOST_CHOSEN: u64 = 24 << 20;
const LARGEST_CHOSEN: usize = 21;

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
