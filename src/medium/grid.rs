//! Voxels in memory: a bit says whether one is there, 24 bytes hold a lobe.

use formats::sggx::{FlakeLobe, Sggx};
use glam::Vec3;

use crate::math::linear::largest_eigenvalue;

/// Most lobes of a voxel.
pub const MAX_LOBES: usize = 3;

/// Voxels along an edge of a block: 64 of them are one word of bits. Majorants are kept a block.
pub(super) const BLOCK: usize = 4;

/// Largest code of a signed and of an unsigned 16-bit number.
const SIGNED: f32 = 32_767.0;
const UNSIGNED: f32 = 65_535.0;

/// Most empty blocks around one that are counted.
const MAX_CLEARANCE: u32 = 1 << 12;

/// Headroom of a majorant over rounding: what σ and λmax may be off by in f32.
const HEADROOM: f32 = 1.0 + 1e-5;

/// Where a medium lies: voxels, their size, and which axes have no ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MediumShape {
    /// Voxels along x, y, z; at least 1 each.
    pub size: [usize; 3],
    /// Edges of a voxel in metres, greater than 0.
    pub voxel: [f64; 3],
    /// Axes along which the grid repeats for ever.
    pub repeat: [bool; 3],
}

impl MediumShape {
    /// Metres along x, y, z; of an axis that repeats one period.
    pub fn extent(&self) -> [f64; 3] {
        std::array::from_fn(|k| self.size[k] as f64 * self.voxel[k])
    }

    /// Blocks along x, y, z.
    pub(super) fn blocks(&self) -> [usize; 3] {
        self.size.map(|n| n.div_ceil(BLOCK))
    }
}

/// What a voxel holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Voxel {
    /// Flake area per volume, 1/m.
    pub density: f32,
    lobes: [FlakeLobe; MAX_LOBES],
    count: usize,
}

impl Voxel {
    /// A voxel of `density` (1/m) with these lobes; their areas sum to 1.
    ///
    /// # Panics
    /// If there is no lobe or more than [`MAX_LOBES`].
    pub fn new(density: f32, lobes: &[FlakeLobe]) -> Self {
        assert!((1..=MAX_LOBES).contains(&lobes.len()), "one to {MAX_LOBES} lobes");
        debug_assert!((lobes.iter().map(|lobe| lobe.area).sum::<f32>() - 1.0).abs() < 1e-3, "areas that sum to 1");
        let mut all = [UNUSED; MAX_LOBES];
        all[..lobes.len()].copy_from_slice(lobes);
        Self { density, lobes: all, count: lobes.len() }
    }

    /// The lobes.
    pub fn lobes(&self) -> &[FlakeLobe] {
        &self.lobes[..self.count]
    }
}

/// A lobe without flakes.
const UNUSED: FlakeLobe = FlakeLobe { area: 0.0, shape: Sggx::ISOTROPIC, albedo: [0.0; 3] };

/// 64 voxels: which are occupied, and the index of the first of these.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Block {
    pub(super) occupied: u64,
    /// Of a block without any: how many blocks around it are empty, too.
    first: u32,
    /// Least upper bound of σt in the block, per unit of length.
    pub(super) majorant: f32,
}

/// A lobe in 24 bytes, all that a flight or a reflection needs from one place in memory.
///
/// The factor of S (entries of at most 1) is rounded to 3e-5: a σ of 0.01, the least that inputs have, to 0.2 %.
#[derive(Clone, Copy, Debug)]
struct PackedLobe {
    /// ρφ, the lobe's flake area per volume, 1/unit.
    density: f32,
    factor: [i16; 6],
    albedo: [u16; 3],
}

/// A grid of microflakes.
#[derive(Clone, Debug)]
pub struct Medium {
    shape: MediumShape,
    lobe_count: usize,
    /// Metres of the unit of length that flights are measured in: the shortest edge of a voxel.
    unit: f64,
    /// Voxels along each axis a unit of length.
    steps: Vec3,
    /// `[z][y][x]`.
    pub(super) blocks: Vec<Block>,
    /// `[occupied voxel][lobe]`.
    lobes: Vec<PackedLobe>,
}

