//! All texels of a surface, sorted by (normal bin, colour, patch).

use super::super::splits::Splits;
use super::super::visibility::EMPTY_SLOT;
use super::super::{FineSurface, patch_of};
use formats::lookup;
use rayon::prelude::*;
use std::ops::Range;

/// Colour classes per visibility bin, where there is a colour map: quantiles of luminance.
const COLOR_CLASSES: usize = 4;

/// Resolutions of the concentric square of normals: coarse bins for visibility, finer ones for the BRDF.
#[derive(Clone, Copy, Debug)]
struct NormalBins {
    /// Visibility bins per axis.
    groups: usize,
    /// Fine bins per visibility bin and axis.
    per_group: usize,
}

impl NormalBins {
    /// Bins for `texels` texels spread over `parts` patches and colour classes, and `pairs` pairs of directions.
    fn new(texels: usize, parts: usize, pairs: usize, alpha: Option<f32>) -> Self {
        // two words a group on average, for texels that leave words half empty cost as much as full ones; a small map or
        // one with few directions may cost as much as a map of 1024² with 16 patches and 15 × 15 directions
        const TEXELS_PER_GROUP: f64 = 112.0;
        const FREE_WORK: f64 = 16.0 * 576.0 * 25425.0;
        let groups = ((texels as f64 / TEXELS_PER_GROUP).max(FREE_WORK / pairs as f64) / parts as f64).sqrt();
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
pub(super) struct Facet {
    pub(super) slope: [f32; 2],
    pub(super) normal: [f32; 3],
}

/// How much of a group's places lie in a facet, in texels a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Share {
    pub(super) facet: u32,
    pub(super) group: u32,
    pub(super) fraction: f32,
    pub(super) color: [f32; 3],
}

/// Texels of one patch in one visibility bin, a piece a tile.
#[derive(Clone, Debug)]
pub(super) struct Group {
    pub(super) patch: u32,
    pub(super) pieces: Vec<Piece>,
}

/// Texels of a group in one tile: whole words of the visibility bits from a multiple of 64 slots on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    pub(super) first_slot: u32,
    pub(super) texels: u32,
}

impl Piece {
    pub(super) fn words(self) -> Range<usize> {
        let first = self.first_slot as usize / 64;
        first..first + self.texels.div_ceil(64) as usize
    }

    fn slots(self) -> Range<usize> {
        self.first_slot as usize..(self.first_slot + self.texels) as usize
    }
}

impl Group {
    pub(super) fn word_count(&self) -> usize {
        self.pieces.iter().map(|piece| piece.words().len()).sum()
    }
}

/// Groups, facets and shares of one visibility bin, as ranges.
#[derive(Clone, Debug)]
pub(super) struct Bin {
    pub(super) groups: Range<usize>,
    pub(super) facets: Range<usize>,
    pub(super) shares: Range<usize>,
}

/// All texels, sorted into groups; those that are steep, in parts.
#[derive(Clone, Debug, Default)]
pub(super) struct Grouping {
    pub(super) splits: Splits,
    /// Place ([`Splits`]) of each slot.
    pub(super) slots: Vec<u32>,
    pub(super) groups: Vec<Group>,
    pub(super) facets: Vec<Facet>,
    pub(super) shares: Vec<Share>,
    pub(super) bins: Vec<Bin>,
    pub(super) patch_texels: Vec<u32>,
}

/// What the sort needs of a place: its keys, packed so that one integer compare orders them.
#[derive(Clone, Copy)]
struct Key {
    facet: u32,
    class: u8,
}

