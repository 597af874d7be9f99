//! f_low for renderers: evaluated and sampled a hundred million times.
//!
//! [`LevelBrdf::new`] prepares a level once: the constants of every lobe, S in texels of four floats, what the sampler
//! takes for the base BRDF. [`LevelBrdf::at`] binds a place and a viewer, so that [`BoundBrdf::eval`] is left with what
//! depends on the light. Nothing is allocated after `new`. The formulas are those of [`crate::cell_brdf`] and
//! [`crate::lookup`]; only the order of sums over lobes differs from [`SurfaceLevel::f_low`].
//!
//! ```
//! use farfield_formats::level_brdf::{LevelBrdf, LevelHit};
//! use farfield_formats::{Error, SurfaceAsset, lookup::direction_of};
//!
//! fn main() -> Result<(), Error> {
//!     let bark = SurfaceAsset::read("tests/data/v1".as_ref())?;
//!     let level = LevelBrdf::new(&bark, &bark.levels[0]);
//!     let x = [0.3, 0.6];
//!     let n_c = bark.levels[0].normal_at(&bark, x);
//!     let brdf = level.at(&LevelHit { x, n_c, tilt: [0.0; 2] }, direction_of([0.7, 0.6]));
//!     if let Some(sample) = brdf.sample([0.1, 0.2, 0.3]) {
//!         let cos_theta: f32 = (0..3).map(|k| n_c[k] * sample.wi[k]).sum();
//!         println!("towards {:?}: weight {:?}", sample.wi, sample.f.map(|f| f * cos_theta / sample.pdf));
//!     }
//!     Ok(())
//! }
//! ```

mod mixture;
mod shear;

use std::cell::OnceCell;

use crate::asset::{AdditiveTerm, MAX_LOBES, MAX_RANK, SurfaceAsset, SurfaceLevel};
use crate::cell_brdf::lanes::{FacingLanes, KernelLanes, Lane};
use crate::cell_brdf::{CellBrdf, LobeKernel, MIN_FACING, Specular, SpecularRef, Tint, dot, half_vector, prepared};
use crate::lookup::{angular_taps, bilinear_taps};
use mixture::{BaseGaussians, HalfMixture, View, cosine_direction, cosine_pdf};

/// A level made ready for rendering. It borrows the asset for T and the base BRDF, and holds lobes and S itself.
#[derive(Clone, Debug)]
pub struct LevelBrdf<'a> {
    asset: &'a SurfaceAsset,
    level: &'a SurfaceLevel,
    /// (weight, kernel) of the lobes in use, cell after cell.
    lobes: Vec<(f32, LobeKernel)>,
    /// Where each cell's lobes begin in `lobes`, and the end.
    first_lobe: Vec<u32>,
    /// S, `[rank][wo·N² + wi]`, padded to whole vectors.
    angular: Vec<[f32; 4]>,
    conductor: Option<SpecularRef<'a>>,
    gaussians: BaseGaussians,
}

/// Where a ray meets the displaced surface of a level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelHit {
    /// Place as fractions of the map along u and v, in [0, 1).
    pub x: [f32; 2],
    /// Unit normal of the displaced surface there, base frame.
    pub n_c: [f32; 3],
    /// Slope (∂L/∂x, ∂L/∂y) of a large-scale displacement L under the tile, metres per metre along the axes of the base
    /// frame; 0 without one. `n_c` is then the normal of the sum of both displacements.
    pub tilt: [f32; 2],
}

/// A direction drawn from [`BoundBrdf::sample`] or [`BoundAdditive::sample`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelSample {
    /// Towards the light, unit, base frame; above the horizons of base and, for the former, `n_c`.
    pub wi: [f32; 3],
    /// Density of `wi`, 1/sr; greater than 0.
    pub pdf: f32,
    /// f_low(ωi, ωo), or T_a·E, 1/sr, RGB, cosine not included.
    pub f: [f32; 3],
}

/// f_low at one place for one viewer.
#[derive(Clone, Debug)]
pub struct BoundBrdf<'a> {
    level: &'a LevelBrdf<'a>,
    hit: LevelHit,
    wo: [f32; 3],
    lobes: KernelLanes,
    viewer: FacingLanes,
    tint: Tint,
    /// First texel and weight of the four rows of S around ωo.
    rows: [(usize, f32); 4],
    /// T_r(x), padded.
    spatial: [[f32; 4]; MAX_RANK],
    /// 1/(⟨n_c, ωg⟩ P_c(ωo)); 0 where f_low is 0 for every ωi.
    scale: f32,
    sampler: OnceCell<Sampler>,
}