impl Medium {
    /// The medium of this shape whose voxels have up to `lobe_count` lobes; `voxel_at([x, y, z])` gives each voxel once,
    /// `None` or a density of 0 for an empty one.
    ///
    /// Matrices with eigenvalues above 1 are divided by the largest, and the density is multiplied by its root: the same
    /// medium.
    ///
    /// # Panics
    /// If a size is 0, a voxel has no extent or more lobes, or a density is negative or not finite.
    pub fn new(shape: MediumShape, lobe_count: usize, voxel_at: impl Fn([usize; 3]) -> Option<Voxel>) -> Self {
        assert!(shape.size.iter().all(|&n| n > 0) && shape.voxel.iter().all(|&edge| edge > 0.0), "a grid with voxels");
        assert!((1..=MAX_LOBES).contains(&lobe_count), "one to {MAX_LOBES} lobes");
        let unit = shape.voxel.into_iter().fold(f64::INFINITY, f64::min);
        let steps = Vec3::from_array(shape.voxel.map(|edge| (unit / edge) as f32));
        let mut medium = Self { shape, lobe_count, unit, steps, blocks: Vec::new(), lobes: Vec::new() };
        let [bx, by, bz] = shape.blocks();
        for k in 0..bx * by * bz {
            medium.push_block([k % bx, k / bx % by, k / (bx * by)], &voxel_at);
        }
        medium.find_clearances();
        medium
    }

    /// Appends the block at that place, of voxels in the order of its bits.
    fn push_block(&mut self, at: [usize; 3], voxel_at: &impl Fn([usize; 3]) -> Option<Voxel>) {
        let mut block = Block { first: self.occupied() as u32, ..Block::default() };
        for bit in 0..BLOCK * BLOCK * BLOCK {
            let [x, y, z] = [at[0], at[1], at[2]].map(|k| BLOCK * k);
            let voxel = [x + bit % BLOCK, y + bit / BLOCK % BLOCK, z + bit / (BLOCK * BLOCK)];
            if (0..3).any(|k| voxel[k] >= self.shape.size[k]) {
                continue;
            }
            let Some(voxel) = voxel_at(voxel).filter(|voxel| voxel.density != 0.0) else { continue };
            assert!(voxel.density.is_finite() && voxel.density > 0.0, "a density of at least 0");
            block.occupied |= 1 << bit;
            block.majorant = block.majorant.max(self.push_voxel(&voxel));
        }
        self.blocks.push(block);
    }

    /// Gives every empty block the number of empty blocks around it in all directions: the chessboard distance to the
    /// nearest occupied one, less one; beyond the rim all is empty.
    ///
    /// Two sweeps over neighbours that were swept before (a distance transform).
    fn find_clearances(&mut self) {
        let size = self.shape.blocks().map(|n| n as i32);
        let count = self.blocks.len();
        let mut distance: Vec<u32> =
            self.blocks.iter().map(|block| if block.occupied == 0 { MAX_CLEARANCE + 1 } else { 0 }).collect();
        for backwards in [false, true] {
            for k in 0..count {
                let k = if backwards { count - 1 - k } else { k };
                let at = [k as i32 % size[0], k as i32 / size[0] % size[1], k as i32 / (size[0] * size[1])];
                // The 13 neighbours that come before, in the order of the sweep.
                for neighbour in 0..13 {
                    let sign = if backwards { -1 } else { 1 };
                    let step = [neighbour % 3 - 1, neighbour / 3 % 3 - 1, neighbour / 9 - 1].map(|s| s * sign);
                    let [x, y, z] = [0, 1, 2].map(|a| at[a] + step[a]);
                    let inside = (0..size[0]).contains(&x) && (0..size[1]).contains(&y) && (0..size[2]).contains(&z);
                    if inside {
                        distance[k] = distance[k].min(distance[((z * size[1] + y) * size[0] + x) as usize] + 1);
                    }
                }
            }
        }
        for (block, distance) in self.blocks.iter_mut().zip(distance).filter(|(block, _)| block.occupied == 0) {
            block.first = distance - 1;
        }
    }

    /// Appends a voxel and returns the largest σt that it shows, per unit of length.
    fn push_voxel(&mut self, voxel: &Voxel) -> f32 {
        assert!(voxel.lobes().len() <= self.lobe_count, "at most {} lobes", self.lobe_count);
        // |entries of L| <= √(diagonal of S) <= √λmax
        let used = voxel.lobes().iter().filter(|lobe| lobe.area > 0.0);
        let largest = used.clone().flat_map(|lobe| lobe.shape.factor()).fold(0.0, |max: f32, l| max.max(l.abs()));
        let scale = largest.max(1.0);
        let first = self.lobes.len();
        let unscaled = f64::from(scale) * self.unit * f64::from(voxel.density);
        let packed = voxel.lobes[..self.lobe_count].iter().map(|lobe| PackedLobe::new(lobe, unscaled, scale));
        self.lobes.extend(packed);
        let shown = self.lobes[first..].iter().map(|lobe| {
            let [xx, yy, zz, xy, xz, yz] = lobe.shape().matrix().map(f64::from);
            lobe.density * (largest_eigenvalue([xx, yy, zz, xy, xz, yz]).sqrt() as f32)
        });
        HEADROOM * shown.sum::<f32>()
    }

