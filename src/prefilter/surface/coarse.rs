//! F of the coarse surface on the table directions, from all cells.
//!
//! F_coarse = mean over p of g(ωi) g(ωo) N_c V(ωi) V(ωo) with g = A_c/P_c and A_c(ω) = ⟨n_c, ω⟩/⟨n_c, ωg⟩.
//! Each cell is sampled at a regular grid of places, where n_c and V are those of the coarse bilinear surface.
//! N_c is a sum over the cell's lobes; there are as many lobes as fine texels, but many look alike, so lobes are merged
//! into prototypes of nearly the same mean and concentration, and only those meet every pair of directions.

use super::reflectance::{
    Part, PatchReflectance, TableDirections, Term, assemble, pair, pair_count, row_ranges, terms, tint,
};
use super::visibility::{EMPTY_SLOT, VisibilityBits};
use super::{VmfLobe, patch_of};
use crate::geometry::HeightField;
use crate::material::Brdf;
use crate::math::simd;
use formats::cell_brdf::{Facing, LobeKernel, MIN_FACING, half_vector};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;

/// Places per axis of the whole map, at least: 384² leave 0.6 % in F on the nodes (twill, 8×, diffuse; 512² 0.54 %, 256² 0.8 %).
const PLACES: usize = 384;

/// Places per axis of a cell, at least: its normal and its shadows vary over a bilinear cell, and one place in the
/// middle sees neither (twill tiled to 4096², 8×: ε above 75° is 15 % with 1 place, 2 % with 2).
const MIN_PLACES_PER_CELL: usize = 2;

/// At most this many prototypes: a narrower base NDF sees smaller differences between lobes. Fewer pairs of directions
/// than N = 15 has allow more prototypes at the same cost, and small patches need them: theirs average over few cells.
///
/// Measured on twill at 8×, ε off the nodes: diffuse 0.57 % with 1536, 0.59 % with 768, 0.62 % with 400; α = 0.3 1.49,
/// 1.51, 1.61 %; α = 0.1 4.7, 5.0, 7.0 %.
fn max_prototypes(brdf: &Brdf, pairs: usize) -> usize {
    const MEASURED_PAIRS: usize = 25425;
    let measured = match brdf.specular {
        None => 448,
        Some(conductor) if conductor.alpha >= 0.25 => 1024,
        Some(_) => 1536,
    };
    measured * (MEASURED_PAIRS / pairs).clamp(1, 8)
}

/// Rows of pairs a task: what a task holds of the prototypes' tables must fit a cache.
const TASKS: usize = 12;

/// What the coarse surface is made of.
#[derive(Clone, Copy)]
pub struct CoarseSurface<'a> {
    /// Coarse heights.
    pub heights: &'a HeightField,
    /// `[lobe][cell]`.
    pub lobes: &'a [Vec<VmfLobe>],
    /// Mean colour factor a cell, where there is a colour map.
    pub base_color: Option<&'a [[f32; 3]]>,
    /// The base BRDF.
    pub brdf: &'a Brdf,
    /// Spherical Gaussians of its NDF, (λ, amplitude) each.
    pub gaussians: &'a [[f32; 2]],
}

/// F of the coarse surface with f_c, before any scaling.
pub fn coarse_reflectance(
    coarse: &CoarseSurface<'_>,
    patches: [usize; 2],
    directions: &TableDirections,
) -> PatchReflectance {
    let merged = MergedLobes::new(coarse.lobes, max_prototypes(coarse.brdf, pair_count(directions.len())), directions);
    reflectance_of(coarse, &merged, patches, directions)
}

/// [`coarse_reflectance`] with lobes that have been merged before: they do not depend on the heights.
pub(super) fn reflectance_of(
    coarse: &CoarseSurface<'_>,
    merged: &MergedLobes,
    patches: [usize; 2],
    directions: &TableDirections,
) -> PatchReflectance {
    let places = Places::of_map(coarse.heights);
    let bits = VisibilityBits::sweep(&places.field, &directions.vectors, places.slots());
    let terms = terms(coarse.brdf, coarse.base_color.is_some());
    let task = Task { coarse, merged, patches, directions, places: &places, bits: &bits, terms };
    let sums = task.sums();
    assemble(&sums, &task.terms, coarse.brdf, directions)
}