/// Sorts all texels into visibility bins and groups, as fine as `pairs` pairs of directions allow.
pub(super) fn group_texels(fine: &FineSurface, patches: [usize; 2], pairs: usize) -> Grouping {
    let [width, height] = fine.heights.size();
    let classes = if fine.color.is_some() { COLOR_CLASSES } else { 1 };
    let tiles = Tiles::new([width, height], patches);
    let parts = tiles.count() * classes;
    let alpha = fine.brdf.specular.map(|conductor| conductor.alpha);
    let bins = NormalBins::new(width * height, parts, pairs, alpha);
    let limits = fine.color.as_deref().map(luminance_quantiles);
    // bin of normals for every texel, facets numbered so that those of one visibility bin are neighbours
    let splits = Splits::new(&fine.heights);
    let key_of = |bins: NormalBins, place: usize| {
        let facet = bins.facet(facet_normal(splits.slope(&fine.heights, place)));
        let color = fine.color.as_ref().map(|color| luminance(color[splits.place(place).texel as usize]));
        let class = limits.zip(color).map_or(0, |(limits, y)| limits.iter().filter(|&&l| y > l).count());
        Key { facet, class: class as u8 }
    };
    let keys: Vec<Key> = (0..width * height).into_par_iter().map(|texel| key_of(bins, texel)).collect();
    let mut grouping = sort_groups(fine, &splits, tiles, &keys, bins);
    for groups in PART_GROUPS {
        let bins = NormalBins { groups, per_group: facet_resolution(alpha).div_ceil(groups) };
        let keys: Vec<Key> =
            (width * height..splits.places()).into_par_iter().map(|place| key_of(bins, place)).collect();
        let sorted = SortedParts::new(fine, &splits, tiles, &keys, bins);
        if sorted.group_count() * PARTS_PER_GROUP <= keys.len().max(FREE_PARTS) || groups == PART_GROUPS[2] {
            sorted.add_to(&mut grouping, fine, &splits, &keys);
            break;
        }
    }
    Grouping { splits, ..grouping }
}

/// Visibility bins of parts per axis, the finest first. Steep normals crowd on the rim of the square, and a bin of 4°
/// there holds walls that face the light beside walls that do not: what is lit would count with the mean of both
/// (cliffs: 1.6 % too dark with 24).
const PART_GROUPS: [usize; 3] = [96, 48, 24];

/// Classes of area that parts are grouped by, for every doubling: high walls see more light than low ones, and would
/// count with the mean area of both (cliffs: 1.5 % too dark without classes).
const AREA_CLASSES: f32 = 4.0;

/// Classes of area, at most.
const MOST_AREAS: usize = 64;

/// Parts of a group that are worth its cost, on average.
const PARTS_PER_GROUP: usize = 24;

/// Fewer parts than this may have groups of any size.
const FREE_PARTS: usize = 65_536;

/// The parts of steep texels, sorted by (bin, patch): there are too many bins, most of them empty, to count them all.
struct SortedParts {
    /// (visibility bin and class, patch, place), ordered.
    parts: Vec<(u32, u32, u32)>,
    facets_per_bin: usize,
}

impl SortedParts {
    fn new(fine: &FineSurface, splits: &Splits, tiles: Tiles, keys: &[Key], bins: NormalBins) -> Self {
        let first = splits.places() - keys.len();
        let mut parts: Vec<(u32, u32, u32)> = keys
            .par_iter()
            .zip(first..splits.places())
            .map(|(key, place)| {
                let part = splits.place(place);
                let [x, y] = splits.slope(&fine.heights, place);
                let area = (0.5 * (1.0 + x * x + y * y).log2() * AREA_CLASSES).min(MOST_AREAS as f32 - 1.0) as usize;
                let class = (usize::from(part.halvings) * MOST_AREAS + area) * COLOR_CLASSES + usize::from(key.class);
                let bin = class * bins.group_count() + key.facet as usize / bins.facets_per_group();
                let patch = tiles.patch(tiles.of_texel(part.texel as usize));
                (bin as u32, patch as u32, place as u32)
            })
            .collect();
        parts.par_sort_unstable();
        Self { parts, facets_per_bin: bins.facets_per_group() }
    }

    fn group_count(&self) -> usize {
        self.parts.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).count()
    }

    /// Adds the groups, each in words of its own, and their facets.
    fn add_to(&self, grouping: &mut Grouping, fine: &FineSurface, splits: &Splits, keys: &[Key]) {
        for bin in self.parts.chunk_by(|a, b| a.0 == b.0) {
            let first = grouping.groups.len();
            let mut sizes: Vec<u32> = Vec::new();
            for group in bin.chunk_by(|a, b| a.1 == b.1) {
                let first_slot = grouping.slots.len() as u32;
                grouping.slots.extend(group.iter().map(|part| part.2));
                grouping.slots.resize(grouping.slots.len().next_multiple_of(64), EMPTY_SLOT);
                let piece = Piece { first_slot, texels: group.len() as u32 };
                grouping.groups.push(Group { patch: group[0].1, pieces: vec![piece] });
                sizes.push(piece.texels);
            }
            let share = 0.5_f32.powi(i32::from(splits.place(bin[0].2 as usize).halvings));
            let groups = Groups { range: first..grouping.groups.len(), sizes: &sizes, share };
            add_bin(
                fine,
                splits,
                |place| keys[place - (splits.places() - keys.len())],
                grouping,
                &groups,
                self.facets_per_bin,
            );
        }
    }
}

