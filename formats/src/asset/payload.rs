//! What a payload's texels mean: its role, its size, and values to half floats and back.

use super::{MAX_HALF, MAX_LOG_KAPPA, SurfaceLevel};
use crate::Error;
use crate::cell_brdf::Lobe;
use crate::ktx2::{TexelFormat, Texels};
use crate::lookup::{octahedral_decode, octahedral_encode};
use half::f16;

/// Meaning of one payload file of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Heights,
    Lobe(usize),
    BaseColor,
    Spatial(usize),
    Angular(usize),
    AdditiveSpatial,
    AdditiveAngular,
}

/// The counts of a level that decide which payloads it has and how large they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
    pub(super) cells: [usize; 2],
    pub(super) lobes: usize,
    pub(super) has_color: bool,
    pub(super) patches: [usize; 2],
    pub(super) directions: usize,
    pub(super) rank: usize,
    /// Direction cells per axis of the additive term, if there is one.
    pub(super) additive: Option<usize>,
}

impl Shape {
    pub(super) fn of(level: &SurfaceLevel) -> Self {
        Self {
            cells: level.cells,
            lobes: level.lobes.len(),
            has_color: level.base_color.is_some(),
            patches: level.patches,
            directions: level.directions,
            rank: level.spatial.len(),
            additive: level.additive.as_ref().map(|term| term.directions),
        }
    }

    /// Every payload of the level, in the order of `asset.json`.
    pub(super) fn roles(&self) -> Vec<Role> {
        let mut roles = vec![Role::Heights];
        roles.extend((0..self.lobes).map(Role::Lobe));
        roles.extend(self.has_color.then_some(Role::BaseColor));
        roles.extend((0..self.rank).map(Role::Spatial));
        roles.extend((0..self.rank).map(Role::Angular));
        if self.additive.is_some() {
            roles.extend([Role::AdditiveSpatial, Role::AdditiveAngular]);
        }
        roles
    }

    /// Columns and rows of a payload.
    pub(super) fn size(&self, role: Role) -> [usize; 2] {
        match role {
            Role::Heights | Role::Lobe(_) | Role::BaseColor => self.cells,
            Role::Spatial(_) | Role::AdditiveSpatial => self.patches,
            Role::Angular(_) => [self.directions * self.directions; 2],
            Role::AdditiveAngular => [self.additive.map_or(0, |n| n * n); 2],
        }
    }
}

impl Role {
    /// Name in `asset.json` and in the file's name.
    pub(super) fn name(self) -> String {
        match self {
            Self::Heights => "heights".into(),
            Self::Lobe(lobe) => format!("lobe{lobe}"),
            Self::BaseColor => "base_color".into(),
            Self::Spatial(rank) => format!("spatial{rank}"),
            Self::Angular(rank) => format!("angular{rank}"),
            Self::AdditiveSpatial => "additive_spatial".into(),
            Self::AdditiveAngular => "additive_angular".into(),
        }
    }

    pub(super) fn format(self) -> TexelFormat {
        match self {
            Self::Heights => TexelFormat::Single,
            _ => TexelFormat::Half,
        }
    }
}

/// The texels of a level's payload; an error names the level and the role.
pub(super) fn texels(level: &SurfaceLevel, role: Role) -> Result<Texels, Error> {
    let place = || format!("level {}, {}", level.index, role.name());
    let colors = |values: &[[f32; 3]]| {
        let halves = values.iter().enumerate().map(|(index, &rgb)| color_texel(rgb).map_err(|e| e.at(place(), index)));
        Ok(Texels::Half(halves.collect::<Result<_, _>>()?))
    };
    let amounts = |values: &[[f32; 3]]| match values.iter().position(|rgb| rgb.iter().any(|value| *value < 0.0)) {
        Some(index) => Err(Unfit::new("values of at least 0", values[index]).at(place(), index)),
        None => colors(values),
    };
    match role {
        Role::Heights => match level.heights.iter().position(|height| !height.is_finite()) {
            Some(index) => Err(Unfit::new("a finite height in metres", level.heights[index]).at(place(), index)),
            None => Ok(Texels::Single(level.heights.clone())),
        },
        Role::Lobe(lobe) => {
            let cells = level.lobes[lobe].iter().enumerate();
            let halves = cells.map(|(index, lobe)| lobe_texel(lobe).map_err(|e| e.at(place(), index)));
            Ok(Texels::Half(halves.collect::<Result<_, _>>()?))
        }
        Role::BaseColor => colors(level.base_color.as_deref().unwrap_or_default()),
        Role::Spatial(rank) => colors(&level.spatial[rank]),
        Role::Angular(rank) => colors(&level.angular[rank]),
        Role::AdditiveSpatial => amounts(level.additive.as_ref().map_or(&[], |term| &term.spatial)),
        Role::AdditiveAngular => amounts(level.additive.as_ref().map_or(&[], |term| &term.angular)),
    }
}

/// A value that the format cannot hold.
struct Unfit {
    wanted: &'static str,
    found: String,
}

impl Unfit {
    fn new(wanted: &'static str, found: impl std::fmt::Debug) -> Self {
        Self { wanted, found: format!("{found:?}") }
    }

    fn at(self, role: String, index: usize) -> Error {
        Error::Value { role, index, wanted: self.wanted.into(), found: self.found }
    }
}

