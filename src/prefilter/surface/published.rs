//! The published estimator of T and S, kept as a baseline for benches and tests.
//!
//! R of (4.12) is the ratio of two effective BRDFs, each found by tracing paths for one pair of directions at a time. S
//! (4.24) averages R over stratified positions, T (4.22) over pairs of directions drawn by their cosines. The coarse
//! surface carries f'_low of (4.11), that is (4.5) as printed with the vMF mixture of the cell, not our f_c. Counts
//! default to the paper's (its section 4.7.1), and any bin can be evaluated on its own, so that a subset gives the time
//! of the whole by count.
//!
//! Where the paper leaves a choice, it is made in the baseline's favour: paths start at stratified points, both surfaces
//! at the same ones, and a path ends at the first hidden direction.

use std::f32::consts::TAU;

use glam::Vec3;

use super::VmfLobe;
use crate::geometry::HeightTracer;
use crate::material::Brdf;
use crate::math::rng::Stream;
use crate::transport::effective::{base_scatter, for_each_point, surface_point};
use crate::transport::{PatchPoint, PatchSampling};

/// Sample counts of the published estimator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PublishedSettings {
    /// Patches of T along u and v.
    pub patches: [usize; 2],
    /// Strata per axis of the positions p of (4.24).
    pub position_strata: usize,
    /// Strata per axis of a patch's paths: `path_strata²` paths for either surface.
    pub path_strata: usize,
    /// Pairs of directions for a bin of T (4.22).
    pub pairs: usize,
    /// Added to divisors, against division by 0 (the paper's ε, whose value it does not give).
    pub epsilon: f64,
    /// Seed of all sampling.
    pub seed: u64,
}

impl Default for PublishedSettings {
    /// The paper's counts: M = 4, 16 positions, 2500 paths, 5000 pairs. ε is a thousandth of a white plane's value at 70°.
    fn default() -> Self {
        Self { patches: [4, 4], position_strata: 4, path_strata: 50, pairs: 5000, epsilon: 1e-4, seed: 1 }
    }
}

/// The two surfaces that are compared.
#[derive(Clone, Copy, Debug)]
pub struct Surfaces<'a> {
    /// The fine heights.
    pub fine: &'a HeightTracer<'a>,
    /// The base BRDF.
    pub brdf: Brdf,
    /// Optional colour factor a texel of the fine map, `[v][u]`; the coarse surface takes none, as in the paper.
    pub color: Option<&'a [[f32; 3]]>,
    /// The coarse heights.
    pub coarse: &'a HeightTracer<'a>,
    /// Normal distributions of the coarse cells, `[lobe][cell]`.
    pub lobes: &'a [Vec<VmfLobe>],
}

/// F of one patch of both surfaces for one pair of directions, and the ratio of their effective BRDFs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchRatio {
    /// F of the fine surface, RGB.
    pub fine: [f64; 3],
    /// F of the coarse surface under f'_low, RGB.
    pub coarse: [f64; 3],
    /// R (4.12), RGB.
    pub ratio: [f64; 3],
}

/// Error of the baseline's F against more samples, over patches and pairs of directions, RGB summed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PublishedError {
    /// √(Σ (F̂ − F)² / ΣF²) of single patches, fine surface.
    pub fine_patch: f64,
    /// The same of the mean over all patches.
    pub fine_mean: f64,
    /// Both for the coarse surface under f'_low.
    pub coarse_patch: f64,
    /// The mean over all patches of the coarse surface.
    pub coarse_mean: f64,
}

/// F and A of a patch from the same points.
#[derive(Clone, Copy, Debug, Default)]
struct PatchSums {
    f: [f64; 3],
    area: f64,
}

/// The two surfaces of a ratio.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Fine,
    Coarse,
}

/// The published estimator for one pair of surfaces.
#[derive(Clone, Copy, Debug)]
pub struct Published<'a> {
    surfaces: Surfaces<'a>,
    settings: PublishedSettings,
}

/// Streams of random numbers: which estimate, which use of it.
const POSITIONS: u64 = 1 << 32;
const PAIRS: u64 = 2 << 32;
const NORMALS: u64 = 3 << 32;
const REFERENCE: u64 = 4 << 32;

