//! Matrices S of a volume: read, made of fibre directions, or found by the structure tensor; then checked.

use formats::sggx::Sggx;
use formats::symmetric::Eigen;

use super::super::manifest::{AlongSpec, GridSpec, SggxSpec, VolumeSpec};
use super::input::{Files, VolumeInputError};
use crate::io::grid::{Grid, voxel_of};
use crate::prefilter::volume::orientation::{Grey, OrientationSettings, orientations};

/// Least eigenvalue of S: below, single precision does not hold the flakes' density.
const MIN_EIGENVALUE: f64 = 1e-4;

/// What rounding may add to an eigenvalue, relative to the largest.
const ROUNDING: f64 = 1e-3;

/// Mean linearity under which the structure tensor has found no fibres: grains and noise have 0.15 and less.
const FIBROUS: f32 = 0.18;

/// S of every voxel.
pub(super) struct Shapes {
    /// xx yy zz xy xz yz, `[z][y][x]`; 0 in empty voxels.
    pub(super) matrices: Vec<[f32; 6]>,
    /// One line each.
    pub(super) warnings: Vec<String>,
}

/// The matrices of `spec`; densities are multiplied by what was divided out of them.
pub(super) fn read_shapes(
    spec: &VolumeSpec,
    files: &mut Files<'_>,
    grey: &Grid,
    density: &mut [f32],
) -> Result<Shapes, VolumeInputError> {
    match &spec.sggx {
        SggxSpec::Matrices(grid) => read_matrices(grid, files, density),
        SggxSpec::Fibres { directions, along } => {
            let grid = files.read("fibre", directions, &[3])?;
            let axes = grid.values.chunks_exact(3).map(|axis| [axis[0], axis[1], axis[2]]).collect();
            fibres(axes, &Along::read(along, files, density)?, density)
        }
        SggxSpec::StructureTensor { settings, along } => {
            let along = Along::read(along, files, density)?;
            let (axes, warning) = structure(spec, grey, settings, density);
            let mut shapes = fibres(axes, &along, density)?;
            shapes.warnings.extend(warning);
            Ok(shapes)
        }
    }
}

/// The axes of fibres in the stored values, and a warning where there seem to be none.
fn structure(
    spec: &VolumeSpec,
    grey: &Grid,
    settings: &OrientationSettings,
    density: &[f32],
) -> (Vec<[f32; 3]>, Option<String>) {
    let grey = Grey { values: &grey.values, size: grey.size, voxel: spec.voxel, repeat: spec.repeat };
    let found = orientations(&grey, settings);
    let filled = found.iter().zip(density).filter(|(_, density)| **density > 0.0);
    let (sum, count) = filled.fold((0.0, 0usize), |(sum, n), (o, _)| (sum + f64::from(o.linearity), n + 1));
    let mean = (sum / count.max(1) as f64) as f32;
    let warning = (count > 0 && mean < FIBROUS).then(|| {
        format!("the structure tensor finds no clear fibres in the density: mean linearity {mean:.2}, of 0 to 1")
    });
    (found.into_iter().map(|orientation| orientation.axis).collect(), warning)
}

/// The smallest eigenvalue of each voxel's S.
enum Along {
    Constant(f32),
    Eigenvalues(Vec<f32>),
}

impl Along {
    fn read(spec: &AlongSpec, files: &mut Files<'_>, density: &[f32]) -> Result<Self, VolumeInputError> {
        let (key, grid_spec) = match spec {
            AlongSpec::Constant(along) => return Ok(Self::Constant((along * along) as f32)),
            AlongSpec::Areas(grid) => ("along", grid),
            AlongSpec::Eigenvalues(grid) => ("eigenvalue", grid),
        };
        let grid = files.read(key, grid_spec, &[1])?;
        let size = grid.size;
        let mut values = grid.into_fractions();
        let beyond = |(value, density): (&f32, &f32)| *density > 0.0 && !(0.0..=1.0).contains(value);
        if let Some(index) = values.iter().zip(density).position(beyond) {
            return Err(VolumeInputError::Value {
                file: grid_spec.file.clone(),
                voxel: voxel_of(index, size),
                found: format!("{}", values[index]),
                wanted: "0 to 1",
            });
        }
        if key == "along" {
            values.iter_mut().for_each(|along| *along *= *along);
        }
        Ok(Self::Eigenvalues(values))
    }
}

