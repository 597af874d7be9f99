//! The places that stand for a surface: one in the middle of a texel, several where it is steep.
//!
//! A wall of 80:1 is one texel of the base and 80 of surface: its foot is in shadow while its crest is lit, and the
//! patch between its corners may bend from level to steep. Such a texel is split into about 1/⟨ωm, ωg⟩ parts, or more if
//! it bends, along u and v in proportion to its slopes; a place in each part has its own height, normal and visibility,
//! and an equal share of the texel's base. Places are numbered: texels first, row-major, then parts in the order of their texels.

use crate::geometry::HeightField;
use crate::math::rng::Stream;
use rayon::prelude::*;

/// Texels steeper than this somewhere, in area of surface per area of base, are split: 80°, which 0.5 % of twill reaches.
const STEEP: f32 = 6.0;

/// Texels whose slope changes by more than this from one edge to the other are split.
const BENT: f32 = 1.8;

/// Parts for a bend of 1, and four times as many for twice the bend: slopes change by half from part to part.
const PARTS_A_BEND: f32 = 4.0;

/// A texel has at most 2 to this many parts.
const MOST_HALVINGS: u32 = 6;

/// Parts for every texel of a map that are worth their cost; below, every texel stands for itself. Parts would bring twill
/// from an ε of 0.72 to 0.68 % for 1.4 CPU seconds more, and rocks from 0.62 to 0.55 % for 5; cliffs ask for 2.7 a texel.
const LEAST_PARTS: f64 = 1.0;

/// Parts that a map may have for every texel: with the bits of 225 directions they take half as many bytes again.
const PARTS_A_TEXEL: f64 = 0.5;

/// Parts that a small map may have.
const FREE_PARTS: f64 = 262_144.0;

/// Stream of the places within the parts.
const JITTER: u64 = 0x5b11;

/// How a texel is cut: 2^`halvings` parts along u and along v.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Cut {
    texel: u32,
    /// Number of the first part.
    first: u32,
    halvings: [u8; 2],
}

/// One part of a texel.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Row-major texel.
    pub texel: u32,
    /// The part's place within the texel, as fractions along u and v.
    pub st: [f32; 2],
    /// The part is 2 to the minus this of its texel.
    pub halvings: u8,
}

/// The steep texels of a map, in parts.
#[derive(Clone, Debug, Default)]
pub struct Splits {
    texels: usize,
    width: usize,
    cuts: Vec<Cut>,
    parts: Vec<Part>,
}

impl Splits {
    /// Of the steep texels of `field`.
    pub fn new(field: &HeightField) -> Self {
        let [width, height] = field.size();
        let texels = width * height;
        let steep: Vec<(u32, Steepness)> = (0..height)
            .into_par_iter()
            .flat_map_iter(|v| (0..width).map(move |u| (u, v)))
            .filter_map(|(u, v)| {
                let steepness = Steepness::new(field, u, v);
                steepness.is_split().then_some(((v * width + u) as u32, steepness))
            })
            .collect();
        // a map of nothing but walls has each of them in fewer parts
        let wanted: f64 = steep.iter().map(|(_, steepness)| f64::from(steepness.parts())).sum();
        if wanted < LEAST_PARTS * texels as f64 {
            return Self { texels, width, ..Self::default() };
        }
        let most = (PARTS_A_TEXEL * texels as f64).max(FREE_PARTS);
        let fineness = (most / wanted.max(1.0)).min(1.0) as f32;
        let mut splits = Self { texels, width, ..Self::default() };
        for (texel, steepness) in steep {
            splits.cut(texel, steepness.halvings(fineness));
        }
        splits
    }

    fn cut(&mut self, texel: u32, halvings: [u8; 2]) {
        let total = halvings[0] + halvings[1];
        if total == 0 {
            return;
        }
        self.cuts.push(Cut { texel, first: self.parts.len() as u32, halvings });
        let stream = Stream::new(JITTER, u64::from(texel));
        let [columns, rows] = halvings.map(|k| 1_u32 << k);
        self.parts.extend((0..columns * rows).map(|k| {
            let [x, y] = stream.uniform_pair(u64::from(k));
            let st = [((k % columns) as f32 + x) / columns as f32, ((k / columns) as f32 + y) / rows as f32];
            Part { texel, st, halvings: total }
        }));
    }

    /// All parts, in the order of their texels.
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Number of places, whole texels that are cut among them.
    pub fn places(&self) -> usize {
        self.texels + self.parts.len()
    }

    /// Number of the texel's cut, if it has one.
    fn cut_of(&self, texel: usize) -> Option<Cut> {
        let k = self.cuts.binary_search_by_key(&(texel as u32), |cut| cut.texel).ok()?;
        Some(self.cuts[k])
    }

    /// The places of a texel: itself, or its parts.
    pub fn places_of(&self, texel: usize) -> std::ops::Range<usize> {
        match self.cut_of(texel) {
            None => texel..texel + 1,
            Some(cut) => {
                let first = self.texels + cut.first as usize;
                first..first + (1 << (cut.halvings[0] + cut.halvings[1]))
            }
        }
    }

