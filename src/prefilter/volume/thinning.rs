//! What part of an averaged density keeps the transmittance of a footprint.
//!
//! Light leaks through the gaps between fibres, and by Jensen's inequality an average has less transmittance than what it
//! averages: mean(e^−τ) >= e^−mean(τ). For each coarse voxel and axis, the depths τ of the columns of fine voxels through its
//! footprint give both, and −ln mean(e^−τ)/mean(τ), averaged over the axes, is what is kept of the density.

use super::coarsen::for_each_voxel;
use crate::medium::Medium;

/// The part of the density of each voxel of `coarse` that keeps the transmittance through it; 1 where nothing is.
///
/// Fine voxels count where their centres lie.
pub(crate) fn kept_density(fine: &Medium, coarse: &Medium) -> impl Fn([usize; 3]) -> f64 + use<> {
    let [fine_size, size] = [fine.shape().size, coarse.shape().size];
    let home = move |k: usize, at: usize| (at * size[k] + size[k] / 2) / fine_size[k];
    let mut logs = vec![(0.0, 0_u32); size[0] * size[1] * size[2]];
    for axis in 0..3 {
        let [a, b] = [(axis + 1) % 3, (axis + 2) % 3];
        // τ of every column through a coarse voxel, by its place across the axis.
        let mut depths = vec![0.0_f64; fine_size[a] * fine_size[b] * size[axis]];
        let mut along = [0.0; 3];
        along[axis] = 1.0;
        let column = |at: [usize; 3], step: usize| (step * fine_size[b] + at[b]) * fine_size[a] + at[a];
        for_each_voxel(fine, |at, voxel| {
            let sigma_t = voxel.density * formats::sggx::projected_area(voxel.lobes(), along);
            depths[column(at, home(axis, at[axis]))] += f64::from(sigma_t) * fine.shape().voxel[axis];
        });
        let mut sums = vec![(0.0, 0.0, 0.0); logs.len()];
        for step in 0..size[axis] {
            for (i, j) in (0..fine_size[b]).flat_map(|j| (0..fine_size[a]).map(move |i| (i, j))) {
                let mut at = [0; 3];
                (at[axis], at[a], at[b]) = (step, home(a, i), home(b, j));
                let depth = depths[(step * fine_size[b] + j) * fine_size[a] + i];
                let (through, depth_sum, count) = &mut sums[(at[2] * size[1] + at[1]) * size[0] + at[0]];
                *through += (-depth).exp();
                *depth_sum += depth;
                *count += 1.0;
            }
        }
        for ((through, depth, count), (kept, axes)) in sums.into_iter().zip(&mut logs) {
            if depth > 0.0 {
                *kept += -(through / count).ln() / (depth / count);
                *axes += 1;
            }
        }
    }
    move |at| {
        let (kept, axes) = logs[(at[2] * size[1] + at[1]) * size[0] + at[0]];
        if axes > 0 { (kept / f64::from(axes)).min(1.0) } else { 1.0 }
    }
}
