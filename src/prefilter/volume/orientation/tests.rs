//! Made-up fibres at known angles: what the structure tensor says about them.

use super::*;
use crate::math::rng::{Draws, Stream};

const SETTINGS: OrientationSettings = OrientationSettings { sigma: 1.0, rho: 4.0 };

fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
    v.map(|x| x / length)
}

/// Degrees between two axes.
fn angle(a: [f32; 3], b: [f32; 3]) -> f32 {
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let dot: f32 = (0..3).map(|k| a[k] * b[k]).sum();
    cross.iter().map(|x| x * x).sum::<f32>().sqrt().atan2(dot.abs()).to_degrees()
}

/// Grey of parallel cylinders of this radius along `axis`, on a square lattice 3 radii wide, soft over a voxel; in voxels,
/// of which z ones may be longer.
fn cylinders(size: [usize; 3], axis: [f32; 3], radius: f32, z_edge: f32) -> Vec<f32> {
    let side = unit(if axis[0].abs() < 0.7 { [0.0, axis[2], -axis[1]] } else { [axis[2], 0.0, -axis[0]] });
    let other = [
        axis[1] * side[2] - axis[2] * side[1],
        axis[2] * side[0] - axis[0] * side[2],
        axis[0] * side[1] - axis[1] * side[0],
    ];
    let pitch = 3.0 * radius;
    let voxel = |i: usize| {
        let p = [i % size[0], i / size[0] % size[1], i / size[0] / size[1]].map(|n| n as f32);
        let p = [p[0], p[1], p[2] * z_edge];
        let [s, t] = [side, other].map(|d| (0..3).map(|k| p[k] * d[k]).sum::<f32>());
        let [s, t] = [s, t].map(|x| x - pitch * (x / pitch).round());
        (radius - s.hypot(t) + 0.5).clamp(0.0, 1.0)
    };
    (0..size.iter().product()).map(voxel).collect()
}

/// Mean and worst angle to `axis` over the voxels of `values` above half, `rim` away from the borders.
fn errors(grey: &Grey<'_>, axis: [f32; 3], rim: usize) -> (f32, f32) {
    let found = orientations(grey, &SETTINGS);
    let [nx, ny, _] = grey.size;
    let inside = |i: &usize| {
        let at = [i % nx, i / nx % ny, i / nx / ny];
        (0..3).all(|k| at[k] >= rim && at[k] + rim < grey.size[k])
    };
    let angles: Vec<f32> =
        (0..found.len()).filter(inside).filter(|&i| grey.values[i] > 0.5).map(|i| angle(found[i].axis, axis)).collect();
    assert!(angles.len() > 500, "{} voxels", angles.len());
    (angles.iter().sum::<f32>() / angles.len() as f32, angles.iter().copied().fold(0.0, f32::max))
}

const AXES: [[f32; 3]; 6] =
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [1.0, -2.0, 0.5], [0.3, 0.2, 0.9], [1.0, 1.0, 1.0]];

#[test]
fn parallel_cylinders_point_where_they_were_laid() {
    for axis in AXES.map(unit) {
        let size = [40, 36, 44];
        let values = cylinders(size, axis, 2.5, 1.0);
        let grey = Grey { values: &values, size, voxel: [1e-5; 3], repeat: [false; 3] };
        let (mean, worst) = errors(&grey, axis, 12);
        println!("{axis:?}: {mean:.2}° in the mean, {worst:.2}° at worst");
        // Found: 0.01 and 0.04; sampled Gaussians of σ = 1 are nearly isotropic.
        assert!(mean < 0.05 && worst < 0.2, "{axis:?}: {mean} {worst}");
    }
}

#[test]
fn long_voxels_do_not_bend_fibres() {
    let axis = unit([1.0, 0.5, 1.0]);
    let values = cylinders([48, 48, 40], axis, 4.0, 2.0);
    let grey = Grey { values: &values, size: [48, 48, 40], voxel: [1e-5, 1e-5, 2e-5], repeat: [false; 3] };
    let (mean, worst) = errors(&grey, axis, 10);
    println!("voxels twice as long: {mean:.2}° in the mean, {worst:.2}° at worst");
    assert!(mean < 0.2 && worst < 1.0, "{mean} {worst}");
}