/// The additive term at one place for one viewer: a BRDF of the base plane, README section 4.1.
#[derive(Clone, Debug)]
pub struct BoundAdditive<'a> {
    term: &'a AdditiveTerm,
    tilt: [f32; 2],
    /// Unit normal of the base plane, tilted or not.
    normal: [f32; 3],
    /// First texel and weight of the four rows of E around ωo.
    rows: [(usize, f32); 4],
    /// T_a(x).
    spatial: [f32; 3],
}

/// How directions are drawn: cosine about n_c with a probability, half vectors from a mixture otherwise.
#[derive(Clone, Debug)]
struct Sampler {
    cosine: f32,
    half: HalfMixture,
}

/// What one ωi costs, shared between f and pdf.
struct Incident {
    cos_half: f32,
    cos_io: f32,
}

impl<'a> LevelBrdf<'a> {
    /// Prepares `level` of `asset`; its lobes take 44 bytes each, S 16 bytes a texel.
    ///
    /// # Panics
    /// If a cell has more lobes, or the level more ranks, than an asset may hold.
    pub fn new(asset: &'a SurfaceAsset, level: &'a SurfaceLevel) -> Self {
        assert!(level.lobes.len() <= MAX_LOBES, "{} lobes, more than an asset may hold", level.lobes.len());
        assert!(level.spatial.len() <= MAX_RANK, "rank {}, more than an asset may hold", level.spatial.len());
        let cells = level.cells[0] * level.cells[1];
        let mut lobes = Vec::new();
        let mut first_lobe = vec![0];
        for cell in 0..cells {
            lobes.extend(prepared(level.lobes.iter().map(|lobe| lobe[cell])));
            first_lobe.push(u32::try_from(lobes.len()).expect("16384² cells of 8 lobes are 2³¹"));
        }
        let conductor = asset.bsdf.specular.as_ref().map(Specular::view);
        Self {
            asset,
            level,
            lobes,
            first_lobe,
            angular: level.angular.iter().flatten().map(|&[r, g, b]| [r, g, b, 0.0]).collect(),
            conductor,
            gaussians: conductor.map_or(BaseGaussians::NONE, |view| BaseGaussians::new(view.gaussians)),
        }
    }

    /// f_c of a cell, as [`SurfaceLevel::cell_brdf`] but without preparing its lobes again.
    pub fn cell_brdf(&self, cell: usize) -> CellBrdf<'_> {
        CellBrdf::of_prepared(self.cell_lobes(cell), &self.asset.bsdf, self.color(cell))
    }

    /// The BRDF at a hit as seen from `wo`: unit, away from the surface, base frame.
    pub fn at(&self, hit: &LevelHit, wo: [f32; 3]) -> BoundBrdf<'_> {
        let cell = self.level.cell_at(hit.x);
        let lobes = if hit.tilt == [0.0; 2] {
            KernelLanes::new(self.cell_lobes(cell).iter().copied())
        } else {
            KernelLanes::new(self.cell_lobes(cell).iter().map(|&lobe| shear::lobe(lobe, hit.tilt)))
        };
        let viewer = lobes.facing(wo);
        let facing = lobes.facing_sum(&viewer);
        let flat_wo = shear::straighten(wo, hit.tilt);
        let is_seen = flat_wo[2] > 0.0 && hit.n_c[2] > 0.0 && facing >= MIN_FACING;
        let columns = self.level.directions * self.level.directions;
        let mut spatial = [[0.0; 4]; MAX_RANK];
        for (rank, spatial) in spatial.iter_mut().enumerate().take(self.level.spatial.len()) {
            spatial[..3].copy_from_slice(&self.level.spatial_at(rank, hit.x, self.asset.boundary));
        }
        BoundBrdf {
            level: self,
            hit: *hit,
            wo,
            lobes,
            viewer,
            tint: Tint::new(&self.asset.bsdf, self.color(cell)),
            rows: angular_taps(flat_wo, self.level.directions).map(|(row, weight)| (row * columns, weight)),
            spatial,
            scale: if is_seen { 1.0 / (hit.n_c[2] * facing) } else { 0.0 },
            sampler: OnceCell::new(),
        }
    }

    /// The additive term at a hit as seen from `wo`; `None` where the level has none, and below the base.
    pub fn additive_at(&self, hit: &LevelHit, wo: [f32; 3]) -> Option<BoundAdditive<'_>> {
        let term = self.level.additive.as_ref()?;
        let flat_wo = shear::straighten(wo, hit.tilt);
        let columns = term.directions * term.directions;
        let mut spatial = [0.0; 3];
        for (texel, weight) in bilinear_taps(hit.x, self.level.patches, self.asset.boundary) {
            (0..3).for_each(|k| spatial[k] += weight * term.spatial[texel][k]);
        }
        (flat_wo[2] > 0.0).then(|| BoundAdditive {
            term,
            tilt: hit.tilt,
            normal: shear::base_normal(hit.tilt),
            rows: angular_taps(flat_wo, term.directions).map(|(row, weight)| (row * columns, weight)),
            spatial,
        })
    }

    fn cell_lobes(&self, cell: usize) -> &[(f32, LobeKernel)] {
        &self.lobes[self.first_lobe[cell] as usize..self.first_lobe[cell + 1] as usize]
    }

    fn color(&self, cell: usize) -> [f32; 3] {
        self.level.base_color.as_ref().map_or([1.0; 3], |colors| colors[cell])
    }
}