/// The groups of one visibility bin.
struct Groups<'a> {
    range: Range<usize>,
    /// Places of each.
    sizes: &'a [u32],
    /// What each place is of a texel.
    share: f32,
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

/// Counting sort of the texels by (tile, visibility bin and colour class), and the share of each facet in each group;
/// texels that stand in parts have no slot.
fn sort_groups(fine: &FineSurface, splits: &Splits, tiles: Tiles, keys: &[Key], bins: NormalBins) -> Grouping {
    let bin_of = |key: Key| key.facet as usize / bins.facets_per_group() * COLOR_CLASSES + usize::from(key.class);
    let (bin_count, tile_count) = (bins.group_count() * COLOR_CLASSES, tiles.count());
    let is_cut = splits.is_cut();
    let mut counts = vec![0_u32; bin_count * tile_count];
    let mut patch_texels = vec![0_u32; tiles.patches[0] * tiles.patches[1]];
    for (texel, &key) in keys.iter().enumerate() {
        let tile = tiles.of_texel(texel);
        counts[tile * bin_count + bin_of(key)] += u32::from(!is_cut[texel]);
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
    for (texel, &key) in keys.iter().enumerate().filter(|(texel, _)| !is_cut[*texel]) {
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
            let groups = Groups { range: first..grouping.groups.len(), sizes: &sizes, share: 1.0 };
            add_bin(fine, splits, |texel| keys[texel], &mut grouping, &groups, bins.facets_per_group());
        }
    }
    grouping
}

/// Adds the facets and shares of one visibility bin.
fn add_bin(
    fine: &FineSurface,
    splits: &Splits,
    key_of: impl Fn(usize) -> Key,
    grouping: &mut Grouping,
    groups: &Groups<'_>,
    facets_per_bin: usize,
) {
    let &Groups { range: ref groups, sizes, share } = groups;
    #[derive(Clone, Copy, Default)]
    struct Sum {
        count: u32,
        color: [f64; 3],
    }
    let mut sums = vec![Sum::default(); facets_per_bin * sizes.len()];
    let mut slopes = vec![([0.0_f64; 2], 0_u32); facets_per_bin];
    for (k, group) in groups.clone().enumerate() {
        for &place in grouping.groups[group].pieces.iter().flat_map(|piece| &grouping.slots[piece.slots()]) {
            let place = place as usize;
            let facet = key_of(place).facet as usize % facets_per_bin;
            let slope = splits.slope(&fine.heights, place);
            let (sum, count) = &mut slopes[facet];
            *count += 1;
            (0..2).for_each(|axis| sum[axis] += f64::from(slope[axis]));
            let sum = &mut sums[facet * sizes.len() + k];
            sum.count += 1;
            if let Some(color) = &fine.color {
                let color = color[splits.place(place).texel as usize];
                (0..3).for_each(|channel| sum.color[channel] += f64::from(color[channel]));
            }
        }
    }
    let (first_facet, first_share) = (grouping.facets.len(), grouping.shares.len());
    for (facet, &(sum, count)) in slopes.iter().enumerate().filter(|(_, (_, count))| *count > 0) {
        let slope = sum.map(|s| (s / f64::from(count)) as f32);
        for (k, sum) in sums[facet * sizes.len()..][..sizes.len()].iter().enumerate().filter(|(_, s)| s.count > 0) {
            grouping.shares.push(Share {
                facet: grouping.facets.len() as u32,
                group: (groups.start + k) as u32,
                fraction: share * sum.count as f32 / sizes[k] as f32,
                color: sum.color.map(|c| (c / f64::from(sum.count)) as f32),
            });
        }
        grouping.facets.push(Facet { slope, normal: facet_normal(slope) });
    }
    grouping.bins.push(Bin {
        groups: groups.clone(),
        facets: first_facet..grouping.facets.len(),
        shares: first_share..grouping.shares.len(),
    });
}
