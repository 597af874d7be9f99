//! What the flakes of a voxel reflect: the scaled phase function, bound to the known direction.

use formats::sggx::{self as flakes, FlakeLobe};
use glam::Vec3;

use super::grid::{MAX_LOBES, Medium};
use crate::math::sggx;

/// The flakes of a voxel as one direction sees them.
#[derive(Clone, Copy, Debug)]
pub struct BoundFlakes {
    lobes: [FlakeLobe; MAX_LOBES],
    count: usize,
    /// The known direction, unit, away from the flakes.
    w: Vec3,
    /// ρφ_j σ_j(w); the density ρ cancels wherever it stands.
    shown: [f32; MAX_LOBES],
    /// Σ of `shown`.
    total: f32,
}

/// A direction that flakes scatter to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Unit, away from the flakes.
    pub wi: Vec3,
    /// Phase function over density of `wi`, RGB: the mean albedo of the flakes that reflect there.
    pub weight: [f32; 3],
    /// Share of each lobe in the flakes that reflect there: φ_j D_j(h) / Σ_l φ_l D_l(h).
    pub posterior: [f32; MAX_LOBES],
}

impl Medium {
    /// The flakes of the occupied voxel `index` as seen from `w` (unit, away from them).
    #[inline]
    pub fn flakes(&self, index: usize, w: Vec3) -> BoundFlakes {
        let count = self.lobe_count();
        let mut lobes = [self.lobe(index, 0); MAX_LOBES];
        (1..count).for_each(|j| lobes[j] = self.lobe(index, j));
        let mut shown = [0.0; MAX_LOBES];
        (0..count).for_each(|j| shown[j] = lobes[j].area * lobes[j].shape.projected_area(w.to_array()));
        BoundFlakes { lobes, count, w, shown, total: shown.iter().sum() }
    }
}

impl BoundFlakes {
    /// Scatters, from two uniform numbers in [0, 1) of which the first also chooses the lobe.
    ///
    /// The density of `wi` is [`BoundFlakes::pdf`]; all lobes count in the weight, not only the one that was chosen.
    #[inline]
    pub fn sample(&self, mut u: [f32; 2]) -> Scatter {
        let mut chosen = 0;
        if self.count > 1 {
            let mut left = u[0] * self.total;
            while chosen + 1 < self.count && left >= self.shown[chosen] {
                left -= self.shown[chosen];
                chosen += 1;
            }
            // A lobe is chosen where it shows some area; rounding may reach 1.
            u[0] = (left / self.shown[chosen]).clamp(0.0, 1.0 - f32::EPSILON / 2.0);
        }
        let m = sggx::visible_normal(&self.lobes[chosen].shape, self.w, u);
        let posterior = self.posterior(m);
        Scatter { wi: sggx::reflected(self.w, m), weight: self.albedo(&posterior), posterior }
    }

    /// Density of [`BoundFlakes::sample`] at `wi`, 1/sr: the phase function of white flakes.
    #[inline]
    pub fn pdf(&self, wi: Vec3) -> f32 {
        let Some(h) = flakes::half_vector(self.w.to_array(), wi.to_array()) else { return 0.0 };
        0.25 * self.lobes().map(|lobe| lobe.area * lobe.shape.density(h)).sum::<f32>() / self.total
    }

    /// The scaled phase function towards `wi`, RGB, 1/sr.
    #[inline]
    pub fn eval(&self, wi: Vec3) -> [f32; 3] {
        let towards = wi.to_array();
        flakes::scattering(&self.lobes[..self.count], self.w.to_array(), towards).map(|value| value / self.total)
    }

    /// Share of each lobe in the flakes of normal `m`.
    #[inline]
    fn posterior(&self, m: Vec3) -> [f32; MAX_LOBES] {
        let mut share = [0.0; MAX_LOBES];
        if self.count == 1 {
            share[0] = 1.0;
            return share;
        }
        let mut sum = 0.0;
        for (j, lobe) in self.lobes().enumerate() {
            share[j] = lobe.area * lobe.shape.density(m.to_array());
            sum += share[j];
        }
        share.map(|value| value / sum)
    }

    /// Mean albedo under these shares.
    #[inline]
    fn albedo(&self, posterior: &[f32; MAX_LOBES]) -> [f32; 3] {
        let mut sum = [0.0; 3];
        for (lobe, share) in self.lobes().zip(posterior) {
            (0..3).for_each(|c| sum[c] += share * lobe.albedo[c]);
        }
        sum
    }

    fn lobes(&self) -> impl Iterator<Item = &FlakeLobe> {
        self.lobes[..self.count].iter()
    }
}