    /// Where the medium lies.
    pub fn shape(&self) -> &MediumShape {
        &self.shape
    }

    /// Lobes a voxel.
    pub fn lobe_count(&self) -> usize {
        self.lobe_count
    }

    /// Metres of the unit of length of flights.
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// Voxels along each axis a unit of length.
    #[inline]
    pub(super) fn steps(&self) -> Vec3 {
        self.steps
    }

    /// Voxels that hold flakes; their indices count from 0 in an order of the medium's own.
    pub fn occupied(&self) -> usize {
        self.lobes.len() / self.lobe_count
    }

    /// Bytes of memory that the voxels take.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.blocks[..]) + size_of_val(&self.lobes[..])
    }

    /// Index of the occupied voxel at (x, y, z), if it is one.
    pub fn voxel_index(&self, [x, y, z]: [usize; 3]) -> Option<usize> {
        let [bx, by, _] = self.shape.blocks();
        let block = &self.blocks[(z / BLOCK * by + y / BLOCK) * bx + x / BLOCK];
        let bit = ((z % BLOCK) * BLOCK + y % BLOCK) * BLOCK + x % BLOCK;
        block.index(bit as u32)
    }

    /// What the occupied voxel of that index holds.
    pub fn voxel(&self, index: usize) -> Voxel {
        let mut lobes = [UNUSED; MAX_LOBES];
        let total: f32 = (0..self.lobe_count).map(|j| self.packed(index)[j].density).sum();
        for (lobe, packed) in lobes.iter_mut().zip(self.packed(index)) {
            *lobe = packed.lobe();
            lobe.area /= total;
        }
        Voxel { density: (f64::from(total) / self.unit) as f32, lobes, count: self.lobe_count }
    }

    /// Lobe `j` of the occupied voxel; its `area` is ρφ, per unit of length.
    #[inline]
    pub(super) fn lobe(&self, index: usize, j: usize) -> FlakeLobe {
        self.packed(index)[j].lobe()
    }

    /// σt of the occupied voxel towards `w` (unit), per unit of length.
    #[inline]
    pub(super) fn sigma_t(&self, index: usize, w: [f32; 3]) -> f32 {
        self.packed(index).iter().map(|lobe| lobe.density * lobe.shape().projected_area(w)).sum()
    }

    #[inline]
    fn packed(&self, index: usize) -> &[PackedLobe] {
        &self.lobes[index * self.lobe_count..][..self.lobe_count]
    }

    /// This medium with other albedos: `albedo(index, lobe)` gives that of each lobe of each occupied voxel.
    pub fn with_albedos(&self, albedo: impl Fn(usize, usize) -> [f32; 3]) -> Self {
        let mut medium = self.clone();
        for (k, lobe) in medium.lobes.iter_mut().enumerate() {
            lobe.albedo = quantised(albedo(k / self.lobe_count, k % self.lobe_count));
        }
        medium
    }

    /// This medium with all densities multiplied by `factor`, greater than 0.
    pub fn with_density_times(&self, factor: f32) -> Self {
        assert!(factor.is_finite() && factor > 0.0, "a factor greater than 0");
        let mut medium = self.clone();
        medium.lobes.iter_mut().for_each(|lobe| lobe.density *= factor);
        medium.blocks.iter_mut().for_each(|block| block.majorant *= factor);
        medium
    }

    /// This medium with one majorant for all: what super-voxels are compared with.
    pub fn with_global_majorant(&self) -> Self {
        let mut medium = self.clone();
        let most = self.blocks.iter().map(|block| block.majorant).fold(0.0, f32::max);
        medium.blocks.iter_mut().for_each(|block| block.majorant = most);
        medium
    }
}

impl Block {
    /// Index of the occupied voxel of that bit, if it is one.
    #[inline]
    pub(super) fn index(&self, bit: u32) -> Option<usize> {
        let here = 1 << bit;
        (self.occupied & here != 0).then(|| self.first as usize + (self.occupied & (here - 1)).count_ones() as usize)
    }

    /// Empty blocks around this empty one, in all directions.
    #[inline]
    pub(super) fn clearance(&self) -> i32 {
        self.first as i32
    }
}

impl PackedLobe {
    /// `lobe` with its factor divided by `scale`, in a voxel of that density (1/unit).
    fn new(lobe: &FlakeLobe, density: f64, scale: f32) -> Self {
        let mut factor = lobe.shape.factor().map(|l| (l / scale * SIGNED).round() as i16);
        // A diagonal that rounds to 0 has no inverse.
        [0, 2, 5].into_iter().for_each(|k| factor[k] = factor[k].max(1));
        Self { density: (density * f64::from(lobe.area)) as f32, factor, albedo: quantised(lobe.albedo) }
    }

