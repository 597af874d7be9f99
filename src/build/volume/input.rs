//! The fine volume that a manifest entry describes, read from its files: densities in 1/m, albedos, matrices S.

use std::collections::BTreeMap;
use std::path::Path;

use super::super::manifest::{AlbedoSpec, GridSpec, VolumeSpec};
use super::shapes::{Shapes, read_shapes};
use crate::io::grid::{Grid, decode_grid, voxel_of};
use crate::io::{Error, SourceFile};

/// A fine volume as plain arrays, with the provenance of its files. Voxels of density 0 are empty, whatever else they hold.
#[derive(Clone, Debug)]
pub struct VolumeInput {
    /// Voxels along x, y, z.
    pub size: [usize; 3],
    /// Metres along x, y, z of a voxel.
    pub voxel: [f64; 3],
    /// Axes along which the volume repeats.
    pub repeat: [bool; 3],
    /// Flake area per volume, 1/m, `[z][y][x]`; finite, at least 0.
    pub density: Vec<f32>,
    /// Albedo of the flakes.
    pub albedo: VolumeAlbedo,
    /// S in the order xx yy zz xy xz yz, `[z][y][x]`; eigenvalues from 1e-4 to 1 where there is density.
    pub shapes: Vec<[f32; 6]>,
    /// BLAKE3 of the density file's bytes, 64 hex digits.
    pub density_digest: String,
    /// BLAKE3 of the other files' bytes, by the manifest's key.
    pub digests: BTreeMap<&'static str, String>,
    /// What the user should know about the files, one line each; no names of files, which no key is made of.
    pub warnings: Vec<String>,
}

/// Albedo of the flakes of a volume, linear RGB in [0, 1].
#[derive(Clone, Debug, PartialEq)]
pub enum VolumeAlbedo {
    /// The same in every voxel.
    Constant([f32; 3]),
    /// `[z][y][x]`.
    PerVoxel(Vec<[f32; 3]>),
}

impl VolumeAlbedo {
    /// Of voxel `index`.
    pub fn at(&self, index: usize) -> [f32; 3] {
        match self {
            Self::Constant(rgb) => *rgb,
            Self::PerVoxel(albedos) => albedos[index],
        }
    }
}

impl VolumeInput {
    /// Voxels that hold something.
    pub fn occupied(&self) -> usize {
        self.density.iter().filter(|density| **density > 0.0).count()
    }
}

/// Why a fine volume could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VolumeInputError {
    /// A file is not what it should be.
    #[error("{0}")]
    File(#[from] Error),
    /// A grid of another size than the density's.
    #[error(
        "`{file}`: has {} × {} × {} voxels; wanted {} × {} × {}, those of the density",
        found[0], found[1], found[2], wanted[0], wanted[1], wanted[2]
    )]
    Size {
        /// The grid.
        file: String,
        /// Its voxels.
        found: [usize; 3],
        /// Those of the density.
        wanted: [usize; 3],
    },
    /// A number that means nothing in its place.
    #[error("`{file}`: voxel ({}, {}, {}) has {found}; wanted {wanted}", voxel[0], voxel[1], voxel[2])]
    Value {
        /// The grid.
        file: String,
        /// x, y and z.
        voxel: [usize; 3],
        /// What is there.
        found: String,
        /// What would do.
        wanted: &'static str,
    },
}

/// The files of a volume as they are read: digests are kept, sizes compared.
pub(super) struct Files<'a> {
    folder: &'a Path,
    /// Voxels of the density, once it is read.
    pub(super) size: Option<[usize; 3]>,
    pub(super) digests: BTreeMap<&'static str, String>,
}

