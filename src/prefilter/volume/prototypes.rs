//! Lobes of a coarse level: prototypes of S over the whole object, and how many of them.
//!
//! K-means over all fine S gives m prototypes, and a coarse voxel has one lobe for each that occurs in it. So lobes of the
//! same number are alike in all voxels without reordering (\[WU19\] 3.14), and no voxel is a reference for the others.

use formats::sggx::Sggx;
use glam::Vec3;

use super::coarsen::{ShapePoint, coarse_shape, for_each_voxel, shape_point, shares};
use super::kmeans::{centres, nearest};
use crate::math::warp;
use crate::medium::{MAX_LOBES, Medium};

/// Fine voxels that prototypes are found from, at most: every n-th of all.
const MAX_POINTS: usize = 16_384;
/// Coarse voxels that the error of normals is measured in, and fine voxels of each.
const ERROR_VOXELS: usize = 48;
const ERROR_FINE: usize = 64;
/// Directions along an edge of the square over the sphere.
const DIRECTIONS: usize = 20;

/// Every further lobe must lower the error of normals to this share (\[WU19\] 3.8.1).
const WORTH_A_LOBE: f64 = 0.5;
/// Error of normals under which no more lobes are tried.
const GOOD_ENOUGH: f64 = 0.15;

/// Prototypes and what each number of them would have given.
#[derive(Clone, Debug, PartialEq)]
pub struct Prototypes {
    /// One a lobe.
    pub shapes: Vec<ShapePoint>,
    /// L2 error of the distribution of normals over its norm, by number of lobes, as far as it was measured.
    pub normal_errors: Vec<f64>,
}

impl Prototypes {
    /// The prototypes for levels of `factor`: `count` of them, or as many as are worth it; at least one.
    pub fn new(fine: &Medium, factor: f64, count: Option<usize>, seed: u64) -> Self {
        let points = points(fine);
        if points.is_empty() {
            return Self { shapes: vec![shape_point(&Sggx::ISOTROPIC)], normal_errors: Vec::new() };
        }
        if let Some(count) = count {
            return Self { shapes: centres(&points, count.clamp(1, MAX_LOBES), seed), normal_errors: Vec::new() };
        }
        let footprints = footprints(fine, factor, seed);
        let mut chosen = centres(&points, 1, seed);
        let mut errors = vec![normal_error(&footprints, &chosen)];
        // Beyond a lobe that is not worth it: three directions of fibres are none the better for two lobes.
        for count in 2..=MAX_LOBES {
            let reached = errors[chosen.len() - 1];
            let more = centres(&points, count, seed);
            if reached <= GOOD_ENOUGH || more.len() < count {
                break;
            }
            errors.push(normal_error(&footprints, &more));
            if errors[count - 1] <= WORTH_A_LOBE.powi((count - chosen.len()) as i32) * reached {
                chosen = more;
            }
        }
        Self { shapes: chosen, normal_errors: errors }
    }
}

/// S of the fine lobes, weighted by flake area.
fn points(fine: &Medium) -> Vec<(ShapePoint, f64)> {
    let step = fine.occupied().div_ceil(MAX_POINTS).max(1);
    let voxels = (0..fine.occupied()).step_by(step).map(|index| fine.voxel(index));
    voxels
        .flat_map(|voxel| {
            let weigh =
                move |lobe: &formats::sggx::FlakeLobe| (shape_point(&lobe.shape), f64::from(voxel.density * lobe.area));
            voxel.lobes().iter().map(weigh).collect::<Vec<_>>()
        })
        .collect()
}

