//! Speed and size against error: a surface is built for a row of targets, and every result is measured alike.
//!
//! Two errors stand beside the cost of a level. ε over one grid of patches, the same for all targets, for levels whose T
//! has other patches cannot be compared over their own; and the error of an image, level against original under one area
//! light, with noise told from bias by two independent halves. [`study`] takes the choice itself apart.

mod image;
mod plot;
mod study;
mod written;

use std::path::Path;

use formats::asset::{Figure, SurfaceAsset, SurfaceLevel};
use serde::Serialize;

use self::image::Reference;
use super::metrics::Interval;
use crate::build::clock::StageClock;
use crate::build::encode::{bytes_by_part, surface_asset};
use crate::build::level::{self, BuiltLevel};
use crate::build::level_error::{Grid, measure_over};
use crate::build::{Input, SurfaceSpec, input};

pub use plot::plots;
pub use study::{Study, study};
pub use written::{level_lines, study_tables, table};

/// Targets that are swept where none are named: from what the smallest tables reach to what none do.
pub const TARGETS: [f64; 7] = [0.16, 0.08, 0.04, 0.03, 0.02, 0.01, 0.005];

/// Points per axis of a patch of the common grid: 256 patches of 1024 points, about as many rays as for a level of 4 × 4.
const GRID_POINTS: usize = 32;

/// Patches of the common grid per axis, where there are as many cells.
const GRID_PATCHES: usize = 16;

/// What is swept, and how it is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct TradeoffSettings {
    /// Targets, ε below 75°.
    pub errors: Vec<f64>,
    /// The one level to sweep, from 1; `None` is all.
    pub level: Option<usize>,
    /// Width and height of the images in pixels.
    pub size: usize,
    /// Samples a pixel of either half of an image.
    pub samples_per_half: u32,
    /// Seed of the images.
    pub seed: u64,
}

/// A sweep of one surface.
#[derive(Clone, Debug, Serialize)]
pub struct Tradeoff {
    /// Surface.
    pub name: String,
    /// Its levels.
    pub levels: Vec<LevelTradeoff>,
}

/// A sweep of one level.
#[derive(Clone, Debug, Serialize)]
pub struct LevelTradeoff {
    /// Number of the level.
    pub level: u32,
    /// Source texels a cell along u and v.
    pub factor: [f64; 2],
    /// Patches of the common grid.
    pub grid: [usize; 2],
    /// One row a target, in their order.
    pub rows: Vec<Row>,
}

/// What one target gave.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// ε below 75° that was aimed at.
    pub target: f64,
    /// The level that came out.
    #[serde(flatten)]
    pub tables: TablesRow,
    /// ε below 75° that was predicted over the finest grid when sizes were chosen.
    pub predicted: Option<f64>,
    /// ε below 75° over the patches of T, which the asset states and the target is held against.
    pub own: Figure,
    /// Relative mean square error of the image without its noise.
    pub image: Option<Interval>,
    /// Relative error of the image's mean.
    pub image_mean: Option<Interval>,
}

/// Sizes of a level's tables, what they cost and their errors over the common grid.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TablesRow {
    /// Patches of T along u and v.
    #[serde(rename = "M")]
    pub patches: [usize; 2],
    /// Direction cells of S per axis.
    #[serde(rename = "N")]
    pub directions: usize,
    /// Terms of the product.
    pub rank: usize,
    /// Most lobes of a cell.
    pub lobes: usize,
    /// ε below 75°.
    pub below_75: Figure,
    /// ε with a direction above 75°.
    pub above_75: Figure,
    /// CPU seconds to compile the level, reading and measuring left out.
    pub cpu_seconds: f64,
    /// Bytes of its payloads.
    pub bytes: u64,
}