    #[inline]
    fn shape(&self) -> Sggx {
        Sggx::from_factor(self.factor.map(|l| f32::from(l) * (1.0 / SIGNED)))
    }

    /// The lobe; its `area` is ρφ, per unit of length.
    #[inline]
    fn lobe(&self) -> FlakeLobe {
        let albedo = self.albedo.map(|a| f32::from(a) * (1.0 / UNSIGNED));
        FlakeLobe { area: self.density, shape: self.shape(), albedo }
    }
}

fn quantised(albedo: [f32; 3]) -> [u16; 3] {
    // Energy: an albedo above 1 by rounding is 1.
    albedo.map(|a| (a.clamp(0.0, 1.0) * UNSIGNED).round() as u16)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lobe(along: f32) -> FlakeLobe {
        FlakeLobe { area: 1.0, shape: Sggx::fibre([0.6, -0.48, 0.64], along), albedo: [0.9, 0.5, 0.0] }
    }

    #[test]
    fn voxels_come_back_as_they_were_put_in() {
        let shape = MediumShape { size: [5, 9, 6], voxel: [1e-3, 2e-3, 1e-3], repeat: [false; 3] };
        let is_occupied = |[x, y, z]: [usize; 3]| (x * 7 + y * 3 + z) % 3 == 0;
        let density = |[x, y, z]: [usize; 3]| 100.0 + (x + 10 * y + 100 * z) as f32;
        let medium = Medium::new(shape, 1, |at| is_occupied(at).then(|| Voxel::new(density(at), &[lobe(0.1)])));
        let mut seen = 0;
        for at in (0..5 * 9 * 6).map(|k| [k % 5, k / 5 % 9, k / 45]) {
            let found = medium.voxel_index(at).map(|index| medium.voxel(index));
            assert_eq!(found.is_some(), is_occupied(at), "{at:?}");
            let Some(voxel) = found else { continue };
            seen += 1;
            assert!((voxel.density / density(at) - 1.0).abs() < 1e-6);
            for (stored, given) in voxel.lobes()[0].shape.matrix().into_iter().zip(lobe(0.1).shape.matrix()) {
                assert!((stored - given).abs() < 1e-4, "{stored} {given}");
            }
        }
        assert_eq!(seen, medium.occupied());
    }

    #[test]
    fn an_occupied_voxel_of_one_lobe_takes_less_than_32_bytes() {
        let shape = MediumShape { size: [64; 3], voxel: [1.0; 3], repeat: [false; 3] };
        // one voxel in seven, as in the sparsest of the synthetic scenes, scattered: the worst for blocks
        let medium =
            Medium::new(shape, 1, |[x, y, z]| ((x + 3 * y + 5 * z) % 7 == 0).then(|| Voxel::new(1.0, &[lobe(0.1)])));
        assert!(medium.bytes() <= 32 * medium.occupied(), "{} bytes", medium.bytes() / medium.occupied());
    }

    #[test]
    fn large_matrices_are_scaled_without_loss() {
        let shape = MediumShape { size: [1; 3], voxel: [0.5; 3], repeat: [false; 3] };
        let large = Sggx::from_matrix([9.0, 4.0, 1.0, 0.0, 1.0, 0.0]).unwrap();
        let medium = Medium::new(shape, 1, |_| Some(Voxel::new(2.0, &[FlakeLobe { shape: large, ..lobe(1.0) }])));
        let w = [0.36, 0.48, -0.8];
        let expected = 2.0 * large.projected_area(w) * 0.5; // a unit is half a metre
        assert!((medium.sigma_t(0, w) / expected - 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_majorant_bounds_every_direction() {
        let shape = MediumShape { size: [1; 3], voxel: [1.0; 3], repeat: [false; 3] };
        for along in [1.0, 0.1, 0.01] {
            let pair = [FlakeLobe { area: 0.7, ..lobe(along) }, FlakeLobe { area: 0.3, ..lobe(1.0) }];
            let medium = Medium::new(shape, 2, |_| Some(Voxel::new(3.0, &pair)));
            let stream = crate::math::rng::Stream::new(1, 1);
            let shown = (0..2000).map(|k| crate::math::warp::sphere(stream.uniform_pair(k)));
            let most = shown.map(|w| medium.sigma_t(0, w.to_array())).fold(0.0, f32::max);
            let bound = medium.blocks[0].majorant;
            // 2000 directions come within 1e-3 of the largest
            assert!(most <= bound && most > 0.995 * bound, "{most} {bound}");
        }
    }
}