impl<'a> Published<'a> {
    /// The estimator of `surfaces` with these counts.
    pub fn new(surfaces: Surfaces<'a>, settings: PublishedSettings) -> Self {
        debug_assert!(settings.path_strata > 0 && settings.position_strata > 0, "at least one sample");
        Self { surfaces, settings }
    }

    /// S(ωi, ωo) (4.24): R averaged over stratified positions, RGB. `bin` keys the random numbers.
    pub fn angular(&self, bin: u64, wi: Vec3, wo: Vec3) -> [f64; 3] {
        let strata = self.settings.position_strata;
        let positions = Stream::new(self.settings.seed, POSITIONS + bin);
        let mut sum = [0.0; 3];
        for k in 0..strata * strata {
            let place = positions.stratified([strata; 2], k);
            let [column, row] = [0, 1].map(|a| (place[a] * self.settings.patches[a] as f32) as usize);
            let patch = row * self.settings.patches[0] + column;
            let ratio = self.ratio(patch, bin * (strata * strata) as u64 + k as u64, [wi, wo]).ratio;
            (0..3).for_each(|c| sum[c] += ratio[c]);
        }
        sum.map(|s| s / (strata * strata) as f64)
    }

    /// T of a patch (4.22) up to the common factor 1/C: R averaged over the first `pairs` pairs of directions, both drawn
    /// by their cosines, RGB. With `pairs` of the settings it is the whole bin; dividing by the mean over patches is C.
    pub fn spatial(&self, patch: usize, pairs: usize) -> [f64; 3] {
        let directions = Stream::new(self.settings.seed, PAIRS + patch as u64);
        let mut sum = [0.0; 3];
        for k in 0..pairs as u64 {
            let pair = [0, 1].map(|end| cosine_direction(directions.uniform_pair(2 * k + end)));
            let ratio = self.ratio(patch, PAIRS + k, pair).ratio;
            (0..3).for_each(|c| sum[c] += ratio[c]);
        }
        sum.map(|s| s / pairs as f64)
    }

    /// R(x, ωi, ωo) of one patch (4.12) from `path_strata²` paths on either surface; `estimate` keys the random numbers.
    pub fn ratio(&self, patch: usize, estimate: u64, pair: [Vec3; 2]) -> PatchRatio {
        let sampling = self.sampling(patch, estimate, self.settings.path_strata);
        let fine = self.sums(Side::Fine, &sampling, pair);
        let coarse = self.sums(Side::Coarse, &sampling, pair);
        let epsilon = self.settings.epsilon;
        let effective = |sums: &PatchSums| sums.f.map(|f| f / (sums.area + epsilon));
        let (above, below) = (effective(&fine), effective(&coarse));
        let ratio = [0, 1, 2].map(|c| above[c] / (below[c] + epsilon));
        PatchRatio { fine: fine.f, coarse: coarse.f, ratio }
    }

    fn sampling(&self, patch: usize, estimate: u64, strata: usize) -> PatchSampling {
        let seed = Stream::new(self.settings.seed, estimate).bits(patch as u64);
        PatchSampling::of_grid(self.settings.patches, patch, strata, seed)
    }

    fn tracer(&self, side: Side) -> &'a HeightTracer<'a> {
        match side {
            Side::Fine => self.surfaces.fine,
            Side::Coarse => self.surfaces.coarse,
        }
    }

    /// F and A of one pair: a path casts towards the viewer first, and towards the light if it is seen.
    fn sums(&self, side: Side, sampling: &PatchSampling, [wi, wo]: [Vec3; 2]) -> PatchSums {
        let tracer = self.tracer(side);
        let mut sums = PatchSums::default();
        let normals = Stream::new(sampling.seed, NORMALS + sampling.patch);
        let paths = sampling.strata * sampling.strata;
        for path in 0..paths {
            let place = sampling.place(path);
            let point = surface_point(tracer.heights(), place);
            let normal = tracer.normal(point);
            if normal.dot(wo) <= 0.0 || tracer.occluded(point, wo) {
                continue;
            }
            sums.area += f64::from(normal.dot(wo) / normal.z);
            if normal.dot(wi) <= 0.0 || tracer.occluded(point, wi) {
                continue;
            }
            let facet = self.facet(side, point.cell, normal, normals.bits(path as u64));
            let f = self.scatter(side, &facet, [wi, wo]);
            (0..3).for_each(|c| sums.f[c] += f64::from(f[c]));
        }
        PatchSums { f: sums.f.map(|f| f / paths as f64), area: sums.area / paths as f64 }
    }

