//! Directions of fibres in a grey volume, by the structure tensor.
//!
//! Along a fibre grey hardly changes, across it does: of the tensor J = G_ρ ∗ (∇v_σ ∇v_σᵀ), with v_σ the volume smoothed by a
//! Gaussian of σ voxels and G_ρ one of ρ voxels, the eigenvector of the smallest eigenvalue points along the fibres.
//! σ takes the noise away and should be below a fibre's radius; ρ is how far neighbours vote.
//!
//! Slices are independent: a window of them is kept, whatever the volume's depth, and threads share its slices.

use std::collections::BTreeMap;

use formats::symmetric::Eigen;
use rayon::prelude::*;

/// A Gaussian is cut off at this many standard deviations: 6e-5 of it lie beyond.
const CUT: f32 = 4.0;

/// Slices that are finished together.
const BLOCK: usize = 16;

/// A grey volume.
#[derive(Clone, Copy, Debug)]
pub struct Grey<'a> {
    /// `[z][y][x]`.
    pub values: &'a [f32],
    /// Voxels along x, y, z.
    pub size: [usize; 3],
    /// Edges of a voxel, in any unit.
    pub voxel: [f64; 3],
    /// Axes along which the volume repeats; along the others its rim goes on.
    pub repeat: [bool; 3],
}

/// Scales of the structure tensor, in voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientationSettings {
    /// σ, of the volume that is differentiated.
    pub sigma: f32,
    /// ρ, of the tensor.
    pub rho: f32,
}

/// What the tensor says about a voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orientation {
    /// Direction along which grey changes least, unit length, its sign without meaning.
    pub axis: [f32; 3],
    /// (λ2 − λ3)/λ1 of the falling eigenvalues: 1 for perfect fibres, 0 for grains, sheets and nothing.
    pub linearity: f32,
}

/// The orientation of every voxel, `[z][y][x]`.
pub fn orientations(grey: &Grey<'_>, settings: &OrientationSettings) -> Vec<Orientation> {
    let [nx, ny, nz] = grey.size;
    let filters = &Filters::new(settings, grey.values);
    let reach = filters.tensor.len() as isize / 2;
    let mut slices: BTreeMap<usize, Vec<[f32; 6]>> = BTreeMap::new();
    let mut found = Vec::with_capacity(nx * ny * nz);
    for start in (0..nz).step_by(BLOCK) {
        let end = (start + BLOCK).min(nz);
        let wanted = (start as isize - reach..end as isize + reach).map(|z| border(z, nz, grey.repeat[2]));
        let mut wanted: Vec<usize> = wanted.collect();
        wanted.sort_unstable();
        wanted.dedup();
        slices.retain(|z, _| wanted.binary_search(z).is_ok());
        let missing: Vec<usize> = wanted.into_iter().filter(|z| !slices.contains_key(z)).collect();
        let made: Vec<_> = missing.par_iter().map(|&z| (z, tensor_slice(grey, filters, z))).collect();
        slices.extend(made);
        let finished: Vec<Vec<Orientation>> = (start..end)
            .into_par_iter()
            .map(|z| {
                let near = |offset: isize| &slices[&border(z as isize + offset, nz, grey.repeat[2])];
                let mut sums = vec![[0.0; 6]; nx * ny];
                for (weight, offset) in filters.tensor.iter().zip(-reach..) {
                    sums.iter_mut().zip(near(offset)).for_each(|(sum, j)| (0..6).for_each(|k| sum[k] += weight * j[k]));
                }
                sums.into_iter().map(orientation_of).collect()
            })
            .collect();
        finished.into_iter().for_each(|slice| found.extend(slice));
    }
    found
}

/// The three kernels, of odd length.
struct Filters {
    /// G_σ.
    smooth: Vec<f32>,
    /// Its derivative, of which the convolution with x is 1.
    derivative: Vec<f32>,
    /// G_ρ.
    tensor: Vec<f32>,
    /// Factor of all values: squares shall neither overflow nor vanish.
    scale: f32,
}

impl Filters {
    fn new(settings: &OrientationSettings, values: &[f32]) -> Self {
        let largest = values.iter().fold(0.0f32, |largest, value| largest.max(value.abs()));
        let scale = if largest >= f32::MIN_POSITIVE { 1.0 / largest } else { 1.0 };
        let smooth = gaussian(settings.sigma);
        let reach = smooth.len() as isize / 2;
        // Below half a voxel the samples of the derivative are those of central differences.
        let mut derivative: Vec<f32> = match reach {
            0 => vec![-0.5, 0.0, 0.5],
            _ => (-reach..).zip(&smooth).map(|(i, weight)| i as f32 * weight).collect(),
        };
        let centre = derivative.len() as isize / 2;
        let slope: f32 = (-centre..).zip(&derivative).map(|(i, weight)| i as f32 * weight).sum();
        derivative.iter_mut().for_each(|weight| *weight /= slope);
        Self { smooth, derivative, tensor: gaussian(settings.rho), scale }
    }
}

