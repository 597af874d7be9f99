//! The lobes of one cell side by side: the same formulas as [`CellBrdf`](super::CellBrdf), in loops that compilers
//! vectorise.

use super::{Facing, LobeKernel, SpecularRef, dot, one_minus_half_cosine};

/// Most lobes side by side.
pub(crate) const LANES: usize = crate::asset::MAX_LOBES;

/// Lanes come in groups of this many: one vector of every instruction set that we meet.
pub(crate) const GROUP: usize = 4;

/// Gaussians that are taken together.
const CHUNK: usize = 4;

/// One number a lobe.
pub(crate) type Lane = [f32; LANES];

/// Up to [`LANES`] lobes: their weights and the constants of their kernels.
#[derive(Clone, Debug)]
pub(crate) struct KernelLanes {
    is_half: bool,
    weight: Lane,
    mean: [Lane; 3],
    kappa: Lane,
    norm: Lane,
    resultant: Lane,
    var_across: Lane,
    var_along: Lane,
    widen: Lane,
}

/// [`Facing`] of every lane.
#[derive(Clone, Debug, Default)]
pub(crate) struct FacingLanes {
    pub(crate) cos_mean: Lane,
    mean: Lane,
    normal_mean: Lane,
    fraction: Lane,
    excess: Lane,
}

impl KernelLanes {
    /// These lobes, (weight, kernel) each; at most [`LANES`]. Spare lanes are flat lobes of weight 0.
    #[inline]
    pub(crate) fn new(lobes: impl ExactSizeIterator<Item = (f32, LobeKernel)>) -> Self {
        debug_assert!(lobes.len() <= LANES, "{} lobes", lobes.len());
        let zero = [0.0; LANES];
        let mut lanes = Self {
            is_half: lobes.len() <= GROUP,
            weight: zero,
            mean: [zero, zero, [1.0; LANES]],
            kappa: [1.0; LANES],
            norm: [1.0; LANES],
            resultant: [1.0; LANES],
            var_across: [1.0; LANES],
            var_along: [1.0; LANES],
            widen: [1.0; LANES],
        };
        for (j, (weight, kernel)) in lobes.enumerate() {
            lanes.weight[j] = weight;
            (0..3).for_each(|k| lanes.mean[k][j] = kernel.mean[k]);
            lanes.kappa[j] = kernel.kappa;
            lanes.norm[j] = kernel.norm;
            lanes.resultant[j] = kernel.resultant;
            lanes.var_across[j] = kernel.var_across;
            lanes.var_along[j] = kernel.var_along;
            lanes.widen[j] = kernel.widen;
        }
        lanes
    }

    /// Whether the first [`GROUP`] lanes hold all lobes. Loops are over 4 or 8 lanes, known when compiling: with a
    /// number known only when running they were not vectorised.
    #[inline(always)]
    pub(crate) fn is_half(&self) -> bool {
        self.is_half
    }

    /// Weight of every lane.
    #[inline(always)]
    pub(crate) fn weight(&self) -> &Lane {
        &self.weight
    }

    /// κ of every lane.
    #[inline(always)]
    pub(crate) fn kappa(&self) -> &Lane {
        &self.kappa
    }

    /// μ of a lane.
    #[inline(always)]
    pub(crate) fn mean(&self, j: usize) -> [f32; 3] {
        [0, 1, 2].map(|k| self.mean[k][j])
    }

    #[inline(always)]
    fn kernel(&self, j: usize) -> LobeKernel {
        LobeKernel {
            mean: self.mean(j),
            kappa: self.kappa[j],
            norm: self.norm[j],
            resultant: self.resultant[j],
            var_across: self.var_across[j],
            var_along: self.var_along[j],
            widen: self.widen[j],
        }
    }

    /// μ_j·ω of every lane.
    #[inline(always)]
    pub(crate) fn cos_mean(&self, w: [f32; 3]) -> Lane {
        let mut lane = [0.0; LANES];
        for (j, cos_mean) in lane.iter_mut().enumerate() {
            *cos_mean = dot(self.mean(j), w);
        }
        lane
    }

