//! Sparse grids: bricks of 8³ voxels, of which only those that hold something are stored, side by side in an atlas.

/// Voxels of a brick along one axis.
pub(super) const BRICK: usize = 8;

/// Voxels of a brick.
pub(super) const BRICK_VOXELS: usize = BRICK * BRICK * BRICK;

/// Where the bricks of a level are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Bricks {
    /// Voxels of the level.
    size: [usize; 3],
    /// `[z][y][x]` over the bricks of the level: 0 for one that is empty, else its place in the atlas and 1.
    pub(super) index: Vec<u32>,
    /// Bricks that are stored.
    pub(super) count: usize,
    /// Bricks of the atlas along x, y and z.
    pub(super) atlas: [usize; 3],
}

/// A voxel of a brick that is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct StoredVoxel {
    /// Index of its brick over the level.
    pub(super) brick: usize,
    /// Index of the voxel in the level.
    pub(super) voxel: usize,
    /// Index of its texel in the atlas.
    pub(super) texel: usize,
}

/// Bricks along each axis that cover `size` voxels.
pub(super) fn bricks_over(size: [usize; 3]) -> [usize; 3] {
    size.map(|n| n.div_ceil(BRICK))
}

/// An atlas for `count` bricks: as near to a cube as whole numbers allow, of one brick at least.
pub(super) fn atlas_for(count: usize) -> [usize; 3] {
    let count = count.max(1);
    let x = (1..).find(|x| x * x * x >= count).expect("a cube root");
    let y = (1..).find(|y| x * y * y >= count).expect("a root");
    [x, y, count.div_ceil(x * y)]
}

impl Bricks {
    /// The bricks of a level of `size` voxels whose `occupied` ones are listed.
    pub(super) fn of(size: [usize; 3], occupied: &[u32]) -> Self {
        let over = bricks_over(size);
        let mut index = vec![0; over.iter().product()];
        for &voxel in occupied {
            let [x, y, z] = place(size, voxel as usize).map(|n| n / BRICK);
            index[(z * over[1] + y) * over[0] + x] = 1;
        }
        let mut count = 0;
        for entry in index.iter_mut().filter(|entry| **entry > 0) {
            count += 1;
            *entry = count;
        }
        let count = count as usize;
        Self { size, index, count, atlas: atlas_for(count) }
    }

    /// The bricks of a stored index; the error is (entry, what it should be).
    pub(super) fn from_index(size: [usize; 3], index: Vec<u32>, count: usize) -> Result<Self, (usize, u32)> {
        let mut last = 0;
        for (entry, &slot) in index.iter().enumerate().filter(|(_, slot)| **slot > 0) {
            last += 1;
            if slot != last {
                return Err((entry, last));
            }
        }
        if last as usize != count {
            return Err((index.len(), count as u32));
        }
        Ok(Self { size, index, count, atlas: atlas_for(count) })
    }

    /// Texel of the atlas that holds voxel `voxel` of the level; `None` where its brick is empty.
    pub(super) fn texel_of(&self, voxel: usize) -> Option<usize> {
        let [x, y, z] = place(self.size, voxel);
        let over = bricks_over(self.size);
        let slot = self.index[(z / BRICK * over[1] + y / BRICK) * over[0] + x / BRICK].checked_sub(1)?;
        let corner = place(self.atlas, slot as usize).map(|n| n * BRICK);
        Some(self.texel([corner[0] + x % BRICK, corner[1] + y % BRICK, corner[2] + z % BRICK]))
    }

    /// The voxels of the level that have a texel, brick by brick, rising within a brick.
    pub(super) fn voxels(&self) -> impl Iterator<Item = StoredVoxel> + '_ {
        let over = bricks_over(self.size);
        let stored = self.index.iter().enumerate().filter(|(_, slot)| **slot > 0);
        stored.flat_map(move |(brick, slot)| {
            let from = place(over, brick).map(|n| n * BRICK);
            let corner = place(self.atlas, *slot as usize - 1).map(|n| n * BRICK);
            (0..BRICK_VOXELS).filter_map(move |inside| {
                let [i, j, k] = place([BRICK; 3], inside);
                let at = [from[0] + i, from[1] + j, from[2] + k];
                let lies_inside = (0..3).all(|axis| at[axis] < self.size[axis]);
                let voxel = (at[2] * self.size[1] + at[1]) * self.size[0] + at[0];
                let texel = || self.texel([corner[0] + i, corner[1] + j, corner[2] + k]);
                lies_inside.then(|| StoredVoxel { brick, voxel, texel: texel() })
            })
        })
    }

    /// Texels of the atlas along x, y and z.
    pub(super) fn atlas_size(&self) -> [usize; 3] {
        self.atlas.map(|bricks| bricks * BRICK)
    }

    fn texel(&self, [x, y, z]: [usize; 3]) -> usize {
        let [width, height, _] = self.atlas_size();
        (z * height + y) * width + x
    }
}

/// x, y, z of an index into a grid of `size`.
fn place(size: [usize; 3], index: usize) -> [usize; 3] {
    [index % size[0], index / size[0] % size[1], index / size[0] / size[1]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn atlases_hold_their_bricks_and_hardly_more() {
        for count in [0, 1, 2, 7, 8, 9, 100, 1000, 4097, 1_000_000] {
            let [x, y, z] = atlas_for(count);
            assert!(x * y * z >= count.max(1) && x * y * (z - 1) < count.max(1), "{count}: {x} {y} {z}");
            assert!(x.max(y).max(z) <= x.min(y).min(z) + 2, "{count}: {x} {y} {z}");
        }
    }

    #[test]
    fn every_voxel_has_a_texel_of_its_own() {
        let size = [19, 8, 11];
        let occupied: Vec<u32> = (0..19 * 8 * 11).filter(|i| i % 19 < 3 || i % 97 == 0 && i / 19 / 8 < 8).collect();
        let bricks = Bricks::of(size, &occupied);
        assert_eq!(Bricks::from_index(size, bricks.index.clone(), bricks.count), Ok(bricks.clone()));
        let mut texels: Vec<usize> = bricks.voxels().map(|stored| stored.texel).collect();
        assert!(bricks.voxels().all(|stored| bricks.texel_of(stored.voxel) == Some(stored.texel)));
        assert!(occupied.iter().all(|&voxel| bricks.texel_of(voxel as usize).is_some()));
        texels.sort_unstable();
        texels.dedup();
        assert_eq!(texels.len(), bricks.voxels().count());
        assert!(*texels.last().unwrap() < bricks.atlas_size().iter().product());
    }
}