/// A of the coarse surface, `[patch][direction]`: the area that a patch shows, per base area.
pub(super) fn shown_areas(heights: &HeightField, patches: [usize; 2], directions: &TableDirections) -> Vec<Vec<f32>> {
    let places = Places::of_map(heights);
    let bits = VisibilityBits::sweep(&places.field, &directions.vectors, places.slots());
    let cells = heights.size();
    let areas_of = |(k, &[x, y, z]): (usize, &[f32; 3])| {
        let mut sums = vec![[0.0_f64; 2]; patches[0] * patches[1]];
        for cell in 0..cells[0] * cells[1] {
            let [sum, count] = &mut sums[patch_of([cell % cells[0], cell / cells[0]], cells, patches)];
            for place in 0..places.per_axis * places.per_axis {
                let bit = cell * places.bits_per_cell + place;
                let [i, j] = places.texel(cell, place);
                let slope = places.field.slope(i, j, 0.5, 0.5);
                let seen = bits.direction(k)[bit / 64] >> (bit % 64) & 1;
                *sum += f64::from((z - slope[0] * x - slope[1] * y).max(0.0)) * seen as f64;
                *count += 1.0;
            }
        }
        sums.iter().map(|[sum, count]| (sum / count) as f32).collect::<Vec<f32>>()
    };
    let by_direction: Vec<Vec<f32>> = directions.vectors.par_iter().enumerate().map(areas_of).collect();
    (0..patches[0] * patches[1]).map(|patch| by_direction.iter().map(|areas| areas[patch]).collect()).collect()
}

/// The lobes of all cells as shares of prototypes, and how these face the directions of a table.
pub(super) struct MergedLobes {
    prototypes: Prototypes,
    tables: FacingTables,
    /// 1/P_c, `[cell][direction]`.
    facing: Vec<f32>,
}

impl MergedLobes {
    /// Merges `lobes`, `[lobe][cell]`, to at most `limit` prototypes.
    pub(super) fn new(lobes: &[Vec<VmfLobe>], limit: usize, directions: &TableDirections) -> Self {
        let prototypes = Prototypes::new(lobes, lobes[0].len(), limit);
        let tables = FacingTables::new(&prototypes, directions);
        let facing = tables.inverse_of_cells(&prototypes, directions.len());
        Self { prototypes, tables, facing }
    }
}

/// The places at which the cells are sampled: the centres of `per_axis`² parts of each.
struct Places {
    /// The coarse surface with `per_axis` times the vertices: the same bilinear surface.
    field: HeightField,
    cells: [usize; 2],
    per_axis: usize,
    /// Bits a cell, whole power of two up to 64 or a multiple of 64, so that cells align with words.
    bits_per_cell: usize,
}

impl Places {
    /// As many as a map needs.
    fn of_map(coarse: &HeightField) -> Self {
        let cells = coarse.size();
        Self::new(coarse, PLACES.div_ceil(cells[0].max(cells[1])).clamp(MIN_PLACES_PER_CELL, PLACES))
    }

    fn new(coarse: &HeightField, per_axis: usize) -> Self {
        let cells = coarse.size();
        let places = per_axis * per_axis;
        let bits_per_cell = if places <= 64 { places.next_power_of_two() } else { places.next_multiple_of(64) };
        Self { field: refine(coarse, per_axis), cells, per_axis, bits_per_cell }
    }

    /// Slots cell by cell, padded to whole words.
    fn slots(&self) -> Vec<u32> {
        let count = (self.cells[0] * self.cells[1] * self.bits_per_cell).next_multiple_of(64);
        let mut slots = vec![EMPTY_SLOT; count];
        let width = self.field.size()[0];
        for (cell, slots) in slots.chunks_mut(self.bits_per_cell).enumerate().take(self.cells[0] * self.cells[1]) {
            for (place, slot) in slots.iter_mut().enumerate().take(self.per_axis * self.per_axis) {
                let [i, j] = self.texel(cell, place);
                *slot = (j * width + i) as u32;
            }
        }
        slots
    }

    /// Texel of `field` at a place of a cell.
    fn texel(&self, cell: usize, place: usize) -> [usize; 2] {
        let corner = [cell % self.cells[0], cell / self.cells[0]];
        [corner[0] * self.per_axis + place % self.per_axis, corner[1] * self.per_axis + place / self.per_axis]
    }
}

