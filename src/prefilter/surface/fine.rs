//! F of the fine surface on the table directions, from all texels.
//!
//! Texels are grouped by (normal bin, colour, patch). Within a group all texels have nearly the same normal, so
//!
//! ```text
//! F(ωi, ωo) = Σ_groups  mean over the group of f ⟨ωm, ωi⟩⟨ωm, ωo⟩/⟨ωm, ωg⟩  ·  popcount(V(ωi) ∧ V(ωo)) / texels
//! ```
//!
//! (4.6)–(4.8) without sampling noise. The mean runs over finer bins of normals than the groups: a narrow NDF needs
//! them, visibility does not. Each fine bin is stood for by its mean slope, which keeps the visible area exact.

use super::reflectance::{
    Part, PatchReflectance, TableDirections, Term, assemble, pair, pair_count, row_ranges, terms, tint,
};
use super::visibility::{EMPTY_SLOT, VisibilityBits};
use super::{FineSurface, patch_of};
use crate::math::simd;
use formats::lookup;
use rayon::prelude::*;
use std::ops::Range;

/// Colour classes per visibility bin, where there is a colour map: quantiles of luminance.
const COLOR_CLASSES: usize = 4;

/// Tasks that the pairs are split into; a constant, so that no sum depends on the number of threads.
const TASKS: usize = 16;

/// Resolutions of the concentric square of normals: coarse bins for visibility, finer ones for the BRDF.
#[derive(Clone, Copy, Debug)]
struct NormalBins {
    /// Visibility bins per axis.
    groups: usize,
    /// Fine bins per visibility bin and axis.
    per_group: usize,
}

impl NormalBins {
    /// Bins for `texels` texels spread over `parts` patches and colour classes.
    fn new(texels: usize, parts: usize, alpha: Option<f32>) -> Self {
        // two words a group on average, for texels that leave words half empty cost as much as full ones; a small map
        // may have as many groups as a map of 1024² with 16 patches
        const TEXELS_PER_GROUP: f64 = 112.0;
        const FREE_GROUPS: f64 = 16.0 * 576.0;
        let groups = ((texels as f64 / TEXELS_PER_GROUP).max(FREE_GROUPS) / parts as f64).sqrt();
        let groups = (groups.round() as usize).clamp(8, 24);
        Self { groups, per_group: facet_resolution(alpha).div_ceil(groups) }
    }

    /// Fine bin of a normal: those of one visibility bin are neighbours.
    fn facet(self, normal: [f32; 3]) -> u32 {
        let (k, resolution) = (self.per_group, self.groups * self.per_group);
        let [u, v] = lookup::square_of(normal).map(|s| ((s * resolution as f32) as usize).min(resolution - 1));
        let group = (v / k) * self.groups + u / k;
        (group * k * k + (v % k) * k + u % k) as u32
    }

    /// Fine bins of one visibility bin.
    fn facets_per_group(self) -> usize {
        self.per_group * self.per_group
    }

    /// Visibility bins.
    fn group_count(self) -> usize {
        self.groups * self.groups
    }
}

/// Fine bins of normals per axis: a bin is about 2.5/resolution wide, a third of the base NDF's width.
///
/// Twill at 8×, α = 0.1: ε off the nodes is 4.69, 4.70 and 4.70 % with 72, 144 and 288.
fn facet_resolution(alpha: Option<f32>) -> usize {
    alpha.map_or(24, |alpha| ((7.0 / alpha) as usize).clamp(48, 288))
}

/// Texels with nearly the same normal, as one facet.
#[derive(Clone, Copy, Debug)]
struct Facet {
    slope: [f32; 2],
    normal: [f32; 3],
}

/// How much of a group's texels lie in a facet.
#[derive(Clone, Copy, Debug)]
struct Share {
    facet: u32,
    group: u32,
    fraction: f32,
    color: [f32; 3],
}

/// Texels of one patch in one visibility bin, a piece a tile.
#[derive(Clone, Debug)]
struct Group {
    patch: u32,
    pieces: Vec<Piece>,
}

/// Texels of a group in one tile: whole words of the visibility bits from a multiple of 64 slots on.
#[derive(Clone, Copy, Debug)]
struct Piece {
    first_slot: u32,
    texels: u32,
}

impl Piece {
    fn words(self) -> Range<usize> {
        let first = self.first_slot as usize / 64;
        first..first + self.texels.div_ceil(64) as usize
    }

    fn slots(self) -> Range<usize> {
        self.first_slot as usize..(self.first_slot + self.texels) as usize
    }
}

impl Group {
    fn word_count(&self) -> usize {
        self.pieces.iter().map(|piece| piece.words().len()).sum()
    }
}

/// Groups, facets and shares of one visibility bin, as ranges.
#[derive(Clone, Debug)]
struct Bin {
    groups: Range<usize>,
    facets: Range<usize>,
    shares: Range<usize>,
}