/// A Gaussian of `sigma` voxels that sums to 1; a single 1 where it is too narrow to see.
fn gaussian(sigma: f32) -> Vec<f32> {
    /// Below, the neighbours' weight is under 1e-5.
    const NARROW: f32 = 0.2;
    if sigma < NARROW {
        return vec![1.0];
    }
    let reach = (CUT * sigma).ceil() as isize;
    let weights: Vec<f64> = (-reach..=reach).map(|i| (-0.5 * (i as f64 / f64::from(sigma)).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    weights.into_iter().map(|weight| (weight / sum) as f32).collect()
}

/// The index that stands for `i` in a row of `n`.
fn border(i: isize, n: usize, repeat: bool) -> usize {
    if repeat { i.rem_euclid(n as isize) as usize } else { i.clamp(0, n as isize - 1) as usize }
}

/// ∇v_σ ∇v_σᵀ of slice `z`, smoothed along x and y: xx yy zz xy xz yz.
fn tensor_slice(grey: &Grey<'_>, filters: &Filters, z: usize) -> Vec<[f32; 6]> {
    let size = [grey.size[0], grey.size[1]];
    let repeat = [grey.repeat[0], grey.repeat[1]];
    let [flat, steep] =
        [&filters.smooth, &filters.derivative].map(|kernel| across_slices(grey, kernel, filters.scale, z));
    let [smooth, derivative] = [&filters.smooth[..], &filters.derivative[..]];
    let gradients = [(&flat, derivative, smooth), (&flat, smooth, derivative), (&steep, smooth, smooth)]
        .map(|(slice, along_x, along_y)| filtered(slice, size, repeat, [along_x, along_y]));
    // Edges relative to the shortest, so that units cannot overflow the squares.
    let shortest = grey.voxel.into_iter().fold(f64::INFINITY, f64::min);
    let [dx, dy, dz] = grey.voxel.map(|edge| (shortest / edge) as f32);
    let products: Vec<[f32; 6]> = (0..size[0] * size[1])
        .map(|i| {
            let [x, y, z] = [gradients[0][i][0] * dx, gradients[1][i][0] * dy, gradients[2][i][0] * dz];
            [x * x, y * y, z * z, x * y, x * z, y * z]
        })
        .collect();
    filtered(&products, size, repeat, [&filters.tensor; 2])
}

/// The slices around `z`, weighted by `kernel` and `scale`.
fn across_slices(grey: &Grey<'_>, kernel: &[f32], scale: f32, z: usize) -> Vec<[f32; 1]> {
    let [nx, ny, nz] = grey.size;
    let reach = kernel.len() as isize / 2;
    let mut sums = vec![[0.0]; nx * ny];
    for (weight, offset) in kernel.iter().zip(-reach..) {
        let start = border(z as isize + offset, nz, grey.repeat[2]) * nx * ny;
        let slice = &grey.values[start..start + nx * ny];
        sums.iter_mut().zip(slice).for_each(|(sum, value)| sum[0] += weight * (scale * value));
    }
    sums
}

/// `values` correlated with one kernel along x and one along y.
fn filtered<const N: usize>(
    values: &[[f32; N]],
    [nx, ny]: [usize; 2],
    repeat: [bool; 2],
    [along_x, along_y]: [&[f32]; 2],
) -> Vec<[f32; N]> {
    let mut rows = vec![[0.0; N]; nx * ny];
    let reach = along_x.len() as isize / 2;
    let mut padded = Vec::with_capacity(nx + along_x.len());
    for (source, sums) in values.chunks_exact(nx).zip(rows.chunks_exact_mut(nx)) {
        padded.clear();
        padded.extend((-reach..nx as isize + reach).map(|x| source[border(x, nx, repeat[0])]));
        for (offset, weight) in along_x.iter().enumerate() {
            add(sums, &padded[offset..], *weight);
        }
    }
    let mut out = vec![[0.0; N]; nx * ny];
    let reach = along_y.len() as isize / 2;
    for (y, sums) in out.chunks_exact_mut(nx).enumerate() {
        for (weight, offset) in along_y.iter().zip(-reach..) {
            let start = border(y as isize + offset, ny, repeat[1]) * nx;
            add(sums, &rows[start..], *weight);
        }
    }
    out
}

/// Adds the first of `values` times `weight` to `sums`.
fn add<const N: usize>(sums: &mut [[f32; N]], values: &[[f32; N]], weight: f32) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| (0..N).for_each(|k| sum[k] += weight * value[k]));
}

/// Smallest eigenvector and linearity of a tensor.
fn orientation_of(tensor: [f32; 6]) -> Orientation {
    /// Of the largest value, squared, a voxel: rounding of a flat volume is far below, anything to be seen far above.
    const NOTHING: f64 = 1e-12;
    let Eigen { values: [first, second, third], vectors } = Eigen::of(tensor.map(f64::from));
    let linearity = if first > NOTHING { ((second - third) / first) as f32 } else { 0.0 };
    Orientation { axis: vectors[2].map(|value| value as f32), linearity }
}

#[cfg(test)]
mod tests;
