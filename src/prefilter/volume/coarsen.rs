//! Averages over the footprints of coarse voxels: density by \[WU19\] (3.6), S and albedo weighted by density, one lobe a
//! prototype.
//!
//! A coarse voxel covers n/N fine voxels along an axis, N = max(1, round(n/factor)), whole or not: a fine voxel on a border
//! counts on either side by the share that lies there. Empty voxels have no S and no albedo and enter no average of these.

use formats::sggx::{FlakeLobe, Sggx};

use super::kmeans::nearest;
use crate::medium::{MAX_LOBES, Medium, MediumShape, Voxel};

/// Six numbers of S whose distance is that of the matrices: off-diagonal ones count twice.
pub(crate) type ShapePoint = [f64; 6];

/// S as a point.
pub(crate) fn shape_point(shape: &Sggx) -> ShapePoint {
    let [xx, yy, zz, xy, xz, yz] = shape.matrix().map(f64::from);
    let root = 2f64.sqrt();
    [xx, yy, zz, root * xy, root * xz, root * yz]
}

/// Sums over a footprint for one lobe.
#[derive(Clone, Copy, Default)]
struct LobeSums {
    /// Σ ρ.
    mass: f64,
    /// Σ ρ S, xx yy zz xy xz yz.
    shape: [f64; 6],
    /// Σ ρ albedo.
    albedo: [f64; 3],
}

/// The shape of the grid that is `factor` times coarser.
pub fn coarse_shape(fine: &MediumShape, factor: f64) -> MediumShape {
    let size = fine.size.map(|n| ((n as f64 / factor).round() as usize).max(1));
    let voxel = std::array::from_fn(|k| fine.voxel[k] * fine.size[k] as f64 / size[k] as f64);
    MediumShape { size, voxel, repeat: fine.repeat }
}

/// The coarse medium whose voxels have a lobe for every prototype that occurs in them; `thinning` gives what the density of
/// a coarse voxel is multiplied with (1 for (3.6) itself).
pub fn coarsen(fine: &Medium, factor: f64, prototypes: &[ShapePoint], thinning: impl Fn([usize; 3]) -> f64) -> Medium {
    let shape = coarse_shape(fine.shape(), factor);
    let [nx, ny, nz] = shape.size;
    let lobe_count = prototypes.len();
    let mut sums = vec![LobeSums::default(); nx * ny * nz * lobe_count];
    for_each_voxel(fine, |at, voxel| {
        let shares: [_; 3] = std::array::from_fn(|k| shares(at[k], fine.shape().size[k], shape.size[k]));
        for lobe in voxel.lobes() {
            let j = nearest(prototypes, &shape_point(&lobe.shape));
            for (z, c) in shares[2] {
                for (y, b) in shares[1] {
                    for (x, a) in shares[0] {
                        let mass = a * b * c * f64::from(voxel.density * lobe.area);
                        sums[((z * ny + y) * nx + x) * lobe_count + j].add(mass, lobe);
                    }
                }
            }
        }
    });
    let volume: f64 = (0..3).map(|k| fine.shape().size[k] as f64 / shape.size[k] as f64).product();
    Medium::new(shape, lobe_count, |at| {
        let first = ((at[2] * ny + at[1]) * nx + at[0]) * lobe_count;
        coarse_voxel(&sums[first..first + lobe_count], thinning(at) / volume)
    })
}

/// Calls `visit` with the place and content of every occupied voxel, x fastest.
pub(crate) fn for_each_voxel(medium: &Medium, mut visit: impl FnMut([usize; 3], &Voxel)) {
    let [nx, ny, nz] = medium.shape().size;
    for k in 0..nx * ny * nz {
        let at = [k % nx, k / nx % ny, k / (nx * ny)];
        if let Some(index) = medium.voxel_index(at) {
            visit(at, &medium.voxel(index));
        }
    }
}

/// The two coarse voxels (the second with share 0 if there is one alone) that fine voxel `k` of `fine` lies in.
pub(crate) fn shares(k: usize, fine: usize, coarse: usize) -> [(usize, f64); 2] {
    // In units of 1/coarse of a fine voxel: whole numbers, so that borders are exact.
    let [start, end] = [k * coarse, (k + 1) * coarse];
    let first = start / fine;
    let border = ((first + 1) * fine).min(end);
    let share = (border - start) as f64 / coarse as f64;
    [(first, share), ((first + 1).min(coarse - 1), 1.0 - share)]
}

impl LobeSums {
    fn add(&mut self, mass: f64, lobe: &FlakeLobe) {
        self.mass += mass;
        let matrix = lobe.shape.matrix();
        (0..6).for_each(|k| self.shape[k] += mass * f64::from(matrix[k]));
        (0..3).for_each(|c| self.albedo[c] += mass * f64::from(lobe.albedo[c]));
    }
}