fn color_texel(rgb: [f32; 3]) -> Result<[f16; 4], Unfit> {
    // Written so that NaN fails too.
    if !rgb.iter().all(|value| value.abs() <= MAX_HALF) {
        return Err(Unfit::new("finite values of magnitude at most 6e4", rgb));
    }
    let [r, g, b] = rgb.map(f16::from_f32);
    Ok([r, g, b, f16::ONE])
}

fn lobe_texel(lobe: &Lobe) -> Result<[f16; 4], Unfit> {
    /// A unit vector in f32 is off by a few 1e-7; further off, something else was meant.
    const UNIT: f32 = 1e-4;
    if !(0.0..=MAX_HALF).contains(&lobe.weight) {
        return Err(Unfit::new("a lobe weight in [0, 6e4]", lobe.weight));
    }
    let weight = f16::from_f32(lobe.weight);
    if weight == f16::ZERO {
        return Ok([f16::ZERO; 4]);
    }
    let log_kappa = f64::from(lobe.kappa).ln_1p() as f32;
    if !(0.0..=MAX_LOG_KAPPA).contains(&log_kappa) {
        return Err(Unfit::new("a lobe κ in [0, 4.8e8]", lobe.kappa));
    }
    let length = lobe.mean.iter().map(|c| c * c).sum::<f32>().sqrt();
    if !(1.0 - UNIT..=1.0 + UNIT).contains(&length) {
        return Err(Unfit::new("a lobe mean of length 1", lobe.mean));
    }
    let [p, q] = octahedral_encode(lobe.mean);
    Ok([f16::from_f32(p), f16::from_f32(q), f16::from_f32(log_kappa), weight])
}

/// The lobe that a reader finds in place of `lobe`; for values that [`super::SurfaceAsset::encode`] takes.
pub fn quantised_lobe(lobe: &Lobe) -> Lobe {
    lobe_texel(lobe).map_or(*lobe, lobe_of)
}

/// The value that a reader finds in place of `rgb`; for values that [`super::SurfaceAsset::encode`] takes.
pub fn quantised(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|value| f16::from_f32(value).to_f32())
}

/// The lobe of a texel; weight 0 is the same unused lobe whatever the rest of the texel holds.
fn lobe_of([p, q, log_kappa, weight]: [f16; 4]) -> Lobe {
    if weight == f16::ZERO {
        return Lobe { mean: [0.0, 0.0, 1.0], kappa: 0.0, weight: 0.0 };
    }
    Lobe {
        mean: octahedral_decode([p.to_f32(), q.to_f32()]),
        kappa: log_kappa.to_f64().exp_m1() as f32,
        weight: weight.to_f32(),
    }
}

/// The lobes of a payload of file `path`.
pub(super) fn lobes_of(path: &str, texels: &[[f16; 4]]) -> Result<Vec<Lobe>, Error> {
    let valid = |&[p, q, log_kappa, weight]: &[f16; 4]| {
        let inside = |value: f16, low: f32, high: f32| (low..=high).contains(&value.to_f32());
        inside(p, -1.0, 1.0)
            && inside(q, -1.0, 1.0)
            && inside(log_kappa, 0.0, MAX_LOG_KAPPA)
            && inside(weight, 0.0, MAX_HALF)
    };
    match texels.iter().position(|texel| !valid(texel)) {
        Some(index) => Err(bad_texel(path, index, "(−1…1, −1…1, 0…20, 0…6e4)", texels[index].map(f16::to_f32))),
        None => Ok(texels.iter().copied().map(lobe_of).collect()),
    }
}

/// The RGB values of a payload of file `path`.
pub(super) fn colors_of(path: &str, texels: &[[f16; 4]]) -> Result<Vec<[f32; 3]>, Error> {
    let valid = |texel: &[f16; 4]| texel[..3].iter().all(|value| value.to_f32().abs() <= MAX_HALF);
    match texels.iter().position(|texel| !valid(texel)) {
        Some(index) => Err(bad_texel(path, index, "values of magnitude at most 6e4", texels[index].map(f16::to_f32))),
        None => Ok(texels.iter().map(|&[r, g, b, _]| [r, g, b].map(f16::to_f32)).collect()),
    }
}

/// The RGB values of a payload of file `path` that holds no negative ones.
pub(super) fn amounts_of(path: &str, texels: &[[f16; 4]]) -> Result<Vec<[f32; 3]>, Error> {
    match texels.iter().position(|texel| texel[..3].iter().any(|value| value.to_f32() < 0.0)) {
        Some(index) => Err(bad_texel(path, index, "values of at least 0", texels[index].map(f16::to_f32))),
        None => colors_of(path, texels),
    }
}

/// The heights of a payload of file `path`.
pub(super) fn heights_of(path: &str, heights: Vec<f32>) -> Result<Vec<f32>, Error> {
    match heights.iter().position(|height| !height.is_finite()) {
        Some(index) => Err(bad_texel(path, index, "a finite height", heights[index])),
        None => Ok(heights),
    }
}

fn bad_texel(path: &str, index: usize, wanted: &str, found: impl std::fmt::Debug) -> Error {
    Error::malformed(path, format!("texel {index}"), wanted, format!("{found:?}"))
}