/// Fine lobes of some coarse voxels, drawn by their occupied fine voxels.
fn footprints(fine: &Medium, factor: f64, seed: u64) -> Vec<Vec<(Sggx, f64)>> {
    let shape = coarse_shape(fine.shape(), factor);
    let [nx, ny, nz] = shape.size;
    let mut members = vec![0_u32; nx * ny * nz];
    let home = |at: [usize; 3]| {
        let [x, y, z] = std::array::from_fn(|k| shares(at[k], fine.shape().size[k], shape.size[k])[0].0);
        (z * ny + y) * nx + x
    };
    for_each_voxel(fine, |at, _| members[home(at)] += 1);
    // Systematic draws over the occupied fine voxels: a full footprint is as likely as it is full.
    let total: u64 = members.iter().map(|&n| u64::from(n)).sum();
    let offset = crate::math::rng::Stream::new(seed, 1).uniform(0);
    let mut draws = (0..ERROR_VOXELS).map(|k| (k as f64 + f64::from(offset)) / ERROR_VOXELS as f64 * total as f64);
    let mut next = draws.next();
    let mut below = 0.0;
    let mut chosen = vec![None; members.len()];
    let mut count = 0;
    for (k, &n) in members.iter().enumerate() {
        below += f64::from(n);
        while next.is_some_and(|draw| draw < below) {
            if chosen[k].is_none() {
                chosen[k] = Some(count);
                count += 1;
            }
            next = draws.next();
        }
    }
    let mut lists = vec![Vec::new(); count];
    for_each_voxel(fine, |at, voxel| {
        let Some(place) = chosen[home(at)] else { return };
        for lobe in voxel.lobes() {
            lists[place].push((lobe.shape, f64::from(voxel.density * lobe.area)));
        }
    });
    lists.into_iter().map(thinned).collect()
}

/// At most [`ERROR_FINE`] of a list, evenly.
fn thinned<T: Clone>(list: Vec<T>) -> Vec<T> {
    let step = list.len().div_ceil(ERROR_FINE).max(1);
    list.into_iter().step_by(step).collect()
}

/// L2 distance between the mean of the fine distributions of normals and the coarse mixture, over the former's norm, root
/// mean square over the footprints.
fn normal_error(footprints: &[Vec<(Sggx, f64)>], prototypes: &[ShapePoint]) -> f64 {
    let at = |k: usize| (k as f32 + 0.5) / DIRECTIONS as f32;
    let normals: Vec<Vec3> =
        (0..DIRECTIONS * DIRECTIONS).map(|k| warp::sphere([0.5 * at(k % DIRECTIONS), at(k / DIRECTIONS)])).collect();
    let [mut off, mut norm] = [0.0; 2];
    for list in footprints {
        let mut sums = vec![([0.0; 6], 0.0); prototypes.len()];
        for (shape, mass) in list {
            let (sum, total) = &mut sums[nearest(prototypes, &shape_point(shape))];
            let matrix = shape.matrix();
            (0..6).for_each(|k| sum[k] += mass * f64::from(matrix[k]));
            *total += mass;
        }
        let lobes: Vec<(Sggx, f64)> = sums
            .iter()
            .filter(|(_, mass)| *mass > 0.0)
            .filter_map(|(sum, mass)| Some((Sggx::from_matrix(sum.map(|value| (value / mass) as f32))?, *mass)))
            .collect();
        let density = |lobes: &[(Sggx, f64)], m: Vec3| {
            lobes.iter().map(|(shape, mass)| mass * f64::from(shape.density(m.to_array()))).sum::<f64>()
        };
        let mass: f64 = list.iter().map(|(_, mass)| mass).sum();
        for &m in &normals {
            let [fine, coarse] = [list, &lobes].map(|lobes| density(lobes, m) / mass);
            off += (fine - coarse).powi(2);
            norm += fine * fine;
        }
    }
    if norm > 0.0 { (off / norm).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::{MediumShape, Voxel};
    use formats::sggx::FlakeLobe;

    /// Layers of fibres in one direction or two in turns.
    fn layers(axes: &[[f32; 3]]) -> Medium {
        let shape = MediumShape { size: [16; 3], voxel: [1.0; 3], repeat: [false; 3] };
        Medium::new(shape, 1, |[_, _, z]| {
            let lobe = FlakeLobe { area: 1.0, shape: Sggx::fibre(axes[z % axes.len()], 0.2), albedo: [0.5; 3] };
            Some(Voxel::new(1.0, &[lobe]))
        })
    }

    #[test]
    fn there_are_as_many_lobes_as_directions_of_fibres() {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for count in 1..=3 {
            let found = Prototypes::new(&layers(&axes[..count]), 4.0, None, 1);
            assert_eq!(found.shapes.len(), count, "{:?}", found.normal_errors);
            assert!(found.normal_errors[count - 1] < 1e-3, "{:?}", found.normal_errors);
        }
        // what is asked for and is not there is not made up
        assert_eq!(Prototypes::new(&layers(&axes[..1]), 4.0, Some(3), 1).shapes.len(), 1);
    }
}
