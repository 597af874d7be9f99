//! F on the table directions: one symmetric table a patch, and the terms that it is summed from.
//!
//! F(x; ωi, ωo) holds both cosines and is symmetric, so only pairs with `o <= i` are kept. A base BRDF is a sum of
//! parts whose dependence on the normal is one scalar each; colour and Fresnel factors do not depend on the normal
//! (Schlick's term sees ωi·h alone), so sums over facets run on scalars and become RGB once, at the end.

use super::patch_along;
use crate::material::Brdf;
use formats::cell_brdf::{half_vector, schlick_weight};
use std::f32::consts::FRAC_1_PI;

/// Index of the pair (i, o), o <= i.
#[inline(always)]
pub fn pair(i: usize, o: usize) -> usize {
    debug_assert!(o <= i, "pairs are kept once, o <= i");
    i * (i + 1) / 2 + o
}

/// Number of pairs of `n` directions.
pub fn pair_count(n: usize) -> usize {
    n * (n + 1) / 2
}

/// The table directions as structure of arrays.
#[derive(Clone, Debug)]
pub struct TableDirections {
    /// Unit vectors, frame of the base plane, away from the surface.
    pub vectors: Vec<[f32; 3]>,
    /// x, y and z of all directions.
    pub xyz: [Vec<f32>; 3],
    /// Cells of the concentric square per axis (N).
    pub resolution: usize,
}

impl TableDirections {
    /// The centres of `resolution`² cells of the concentric equal-area map.
    pub fn new(resolution: usize) -> Self {
        let vectors = formats::lookup::direction_grid(resolution);
        let xyz = [0, 1, 2].map(|k| vectors.iter().map(|w| w[k]).collect());
        Self { vectors, xyz, resolution }
    }

    /// Every `step`-th centre along each axis, from the first on, and which ones these are.
    pub(super) fn every(&self, step: usize) -> ThinnedDirections {
        let kept = (0..self.resolution).step_by(step);
        let nodes: Vec<usize> = kept
            .clone()
            .flat_map(|row| kept.clone().map(move |k| (row, k)))
            .map(|(row, k)| row * self.resolution + k)
            .collect();
        let vectors = nodes.iter().map(|&node| self.vectors[node]).collect();
        let xyz = [0, 1, 2].map(|k| nodes.iter().map(|&node| self.xyz[k][node]).collect());
        let resolution = kept.len();
        ThinnedDirections { directions: Self { vectors, xyz, resolution }, nodes }
    }

    /// The cells' centres, followed by these directions.
    ///
    /// [`pair`] puts the pairs of the first directions first: the tables of the centres alone begin those of them all.
    pub(super) fn with(mut self, more: &[[f32; 3]]) -> Self {
        self.vectors.extend_from_slice(more);
        (0..3).for_each(|k| self.xyz[k].extend(more.iter().map(|w| w[k])));
        self
    }

    /// Number of directions, N² unless others were added.
    pub fn len(&self) -> usize {
        self.vectors.len()
    }

    /// Never: there is at least one direction.
    pub fn is_empty(&self) -> bool {
        self.vectors.is_empty()
    }
}

/// Some of the directions of a table, still a square of them.
pub(super) struct ThinnedDirections {
    /// The directions.
    pub(super) directions: TableDirections,
    /// Index of each in the whole table.
    pub(super) nodes: Vec<usize>,
}

/// F of all patches: RGB, `[patch][rgb][pair]`.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchReflectance {
    values: Vec<f32>,
    pairs: usize,
}

impl PatchReflectance {
    /// The table of `value(patch, channel, i, o)`, o <= i, for `directions` directions.
    pub(super) fn from_fn(
        patches: usize,
        directions: usize,
        mut value: impl FnMut(usize, usize, usize, usize) -> f32,
    ) -> Self {
        let pairs = pair_count(directions);
        let mut values = Vec::with_capacity(3 * patches * pairs);
        for patch in 0..patches {
            for channel in 0..3 {
                values.extend(
                    (0..directions)
                        .flat_map(|i| (0..=i).map(move |o| (i, o)))
                        .map(|(i, o)| value(patch, channel, i, o)),
                );
            }
        }
        Self { values, pairs }
    }

    /// The table of these values, `[patch][rgb][pair]`; `None` where they are not whole patches.
    pub fn from_values(values: Vec<f32>, pairs: usize) -> Option<Self> {
        (pairs > 0 && !values.is_empty() && values.len().is_multiple_of(3 * pairs)).then_some(Self { values, pairs })
    }

    /// All values, `[patch][rgb][pair]`.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Number of patches.
    pub fn patch_count(&self) -> usize {
        self.values.len() / (3 * self.pairs)
    }

    /// Number of pairs.
    pub fn pair_count(&self) -> usize {
        self.pairs
    }

    /// Number of directions that the pairs are of: n with n(n + 1)/2 pairs.
    pub fn direction_count(&self) -> usize {
        ((2 * self.pairs) as f64).sqrt() as usize
    }

    /// F of one patch and channel for all pairs, in [`pair`] order.
    #[inline]
    pub fn channel(&self, patch: usize, channel: usize) -> &[f32] {
        &self.values[(patch * 3 + channel) * self.pairs..][..self.pairs]
    }
}

impl PatchReflectance {
    /// F between the first `directions` directions alone.
    pub(super) fn of_first(&self, directions: usize) -> Self {
        let pairs = pair_count(directions);
        let values = self.values.chunks(self.pairs).flat_map(|table| &table[..pairs]).copied().collect();
        Self { values, pairs }
    }