/// Sweeps the targets over all levels of `spec`; `on_step` hears what is built. The error is one line.
pub fn sweep(
    spec: &SurfaceSpec,
    folder: &Path,
    settings: &TradeoffSettings,
    on_step: &mut dyn FnMut(&str),
) -> Result<Tradeoff, String> {
    let input = input::read(spec, folder).map_err(|error| error.to_string())?;
    let indices = (1..=spec.levels.len()).filter(|index| settings.level.is_none_or(|level| level == *index));
    let levels = indices.map(|index| sweep_level(spec, &input, index, settings, on_step));
    Ok(Tradeoff { name: spec.name.clone(), levels: levels.collect::<Result<_, _>>()? })
}

/// Sweeps the targets over one level.
fn sweep_level(
    spec: &SurfaceSpec,
    input: &Input,
    index: usize,
    settings: &TradeoffSettings,
    on_step: &mut dyn FnMut(&str),
) -> Result<LevelTradeoff, String> {
    let mut reference = None;
    let mut rows: Vec<Row> = Vec::new();
    let mut seen: Vec<SurfaceAsset> = Vec::new();
    let mut grid = [1, 1];
    for &target in &settings.errors {
        on_step(&format!("{}: level {index}, error {target}", spec.name));
        let mut aimed = spec.clone();
        aimed.levels.iter_mut().for_each(|level| level.error = target);
        let trial = Trial::build(&aimed, input, index)?;
        grid = trial.grid();
        // targets that lead to the same level share its errors, not its time
        let mut known = trial.decoded.clone();
        known.settings = serde_json::Value::Null;
        let row = match seen.iter().position(|asset| *asset == known) {
            Some(place) => Row { target, predicted: trial.built.predicted, ..rows[place].clone() },
            None => {
                let drawn = reference.get_or_insert_with(|| Reference::draw(spec, input, &trial.decoded, settings));
                let (image, image_mean) = drawn.errors(&trial.decoded, settings);
                let own = trial.built.error.below_75;
                Row { target, tables: trial.row(input), predicted: trial.built.predicted, own, image, image_mean }
            }
        };
        seen.push(known);
        let tables = TablesRow { cpu_seconds: trial.cpu_seconds, ..row.tables };
        rows.push(Row { tables, ..row });
    }
    let factor = seen.first().map_or([1.0; 2], |asset| asset.levels[0].factor);
    Ok(LevelTradeoff { level: index as u32, factor, grid, rows })
}

/// A level built with certain settings.
struct Trial {
    built: BuiltLevel,
    decoded: SurfaceAsset,
    cpu_seconds: f64,
    bytes: u64,
}

impl Trial {
    fn build(spec: &SurfaceSpec, input: &Input, index: usize) -> Result<Self, String> {
        let built = level::build_level(spec, input, index, StageClock::default(), &mut |_| {})?;
        let cpu_seconds = built.clock.stages().iter().filter(|(stage, _)| *stage != "measure").map(|(_, s)| s).sum();
        let asset = surface_asset(spec, &input.sources(), vec![SurfaceLevel { error: None, ..built.level.clone() }]);
        let files = asset.encode().map_err(|error| error.to_string())?;
        let bytes = bytes_by_part(&files, index as u32).values().sum();
        let decoded = crate::build::encode::decoded(&files).map_err(|error| error.to_string())?;
        Ok(Self { built, decoded, cpu_seconds, bytes })
    }

    fn level(&self) -> &SurfaceLevel {
        &self.decoded.levels[0]
    }

    /// Patches of the common grid.
    fn grid(&self) -> [usize; 2] {
        self.level().cells.map(|cells| cells.min(GRID_PATCHES))
    }

    fn row(&self, input: &Input) -> TablesRow {
        let reference = level::reference(input, &self.decoded, self.built.on_node, self.decoded.seed);
        let error = measure_over(&reference, self.level(), Grid { patches: self.grid(), points: GRID_POINTS });
        TablesRow {
            patches: self.level().patches,
            directions: self.level().directions,
            rank: self.level().spatial.len(),
            lobes: self.level().lobes.len(),
            below_75: error.below_75,
            above_75: error.above_75,
            cpu_seconds: self.cpu_seconds,
            bytes: self.bytes,
        }
    }
}
