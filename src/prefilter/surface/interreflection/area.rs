//! Places of a patch by the area of their surface.

use super::super::patch_of;
use super::super::splits::Splits;
use crate::geometry::HeightField;
use glam::Vec3;
use std::ops::Range;

/// How the area of a patch is spread over its rows.
pub(super) struct PatchArea {
    columns: Range<usize>,
    rows: Range<usize>,
    /// Area of all rows up to and with each, in texels of the base.
    cumulative: Vec<f64>,
    /// Area within a row up to and with each of its texels, row after row.
    within: Vec<f32>,
}

impl PatchArea {
    /// Of patch `patch` (row-major) of `patches`.
    pub(super) fn new(heights: &HeightField, splits: &Splits, patches: [usize; 2], patch: usize) -> Self {
        let size = heights.size();
        let at = [patch % patches[0], patch / patches[0]];
        let [columns, rows] = [0, 1].map(|axis| {
            let own = |texel: usize| {
                let mut place = [0; 2];
                place[axis] = texel;
                let patch = patch_of(place, size, patches);
                (if axis == 0 { patch % patches[0] } else { patch / patches[0] }) == at[axis]
            };
            let from = (0..size[axis]).find(|&texel| own(texel)).unwrap_or(0);
            from..(from..size[axis]).find(|&texel| !own(texel)).unwrap_or(size[axis])
        });
        let mut total = 0.0;
        let mut area = Self { columns, rows, cumulative: Vec::new(), within: Vec::new() };
        for row in area.rows.clone() {
            let mut within = 0.0;
            for column in area.columns.clone() {
                within += texel_area(heights, splits, column, row);
                area.within.push(within as f32);
            }
            total += within;
            area.cumulative.push(total);
        }
        area
    }

    /// Area per base area.
    pub(super) fn mean(&self) -> f64 {
        let texels = self.columns.len() * self.rows.len();
        self.cumulative.last().map_or(1.0, |total| total / texels as f64)
    }

    /// The place at the fractions `x` of the area: along v over rows, along u within the row, texel by texel.
    pub(super) fn place(&self, heights: &HeightField, splits: &Splits, x: [f64; 2]) -> usize {
        let total = self.cumulative.last().copied().unwrap_or(0.0);
        let at = self.cumulative.partition_point(|&area| area <= x[1] * total).min(self.rows.len() - 1);
        let row = self.rows.start + at;
        let before = if at == 0 { 0.0 } else { self.cumulative[at - 1] };
        let along = x[0] * (self.cumulative[at] - before);
        let within = &self.within[at * self.columns.len()..][..self.columns.len()];
        let column = within.partition_point(|&area| f64::from(area) <= along).min(within.len() - 1);
        let mut rest = along - if column == 0 { 0.0 } else { f64::from(within[column - 1]) };
        let mut places = splits.places_of(row * heights.size()[0] + self.columns.start + column);
        let last = places.end - 1;
        let place = places.find(|&place| {
            rest -= place_area(heights, splits, place);
            rest < 0.0
        });
        place.unwrap_or(last)
    }
}

/// Area of a texel's surface per base area, by the normals of its places.
fn texel_area(heights: &HeightField, splits: &Splits, u: usize, v: usize) -> f64 {
    splits.places_of(v * heights.size()[0] + u).map(|place| place_area(heights, splits, place)).sum()
}

/// What a place has of it.
fn place_area(heights: &HeightField, splits: &Splits, place: usize) -> f64 {
    let [x, y] = splits.slope(heights, place);
    f64::from(Vec3::new(x, y, 1.0).length()) * 0.5_f64.powi(i32::from(splits.place(place).halvings))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Boundary;

    #[test]
    fn places_are_drawn_by_their_area() {
        // a ramp of slope 3 in one column of a flat map, in the second of 2 × 1 patches
        let heights: Vec<f32> = (0..64).map(|k| if k % 8 == 6 { 3.0 } else { 0.0 }).collect();
        let heights = HeightField::new(heights, [8, 8], [1.0; 2], Boundary::Repeat);
        let splits = Splits::new(&heights);
        let area = PatchArea::new(&heights, &splits, [2, 1], 1);
        let steep = 10_f64.sqrt();
        assert!((area.mean() - (2.0 * steep + 2.0) / 4.0).abs() < 1e-6);
        let n = 400;
        let mut columns = [0.0; 8];
        for k in 0..n * n {
            let x = [k % n, k / n].map(|k| (k as f64 + 0.5) / n as f64);
            columns[area.place(&heights, &splits, x) % 8] += 1.0 / (n * n) as f64;
        }
        let total = 2.0 * steep + 2.0;
        for (column, expected) in [(3, 0.0), (4, 1.0 / total), (5, steep / total), (6, steep / total), (7, 1.0 / total)]
        {
            assert!((columns[column] - expected).abs() < 0.005, "{columns:?}");
        }
    }
}