    /// F over the larger patches of the grid `to`, each of whole patches of the grid `from` of this table. A patch weighs
    /// as many texels or cells as it has, of `size` over the map.
    pub(super) fn merged(&self, from: [usize; 2], to: [usize; 2], size: [usize; 2]) -> Self {
        let along = [0, 1].map(|axis| {
            let mut counts = vec![0.0_f64; from[axis]];
            (0..size[axis]).for_each(|at| counts[patch_along(at, size[axis], from[axis])] += 1.0);
            counts
        });
        let mut values = Vec::with_capacity(to[0] * to[1] * 3 * self.pairs);
        for patch in 0..to[0] * to[1] {
            let corner = [patch % to[0], patch / to[0]];
            let ratio = [0, 1].map(|axis| from[axis] / to[axis]);
            let parts: Vec<usize> = (0..ratio[0] * ratio[1])
                .map(|k| (corner[1] * ratio[1] + k / ratio[0]) * from[0] + corner[0] * ratio[0] + k % ratio[0])
                .collect();
            let count = |part: usize| along[0][part % from[0]] * along[1][part / from[0]];
            let total: f64 = parts.iter().map(|&part| count(part)).sum();
            for channel in 0..3 {
                let tables: Vec<_> =
                    parts.iter().map(|&part| (count(part) / total, self.channel(part, channel))).collect();
                let mean = |k: usize| tables.iter().map(|(share, table)| share * f64::from(table[k])).sum::<f64>();
                values.extend((0..self.pairs).map(|k| mean(k) as f32));
            }
        }
        Self { values, pairs: self.pairs }
    }
}

/// The part of the base BRDF that a term belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// f = 1: albedo and 1/π are put in at the end.
    Diffuse,
    /// f = D·G/(4 cosθi cosθo): Fresnel is put in at the end.
    Specular,
}

/// One scalar sum over facets: a part, weighted by a colour channel or not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Term {
    /// Which part of the BRDF.
    pub part: Part,
    /// Which channel of the colour map weights it, if any.
    pub tint: Option<usize>,
}

/// The terms that a BRDF needs: one a part, or one a part and channel where a colour map weights them.
pub fn terms(brdf: &Brdf, colored: bool) -> Vec<Term> {
    let channels = |part| {
        let tints = if colored { vec![Some(0), Some(1), Some(2)] } else { vec![None] };
        tints.into_iter().map(move |tint| Term { part, tint })
    };
    let mut terms = Vec::new();
    if brdf.diffuse != [0.0; 3] || brdf.specular.is_none() {
        terms.extend(channels(Part::Diffuse));
    }
    if brdf.specular.is_some() {
        terms.extend(channels(Part::Specular));
        if colored {
            // Schlick's grazing term is white
            terms.push(Term { part: Part::Specular, tint: None });
        }
    }
    terms
}

/// Weight of a facet with colour `color` in a term.
#[inline(always)]
pub fn tint(term: Term, color: [f32; 3]) -> f32 {
    term.tint.map_or(1.0, |channel| color[channel])
}

/// Puts albedo, Fresnel and channels together; `sums` is `[patch][term][pair]`.
pub fn assemble(sums: &[f32], terms: &[Term], brdf: &Brdf, directions: &TableDirections) -> PatchReflectance {
    let pairs = pair_count(directions.len());
    let colored = terms.iter().any(|term| term.tint.is_some());
    let schlick: Vec<f32> = (0..directions.len())
        .flat_map(|i| (0..=i).map(move |o| (i, o)))
        .map(|(i, o)| schlick_weight(half_vector(directions.vectors[i], directions.vectors[o]).1))
        .collect();
    let mut values = vec![0.0; sums.len() / terms.len() * 3];
    for (patch, sums) in values.chunks_mut(3 * pairs).zip(sums.chunks(terms.len() * pairs)) {
        for (channel, out) in patch.chunks_mut(pairs).enumerate() {
            for (term, sums) in terms.iter().zip(sums.chunks(pairs)) {
                if term.tint.is_some_and(|tinted| tinted != channel) {
                    continue;
                }
                let f0 = brdf.specular.map_or(0.0, |conductor| conductor.f0[channel]);
                // f0 + (1 − f0)·s = f0·(1 − s) + s: the first is coloured, the second never
                let [constant, grazing] = match (term.part, term.tint, colored) {
                    (Part::Diffuse, ..) => [brdf.diffuse[channel] * FRAC_1_PI, 0.0],
                    (Part::Specular, None, false) => [f0, 1.0 - f0],
                    (Part::Specular, Some(_), _) => [f0, -f0],
                    (Part::Specular, None, true) => [0.0, 1.0],
                };
                for ((out, &sum), &s) in out.iter_mut().zip(sums).zip(&schlick) {
                    *out += (constant + grazing * s) * sum;
                }
            }
        }
    }
    PatchReflectance { values, pairs }
}

/// Ranges of rows i with about the same number of pairs each, in order.
pub fn row_ranges(directions: usize, parts: usize) -> Vec<std::ops::Range<usize>> {
    let bound = |k: usize| ((k as f64 / parts as f64).sqrt() * directions as f64).round() as usize;
    (0..parts).map(|k| bound(k)..bound(k + 1)).filter(|range| !range.is_empty()).collect()
}
