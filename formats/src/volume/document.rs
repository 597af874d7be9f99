//! `asset.json` of a volume as serde sees it: its keys in their order, and the checks that need no payload.

use super::packing::AlbedoRange;
use super::{MAX_BRICKS, MAX_LEVELS, MAX_VOLUME_LOBES, MAX_VOXELS, VolumeAsset, VolumeLevel, VolumeSource};
use crate::Error;
use crate::asset::document::{FORMAT, Fault, FileDocument, is_digest, parse_document, within};
use crate::asset::{DOCUMENT, Figure, VERSION};
use crate::ktx2::TexelFormat;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

use super::bricks::{BRICK, BRICK_VOXELS, atlas_for, bricks_over};

/// Value of `kind`.
pub(super) const KIND: &str = "volume";

#[derive(Serialize, Deserialize)]
pub(super) struct Document {
    format: String,
    version: u32,
    kind: String,
    name: String,
    voxel: [f64; 3],
    repeat: [bool; 3],
    source: VolumeSource,
    settings: serde_json::Value,
    versions: BTreeMap<String, String>,
    seed: u64,
    isa: String,
    pub(super) levels: Vec<LevelDocument>,
}

#[derive(Serialize, Deserialize)]
pub(super) struct LevelDocument {
    pub(super) index: u32,
    pub(super) factor: [f64; 3],
    pub(super) size: [usize; 3],
    pub(super) occupied: usize,
    pub(super) bricks: usize,
    pub(super) atlas: [usize; 3],
    /// 1/m of the stored density 1.
    pub(super) density: f32,
    /// Range of each lobe's albedo.
    pub(super) albedo: Vec<AlbedoRange>,
    pub(super) lobes: usize,
    pub(super) files: Vec<FileDocument>,
    pub(super) error: BTreeMap<String, Figure>,
    pub(super) fit: serde_json::Value,
    pub(super) limited_by: Option<String>,
}

/// Meaning of one payload file of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Bricks,
    Density,
    /// M_xx, M_yy, M_zz, M_xy of a lobe.
    Shape(usize),
    /// Albedo and M_xz of a lobe.
    Albedo(usize),
    /// M_yz of a lobe.
    Shear(usize),
}

impl Role {
    /// Every payload of a level of so many lobes, in the order of `asset.json`.
    pub(super) fn all(lobes: usize) -> Vec<Self> {
        let of_lobe = |lobe| [Self::Shape(lobe), Self::Albedo(lobe), Self::Shear(lobe)];
        [Self::Bricks, Self::Density].into_iter().chain((0..lobes).flat_map(of_lobe)).collect()
    }

    /// Name in `asset.json` and in the file's name.
    pub(super) fn name(self) -> String {
        match self {
            Self::Bricks => "bricks".into(),
            Self::Density => "density".into(),
            Self::Shape(lobe) => format!("shape{lobe}"),
            Self::Albedo(lobe) => format!("albedo{lobe}"),
            Self::Shear(lobe) => format!("shear{lobe}"),
        }
    }

    pub(super) fn format(self) -> TexelFormat {
        match self {
            Self::Bricks => TexelFormat::Index,
            Self::Density => TexelFormat::HalfSingle,
            Self::Shape(_) | Self::Albedo(_) => TexelFormat::Bytes,
            Self::Shear(_) => TexelFormat::Byte,
        }
    }

    /// Texels of the payload along x, y and z.
    pub(super) fn size(self, level: &LevelDocument) -> [usize; 3] {
        match self {
            Self::Bricks => bricks_over(level.size),
            _ => level.atlas.map(|bricks| bricks * BRICK),
        }
    }
}

impl Document {
    pub(super) fn new(asset: &VolumeAsset, levels: Vec<LevelDocument>) -> Self {
        Self {
            format: FORMAT.into(),
            version: VERSION,
            kind: KIND.into(),
            name: asset.name.clone(),
            voxel: asset.voxel,
            repeat: asset.repeat,
            source: asset.source.clone(),
            settings: asset.settings.clone(),
            versions: asset.versions.clone(),
            seed: asset.seed,
            isa: asset.isa.clone(),
            levels,
        }
    }

