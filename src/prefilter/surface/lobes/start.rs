//! Where expectation maximisation starts: groups of normals by repeated splitting.

use super::mixture::{Lobe, Mixture, Moments};
use super::samples::MicroNormals;
use glam::Vec3;

/// Variance Σ w|n − mean|² per micro-area under which normals count as equal: that of the greatest concentration.
const EQUAL: f64 = 1e-6;

/// A mixture of at most `count` lobes: the widest group is halved across its principal axis until there are enough.
///
/// Deterministic, unlike random seeds, and not drawn to outliers, as farthest-first seeds are.
pub(super) fn split(samples: &MicroNormals, count: usize) -> Mixture {
    let mut group_of = vec![0_u8; samples.len()];
    let mut groups = vec![Group::of(samples, &group_of, 0)];
    while groups.len() < count {
        // The first of the widest, whatever the order of comparison.
        let widest = (0..groups.len()).fold(0, |best, k| if groups[k].spread > groups[best].spread { k } else { best });
        if groups[widest].spread <= EQUAL * groups[widest].weight {
            break;
        }
        let new = groups.len();
        groups[widest].halve(samples, &mut group_of, [widest as u8, new as u8]);
        groups[widest] = Group::of(samples, &group_of, widest as u8);
        groups.push(Group::of(samples, &group_of, new as u8));
    }
    Mixture { lobes: groups.iter().map(|group| group.lobe).filter(|lobe| lobe.weight > 0.0).collect() }
}

/// Some normals of the cell: Σw, mean and within-group scatter.
struct Group {
    weight: f64,
    /// Σ w |n − n̄|².
    spread: f64,
    /// n̄, shorter than 1.
    mean: Vec3,
    /// Σ w (n − n̄)(n − n̄)ᵀ: xx, yy, zz, xy, xz, yz.
    scatter: [f32; 6],
    lobe: Lobe,
}

impl Group {
    fn of(samples: &MicroNormals, group_of: &[u8], group: u8) -> Self {
        let members = || (0..samples.len()).filter(|&k| group_of[k] == group).map(|k| samples.get(k));
        let mut sum = glam::DVec3::ZERO;
        let mut weight = 0.0;
        for (n, w) in members() {
            sum += f64::from(w) * Vec3::from_array(n).as_dvec3();
            weight += f64::from(w);
        }
        let mean = if weight > 0.0 { (sum / weight).as_vec3() } else { Vec3::Z };
        let mut scatter = [0.0; 6];
        for (n, w) in members() {
            let d = Vec3::from_array(n) - mean;
            let products = [d.x * d.x, d.y * d.y, d.z * d.z, d.x * d.y, d.x * d.z, d.y * d.z];
            scatter.iter_mut().zip(products).for_each(|(sum, product)| *sum += w * product);
        }
        let spread = f64::from(scatter[0] + scatter[1] + scatter[2]);
        // About the unit mean μ: δ = (n − n̄) + (n̄ − μ).
        let about = mean.normalize_or(Vec3::Z);
        let shift = (mean - about).as_dvec3();
        let offset = (weight * shift).to_array();
        let lobe = Moments { weight, offset, spread: spread + weight * shift.length_squared() }.lobe(about);
        Self { weight, spread, mean, scatter, lobe }
    }

    /// Moves the members on the far side of the plane through the mean across the principal axis to `groups[1]`.
    fn halve(&self, samples: &MicroNormals, group_of: &mut [u8], groups: [u8; 2]) {
        let axis = self.principal_axis();
        for (k, group) in group_of.iter_mut().enumerate() {
            if *group == groups[0] && (Vec3::from_array(samples.get(k).0) - self.mean).dot(axis) > 0.0 {
                *group = groups[1];
            }
        }
    }

    /// Direction of the greatest scatter, by power iteration from the column of the greatest diagonal entry.
    fn principal_axis(&self) -> Vec3 {
        let [xx, yy, zz, xy, xz, yz] = self.scatter;
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