    fn facet(&self, side: Side, cell: [usize; 2], normal: Vec3, bits: u64) -> Facet {
        let index = cell[1] * self.tracer(side).heights().size()[0] + cell[0];
        match side {
            Side::Fine => Facet {
                normal,
                brdf: self.surfaces.color.map_or(self.surfaces.brdf, |color| self.surfaces.brdf.tinted(color[index])),
                micro: normal,
                micro_area: 1.0,
            },
            Side::Coarse => {
                let (micro, micro_area) = sample_mixture(self.surfaces.lobes, index, Stream::new(bits, 0));
                Facet { normal, brdf: self.surfaces.brdf, micro, micro_area }
            }
        }
    }

    /// f ⟨n, ωi⟩ ⟨n, ωo⟩/⟨n, ωg⟩ of a facet, f being the base BRDF or one sample of f'_low, RGB.
    fn scatter(&self, side: Side, facet: &Facet, [wi, wo]: [Vec3; 2]) -> [f32; 3] {
        if side == Side::Fine {
            return base_scatter(&facet.brdf, facet.normal, wi, wo);
        }
        // (4.5): ρ = (1/cosθi) ∫ f(ωi, ωo; ω) ⟨ω, ωi⟩ D(ω) dω over the upper hemisphere; θi from the base normal.
        if facet.micro.z <= 0.0 {
            return [0.0; 3];
        }
        let cosines = facet.normal.dot(wi) * facet.normal.dot(wo) / facet.normal.z;
        let weight = facet.micro_area * facet.micro.dot(wi) / wi.z * cosines;
        facet.brdf.eval(facet.micro, wi, wo).map(|f| f * weight)
    }

    /// RMS error of F at these counts against `16` times the paths, over all pairs of `directions` and all patches.
    ///
    /// The reference has its own noise: at stratified points, whose variance falls at least as 1/n, under a sixteenth of
    /// the variance measured.
    pub fn reflectance_error(&self, directions: &[Vec3]) -> PublishedError {
        let count = directions.len();
        let patches = self.settings.patches[0] * self.settings.patches[1];
        let pair = |k: usize| [directions[k % count], directions[k / count]];
        let mut errors = [Squares::default(); 4];
        let references = [Side::Fine, Side::Coarse].map(|side| {
            let of_patch = |patch| self.reference(side, patch, directions);
            (0..patches).map(of_patch).collect::<Vec<_>>()
        });
        for k in 0..count * count {
            let ratios = (0..patches).map(|patch| self.ratio(patch, (k * patches) as u64, pair(k)));
            let estimates: Vec<_> = ratios.map(|ratio| [ratio.fine, ratio.coarse]).collect();
            for side in 0..2 {
                let estimate = estimates.iter().map(|of_side| of_side[side]);
                let reference = references[side].iter().map(|of_patch| of_patch[k]);
                estimate.clone().zip(reference.clone()).for_each(|(f, exact)| errors[2 * side].add(f, exact));
                errors[2 * side + 1].add(mean(estimate), mean(reference));
            }
        }
        let [fine_patch, fine_mean, coarse_patch, coarse_mean] = errors.map(|e| e.relative());
        PublishedError { fine_patch, fine_mean, coarse_patch, coarse_mean }
    }

