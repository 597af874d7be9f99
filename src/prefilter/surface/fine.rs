//! F of the fine surface on the table directions, from all texels.
//!
//! Texels are grouped by (normal bin, colour, patch). Within a group all texels have nearly the same normal, so
//!
//! ```text
//! F(ωi, ωo) = Σ_groups  mean over the group of f ⟨ωm, ωi⟩⟨ωm, ωo⟩/⟨ωm, ωg⟩  ·  popcount(V(ωi) ∧ V(ωo)) / texels
//! ```
//!
//! (4.6)–(4.8) without sampling noise. The mean runs over finer bins of normals than the groups: a narrow NDF needs
//! them, visibility does not. Steep texels are taken in parts ([`Splits`]), which are grouped apart by their share. Each fine bin is stood for by its mean slope, which keeps the visible area exact.

mod grouping;

use super::FineSurface;
use super::reflectance::{
    Part, PatchReflectance, TableDirections, Term, assemble, pair, pair_count, row_ranges, terms, tint,
};
use super::splits::Splits;
use super::visibility::VisibilityBits;
use crate::math::simd;
use grouping::{Bin, Facet, Grouping, group_texels};
use rayon::prelude::*;
use std::ops::Range;

/// Tasks that the pairs are split into; a constant, so that no sum depends on the number of threads.
const TASKS: usize = 16;

/// F of the fine surface under direct light.
pub fn fine_reflectance(
    fine: &FineSurface,
    patches: [usize; 2],
    directions: &TableDirections,
    on_stage: &mut dyn FnMut(&'static str),
) -> PatchReflectance {
    SortedSurface::new(fine, patches, directions, on_stage).direct(directions, on_stage)
}

/// A surface whose texels have been sorted into groups, and what every texel sees.
pub(super) struct SortedSurface<'a> {
    fine: &'a FineSurface,
    grouping: Grouping,
    bits: VisibilityBits,
}

impl<'a> SortedSurface<'a> {
    /// Sorts the texels and finds what they see of every direction.
    pub(super) fn new(
        fine: &'a FineSurface,
        patches: [usize; 2],
        directions: &TableDirections,
        on_stage: &mut dyn FnMut(&'static str),
    ) -> Self {
        on_stage("group");
        let grouping = group_texels(fine, patches, pair_count(directions.len()));
        on_stage("visibility");
        let (splits, slots) = (&grouping.splits, grouping.slots.clone());
        let bits = VisibilityBits::sweep_places(&fine.heights, splits, &directions.vectors, slots);
        Self { fine, grouping, bits }
    }

    /// F under direct light.
    pub(super) fn direct(
        &self,
        directions: &TableDirections,
        on_stage: &mut dyn FnMut(&'static str),
    ) -> PatchReflectance {
        on_stage("fine");
        let terms = terms(&self.fine.brdf, self.fine.color.is_some());
        let sums = sum_terms(self.fine, &self.grouping, &self.bits, directions, &terms);
        assemble(&sums, &terms, &self.fine.brdf, directions)
    }

    /// What every slot sees of other directions than the table's own.
    pub(super) fn sees(&self, directions: &TableDirections) -> VisibilityBits {
        let (splits, slots) = (&self.grouping.splits, self.grouping.slots.clone());
        VisibilityBits::sweep_places(&self.fine.heights, splits, &directions.vectors, slots)
    }

    /// The steep texels' parts.
    pub(super) fn splits(&self) -> &Splits {
        &self.grouping.splits
    }

    /// Place of every slot.
    pub(super) fn slots(&self) -> &[u32] {
        &self.grouping.slots
    }
}

/// Sums every term over all groups: `[patch][term][pair]`, divided by the texels of the patch.
fn sum_terms(
    fine: &FineSurface,
    grouping: &Grouping,
    bits: &VisibilityBits,
    directions: &TableDirections,
    terms: &[Term],
) -> Vec<f32> {
    let patches = grouping.patch_texels.len();
    let ranges = row_ranges(directions.len(), TASKS);
    let parts: Vec<Vec<f32>> = ranges
        .par_iter()
        .map(|rows| {
            let alpha = fine.brdf.specular.map_or(1.0, |conductor| conductor.alpha);
            let first = pair_count(rows.start);
            let len = pair_count(rows.end) - first;
            // f32: a patch has one term a bin, 2304 at most
            let mut sums = vec![0.0_f32; patches * terms.len() * len];
            let task = RowSums { grouping, bits, directions, terms, alpha, rows: rows.clone(), first, len };
            simd::run(RowKernel { task: &task, sums: &mut sums });
            sums
        })
        .collect();
    let pairs = pair_count(directions.len());
    let mut all = vec![0.0; patches * terms.len() * pairs];
    for (rows, part) in ranges.iter().zip(&parts) {
        let first = pair_count(rows.start);
        let len = pair_count(rows.end) - first;
        for (k, line) in part.chunks(len).enumerate() {
            let scale = 1.0 / grouping.patch_texels[k / terms.len()] as f32;
            for (to, from) in all[k * pairs + first..][..len].iter_mut().zip(line) {
                *to = from * scale;
            }
        }
    }
    all
}

/// One task: the rows `rows` of all pairs.
struct RowSums<'a> {
    grouping: &'a Grouping,
    bits: &'a VisibilityBits,
    directions: &'a TableDirections,
    terms: &'a [Term],
    alpha: f32,
    rows: Range<usize>,
    first: usize,
    len: usize,
}

struct RowKernel<'a> {
    task: &'a RowSums<'a>,
    sums: &'a mut [f32],
}