/// The same bilinear surface with `factor` times the vertices per axis.
fn refine(coarse: &HeightField, factor: usize) -> HeightField {
    let [width, height] = coarse.size();
    let mut heights = Vec::with_capacity(width * height * factor * factor);
    for j in 0..height * factor {
        let t = (j % factor) as f32 / factor as f32;
        for i in 0..width * factor {
            let s = (i % factor) as f32 / factor as f32;
            let [h00, h10, h01, h11] = coarse.corners(i / factor, j / factor);
            let (top, bottom) = (h00 + s * (h10 - h00), h01 + s * (h11 - h01));
            heights.push(top + t * (bottom - top));
        }
    }
    let spacing = coarse.spacing().map(|d| d / factor as f32);
    HeightField::new(heights, [width * factor, height * factor], spacing, coarse.boundary())
}

/// Lobes that look alike, merged, and the share of each cell in them.
struct Prototypes {
    kernels: Vec<LobeKernel>,
    /// `[cell]` ranges of `members`.
    cells: Vec<Range<usize>>,
    /// (prototype, weight)
    members: Vec<(u32, f32)>,
}

impl Prototypes {
    fn new(lobes: &[Vec<VmfLobe>], cell_count: usize, limit: usize) -> Self {
        // finest first: as long as there are too many prototypes, widen the bins
        let used = lobes.iter().flatten().filter(|lobe| lobe.weight > 0.0).count();
        let mut resolution = if used <= limit { None } else { Some(96.0_f32) };
        loop {
            let built = Self::with_bins(lobes, cell_count, resolution);
            match resolution {
                Some(r) if built.kernels.len() > limit => resolution = Some(r * 0.85),
                _ => return built,
            }
        }
    }

    /// Bins of 1/`resolution` of the concentric square and 8/`resolution` octaves-of-e in κ; one bin a lobe for `None`.
    fn with_bins(lobes: &[Vec<VmfLobe>], cell_count: usize, resolution: Option<f32>) -> Self {
        let mut index = BTreeMap::new();
        let mut sums: Vec<[f64; 5]> = Vec::new();
        let mut cells = Vec::with_capacity(cell_count);
        let mut members = Vec::new();
        for cell in 0..cell_count {
            let first = members.len();
            for (j, lobe) in lobes.iter().enumerate().map(|(j, lobes)| (j, lobes[cell])).filter(|(_, l)| l.weight > 0.0)
            {
                let key = resolution.map_or([cell as i32, j as i32, 0], |r| {
                    let square = formats::lookup::square_of(lobe.mean);
                    [(square[0] * r) as i32, (square[1] * r) as i32, (lobe.kappa.ln_1p() * r / 8.0) as i32]
                });
                let next = sums.len();
                let k = *index.entry(key).or_insert(next);
                if k == next {
                    sums.push([0.0; 5]);
                }
                let weight = f64::from(lobe.weight);
                (0..3).for_each(|axis| sums[k][axis] += weight * f64::from(lobe.mean[axis]));
                sums[k][3] += weight * f64::from(lobe.kappa).ln_1p();
                sums[k][4] += weight;
                members.push((k as u32, lobe.weight));
            }
            cells.push(first..members.len());
        }
        let kernels = sums
            .iter()
            .map(|sum| {
                let length = (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt();
                let mean = [sum[0], sum[1], sum[2]].map(|x| (x / length) as f32);
                LobeKernel::new(mean, (sum[3] / sum[4]).exp_m1() as f32)
            })
            .collect();
        Self { kernels, cells, members }
    }
}

/// How every prototype faces every direction, `[prototype][direction]` each: structure of arrays, for kernels.
struct FacingTables {
    cos_mean: Vec<f32>,
    mean: Vec<f32>,
    normal_mean: Vec<f32>,
    fraction: Vec<f32>,
    excess: Vec<f32>,
}

impl FacingTables {
    fn new(prototypes: &Prototypes, directions: &TableDirections) -> Self {
        let facing: Vec<Facing> = prototypes
            .kernels
            .par_iter()
            .flat_map_iter(|kernel| directions.vectors.iter().map(|&w| kernel.facing(w)))
            .collect();
        let field = |field: fn(&Facing) -> f32| facing.iter().map(field).collect();
        Self {
            cos_mean: field(|f| f.cos_mean),
            mean: field(|f| f.mean),
            normal_mean: field(|f| f.normal_mean),
            fraction: field(|f| f.fraction),
            excess: field(|f| f.excess),
        }
    }