    /// F of a patch for all pairs of `directions` (wi fastest), from 16 times the paths of an estimate.
    fn reference(&self, side: Side, patch: usize, directions: &[Vec3]) -> Vec<[f64; 3]> {
        let sampling = self.sampling(patch, REFERENCE, 4 * self.settings.path_strata);
        let normals = Stream::new(sampling.seed, NORMALS + sampling.patch);
        let count = directions.len();
        let mut sums = vec![[0.0; 3]; count * count];
        for_each_point(self.tracer(side), &sampling, directions, |point: &PatchPoint| {
            let facet = self.facet(side, point.point.cell, point.normal, normals.bits(point.stratum as u64));
            for (k, sum) in sums.iter_mut().enumerate() {
                if point.sees(k % count) && point.sees(k / count) {
                    let f = self.scatter(side, &facet, [directions[k % count], directions[k / count]]);
                    (0..3).for_each(|c| sum[c] += f64::from(f[c]));
                }
            }
        });
        let paths = (sampling.strata * sampling.strata) as f64;
        sums.into_iter().map(|sum| sum.map(|f| f / paths)).collect()
    }
}

/// What a path meets at a point: the surface's normal, and the normal that its BRDF stands for.
#[derive(Clone, Copy, Debug)]
struct Facet {
    normal: Vec3,
    brdf: Brdf,
    /// The micro-normal: the surface's own, or one of the cell's distribution.
    micro: Vec3,
    /// ∫D dω, the micro-area per base area that the sampled normal stands for.
    micro_area: f32,
}

/// Sums of squared errors and squared references.
#[derive(Clone, Copy, Debug, Default)]
struct Squares {
    error: f64,
    reference: f64,
}

impl Squares {
    fn add(&mut self, estimate: [f64; 3], reference: [f64; 3]) {
        let (estimate, reference) = (estimate.iter().sum::<f64>(), reference.iter().sum::<f64>());
        self.error += (estimate - reference).powi(2);
        self.reference += reference.powi(2);
    }

    fn relative(self) -> f64 {
        (self.error / self.reference).sqrt()
    }
}

/// Mean over patches, RGB.
fn mean(of_patches: impl ExactSizeIterator<Item = [f64; 3]>) -> [f64; 3] {
    let count = of_patches.len() as f64;
    of_patches.fold([0.0; 3], |sum, f| [0, 1, 2].map(|c| sum[c] + f[c])).map(|sum| sum / count)
}

/// A normal of the mixture of a cell, drawn in proportion to D, and ∫D dω.
fn sample_mixture(lobes: &[Vec<VmfLobe>], cell: usize, rng: Stream) -> (Vec3, f32) {
    let total: f32 = lobes.iter().map(|lobe| lobe[cell].weight).sum();
    let mut left = rng.uniform(0) * total;
    // Rounding may leave `left` above the last weight: the last lobe that has one is taken then.
    let mut chosen = lobes[0][cell];
    for lobe in lobes.iter().map(|lobe| lobe[cell]).filter(|lobe| lobe.weight > 0.0) {
        chosen = lobe;
        left -= lobe.weight;
        if left < 0.0 {
            break;
        }
    }
    (sample_lobe(&chosen, rng.uniform_pair(1)), total)
}

/// A direction of a vMF lobe: 1 − cosθ = −ln(u + (1 − u) e^{−2κ})/κ, stable for large κ; uniform for κ = 0.
fn sample_lobe(lobe: &VmfLobe, u: [f32; 2]) -> Vec3 {
    let (kappa, x) = (f64::from(lobe.kappa), f64::from(u[0]));
    // Below 1e-4, e^{−2κ} leaves no digits in the logarithm and the lobe is uniform within 1e-4.
    let below = if kappa < 1e-4 { 2.0 * x } else { -((1.0 - x) + x * (-2.0 * kappa).exp()).ln() / kappa };
    let sin_theta = (below * (2.0 - below)).max(0.0).sqrt() as f32; // rounding of `below` past 2
    let (sin_phi, cos_phi) = (u[1] * TAU).sin_cos();
    let mean = Vec3::from_array(lobe.mean);
    let (tangent, bitangent) = mean.any_orthonormal_pair();
    sin_theta * (cos_phi * tangent + sin_phi * bitangent) + (1.0 - below as f32) * mean
}