impl simd::Kernel for RowKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let task = self.task;
        let halves: Vec<[Vec<f32>; 3]> = task.rows.clone().map(|i| half_row(task.directions, i)).collect();
        let mut scratch = Scratch::default();
        for bin in &task.grouping.bins {
            scratch.load(task, bin);
            for (i, halves) in task.rows.clone().zip(&halves) {
                scratch.weigh(task, bin, i, halves);
                scratch.accumulate(task, bin, i, self.sums);
            }
        }
    }
}

/// Half vectors of (i, o) for o <= i, as structure of arrays.
fn half_row(directions: &TableDirections, i: usize) -> [Vec<f32>; 3] {
    let halves: Vec<[f32; 3]> = directions.vectors[..=i]
        .iter()
        .map(|&wo| formats::cell_brdf::half_vector(directions.vectors[i], wo).0)
        .collect();
    [0, 1, 2].map(|k| halves.iter().map(|h| h[k]).collect())
}

/// What one bin needs, for all directions of the task's rows.
#[derive(Default)]
struct Scratch {
    /// `[direction][word of the bin]`
    words: Vec<u64>,
    word_count: usize,
    /// Where each group's words end.
    ends: Vec<usize>,
    /// `[facet][direction]`: visible area per base area, clamped; cosine; Smith's √(α² + (1 − α²)cos²).
    area: Vec<f32>,
    cosine: Vec<f32>,
    smith: Vec<f32>,
    /// `[group][term][o]`: mean over the group of the term's integrand.
    weights: Vec<f32>,
    /// One facet's integrand for the diffuse and the specular part.
    row: [Vec<f32>; 2],
    /// Texels that see both directions, `[o]`; signed, for that converts to floats in one instruction.
    count: Vec<i32>,
}

impl Scratch {
    /// Gathers the bin's visibility words and its facets' cosines.
    #[inline(always)]
    fn load(&mut self, task: &RowSums<'_>, bin: &Bin) {
        let groups = &task.grouping.groups[bin.groups.clone()];
        self.ends.clear();
        let word_count = groups.iter().fold(0, |end, group| {
            self.ends.push(end + group.word_count());
            end + group.word_count()
        });
        self.word_count = word_count;
        self.words.clear();
        for direction in 0..task.rows.end {
            let words = task.bits.direction(direction);
            for piece in groups.iter().flat_map(|group| &group.pieces) {
                self.words.extend_from_slice(&words[piece.words()]);
            }
        }
        let n = task.rows.end;
        let [x, y, z] = &task.directions.xyz;
        let facets = &task.grouping.facets[bin.facets.clone()];
        for array in [&mut self.area, &mut self.cosine, &mut self.smith] {
            array.resize(facets.len() * n, 0.0);
        }
        let a2 = task.alpha * task.alpha;
        for (k, facet) in facets.iter().enumerate() {
            let (area, cosine) = (&mut self.area[k * n..][..n], &mut self.cosine[k * n..][..n]);
            let smith = &mut self.smith[k * n..][..n];
            let (x, y, z) = (&x[..n], &y[..n], &z[..n]);
            for o in 0..n {
                let a = (z[o] - facet.slope[0] * x[o] - facet.slope[1] * y[o]).max(0.0);
                let c = a * facet.normal[2];
                area[o] = a;
                cosine[o] = c;
                smith[o] = (a2 + (1.0 - a2) * c * c).sqrt();
            }
        }
        self.count.resize(n, 0);
        self.row.iter_mut().for_each(|row| row.resize(n, 0.0));
        self.weights.resize(bin.groups.len() * task.terms.len() * n, 0.0);
    }