    /// 1/P_c(ω) for every cell and direction, 0 where P_c is under [`MIN_FACING`]; `[cell][direction]`.
    fn inverse_of_cells(&self, prototypes: &Prototypes, directions: usize) -> Vec<f32> {
        let mut inverse = vec![0.0; prototypes.cells.len() * directions];
        inverse.par_chunks_mut(directions).zip(&prototypes.cells).for_each(|(inverse, members)| {
            for &(prototype, weight) in &prototypes.members[members.clone()] {
                let facing = &self.mean[prototype as usize * directions..][..directions];
                inverse.iter_mut().zip(facing).for_each(|(sum, p)| *sum += weight * p);
            }
            inverse.iter_mut().for_each(|p| *p = if *p < MIN_FACING { 0.0 } else { 1.0 / *p });
        });
        inverse
    }
}

/// Everything that the sums over cells read.
struct Task<'a> {
    coarse: &'a CoarseSurface<'a>,
    patches: [usize; 2],
    directions: &'a TableDirections,
    places: &'a Places,
    bits: &'a VisibilityBits,
    merged: &'a MergedLobes,
    terms: Vec<Term>,
}

impl Task<'_> {
    /// `[patch][term][pair]`, means over the places of a patch.
    fn sums(&self) -> Vec<f32> {
        let ranges = row_ranges(self.directions.len(), TASKS);
        let patch_count = self.patches[0] * self.patches[1];
        let cells = self.coarse.heights.size();
        let patch_of_cell: Vec<usize> = (0..cells[0] * cells[1])
            .map(|cell| patch_of([cell % cells[0], cell / cells[0]], cells, self.patches))
            .collect();
        let parts: Vec<Vec<f64>> = ranges
            .par_iter()
            .map(|rows| {
                let len = pair_count(rows.end) - pair_count(rows.start);
                let mut sums = vec![0.0_f64; patch_count * self.terms.len() * len];
                simd::run(RowKernel { task: self, patch_of_cell: &patch_of_cell, rows: rows.clone(), sums: &mut sums });
                sums
            })
            .collect();
        let mut places = vec![0_usize; patch_count];
        patch_of_cell.iter().for_each(|&patch| places[patch] += self.places.per_axis * self.places.per_axis);
        let pairs = pair_count(self.directions.len());
        let mut all = vec![0.0; patch_count * self.terms.len() * pairs];
        for (rows, part) in ranges.iter().zip(&parts) {
            let first = pair_count(rows.start);
            let len = pair_count(rows.end) - first;
            for (k, line) in part.chunks(len).enumerate() {
                let scale = 1.0 / places[k / self.terms.len()] as f64;
                for (to, from) in all[k * pairs + first..][..len].iter_mut().zip(line) {
                    *to = (from * scale) as f32;
                }
            }
        }
        all
    }
}

struct RowKernel<'a> {
    task: &'a Task<'a>,
    patch_of_cell: &'a [usize],
    rows: Range<usize>,
    sums: &'a mut [f64],
}

impl simd::Kernel for RowKernel<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let task = self.task;
        let n = self.rows.end;
        let tables = PrototypeTables::new(task, self.rows.clone());
        let mut scratch = CellScratch::new(task.places, n);
        let len = pair_count(self.rows.end) - pair_count(self.rows.start);
        let mut block = vec![0.0_f32; self.sums.len()];
        for (cell, &patch) in self.patch_of_cell.iter().enumerate() {
            if cell % BLOCK_TERMS == 0 {
                flush(&mut block, self.sums);
            }
            if task.merged.prototypes.cells[cell].is_empty() {
                continue;
            }
            scratch.load(task, cell, n);
            let facing = &task.merged.facing[cell * task.directions.len()..][..n];
            let color = task.coarse.base_color.map_or([1.0; 3], |colors| colors[cell]);
            for i in self.rows.clone() {
                if facing[i] == 0.0 || !scratch.joint(i, n) {
                    continue;
                }
                let joint = &mut scratch.joint[..i + 1];
                for (b, p) in joint.iter_mut().zip(facing) {
                    *b *= facing[i] * p;
                }
                let at = pair(i, 0) - pair_count(self.rows.start);
                for (t, &term) in task.terms.iter().enumerate() {
                    let numerator = &mut scratch.numerator[..i + 1];
                    numerator.fill(0.0);
                    for &(prototype, weight) in
                        &task.merged.prototypes.members[task.merged.prototypes.cells[cell].clone()]
                    {
                        let row = tables.row(term.part, prototype as usize, i);
                        numerator.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
                    }
                    let scale = tint(term, color);
                    let out = &mut block[(patch * task.terms.len() + t) * len + at..][..i + 1];
                    for ((out, &b), &value) in out.iter_mut().zip(&*joint).zip(&*numerator) {
                        *out += scale * b * value;
                    }
                }
            }
        }
        flush(&mut block, self.sums);
    }
}