    /// The place that stands for the fraction `st` of a texel.
    pub fn place_at(&self, texel: usize, st: [f32; 2]) -> usize {
        let Some(cut) = self.cut_of(texel) else { return texel };
        let at = [0, 1].map(|axis| {
            let parts = 1_usize << cut.halvings[axis];
            ((st[axis] * parts as f32) as usize).min(parts - 1)
        });
        self.texels + cut.first as usize + (at[1] << cut.halvings[0]) + at[0]
    }

    /// Texel of a place, where it stands within it, and how often that texel is halved.
    pub fn place(&self, place: usize) -> Part {
        if place < self.texels {
            Part { texel: place as u32, st: [0.5; 2], halvings: 0 }
        } else {
            self.parts[place - self.texels]
        }
    }

    /// Slopes at a place.
    pub fn slope(&self, field: &HeightField, place: usize) -> [f32; 2] {
        let Part { texel, st: [s, t], .. } = self.place(place);
        field.slope(texel as usize % self.width, texel as usize / self.width, s, t)
    }

    /// Whether each texel is cut, for those who walk through all of them in order.
    pub(super) fn is_cut(&self) -> Vec<bool> {
        let mut cut = vec![false; self.texels];
        self.cuts.iter().for_each(|k| cut[k.texel as usize] = true);
        cut
    }
}

/// How far a texel's patch is from a level point.
#[derive(Clone, Copy, Debug)]
struct Steepness {
    /// The largest slopes along u and v, without sign.
    slopes: [f32; 2],
    /// How much a slope changes from one edge to the other.
    bend: f32,
}

impl Steepness {
    fn new(field: &HeightField, u: usize, v: usize) -> Self {
        let [a, b] = [field.slope(u, v, 0.0, 0.0), field.slope(u, v, 1.0, 1.0)];
        let bend = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
        Self { slopes: [0, 1].map(|axis| a[axis].abs().max(b[axis].abs())), bend }
    }

    /// Area of surface per area of base, where it is steepest.
    fn area(self) -> f32 {
        let [x, y] = self.slopes;
        (1.0 + x * x + y * y).sqrt()
    }

    fn is_split(self) -> bool {
        self.area() > STEEP || self.bend > BENT
    }

    /// Parts that the texel should have.
    fn parts(self) -> f32 {
        let bent = if self.bend > BENT { PARTS_A_BEND * self.bend * self.bend } else { 1.0 };
        self.area().max(bent).min((1 << MOST_HALVINGS) as f32)
    }

    /// Halvings along u and v, so that all parts climb alike along both.
    fn halvings(self, fineness: f32) -> [u8; 2] {
        let total = (self.parts() * fineness).max(1.0).log2().round();
        let [u, v] = self.slopes.map(|slope| slope.max(1e-6).log2());
        let along_u = (0.5 * (total + u - v)).round().clamp(0.0, total);
        [along_u as u8, (total - along_u) as u8]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Boundary;

    #[test]
    fn parts_share_a_wall_and_leave_the_rest_alone() {
        // a wall of 20:1 in column 3, and one down in column 7
        let heights = (0..64).map(|k| if (4..8).contains(&(k % 8)) { 20.0 } else { 0.0 }).collect();
        let field = HeightField::new(heights, [8, 8], [1.0; 2], Boundary::Repeat);
        let splits = Splits::new(&field);
        for texel in 0..64 {
            let places = splits.places_of(texel);
            if texel % 8 != 3 && texel % 8 != 7 {
                assert_eq!(places, texel..texel + 1);
                continue;
            }
            // the power of two next to 20, along u
            assert_eq!(places.len(), 16);
            for (k, place) in places.enumerate() {
                let part = splits.place(place);
                assert_eq!((part.texel, part.halvings), (texel as u32, 4));
                assert_eq!((part.st[0] * 16.0) as usize, k);
                assert_eq!(splits.place_at(texel, part.st), place);
                assert_eq!(splits.slope(&field, place)[0].abs(), 20.0);
            }
        }
    }

    #[test]
    fn a_saddle_is_cut_both_ways() {
        let of = |amplitude: f32| {
            let heights = (0..16).map(|k| if (k + k / 4) % 2 == 0 { amplitude } else { 0.0 }).collect();
            Steepness::new(&HeightField::new(heights, [4, 4], [1.0; 2], Boundary::Repeat), 1, 1)
        };
        assert_eq!(of(1.0).halvings(1.0), [2, 2]);
        assert_eq!(of(8.0).halvings(1.0), [3, 3]);
        assert!(!of(0.7).is_split());
        assert_eq!(Steepness { slopes: [80.0, 0.0], bend: 0.0 }.halvings(1.0), [6, 0]);
        assert_eq!(Steepness { slopes: [0.0, 10.0], bend: 0.0 }.halvings(0.5), [0, 2]);
    }
}
