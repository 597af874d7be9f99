//! Media to test on: made up here, or the synthetic scenes where the data is there.

use farfield::math::rng::Stream;
use farfield::math::warp;
use farfield::medium::{Medium, MediumShape, Voxel};
use formats::sggx::{FlakeLobe, Sggx};

/// Edge of a voxel, metres.
pub(crate) const VOXEL: f64 = 1e-5;

/// A slab of one kind of flakes, endless along x and y, `layers` voxels thick.
pub(crate) fn slab(layers: usize, density: f32, lobes: &[FlakeLobe]) -> Medium {
    let shape = MediumShape { size: [6, 5, layers], voxel: [VOXEL, 2.0 * VOXEL, VOXEL], repeat: [true, true, false] };
    Medium::new(shape, lobes.len(), |_| Some(Voxel::new(density, lobes)))
}

/// Two fibres that cross, of these albedos.
pub(crate) fn crossed(albedos: [[f32; 3]; 2]) -> [FlakeLobe; 2] {
    let lobe = |axis, area, albedo| FlakeLobe { area, shape: Sggx::fibre(axis, 0.1), albedo };
    [lobe([0.8, 0.6, 0.0], 0.6, albedos[0]), lobe([-0.48, 0.64, 0.6], 0.4, albedos[1])]
}

/// A block of scattered fibres, a third of its voxels occupied, some densely.
pub(crate) fn tangle(size: [usize; 3], albedo: [f32; 3]) -> Medium {
    let shape = MediumShape { size, voxel: [VOXEL; 3], repeat: [false; 3] };
    Medium::new(shape, 1, |[x, y, z]| {
        let stream = Stream::new(9, ((z * size[1] + y) * size[0] + x) as u64);
        let [chance, amount] = stream.uniform_pair(0);
        let axis = warp::sphere(stream.uniform_pair(1)).to_array();
        let lobe = FlakeLobe { area: 1.0, shape: Sggx::fibre(axis, 0.1 + 0.9 * stream.uniform(2)), albedo };
        let density = 2.0 * amount * amount / VOXEL as f32;
        (chance < 0.33).then(|| Voxel::new(density, &[lobe]))
    })
}