/// Terms of a sum in f32, at most.
const BLOCK_TERMS: usize = 4096;

/// Adds a block of sums to the totals and empties it.
#[inline(always)]
fn flush(block: &mut [f32], sums: &mut [f64]) {
    for (sum, block) in sums.iter_mut().zip(block) {
        *sum += f64::from(*block);
        *block = 0.0;
    }
}

/// N_j of every prototype for a task's rows.
struct PrototypeTables {
    /// One table a part, `[prototype][row][o]`; empty if the BRDF lacks the part.
    parts: [Vec<f32>; 2],
    rows: Range<usize>,
}

impl PrototypeTables {
    #[inline(always)]
    fn new(task: &Task<'_>, rows: Range<usize>) -> Self {
        let n = rows.end;
        let stride = rows.len() * n;
        let has = |part| task.terms.iter().any(|term| term.part == part);
        let mut parts = [Part::Diffuse, Part::Specular]
            .map(|part| if has(part) { vec![0.0; task.merged.prototypes.kernels.len() * stride] } else { Vec::new() });
        let w = &task.directions.vectors;
        let row_of = |value: fn([f32; 3], [f32; 3]) -> f32| -> Vec<Vec<f32>> {
            rows.clone().map(|i| w[..=i].iter().map(|&wo| value(w[i], wo)).collect()).collect()
        };
        let cos_io = row_of(|a, b| a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
        let cos_half = row_of(|a, b| half_vector(a, b).1);
        for (k, kernel) in task.merged.prototypes.kernels.iter().enumerate() {
            let prototype = PrototypeRow::new(task, k, *kernel);
            for (r, i) in rows.clone().enumerate() {
                let at = k * stride + r * n;
                if !parts[0].is_empty() {
                    prototype.cosines(i, &cos_io[r], &mut parts[0][at..][..i + 1]);
                }
                if !parts[1].is_empty() {
                    prototype.specular(i, &cos_half[r], &mut parts[1][at..][..i + 1]);
                }
            }
        }
        Self { parts, rows }
    }

    #[inline(always)]
    fn row(&self, part: Part, prototype: usize, i: usize) -> &[f32] {
        let n = self.rows.end;
        let table = &self.parts[usize::from(part == Part::Specular)];
        &table[(prototype * self.rows.len() + i - self.rows.start) * n..][..i + 1]
    }
}

/// One prototype and how it faces all directions.
struct PrototypeRow<'a> {
    kernel: LobeKernel,
    cos_mean: &'a [f32],
    normal_mean: &'a [f32],
    fraction: &'a [f32],
    excess: &'a [f32],
    alpha: f32,
    gaussians: &'a [[f32; 2]],
}

impl<'a> PrototypeRow<'a> {
    fn new(task: &Task<'a>, k: usize, kernel: LobeKernel) -> Self {
        let n = task.directions.len();
        let of = |table: &'a Vec<f32>| &table[k * n..][..n];
        Self {
            kernel,
            cos_mean: of(&task.merged.tables.cos_mean),
            normal_mean: of(&task.merged.tables.normal_mean),
            fraction: of(&task.merged.tables.fraction),
            excess: of(&task.merged.tables.excess),
            alpha: task.coarse.brdf.specular.map_or(1.0, |conductor| conductor.alpha),
            gaussians: task.coarse.gaussians,
        }
    }

    #[inline(always)]
    fn facing(&self, o: usize) -> Facing {
        let [cos_mean, normal_mean, fraction, excess] =
            [self.cos_mean[o], self.normal_mean[o], self.fraction[o], self.excess[o]];
        Facing { cos_mean, mean: normal_mean, normal_mean, fraction, excess }
    }