/// S = 1 − (1 − λ)·axis axisᵀ of fibres along `axes`, of any length; isotropic where an axis is 0.
fn fibres(axes: Vec<[f32; 3]>, along: &Along, density: &[f32]) -> Result<Shapes, VolumeInputError> {
    let (mut aimless, mut thin) = (0, 0);
    let mut matrix = |(index, axis): (usize, [f32; 3])| {
        if density[index] <= 0.0 {
            return [0.0; 6];
        }
        let length = axis.iter().map(|x| x * x).sum::<f32>().sqrt();
        if !(length > 0.0 && length.is_finite()) {
            aimless += 1;
            return Sggx::ISOTROPIC.matrix();
        }
        let eigenvalue = match along {
            Along::Constant(value) => *value,
            Along::Eigenvalues(values) => values[index],
        };
        thin += usize::from(eigenvalue < MIN_EIGENVALUE as f32);
        Sggx::fibre(axis.map(|x| x / length), eigenvalue.max(MIN_EIGENVALUE as f32).sqrt()).matrix()
    };
    let matrices = axes.into_iter().enumerate().map(&mut matrix).collect();
    let mut warnings = clamped(thin).into_iter().collect::<Vec<_>>();
    if aimless > 0 {
        warnings.push(format!("{aimless} voxels have the fibre direction 0; they are taken as isotropic"));
    }
    Ok(Shapes { matrices, warnings })
}

/// The warning about so many clamped voxels.
fn clamped(count: usize) -> Option<String> {
    (count > 0).then(|| format!("{count} voxels have eigenvalues of S under 1e-4, which are raised to it"))
}

/// Matrices of a file: symmetric, not negative; eigenvalues over 1 divided out, those under 1e-4 raised.
fn read_matrices(spec: &GridSpec, files: &mut Files<'_>, density: &mut [f32]) -> Result<Shapes, VolumeInputError> {
    let grid = files.read("sggx", spec, &[6, 9])?;
    let (size, channels) = (grid.size, grid.channels);
    let values = grid.into_fractions();
    let mut count = 0;
    let mut matrices = Vec::with_capacity(density.len());
    for (index, (voxel, density)) in values.chunks_exact(channels).zip(density).enumerate() {
        if *density <= 0.0 {
            matrices.push([0.0; 6]);
            continue;
        }
        let fail = |found: String, wanted| VolumeInputError::Value {
            file: spec.file.clone(),
            voxel: voxel_of(index, size),
            found,
            wanted,
        };
        let s = symmetric(voxel).ok_or_else(|| fail(format!("the matrix {voxel:?}"), "a symmetric one"))?;
        let eigen = Eigen::of(s);
        let [largest, _, least] = eigen.values;
        if least < -ROUNDING * largest.max(MIN_EIGENVALUE) {
            return Err(fail(format!("a matrix with the eigenvalue {least:.3e}"), "a positive semidefinite one"));
        }
        let scale = largest.max(1.0);
        *density *= scale.sqrt() as f32;
        if !density.is_finite() {
            return Err(fail(format!("a matrix with the eigenvalue {largest:.3e}"), "a smaller one"));
        }
        count += usize::from(least / scale < MIN_EIGENVALUE);
        matrices.push(match scale > 1.0 || least < MIN_EIGENVALUE {
            true => eigen.map(|value| (value / scale).max(MIN_EIGENVALUE)).map(|value| value as f32),
            false => s.map(|value| value as f32),
        });
    }
    Ok(Shapes { matrices, warnings: clamped(count).into_iter().collect() })
}

/// xx yy zz xy xz yz of six numbers in this order, or of nine row by row; `None` where these are not symmetric.
fn symmetric(voxel: &[f32]) -> Option<[f64; 6]> {
    let value = |index: usize| f64::from(voxel[index]);
    if voxel.len() == 6 {
        return Some(std::array::from_fn(value));
    }
    let scale = (0..9).map(|index| value(index).abs()).fold(0.0, f64::max);
    let pairs = [(1, 3), (2, 6), (5, 7)];
    if pairs.iter().any(|&(upper, lower)| (value(upper) - value(lower)).abs() > ROUNDING * scale) {
        return None;
    }
    let [xy, xz, yz] = pairs.map(|(upper, lower)| 0.5 * (value(upper) + value(lower)));
    Some([value(0), value(4), value(8), xy, xz, yz])
}