/// The voxel of these sums, its density the mass times `scale`; `None` without mass.
fn coarse_voxel(sums: &[LobeSums], scale: f64) -> Option<Voxel> {
    let mass: f64 = sums.iter().map(|sum| sum.mass).sum();
    if mass <= 0.0 {
        return None;
    }
    let mut lobes = [FlakeLobe { area: 0.0, shape: Sggx::ISOTROPIC, albedo: [0.0; 3] }; MAX_LOBES];
    for (lobe, sum) in lobes.iter_mut().zip(sums).filter(|(_, sum)| sum.mass > 0.0) {
        let mean = |value: f64| (value / sum.mass) as f32;
        lobe.area = (sum.mass / mass) as f32;
        // A mean of positive definite matrices is one.
        lobe.shape = Sggx::from_matrix(sum.shape.map(mean)).expect("a positive definite mean");
        lobe.albedo = sum.albedo.map(mean);
    }
    Some(Voxel::new((mass * scale) as f32, &lobes[..sums.len()]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Stream;

    fn scattered(size: [usize; 3]) -> Medium {
        let shape = MediumShape { size, voxel: [1e-3, 2e-3, 1e-3], repeat: [false; 3] };
        Medium::new(shape, 1, |[x, y, z]| {
            let rng = Stream::new(3, ((z * size[1] + y) * size[0] + x) as u64);
            let axis = crate::math::warp::sphere(rng.uniform_pair(0)).to_array();
            let lobe =
                FlakeLobe { area: 1.0, shape: Sggx::fibre(axis, 0.2), albedo: [rng.uniform(1), 0.5, rng.uniform(2)] };
            (rng.uniform(3) < 0.4).then(|| Voxel::new(100.0 * rng.uniform(4), &[lobe]))
        })
    }

    /// Flake area of all voxels, m², and that area times albedo.
    fn total(medium: &Medium) -> (f64, [f64; 3]) {
        let volume: f64 = medium.shape().voxel.iter().product();
        let mut sum = (0.0, [0.0; 3]);
        for_each_voxel(medium, |_, voxel| {
            for lobe in voxel.lobes() {
                let area = f64::from(voxel.density * lobe.area) * volume;
                sum.0 += area;
                (0..3).for_each(|c| sum.1[c] += area * f64::from(lobe.albedo[c]));
            }
        });
        sum
    }

    #[test]
    fn flake_area_and_its_albedo_are_kept_whatever_the_factor() {
        let fine = scattered([13, 8, 10]);
        let before = total(&fine);
        let prototypes =
            [shape_point(&Sggx::fibre([1.0, 0.0, 0.0], 0.2)), shape_point(&Sggx::fibre([0.0, 0.0, 1.0], 0.2))];
        for factor in [1.0, 2.0, 3.0, 4.5, 100.0] {
            for prototypes in [&prototypes[..1], &prototypes[..]] {
                let after = total(&coarsen(&fine, factor, prototypes, |_| 1.0));
                // albedos are stored to 1/65535
                assert!((after.0 / before.0 - 1.0).abs() < 1e-5, "{factor}");
                (0..3).for_each(|c| assert!((after.1[c] / before.1[c] - 1.0).abs() < 1e-4, "{factor}"));
            }
        }
    }

    #[test]
    fn shares_of_a_fine_voxel_sum_to_one_and_fill_every_coarse_voxel_alike() {
        for [fine, coarse] in [[13, 4], [8, 2], [7, 7], [5, 1], [10, 3]] {
            let mut filled = vec![0.0; coarse];
            for (k, share) in (0..fine).flat_map(|k| shares(k, fine, coarse)) {
                filled[k] += share;
            }
            for share in filled {
                assert!((share - fine as f64 / coarse as f64).abs() < 1e-12, "{fine} {coarse}");
            }
        }
    }

    #[test]
    fn a_factor_of_one_is_the_same_medium() {
        let fine = scattered([6, 5, 4]);
        let prototypes = [shape_point(&Sggx::ISOTROPIC)];
        let same = coarsen(&fine, 1.0, &prototypes, |_| 1.0);
        for_each_voxel(&fine, |at, voxel| {
            let other = same.voxel(same.voxel_index(at).unwrap());
            assert!((other.density / voxel.density - 1.0).abs() < 1e-6);
            let [a, b] = [voxel, &other].map(|v| v.lobes()[0].shape.matrix());
            (0..6).for_each(|k| assert!((a[k] - b[k]).abs() < 2e-4));
        });
    }
}