impl BoundAdditive<'_> {
    /// Unit normal of the base plane: what the cosine of the light is taken with, and [`Self::sample`] follows.
    pub fn normal(&self) -> [f32; 3] {
        self.normal
    }

    /// T_a·E(ωi, ωo); 1/sr, RGB, cosine not included. `wi` is unit, away from the surface, in the base frame.
    pub fn eval(&self, wi: [f32; 3]) -> [f32; 3] {
        let flat_wi = shear::straighten(wi, self.tilt);
        if flat_wi[2] <= 0.0 {
            return [0.0; 3];
        }
        let taps = angular_taps(flat_wi, self.term.directions);
        let mut angular = [0.0; 3];
        for (first, row_weight) in self.rows {
            for (column, weight) in taps {
                let texel = self.term.angular[first + column];
                (0..3).for_each(|k| angular[k] += row_weight * weight * texel[k]);
            }
        }
        std::array::from_fn(|k| self.spatial[k] * angular[k])
    }

    /// Density of [`Self::sample`] in the direction `wi`, 1/sr: cosine-weighted about the base plane's normal.
    pub fn pdf(&self, wi: [f32; 3]) -> f32 {
        cosine_pdf(dot(self.normal, wi).max(0.0))
    }

    /// A direction that follows [`Self::pdf`], from two uniform numbers in [0, 1); `None` where rounding leaves it on
    /// the horizon.
    pub fn sample(&self, u: [f32; 2]) -> Option<LevelSample> {
        let wi = cosine_direction(self.normal, u);
        let pdf = self.pdf(wi);
        (pdf > 0.0).then(|| LevelSample { wi, pdf, f: self.eval(wi) })
    }
}