    /// The document in `bytes`, its counts and numbers checked.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, Error> {
        let document: Self = parse_document(bytes, KIND)?;
        document.check().map_err(|fault| Error::malformed(DOCUMENT, fault.place, fault.wanted, fault.found))?;
        Ok(document)
    }

    /// The asset without its levels.
    pub(super) fn into_asset(self, levels: Vec<VolumeLevel>) -> VolumeAsset {
        VolumeAsset {
            name: self.name,
            voxel: self.voxel,
            repeat: self.repeat,
            source: self.source,
            settings: self.settings,
            versions: self.versions,
            seed: self.seed,
            isa: self.isa,
            levels,
        }
    }

    /// The same checks for writer and reader: whatever is written can be read.
    pub(super) fn check(&self) -> Result<(), Fault> {
        /// Range of lengths in metres: an atom and a light year, so that products with densities stay finite.
        const LENGTHS: [f64; 2] = [1e-10, 1e16];
        for (axis, &metres) in self.voxel.iter().enumerate() {
            within(format!("`voxel`[{axis}] in metres"), metres, LENGTHS[0], LENGTHS[1])?;
        }
        for &voxels in &self.source.size {
            within("`source.size`", voxels, 1, u32::MAX)?;
        }
        if !is_digest(&self.source.digest) {
            return Err(Fault::new("`source.digest`", "64 hex digits", format!("`{}`", self.source.digest)));
        }
        within("number of `levels`", self.levels.len(), 0, MAX_LEVELS)?;
        for pair in self.levels.windows(2) {
            within("`index` of a level", pair[1].index, pair[0].index.saturating_add(1), u32::MAX)?;
        }
        self.levels.iter().try_for_each(LevelDocument::check)
    }
}

impl LevelDocument {
    fn check(&self) -> Result<(), Fault> {
        /// Most 1/m of the stored density 1: an atom's width is opaque.
        const MAX_DENSITY: f32 = 1e8;
        /// No error figure is larger, whatever was compiled.
        const MAX_FIGURE: f64 = 1e30;
        let key = |name: &str| format!("level {}, `{name}`", self.index);
        within(key("index"), self.index, 1, u32::MAX)?;
        for axis in 0..3 {
            within(key("factor"), self.factor[axis], 1.0, f64::from(u32::MAX))?;
            within(key("size"), self.size[axis], 1, MAX_VOXELS)?;
        }
        let voxels: usize = self.size.iter().product();
        within(format!("level {}, product of `size`", self.index), voxels, 1, u32::MAX as usize)?;
        let over: usize = bricks_over(self.size).iter().product();
        within(key("bricks"), self.bricks, 0, over.min(MAX_BRICKS))?;
        within(key("occupied"), self.occupied, self.bricks, voxels.min(self.bricks * BRICK_VOXELS))?;
        if self.atlas != atlas_for(self.bricks) {
            let wanted = format!("{:?} for {} bricks", atlas_for(self.bricks), self.bricks);
            return Err(Fault::new(key("atlas"), wanted, format!("{:?}", self.atlas)));
        }
        within(key("density"), self.density, f32::MIN_POSITIVE, MAX_DENSITY)?;
        within(key("lobes"), self.lobes, 1, MAX_VOLUME_LOBES)?;
        within(key("albedo"), self.albedo.len(), self.lobes, self.lobes)?;
        for [low, high] in &self.albedo {
            for channel in 0..3 {
                within(key("albedo"), high[channel], 0.0, 1.0)?;
                within(key("albedo"), low[channel], 0.0, high[channel])?;
            }
        }
        for (name, figure) in &self.error {
            within(key(name), figure.value, -MAX_FIGURE, MAX_FIGURE)?;
            within(key(name), figure.standard_error, 0.0, MAX_FIGURE)?;
        }
        Ok(())
    }
}