/// A direction of the upper hemisphere with density cosθ/π.
fn cosine_direction(u: [f32; 2]) -> Vec3 {
    let radius = u[0].sqrt();
    let (sin_phi, cos_phi) = (u[1] * TAU).sin_cos();
    // u < 1 keeps the direction above the horizon, where (4.5) divides by its cosine.
    Vec3::new(radius * cos_phi, radius * sin_phi, (1.0 - u[0]).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Boundary, HeightField};
    use crate::material::Conductor;

    const GLOSSY: Brdf = Brdf { diffuse: [0.5, 0.3, 0.1], specular: Some(Conductor::ggx(0.3, [0.9; 3])) };

    fn towards(theta: f32, phi: f32) -> Vec3 {
        Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }

    fn flat(size: usize) -> HeightField {
        let spacing = 16.0 / size as f32;
        HeightField::new(vec![0.0; size * size], [size, size], [spacing; 2], Boundary::Repeat)
    }

    fn lobes(cells: usize, kappa: f32) -> Vec<Vec<VmfLobe>> {
        vec![vec![VmfLobe { mean: [0.0, 0.0, 1.0], kappa, weight: 1.0 }; cells]]
    }

    fn settings() -> PublishedSettings {
        PublishedSettings { patches: [2, 2], position_strata: 2, path_strata: 10, pairs: 20, ..Default::default() }
    }

    #[test]
    fn a_flat_plane_scales_by_one() {
        let (fine, coarse) = (flat(16), flat(4));
        let (fine, coarse, lobes) = (HeightTracer::new(&fine), HeightTracer::new(&coarse), lobes(16, 1e6));
        let surfaces = Surfaces { fine: &fine, brdf: GLOSSY, color: None, coarse: &coarse, lobes: &lobes };
        let published = Published::new(surfaces, settings());
        let s = published.angular(3, towards(0.4, 1.0), towards(0.7, 2.0));
        // ε against values of 0.1, and 100 normals of a lobe 1/√κ wide.
        assert!(s.iter().all(|s| (s - 1.0).abs() < 0.01), "{s:?}");
        let t = published.spatial(1, 20);
        assert!(t.iter().all(|t| (t - 1.0).abs() < 0.03), "{t:?}");
    }

    #[test]
    fn the_error_falls_with_the_paths() {
        let heights = (0..256).map(|k| Stream::new(1, 0).uniform(k)).collect();
        let (fine, coarse) = (HeightField::new(heights, [16, 16], [1.0; 2], Boundary::Repeat), flat(4));
        let (fine, coarse, lobes) = (HeightTracer::new(&fine), HeightTracer::new(&coarse), lobes(16, 8.0));
        let surfaces = Surfaces { fine: &fine, brdf: GLOSSY, color: None, coarse: &coarse, lobes: &lobes };
        let directions = [towards(0.2, 0.0), towards(0.8, 2.0), towards(1.1, 4.0)];
        let error = |path_strata| {
            let settings = PublishedSettings { path_strata, ..settings() };
            Published::new(surfaces, settings).reflectance_error(&directions)
        };
        let (few, many) = (error(10), error(40));
        for (few, many) in [
            (few.fine_patch, many.fine_patch),
            (few.coarse_patch, many.coarse_patch),
            (few.fine_mean, many.fine_mean),
            (few.coarse_mean, many.coarse_mean),
        ] {
            assert!(many < 0.5 * few && few < 0.3, "{few} {many}");
        }
    }

    #[test]
    fn sampled_normals_have_the_mean_of_their_lobe() {
        for kappa in [0.0f32, 0.01, 1.0, 30.0, 1e4, 1e6] {
            let lobe = VmfLobe { mean: [0.6, 0.0, 0.8], kappa, weight: 1.3 };
            let mean: Vec3 =
                (0..20_000).map(|k| sample_lobe(&lobe, Stream::new(1, 2).uniform_pair(k))).sum::<Vec3>() / 20_000.0;
            // A₃(κ) = coth κ − 1/κ, κ/3 for small κ.
            let length = if kappa < 0.1 { kappa / 3.0 } else { 1.0 / kappa.tanh() - 1.0 / kappa };
            assert!((mean - Vec3::from_array(lobe.mean) * length).length() < 0.02, "κ = {kappa}: {mean}");
            let normals = vec![vec![lobe; 1]; 3];
            assert!((sample_mixture(&normals, 0, Stream::new(3, 4)).1 - 3.9).abs() < 1e-6);
        }
    }
}