    /// How every lane faces ω.
    #[inline]
    pub(crate) fn facing(&self, w: [f32; 3]) -> FacingLanes {
        if self.is_half() { self.facing_of::<GROUP>(w) } else { self.facing_of::<LANES>(w) }
    }

    #[inline]
    fn facing_of<const N: usize>(&self, w: [f32; 3]) -> FacingLanes {
        let mut out = FacingLanes::default();
        for j in 0..N {
            let facing = self.kernel(j).facing(w);
            out.cos_mean[j] = facing.cos_mean;
            out.mean[j] = facing.mean;
            out.normal_mean[j] = facing.normal_mean;
            out.fraction[j] = facing.fraction;
            out.excess[j] = facing.excess;
        }
        out
    }

    /// P_c(ω) = Σ_j w_j P_j.
    #[inline(always)]
    pub(crate) fn facing_sum(&self, facing: &FacingLanes) -> f32 {
        sum(&std::array::from_fn(|j| self.weight[j] * facing.mean[j]))
    }

    /// Σ_j w_j·cosines_j; `cos_io` = ωi·ωo.
    #[inline]
    pub(crate) fn cosines_sum(&self, i: &FacingLanes, o: &FacingLanes, cos_io: f32) -> f32 {
        let term = |j: usize| self.weight[j] * self.kernel(j).cosines(i.lane(j), o.lane(j), cos_io);
        sum(&std::array::from_fn(term))
    }

    /// Σ_j w_j·specular_j from `cos_half` = ωi·h and μ_j·ωi, μ_j·ωo of every lane.
    #[inline]
    pub(crate) fn specular_sum(&self, specular: SpecularRef<'_>, cos_half: f32, ci: &Lane, co: &Lane) -> f32 {
        if self.is_half() {
            self.specular_sum_of::<GROUP>(specular, cos_half, ci, co)
        } else {
            self.specular_sum_of::<LANES>(specular, cos_half, ci, co)
        }
    }

    #[inline]
    fn specular_sum_of<const N: usize>(&self, specular: SpecularRef<'_>, cos_half: f32, ci: &Lane, co: &Lane) -> f32 {
        let one_minus_cos: Lane = std::array::from_fn(|j| one_minus_half_cosine(cos_half, ci[j], co[j]));
        let mut out = [0.0; LANES];
        for gaussians in specular.gaussians.chunks(CHUNK) {
            let zero = [[0.0; LANES]; CHUNK];
            let (mut kappa, mut mass) = (zero, zero);
            for (kappa, gaussian) in kappa.iter_mut().zip(gaussians) {
                for j in 0..N {
                    kappa[j] = self.kernel(j).product_kappa(gaussian[0], one_minus_cos[j]);
                }
            }
            for ((mass, kappa), &gaussian) in mass.iter_mut().zip(&kappa).zip(gaussians) {
                for j in 0..N {
                    mass[j] = self.kernel(j).product_mass(gaussian, one_minus_cos[j], kappa[j]);
                }
            }
            for ((mass, kappa), gaussian) in mass.iter().zip(&kappa).zip(gaussians) {
                for j in 0..N {
                    let kernel = self.kernel(j);
                    out[j] += mass[j] * kernel.shadowing(specular.alpha, gaussian[0], cos_half, ci[j], co[j], kappa[j]);
                }
            }
        }
        sum(&std::array::from_fn(|j| self.weight[j] * out[j]))
    }
}

impl FacingLanes {
    #[inline(always)]
    fn lane(&self, j: usize) -> Facing {
        Facing {
            cos_mean: self.cos_mean[j],
            mean: self.mean[j],
            normal_mean: self.normal_mean[j],
            fraction: self.fraction[j],
            excess: self.excess[j],
        }
    }
}

/// The sum of all lanes, in an order that vectors of four have: halves, quarters, pairs.
#[inline(always)]
pub(crate) fn sum(lane: &Lane) -> f32 {
    let [a, b, c, d] = std::array::from_fn(|k| lane[k] + lane[k + GROUP]);
    (a + c) + (b + d)
}