impl BoundBrdf<'_> {
    /// f_low(ωi, ωo); 1/sr, RGB, cosine not included. `wi` is unit, away from the surface, in the base frame.
    ///
    /// Equals [`SurfaceLevel::f_low`] to rounding where there is no tilt; under a tilt it is that of the sheared
    /// tile, README section 6.1.
    pub fn eval(&self, wi: [f32; 3]) -> [f32; 3] {
        let flat_wi = shear::straighten(wi, self.hit.tilt);
        if self.scale == 0.0 || flat_wi[2] <= 0.0 {
            return [0.0; 3];
        }
        self.eval_above(flat_wi, &self.lobes.facing(wi), &self.incident(wi))
    }

    /// Density of [`BoundBrdf::sample`] in the direction `wi`, 1/sr; 0 where it gives none.
    ///
    /// Over all directions it integrates to the probability that `sample` gives one.
    pub fn pdf(&self, wi: [f32; 3]) -> f32 {
        let flat_wi = shear::straighten(wi, self.hit.tilt);
        if self.scale == 0.0 || flat_wi[2] <= 0.0 {
            return 0.0;
        }
        self.pdf_above(wi, &self.lobes.cos_mean(wi), &self.incident(wi))
    }

    /// [`BoundBrdf::eval`] and [`BoundBrdf::pdf`] for little more than the price of the first.
    pub fn eval_pdf(&self, wi: [f32; 3]) -> ([f32; 3], f32) {
        let flat_wi = shear::straighten(wi, self.hit.tilt);
        if self.scale == 0.0 || flat_wi[2] <= 0.0 {
            return ([0.0; 3], 0.0);
        }
        let (facing, incident) = (self.lobes.facing(wi), self.incident(wi));
        (self.eval_above(flat_wi, &facing, &incident), self.pdf_above(wi, &facing.cos_mean, &incident))
    }

    /// A direction that follows [`BoundBrdf::pdf`], from three uniform numbers in [0, 1); `u[2]` chooses the part.
    ///
    /// `None` where the direction drawn lies below the horizon of the base or of `n_c`: a lost sample, which counts as
    /// one of value 0.
    pub fn sample(&self, u: [f32; 3]) -> Option<LevelSample> {
        let wi = self.sample_direction(u)?;
        let (f, pdf) = self.eval_pdf(wi);
        (pdf > 0.0).then_some(LevelSample { wi, pdf, f })
    }

    /// The direction of [`BoundBrdf::sample`] alone, for who may have no use for it once it is known: no light there.
    ///
    /// A direction whose [`BoundBrdf::pdf`] is 0 is a lost sample, too.
    pub fn sample_direction(&self, u: [f32; 3]) -> Option<[f32; 3]> {
        if self.scale == 0.0 {
            return None;
        }
        let sampler = self.sampler();
        if u[2] < sampler.cosine {
            return Some(cosine_direction(self.hit.n_c, [u[0], u[1]]));
        }
        let choice = (u[2] - sampler.cosine) / (1.0 - sampler.cosine);
        sampler.half.sample(&self.lobes, self.wo, [u[0], u[1], choice])
    }

    fn incident(&self, wi: [f32; 3]) -> Incident {
        Incident { cos_half: half_vector(wi, self.wo).1, cos_io: dot(wi, self.wo) }
    }

    /// `eval` for ωi above the base, whose direction without the tilt is `flat_wi`.
    fn eval_above(&self, flat_wi: [f32; 3], facing: &FacingLanes, incident: &Incident) -> [f32; 3] {
        let facing_wi = self.lobes.facing_sum(facing);
        if facing_wi < MIN_FACING {
            return [0.0; 3];
        }
        let diffuse = self.lobes.cosines_sum(facing, &self.viewer, incident.cos_io);
        let specular = self.level.conductor.map_or(0.0, |conductor| {
            self.lobes.specular_sum(conductor, incident.cos_half, &facing.cos_mean, &self.viewer.cos_mean)
        });
        let numerator = self.tint.numerator(diffuse, specular, incident.cos_half);
        let scaling = self.scaling(flat_wi);
        let scale = self.scale / facing_wi;
        std::array::from_fn(|k| scaling[k] * (numerator[k] * scale))
    }

    /// `pdf` for ωi above the base; `cos_mean` = μ·ωi of every lobe.
    fn pdf_above(&self, wi: [f32; 3], cos_mean: &Lane, incident: &Incident) -> f32 {
        let cos_theta = dot(self.hit.n_c, wi);
        if cos_theta <= 0.0 {
            return 0.0;
        }
        let sampler = self.sampler();
        let half = sampler.half.pdf(cos_mean, &self.viewer.cos_mean, incident.cos_half);
        sampler.cosine * cosine_pdf(cos_theta) + (1.0 - sampler.cosine) * half
    }

    /// Σ_r T_r(x)·S_r(ωi, ωo), as [`SurfaceLevel::scaling_at`]; the fourth number means nothing.
    ///
    /// A function of its own, so that the compiler does not find out that the fourth is not used: it would drop it and
    /// with it the vectors of four.
    #[inline(never)]
    fn scaling(&self, flat_wi: [f32; 3]) -> [f32; 4] {
        let n = self.level.level.directions;
        let columns = n * n;
        let [a, b, c, d] = angular_taps(flat_wi, n);
        let mut scaling = [0.0; 4];
        for (spatial, table) in self.spatial.iter().zip(self.level.angular.chunks_exact(columns * columns)) {
            let mut angular = [0.0; 4];
            for (first, row_weight) in self.rows {
                let row = &table[first..first + columns];
                let [p, q, r, s] = [row[a.0], row[b.0], row[c.0], row[d.0]];
                for k in 0..4 {
                    angular[k] += row_weight * (a.1 * p[k] + b.1 * q[k] + c.1 * r[k] + d.1 * s[k]);
                }
            }
            (0..4).for_each(|k| scaling[k] += spatial[k] * angular[k]);
        }
        scaling
    }

    /// Found when first asked for: who only evaluates pays nothing.
    fn sampler(&self) -> &Sampler {
        self.sampler.get_or_init(|| {
            let n_c = self.hit.n_c;
            let view =
                View { cos_o: &self.viewer.cos_mean, cos_n: &self.lobes.cos_mean(n_c), cos_on: dot(self.wo, n_c) };
            let half = HalfMixture::new(&self.level.gaussians, &self.lobes, &view);
            let [diffuse, specular] = self.tint.albedos(self.wo[2].clamp(0.0, 1.0));
            Sampler { cosine: if half.is_empty() { 1.0 } else { mixture::cosine_share(diffuse, specular) }, half }
        })
    }
}