    /// N_j of the diffuse part for the pairs (i, o), o <= i.
    #[inline(always)]
    fn cosines(&self, i: usize, cos_io: &[f32], out: &mut [f32]) {
        let own = self.facing(i);
        let len = out.len();
        let (cos_io, cos_mean, normal_mean) = (&cos_io[..len], &self.cos_mean[..len], &self.normal_mean[..len]);
        let (fraction, excess) = (&self.fraction[..len], &self.excess[..len]);
        for o in 0..len {
            let [cos_mean, normal_mean, fraction, excess] = [cos_mean[o], normal_mean[o], fraction[o], excess[o]];
            let other = Facing { cos_mean, mean: normal_mean, normal_mean, fraction, excess };
            out[o] = self.kernel.cosines(own, other, cos_io[o]);
        }
    }

    /// N_j of the specular part for the pairs (i, o), o <= i; one Gaussian at a time, so that the loop over directions
    /// is the innermost.
    #[inline(always)]
    fn specular(&self, i: usize, cos_half: &[f32], out: &mut [f32]) {
        let own = self.cos_mean[i];
        for &gaussian in self.gaussians {
            for ((out, &co), &cos_half) in out.iter_mut().zip(self.cos_mean).zip(cos_half) {
                *out += self.kernel.specular_term(self.alpha, gaussian, cos_half, own, co);
            }
        }
    }
}

/// One cell's visible areas.
struct CellScratch {
    /// `[place][direction]`: A_c(ω) V(ω).
    area: Vec<f32>,
    /// `[direction]`: the visibility word that the place lies in.
    words: Vec<u64>,
    joint: Vec<f32>,
    numerator: Vec<f32>,
}

impl CellScratch {
    fn new(places: &Places, n: usize) -> Self {
        let count = places.per_axis * places.per_axis;
        Self { area: vec![0.0; count * n], words: vec![0; n], joint: vec![0.0; n], numerator: vec![0.0; n] }
    }

    /// A_c(ω) V(ω) at every place of a cell for the first `n` directions.
    #[inline(always)]
    fn load(&mut self, task: &Task<'_>, cell: usize, n: usize) {
        let places = task.places;
        let [x, y, z] = &task.directions.xyz;
        let (x, y, z) = (&x[..n], &y[..n], &z[..n]);
        let first = cell * places.bits_per_cell;
        for (place, area) in self.area.chunks_exact_mut(n).enumerate() {
            let (word, bit) = ((first + place) / 64, (first + place) % 64);
            if place == 0 || bit == 0 {
                self.words.iter_mut().enumerate().for_each(|(o, seen)| *seen = task.bits.direction(o)[word]);
            }
            let [i, j] = places.texel(cell, place);
            let slope = places.field.slope(i, j, 0.5, 0.5);
            for ((((area, &word), &x), &y), &z) in area.iter_mut().zip(&self.words).zip(x).zip(y).zip(z) {
                let facing = (z - slope[0] * x - slope[1] * y).max(0.0);
                // all bits of the number or none: visibility is as good as random, a branch would not pay
                let mask = ((word >> bit) as u32 & 1).wrapping_neg();
                *area = f32::from_bits(facing.to_bits() & mask);
            }
        }
    }

    /// Σ over places of the areas seen from ωi and ωo, o <= i; false if ωi sees none.
    #[inline(always)]
    fn joint(&mut self, i: usize, n: usize) -> bool {
        let joint = &mut self.joint[..i + 1];
        joint.fill(0.0);
        let mut any = false;
        for four in self.area.chunks(4 * n) {
            let own: [f32; 4] = std::array::from_fn(|k| four.get(k * n + i).copied().unwrap_or(0.0));
            if own == [0.0; 4] {
                continue;
            }
            any = true;
            if four.len() == 4 * n {
                let (a, b) = four.split_at(2 * n);
                let ((a, b), (c, d)) = (a.split_at(n), b.split_at(n));
                for ((((sum, a), b), c), d) in joint.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                    *sum += own[0] * a + own[1] * b + own[2] * c + own[3] * d;
                }
            } else {
                for (area, own) in four.chunks_exact(n).zip(own) {
                    joint.iter_mut().zip(area).for_each(|(sum, a)| *sum += own * a);
                }
            }
        }
        any
    }
}
