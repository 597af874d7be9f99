//! Where expectation maximisation starts: groups of normals by repeated splitting.

use super::mixture::{BLOCK, Lobe, Mixture, Moments};
use super::samples::{LANES, MicroNormals};
use glam::{DVec3, Vec3};
use std::ops::Range;

/// Variance Σ w|n − mean|² per micro-area under which normals count as equal: that of the greatest concentration.
const EQUAL: f64 = 1e-6;

/// A mixture of at most `count` lobes: the widest group is halved across its principal axis until there are enough.
///
/// Deterministic, unlike random seeds, and not drawn to outliers, as farthest-first seeds are. Reorders the samples so
/// that a group is a range of them.
pub(super) fn split(samples: &mut MicroNormals, count: usize) -> Mixture {
    let mut groups = vec![Group::of(samples, 0..samples.len(), Vec3::Z)];
    while groups.len() < count {
        // The first of the widest: the order of equals must not depend on anything else.
        let widest = (0..groups.len()).fold(0, |best, k| if groups[k].spread > groups[best].spread { k } else { best });
        if groups[widest].spread <= EQUAL * groups[widest].weight {
            break;
        }
        let Group { ref members, mean, .. } = groups[widest];
        let middle = partition(samples, members.clone(), mean, groups[widest].principal_axis());
        let parts = [members.start..middle, middle..members.end];
        let [near, far] = parts.map(|members| Group::of(samples, members, mean));
        groups[widest] = near;
        groups.push(far);
    }
    Mixture { lobes: groups.iter().map(Group::lobe).filter(|lobe| lobe.weight > 0.0).collect() }
}

/// Moves `members` beyond the plane through `mean` across `axis` to the end; returns where they begin.
fn partition(samples: &mut MicroNormals, members: Range<usize>, mean: Vec3, axis: Vec3) -> usize {
    let mut middle = members.start;
    for k in members {
        if (Vec3::from_array(samples.get(k).0) - mean).dot(axis) <= 0.0 {
            samples.swap(k, middle);
            middle += 1;
        }
    }
    middle
}

/// Some normals of the cell.
struct Group {
    members: Range<usize>,
    /// Σ w.
    weight: f64,
    /// Σ w |n − n̄|².
    spread: f64,
    /// n̄, shorter than 1.
    mean: Vec3,
    /// Σ w (n − n̄)(n − n̄)ᵀ: xx, yy, zz, xy, xz, yz.
    scatter: [f64; 6],
}

impl Group {
    /// Statistics of the samples `members`, summed about a point `about` near their mean.
    fn of(samples: &MicroNormals, members: Range<usize>, about: Vec3) -> Self {
        let mut sums = [0.0; 10];
        for from in members.clone().step_by(BLOCK) {
            let block = from..(from + BLOCK).min(members.end);
            sums.iter_mut().zip(block_sums(samples, block, about)).for_each(|(sum, part)| *sum += part);
        }
        let [weight, x, y, z, xx, yy, zz, xy, xz, yz] = sums;
        let d = if weight > 0.0 { DVec3::new(x, y, z) / weight } else { DVec3::ZERO };
        let products = [d.x * d.x, d.y * d.y, d.z * d.z, d.x * d.y, d.x * d.z, d.y * d.z];
        let mut scatter = [xx, yy, zz, xy, xz, yz];
        scatter.iter_mut().zip(products).for_each(|(sum, product)| *sum -= weight * product);
        let spread = scatter[0] + scatter[1] + scatter[2];
        Self { members, weight, spread, mean: (about.as_dvec3() + d).as_vec3(), scatter }
    }

    fn lobe(&self) -> Lobe {
        // About the unit mean μ: δ = (n − n̄) + (n̄ − μ).
        let about = self.mean.normalize_or(Vec3::Z);
        let shift = (self.mean - about).as_dvec3();
        let offset = (self.weight * shift).to_array();
        Moments { weight: self.weight, offset, spread: self.spread + self.weight * shift.length_squared() }.lobe(about)
    }

    /// Direction of the greatest scatter, by power iteration from the column of the greatest diagonal entry.
    fn principal_axis(&self) -> Vec3 {
        let [xx, yy, zz, xy, xz, yz] = self.scatter.map(|s| s as f32);
        let columns = [Vec3::new(xx, xy, xz), Vec3::new(xy, yy, yz), Vec3::new(xz, yz, zz)];
        let start = (0..3).fold(0, |best, k| if columns[k][k] > columns[best][best] { k } else { best });
        let mut axis = columns[start].normalize_or(Vec3::X);
        for _ in 0..8 {
            let next = columns[0] * axis.x + columns[1] * axis.y + columns[2] * axis.z;
            axis = next.normalize_or(axis);
        }
        axis
    }
}

/// Σw, Σwδ and Σwδδᵀ (xx, yy, zz, xy, xz, yz) of at most [`BLOCK`] samples, δ = n − `about`.
fn block_sums(samples: &MicroNormals, block: Range<usize>, about: Vec3) -> [f64; 10] {
    let (x, tail_x) = samples.x[block.clone()].as_chunks::<LANES>();
    let (y, tail_y) = samples.y[block.clone()].as_chunks::<LANES>();
    let (z, tail_z) = samples.z[block.clone()].as_chunks::<LANES>();
    let (weight, tail_weight) = samples.weight[block].as_chunks::<LANES>();
    let mut sums = [[0.0; LANES]; 10];
    for (((x, y), z), weight) in x.iter().zip(y).zip(z).zip(weight) {
        add_lanes(&mut sums, [x, y, z, weight], about);
    }
    let tail = [tail_x, tail_y, tail_z, tail_weight].map(|tail| {
        let mut lane = [0.0; LANES];
        lane[..tail.len()].copy_from_slice(tail);
        lane
    });
    let [x, y, z, weight] = &tail;
    add_lanes(&mut sums, [x, y, z, weight], about);
    sums.map(|lane| lane.iter().map(|&v| f64::from(v)).sum())
}

#[inline]
fn add_lanes(sums: &mut [[f32; LANES]; 10], [x, y, z, weight]: [&[f32; LANES]; 4], about: Vec3) {
    // Sums in locals: seen through one reference, the compiler would not vectorise them.
    let [mut s, mut sx, mut sy, mut sz, mut sxx, mut syy, mut szz, mut sxy, mut sxz, mut syz] = *sums;
    for k in 0..LANES {
        let [dx, dy, dz] = [x[k] - about.x, y[k] - about.y, z[k] - about.z];
        let [wx, wy, wz] = [weight[k] * dx, weight[k] * dy, weight[k] * dz];
        s[k] += weight[k];
        sx[k] += wx;
        sy[k] += wy;
        sz[k] += wz;
        sxx[k] += wx * dx;
        syy[k] += wy * dy;
        szz[k] += wz * dz;
        sxy[k] += wx * dy;
        sxz[k] += wx * dz;
        syz[k] += wy * dz;
    }
    *sums = [s, sx, sy, sz, sxx, syy, szz, sxy, sxz, syz];
}