impl Files<'_> {
    /// The grid of the manifest's key `key`, with as many numbers a voxel as one of `channels`.
    pub(super) fn read(
        &mut self,
        key: &'static str,
        spec: &GridSpec,
        channels: &[usize],
    ) -> Result<Grid, VolumeInputError> {
        let file = SourceFile::read(&self.folder.join(&spec.file))?;
        let grid = decode_grid(&file, spec.layout.as_ref(), channels)?;
        self.digests.insert(key, blake3::hash(file.bytes()).to_hex().to_string());
        match self.size.filter(|size| *size != grid.size) {
            Some(wanted) => Err(VolumeInputError::Size { file: spec.file.clone(), found: grid.size, wanted }),
            None => Ok(grid),
        }
    }
}

/// Reads the files of `spec`, whose paths are relative to `folder`.
pub fn read(spec: &VolumeSpec, folder: &Path) -> Result<VolumeInput, VolumeInputError> {
    let mut files = Files { folder, size: None, digests: BTreeMap::new() };
    let grey = files.read("density", &spec.density.grid, &[1])?;
    let size = grey.size;
    files.size = Some(size);
    let mut density = densities(spec, &grey)?;
    let albedo = read_albedo(spec, &mut files, &density)?;
    let Shapes { matrices, mut warnings } = read_shapes(spec, &mut files, &grey, &mut density)?;
    let occupied = density.iter().filter(|density| **density > 0.0).count();
    if occupied == 0 {
        warnings.insert(0, "no voxel has a density; check `window` and `scale`".into());
    }
    let density_digest = files.digests.remove("density").expect("the density was read");
    Ok(VolumeInput {
        size,
        voxel: spec.voxel,
        repeat: spec.repeat,
        density,
        albedo,
        shapes: matrices,
        density_digest,
        digests: files.digests,
        warnings,
    })
}

/// Stored values as 1/m.
fn densities(spec: &VolumeSpec, grey: &Grid) -> Result<Vec<f32>, VolumeInputError> {
    let scale = spec.density.scale;
    let largest = f64::from(grey.largest_code.unwrap_or(1.0));
    let density = |value: f32| match spec.density.window {
        Some([low, high]) => ((f64::from(value) - low) / (high - low)).clamp(0.0, 1.0) * scale,
        None => f64::from(value) / largest * scale,
    };
    let convert = |(index, &value): (usize, &f32)| {
        let density = density(value) as f32;
        if (0.0..=MAX_DENSITY).contains(&density) {
            return Ok(density);
        }
        Err(VolumeInputError::Value {
            file: spec.density.grid.file.clone(),
            voxel: voxel_of(index, grey.size),
            found: format!("the density {density} 1/m"),
            wanted: "0 to 1e12",
        })
    };
    grey.values.iter().enumerate().map(convert).collect()
}

/// The largest density in 1/m: an atom's width is opaque.
const MAX_DENSITY: f32 = 1e12;

/// The albedo of voxels that have a density; that of others is not looked at.
fn read_albedo(spec: &VolumeSpec, files: &mut Files<'_>, density: &[f32]) -> Result<VolumeAlbedo, VolumeInputError> {
    let grid_spec = match &spec.albedo {
        AlbedoSpec::Constant(rgb) => return Ok(VolumeAlbedo::Constant(*rgb)),
        AlbedoSpec::Grid(grid) => grid,
    };
    let grid = files.read("albedo", grid_spec, &[1, 3])?;
    let (size, channels) = (grid.size, grid.channels);
    let values = grid.into_fractions();
    let rgb = |voxel: &[f32]| if channels == 1 { [voxel[0]; 3] } else { [voxel[0], voxel[1], voxel[2]] };
    let albedos: Vec<[f32; 3]> = values.chunks_exact(channels).map(rgb).collect();
    let beyond = |rgb: &[f32; 3]| !rgb.iter().all(|value| (0.0..=1.0).contains(value));
    match albedos.iter().zip(density).position(|(rgb, density)| *density > 0.0 && beyond(rgb)) {
        None => Ok(VolumeAlbedo::PerVoxel(albedos)),
        Some(index) => Err(VolumeInputError::Value {
            file: grid_spec.file.clone(),
            voxel: voxel_of(index, size),
            found: format!("the albedo {:?}", albedos[index]),
            wanted: "0 to 1",
        }),
    }
}