/// All texels, sorted into groups.
#[derive(Clone, Debug, Default)]
struct Grouping {
    slots: Vec<u32>,
    groups: Vec<Group>,
    facets: Vec<Facet>,
    shares: Vec<Share>,
    bins: Vec<Bin>,
    patch_texels: Vec<u32>,
}

/// F of the fine surface, and the CPU share of visibility is in `on_stage`.
pub fn fine_reflectance(
    fine: &FineSurface,
    patches: [usize; 2],
    directions: &TableDirections,
    on_stage: &mut dyn FnMut(&'static str),
) -> PatchReflectance {
    on_stage("group");
    let mut grouping = group_texels(fine, patches);
    let slots = std::mem::take(&mut grouping.slots);
    on_stage("visibility");
    let bits = VisibilityBits::sweep(&fine.heights, &directions.vectors, slots);
    on_stage("fine");
    let terms = terms(&fine.brdf, fine.color.is_some());
    let sums = sum_terms(fine, &grouping, &bits, directions, &terms);
    assemble(&sums, &terms, &fine.brdf, directions)
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

/// What the sort needs of a texel: its keys, packed so that one integer compare orders them.
#[derive(Clone, Copy)]
struct Key {
    facet: u32,
    class: u8,
}

/// Sorts all texels into visibility bins and groups.
fn group_texels(fine: &FineSurface, patches: [usize; 2]) -> Grouping {
    let [width, height] = fine.heights.size();
    let classes = if fine.color.is_some() { COLOR_CLASSES } else { 1 };
    let tiles = Tiles::new([width, height], patches);
    let parts = tiles.count() * classes;
    let bins = NormalBins::new(width * height, parts, fine.brdf.specular.map(|conductor| conductor.alpha));
    let limits = fine.color.as_deref().map(luminance_quantiles);
    // bin of normals for every texel, facets numbered so that those of one visibility bin are neighbours
    let keys: Vec<Key> = (0..width * height)
        .into_par_iter()
        .map(|texel| {
            let [sx, sy] = fine.heights.slope(texel % width, texel / width, 0.5, 0.5);
            let facet = bins.facet(facet_normal([sx, sy]));
            let color = fine.color.as_ref().map(|color| luminance(color[texel]));
            let class = limits.zip(color).map_or(0, |(limits, y)| limits.iter().filter(|&&l| y > l).count());
            Key { facet, class: class as u8 }
        })
        .collect();
    sort_groups(fine, tiles, &keys, bins)
}

/// Unit normal of a slope.
fn facet_normal([sx, sy]: [f32; 2]) -> [f32; 3] {
    let nz = 1.0 / (1.0 + sx * sx + sy * sy).sqrt();
    [-sx * nz, -sy * nz, nz]
}

fn luminance(color: [f32; 3]) -> f32 {
    0.2126 * color[0] + 0.7152 * color[1] + 0.0722 * color[2]
}

/// The inner limits of [`COLOR_CLASSES`] classes of about equal size.
fn luminance_quantiles(colors: &[[f32; 3]]) -> [f32; COLOR_CLASSES - 1] {
    let stride = (colors.len() / 65_536).max(1);
    let mut values: Vec<f32> = colors.iter().step_by(stride).map(|&color| luminance(color)).collect();
    values.sort_by(f32::total_cmp);
    std::array::from_fn(|k| values[(k + 1) * values.len() / COLOR_CLASSES])
}

/// Texels per axis of a tile, at most: the masks of a tile's texels stay in a cache while its slots are gathered.
const TILE: usize = 256;

/// Parts of the map that are grouped apart: patches, cut into tiles of at most [`TILE`]² texels.
#[derive(Clone, Copy, Debug)]
struct Tiles {
    size: [usize; 2],
    patches: [usize; 2],
    /// Tiles a patch along u and v.
    cuts: [usize; 2],
}

impl Tiles {
    fn new(size: [usize; 2], patches: [usize; 2]) -> Self {
        Self { size, patches, cuts: [0, 1].map(|axis| size[axis].div_ceil(patches[axis] * TILE)) }
    }

    fn grid(self) -> [usize; 2] {
        [0, 1].map(|axis| self.patches[axis] * self.cuts[axis])
    }

    fn count(self) -> usize {
        self.grid()[0] * self.grid()[1]
    }

    fn of_texel(self, texel: usize) -> usize {
        patch_of([texel % self.size[0], texel / self.size[0]], self.size, self.grid())
    }

    fn patch(self, tile: usize) -> usize {
        let width = self.grid()[0];
        tile / width / self.cuts[1] * self.patches[0] + tile % width / self.cuts[0]
    }

    fn of_patch(self, patch: usize) -> impl Iterator<Item = usize> {
        let (width, [cut_u, cut_v]) = (self.grid()[0], self.cuts);
        let [u, v] = [patch % self.patches[0] * cut_u, patch / self.patches[0] * cut_v];
        (0..cut_u * cut_v).map(move |k| (v + k / cut_u) * width + u + k % cut_u)
    }
}

/// Counting sort of the texels by (tile, visibility bin and colour class), and the share of each facet in each group.
fn sort_groups(fine: &FineSurface, tiles: Tiles, keys: &[Key], bins: NormalBins) -> Grouping {
    let bin_of = |key: Key| key.facet as usize / bins.facets_per_group() * COLOR_CLASSES + usize::from(key.class);
    let (bin_count, tile_count) = (bins.group_count() * COLOR_CLASSES, tiles.count());
    let mut counts = vec![0_u32; bin_count * tile_count];
    let mut patch_texels = vec![0_u32; tiles.patches[0] * tiles.patches[1]];
    for (texel, &key) in keys.iter().enumerate() {
        let tile = tiles.of_texel(texel);
        counts[tile * bin_count + bin_of(key)] += 1;
        patch_texels[tiles.patch(tile)] += 1;
    }
    // slots tile by tile, each group in words of its own
    let mut next: Vec<usize> = Vec::with_capacity(counts.len());
    let mut slot_count = 0;
    for &count in &counts {
        next.push(slot_count);
        slot_count += (count as usize).next_multiple_of(64);
    }
    let first_slots = next.clone();
    let mut grouping = Grouping { patch_texels, slots: vec![EMPTY_SLOT; slot_count], ..Grouping::default() };
    for (texel, &key) in keys.iter().enumerate() {
        let slot = &mut next[tiles.of_texel(texel) * bin_count + bin_of(key)];
        grouping.slots[*slot] = texel as u32;
        *slot += 1;
    }
    for bin in 0..bin_count {
        let first = grouping.groups.len();
        let mut sizes: Vec<u32> = Vec::new();
        for patch in 0..tiles.patches[0] * tiles.patches[1] {
            let mut pieces = Vec::new();
            let mut size = 0;
            for at in tiles.of_patch(patch).map(|tile| tile * bin_count + bin).filter(|&at| counts[at] > 0) {
                pieces.push(Piece { first_slot: first_slots[at] as u32, texels: counts[at] });
                size += counts[at];
            }
            if size > 0 {
                grouping.groups.push(Group { patch: patch as u32, pieces });
                sizes.push(size);
            }
        }
        if !sizes.is_empty() {
            let groups = first..grouping.groups.len();
            add_bin(fine, keys, &mut grouping, groups, &sizes, bins.facets_per_group());
        }
    }
    grouping
}

/// Adds the facets and shares of one visibility bin.
fn add_bin(
    fine: &FineSurface,
    keys: &[Key],
    grouping: &mut Grouping,
    groups: Range<usize>,
    sizes: &[u32],
    facets_per_bin: usize,
) {
    #[derive(Clone, Copy, Default)]
    struct Sum {
        count: u32,
        color: [f64; 3],
    }
    let width = fine.heights.size()[0];
    let mut sums = vec![Sum::default(); facets_per_bin * sizes.len()];
    let mut slopes = vec![([0.0_f64; 2], 0_u32); facets_per_bin];
    for (k, group) in groups.clone().enumerate() {
        for &texel in grouping.groups[group].pieces.iter().flat_map(|piece| &grouping.slots[piece.slots()]) {
            let texel = texel as usize;
            let facet = keys[texel].facet as usize % facets_per_bin;
            let slope = fine.heights.slope(texel % width, texel / width, 0.5, 0.5);
            let (sum, count) = &mut slopes[facet];
            *count += 1;
            (0..2).for_each(|axis| sum[axis] += f64::from(slope[axis]));
            let share = &mut sums[facet * sizes.len() + k];
            share.count += 1;
            if let Some(color) = &fine.color {
                (0..3).for_each(|channel| share.color[channel] += f64::from(color[texel][channel]));
            }
        }
    }
    let (first_facet, first_share) = (grouping.facets.len(), grouping.shares.len());
    for (facet, &(sum, count)) in slopes.iter().enumerate().filter(|(_, (_, count))| *count > 0) {
        let slope = sum.map(|s| (s / f64::from(count)) as f32);
        for (k, share) in sums[facet * sizes.len()..][..sizes.len()].iter().enumerate().filter(|(_, s)| s.count > 0) {
            grouping.shares.push(Share {
                facet: grouping.facets.len() as u32,
                group: (groups.start + k) as u32,
                fraction: share.count as f32 / sizes[k] as f32,
                color: share.color.map(|c| (c / f64::from(share.count)) as f32),
            });
        }
        grouping.facets.push(Facet { slope, normal: facet_normal(slope) });
    }
    grouping.bins.push(Bin {
        groups,
        facets: first_facet..grouping.facets.len(),
        shares: first_share..grouping.shares.len(),
    });
}