    /// Fills `weights` for row i from the facets of the bin.
    #[inline(always)]
    fn weigh(&mut self, task: &RowSums<'_>, bin: &Bin, i: usize, halves: &[Vec<f32>; 3]) {
        let n = task.rows.end;
        let len = i + 1;
        let terms = task.terms;
        self.weights.fill(0.0);
        let mut done = u32::MAX;
        for share in &task.grouping.shares[bin.shares.clone()] {
            let k = share.facet as usize - bin.facets.start;
            if self.area[k * n + i] <= 0.0 {
                continue;
            }
            if done != share.facet {
                self.integrands(task, &task.grouping.facets[share.facet as usize], k * n, i, halves);
                done = share.facet;
            }
            let group = share.group as usize - bin.groups.start;
            for (t, &term) in terms.iter().enumerate() {
                let scale = share.fraction * tint(term, share.color);
                let row = &self.row[usize::from(term.part == Part::Specular)][..len];
                let out = &mut self.weights[(group * terms.len() + t) * n..][..len];
                for (out, row) in out.iter_mut().zip(row) {
                    *out += scale * row;
                }
            }
        }
    }

    /// f ⟨n, ωi⟩⟨n, ωo⟩/⟨n, ωg⟩ of one facet for row i: 1 for the diffuse part's f, D·G/(4 cos cos) for the other.
    #[inline(always)]
    fn integrands(&mut self, task: &RowSums<'_>, facet: &Facet, at: usize, i: usize, halves: &[Vec<f32>; 3]) {
        let len = i + 1;
        let area = &self.area[at..][..len];
        let scale = area[i] * facet.normal[2];
        for (out, &a) in self.row[0][..len].iter_mut().zip(area) {
            *out = scale * a;
        }
        if !task.terms.iter().any(|term| term.part == Part::Specular) {
            return;
        }
        let [nx, ny, nz] = facet.normal;
        let a2 = task.alpha * task.alpha;
        // D G /(4 nz) with D = α²/(π (1 − (1 − α²)(n·h)²)²), G = 2 ci co/(ci so + co si)
        let factor = a2 * std::f32::consts::FRAC_1_PI * 0.5 / nz;
        let (cosine, smith) = (&self.cosine[at..][..len], &self.smith[at..][..len]);
        let (ci, si) = (cosine[i], smith[i]);
        let (hx, hy, hz) = (&halves[0][..len], &halves[1][..len], &halves[2][..len]);
        let out = &mut self.row[1][..len];
        for o in 0..len {
            let c = hx[o] * nx + hy[o] * ny + hz[o] * nz;
            let d = 1.0 - (1.0 - a2) * c * c;
            let g = ci * cosine[o] / (ci * smith[o] + cosine[o] * si + 1e-20);
            out[o] = factor * g / (d * d);
        }
    }

    /// Adds row i: weights times the number of texels that see both directions.
    #[inline(always)]
    fn accumulate(&mut self, task: &RowSums<'_>, bin: &Bin, i: usize, sums: &mut [f32]) {
        let n = task.rows.end;
        let len = i + 1;
        let stride = self.word_count;
        let at = pair(i, 0) - task.first;
        for (g, group) in task.grouping.groups[bin.groups.clone()].iter().enumerate() {
            let (first, last) = (if g == 0 { 0 } else { self.ends[g - 1] }, self.ends[g]);
            let own = &self.words[i * stride..][first..last];
            if own.iter().all(|&word| word == 0) {
                continue;
            }
            let (words, count) = (&self.words[first..], &mut self.count[..len]);
            // most groups have few words: a loop of known length beats a vectorised one there
            match own.len() {
                1 => count_joint::<1>(own, words, stride, count),
                2 => count_joint::<2>(own, words, stride, count),
                3 => count_joint::<3>(own, words, stride, count),
                4 => count_joint::<4>(own, words, stride, count),
                _ => count_joint_any(own, words, stride, count),
            }
            for t in 0..task.terms.len() {
                let weights = &self.weights[(g * task.terms.len() + t) * n..][..len];
                let out = &mut sums[(group.patch as usize * task.terms.len() + t) * task.len + at..][..len];
                for ((out, w), &count) in out.iter_mut().zip(weights).zip(&self.count) {
                    *out += w * count as f32;
                }
            }
        }
    }
}

/// Bits set in both `own` and the same words of every direction, which stand `stride` apart.
#[inline(always)]
fn count_joint<const WORDS: usize>(own: &[u64], words: &[u64], stride: usize, count: &mut [i32]) {
    let own: [u64; WORDS] = std::array::from_fn(|k| own[k]);
    for (o, count) in count.iter_mut().enumerate() {
        let other = &words[o * stride..][..WORDS];
        *count = own.iter().zip(other).map(|(a, b)| (a & b).count_ones() as i32).sum();
    }
}

/// [`count_joint`] for any number of words.
#[inline(always)]
fn count_joint_any(own: &[u64], words: &[u64], stride: usize, count: &mut [i32]) {
    for (o, count) in count.iter_mut().enumerate() {
        let other = &words[o * stride..][..own.len()];
        *count = own.iter().zip(other).map(|(a, b)| (a & b).count_ones() as i32).sum();
    }
}
