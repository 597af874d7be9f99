//! What may stand for a surface in a render: the original, its prefiltered levels, or a baseline.
//!
//! A [`ModelData`] owns heights and materials of each level; [`ModelData::object`] lends them to a scene. All models run
//! through the same renderer and differ in nothing else.

mod farfield;
mod full;
mod leadr;
mod lobes;
mod naive;

use formats::asset::{Light, SurfaceAsset};
use formats::level_brdf::LevelBrdf;
use serde::Serialize;

use super::Input;
use crate::geometry::{DisplacedPlane, HeightField, HeightTracer, LargeShape};
use crate::material::{Brdf, SlopeMoments};
use crate::prefilter::surface::FineSurface;
use crate::transport::render::Integrator;
use crate::transport::scene::{RenderLevel, SurfaceObject};
use crate::transport::shading::Shading;

/// What is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Model {
    /// The prefiltered levels of the asset.
    Farfield,
    /// The surface at full resolution.
    Full,
    /// Averaged heights with the base BRDF.
    Naive,
    /// The asset's coarse heights and lobes, without its scaling.
    Lobes,
    /// Averaged heights with one Beckmann lobe a cell.
    Leadr,
}

/// One model of a surface, ready to be lent to scenes.
#[derive(Clone, Debug)]
pub struct ModelData {
    /// Which model.
    pub model: Model,
    asset: Option<SurfaceAsset>,
    levels: Vec<ModelLevel>,
    texel: [f64; 2],
}

/// Heights and materials of one level.
#[derive(Clone, Debug)]
struct ModelLevel {
    /// Number in the asset; 0 is the source.
    index: u32,
    factor: f64,
    heights: HeightField,
    reflects: Reflects,
}

/// What the points of a level reflect.
#[derive(Clone, Debug)]
enum Reflects {
    /// The base BRDF, with a colour factor a cell.
    Base { brdf: Brdf, color: Option<Vec<[f32; 3]>> },
    /// The level at this place of the asset.
    Prefiltered { place: usize },
    /// Slope moments a cell.
    Leadr { brdf: Brdf, color: Option<Vec<[f32; 3]>>, moments: Vec<SlopeMoments> },
}

impl Model {
    /// As command lines and files call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Farfield => "farfield",
            Self::Full => "full",
            Self::Naive => "naive",
            Self::Lobes => "lobes",
            Self::Leadr => "leadr",
        }
    }
}

impl ModelData {
    /// The surface at full resolution.
    pub fn full(input: &Input) -> Self {
        Self::of_source(Model::Full, &input.fine, vec![full::level(&input.fine)])
    }

    /// Averaged heights on grids of `cells`, fine to coarse.
    pub fn naive(input: &Input, cells: &[[usize; 2]]) -> Self {
        Self::of_source(Model::Naive, &input.fine, levels_of(&input.fine, cells, naive::level))
    }

    /// One Beckmann lobe a cell on grids of `cells`, fine to coarse.
    pub fn leadr(input: &Input, cells: &[[usize; 2]]) -> Self {
        Self::of_source(Model::Leadr, &input.fine, levels_of(&input.fine, cells, leadr::level))
    }

    /// The levels of an asset.
    pub fn farfield(asset: SurfaceAsset) -> Self {
        Self::of_asset(Model::Farfield, asset)
    }

    /// The levels of an asset without their scaling.
    pub fn lobes(asset: &SurfaceAsset) -> Self {
        Self::of_asset(Model::Lobes, lobes::without_scaling(asset))
    }

    fn of_source(model: Model, fine: &FineSurface, levels: Vec<ModelLevel>) -> Self {
        Self { model, asset: None, levels, texel: fine.heights.spacing().map(f64::from) }
    }

    fn of_asset(model: Model, asset: SurfaceAsset) -> Self {
        let levels = farfield::levels(&asset);
        let source = [asset.source.width, asset.source.height];
        let texel = [0, 1].map(|k| asset.size[k] / f64::from(source[k]));
        Self { model, asset: Some(asset), levels, texel }
    }

    /// Numbers of the levels, in order; 0 is the source.
    pub fn indices(&self) -> impl Iterator<Item = u32> + '_ {
        self.levels.iter().map(|level| level.index)
    }

    /// How many levels there are.
    pub fn level_count(&self) -> usize {
        self.levels.len()
    }

    /// The integrator that shows the light which an asset of this `light` stands for.
    ///
    /// What holds interreflection already is rendered with direct light, everything else follows it if the asset has it.
    pub fn integrator(&self, light: Light) -> Integrator {
        match light {
            Light::Baked if self.model != Model::Farfield => Integrator::Path,
            Light::Global => Integrator::Path,
            Light::Direct | Light::Baked => Integrator::Direct,
        }
    }

    /// The surface as `tiles[0] × tiles[1]` tiles, on `large` if there is one.
    pub fn object<'a>(&'a self, tiles: [u32; 2], large: Option<&'a LargeShape>) -> SurfaceObject<'a> {
        let level = |level: &'a ModelLevel| RenderLevel {
            factor: level.factor,
            plane: DisplacedPlane::new(HeightTracer::new(&level.heights), tiles, large),
            shading: self.shading(level),
        };
        SurfaceObject::new(self.levels.iter().map(level).collect(), self.texel)
    }

    fn shading<'a>(&'a self, level: &'a ModelLevel) -> Shading<'a> {
        match &level.reflects {
            Reflects::Base { brdf, color } => Shading::Base { brdf: *brdf, color: color.as_deref() },
            Reflects::Prefiltered { place } => {
                let asset = self.asset.as_ref().expect("prefiltered levels come with their asset");
                Shading::Prefiltered(LevelBrdf::new(asset, &asset.levels[*place]))
            }
            Reflects::Leadr { brdf, color, moments } => {
                Shading::Leadr { brdf: *brdf, color: color.as_deref(), moments }
            }
        }
    }
}

/// A level on each grid.
fn levels_of(
    fine: &FineSurface,
    grids: &[[usize; 2]],
    level: impl Fn(&FineSurface, [usize; 2]) -> (HeightField, Reflects),
) -> Vec<ModelLevel> {
    let of_grid = |(place, &cells): (usize, &[usize; 2])| {
        let (heights, reflects) = level(fine, cells);
        let factor = mean_factor(fine.heights.size(), cells);
        ModelLevel { index: place as u32 + 1, factor, heights, reflects }
    };
    grids.iter().enumerate().map(of_grid).collect()
}

/// Source texels a cell: the geometric mean over both axes.
fn mean_factor(source: [usize; 2], cells: [usize; 2]) -> f64 {
    let [u, v] = [0, 1].map(|k| source[k] as f64 / cells[k] as f64);
    (u * v).sqrt()
}
