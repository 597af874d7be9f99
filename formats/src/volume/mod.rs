//! A volume asset as plain arrays: coarse levels of a cloud of microflakes.
//!
//! A voxel that is not empty holds the density ρ of flake area (1/m) and lobes of flakes, [`FlakeLobe`], whose areas sum to
//! 1; [`crate::sggx`] evaluates them. Levels are sparse: what they hold is listed for occupied voxels alone.

mod bricks;
mod decode;
mod document;
mod encode;
mod packing;

pub use packing::{MIN_SHAPE, quantised_voxel};

use crate::asset::{Figure, MAX_LEVELS, PayloadFile};
use crate::sggx::{self, FlakeLobe};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Most voxels of a level along one axis: what graphics hardware takes as a 3D texture.
pub const MAX_VOXELS: usize = 2048;
/// Most lobes of a voxel.
pub const MAX_VOLUME_LOBES: usize = 8;
/// The number that stands for the largest density of a level: halves keep 11 bits from there down to 2e-9 of it.
pub const MAX_STORED_DENSITY: f32 = 32768.0;
/// Most bricks that a level stores: 2^28 voxels, a GiB of memory a texture.
pub const MAX_BRICKS: usize = 1 << 19;
/// Voxels of a brick along one axis.
pub const BRICK: usize = bricks::BRICK;

/// A prefiltered volume: its coarse levels and where they come from.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeAsset {
    /// Name in the manifest.
    pub name: String,
    /// Metres along x, y and z of a voxel of the source.
    pub voxel: [f64; 3],
    /// Axes along which the volume goes on without end.
    pub repeat: [bool; 3],
    /// The density grid that was compiled.
    pub source: VolumeSource,
    /// Settings of the build, canonical; not needed to read the asset.
    pub settings: serde_json::Value,
    /// Version of each stage that made the asset.
    pub versions: BTreeMap<String, String>,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Instruction set of the float kernels; bytes are equal within one.
    pub isa: String,
    /// Levels from fine to coarse.
    pub levels: Vec<VolumeLevel>,
}

/// The density grid behind a volume asset.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct VolumeSource {
    /// BLAKE3 of the file's bytes, 64 hex digits.
    pub digest: String,
    /// Voxels along x, y and z.
    pub size: [u32; 3],
}

/// One coarse level, complete in itself.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeLevel {
    /// Number of the level, from 1; 0 is the source.
    pub index: u32,
    /// Source voxels a voxel of the level along x, y and z.
    pub factor: [f64; 3],
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// Indices (z·ny + y)·nx + x of the voxels that are not empty, rising.
    pub occupied: Vec<u32>,
    /// ρ of the occupied voxels, 1/m, greater than 0.
    pub density: Vec<f32>,
    /// `[lobe][occupied voxel]`; area 0 where a voxel uses fewer. The areas of a voxel sum to 1.
    pub lobes: Vec<Vec<FlakeLobe>>,
    /// Measured errors by name.
    pub error: BTreeMap<String, Figure>,
    /// Diagnostics of the fit of its weights, any JSON; not needed to read the level.
    pub fit: serde_json::Value,
    /// What kept the level from its target, if anything.
    pub limited_by: Option<String>,
}

/// What an occupied voxel holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Voxel {
    /// ρ, 1/m.
    pub density: f32,
    /// Its lobes, those of area 0 left out.
    pub lobes: Vec<FlakeLobe>,
}

impl VolumeLevel {
    /// The voxel that holds the fraction `x` ∈ [0, 1) of the volume along x, y and z; `None` where it is empty.
    pub fn voxel_at(&self, x: [f32; 3]) -> Option<Voxel> {
        // x just under 1 may round up to `size`.
        let [i, j, k] = [0, 1, 2].map(|axis| ((x[axis] * self.size[axis] as f32) as usize).min(self.size[axis] - 1));
        let index = u32::try_from((k * self.size[1] + j) * self.size[0] + i).ok()?;
        self.occupied.binary_search(&index).ok().map(|place| self.voxel(place))
    }

    /// Occupied voxel number `place`.
    pub fn voxel(&self, place: usize) -> Voxel {
        let lobes = self.lobes.iter().map(|lobe| lobe[place]).filter(|lobe| lobe.area > 0.0).collect();
        Voxel { density: self.density[place], lobes }
    }
}

impl Voxel {
    /// σ_t(ω) = ρ Σ_j φ_j σ_j(ω), 1/m, of light that comes from or goes to the unit direction `w`.
    pub fn extinction(&self, w: [f32; 3]) -> f32 {
        self.density * sggx::projected_area(&self.lobes, w)
    }

    /// p(ω, ω′), 1/sr, RGB; its integral over `wi` is the albedo seen from `w`. Both point away from the voxel.
    pub fn phase(&self, w: [f32; 3], wi: [f32; 3]) -> [f32; 3] {
        sggx::phase(&self.lobes, w, wi)
    }
}