#[test]
fn noise_as_strong_as_the_fibres_turns_them_by_a_few_degrees() {
    let axis = unit([1.0, -2.0, 0.5]);
    let size = [48, 48, 48];
    for (noise, limit) in [(0.2, 0.4), (0.5, 1.2), (1.0, 3.5)] {
        let mut values = cylinders(size, axis, 2.5, 1.0);
        let mut draws = Draws::new(Stream::new(5, 0));
        // Twelve uniform numbers less six: variance 1.
        values.iter_mut().for_each(|v| *v += noise * ((0..12).map(|_| draws.uniform()).sum::<f32>() - 6.0));
        let grey = Grey { values: &values, size, voxel: [1.0; 3], repeat: [false; 3] };
        let (mean, _) = errors(&grey, axis, 12);
        println!("noise {noise}: {mean:.2}° in the mean");
        assert!(mean < limit, "noise {noise}: {mean}°");
    }
}

#[test]
fn crossing_plies_keep_their_own_directions() {
    let [low, high] = [[1.0, 0.0, 0.0], unit([0.3, 1.0, 0.0])];
    let size = [40, 40, 64];
    let [a, b] = [low, high].map(|axis| cylinders(size, axis, 2.0, 1.0));
    let half = a.len() / 2;
    let values: Vec<f32> = a[..half].iter().chain(&b[half..]).copied().collect();
    let grey = Grey { values: &values, size, voxel: [1.0; 3], repeat: [false; 3] };
    let found = orientations(&grey, &SETTINGS);
    let mean = |slices: std::ops::Range<usize>, axis: [f32; 3]| {
        let voxels = slices.start * 1600..slices.end * 1600;
        voxels.clone().map(|i| angle(found[i].axis, axis)).sum::<f32>() / voxels.len() as f32
    };
    assert!(mean(14..22, low) < 2.0 && mean(42..50, high) < 2.0, "{} {}", mean(14..22, low), mean(42..50, high));
    // Where they meet the tensor sees two directions: the axis lies in their plane, or neither is meant.
    let linearity = |z: usize| (0..1600).map(|i| found[z * 1600 + i].linearity).sum::<f32>() / 1600.0;
    assert!(linearity(32) < 0.7 * linearity(18), "{} {}", linearity(32), linearity(18));
}

#[test]
fn repeating_volumes_have_no_rim() {
    // Cylinders along y, of a lattice that 36 voxels along x and z repeat.
    let size = [36, 12, 36];
    let values = cylinders(size, [0.0, 1.0, 0.0], 3.0, 1.0);
    let grey = Grey { values: &values, size, voxel: [1.0; 3], repeat: [true; 3] };
    let found = orientations(&grey, &SETTINGS);
    for i in 0..found.len() {
        let at = [i % 36, i / 36 % 12, i / 432];
        let shifted = (at[2] + 9) % 36 * 432 + at[1] * 36 + (at[0] + 18) % 36;
        assert!(angle(found[i].axis, [0.0, 1.0, 0.0]) < 0.01);
        // The lattice is 9 wide: the same place of another cylinder.
        assert!((found[i].linearity - found[shifted].linearity).abs() < 1e-3, "{at:?}");
    }
}

#[test]
fn flat_and_tiny_volumes_give_finite_axes() {
    for (size, value) in [([1, 1, 1], 0.3), ([5, 1, 2], 0.0), ([1, 7, 1], 1e30), ([4, 4, 4], 1e-30)] {
        let values = vec![value; size.iter().product()];
        for repeat in [[false; 3], [true; 3]] {
            let grey = Grey { values: &values, size, voxel: [1e-9, 1.0, 1e9], repeat };
            for Orientation { axis, linearity } in orientations(&grey, &OrientationSettings { sigma: 0.0, rho: 0.0 }) {
                let length: f32 = axis.iter().map(|x| x * x).sum();
                assert!((length - 1.0).abs() < 1e-6 && (0.0..=1.0).contains(&linearity), "{axis:?} {linearity}");
            }
        }
    }
}

#[test]
fn threads_change_no_bit() {
    let size = [20, 18, 40];
    let values = cylinders(size, unit([0.3, 0.2, 0.9]), 2.0, 1.0);
    let grey = Grey { values: &values, size, voxel: [1.0; 3], repeat: [false; 3] };
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| orientations(&grey, &SETTINGS))
    };
    assert_eq!(on(1), on(3));
}
