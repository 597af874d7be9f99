//! Parts of steep texels within a sweep: each has a ray of its own.

use super::super::splits::Splits;
use super::March;
use crate::geometry::HeightField;

/// One part, as a sweep meets it.
#[derive(Clone, Copy, Debug)]
pub(super) struct RowPart {
    /// Texel along the row.
    column: u32,
    /// Where it stands within its texel, along the row and down the rows.
    within: [f32; 2],
    height: f32,
    /// Number of the part.
    part: u32,
}

/// The parts of a map, row by row of a march.
#[derive(Clone, Debug, Default)]
pub(super) struct PartRows {
    parts: Vec<RowPart>,
    /// Where each row's parts begin, and the end; empty where there are none.
    firsts: Vec<u32>,
}

impl PartRows {
    /// Rows of the march follow `axis`: 1 as stored, 0 transposed.
    pub(super) fn new(field: &HeightField, splits: &Splits, rows: usize, axis: usize) -> Self {
        if splits.parts().is_empty() {
            return Self::default();
        }
        let width = field.size()[0] as u32;
        let mut parts: Vec<(u32, RowPart)> = splits
            .parts()
            .iter()
            .enumerate()
            .map(|(k, part)| {
                let at = [part.texel % width, part.texel / width];
                let [h00, h10, h01, h11] = field.corners(at[0] as usize, at[1] as usize);
                let [s, t] = part.st;
                let [top, bottom] = [h00 + s * (h10 - h00), h01 + s * (h11 - h01)];
                let height = top + t * (bottom - top);
                let within = [part.st[1 - axis], part.st[axis]];
                (at[axis], RowPart { column: at[1 - axis], within, height, part: k as u32 })
            })
            .collect();
        parts.sort_by_key(|&(row, part)| (row, part.part));
        let firsts = (0..=rows as u32).map(|row| parts.partition_point(|&(at, _)| at < row) as u32).collect();
        Self { parts: parts.into_iter().map(|(_, part)| part).collect(), firsts }
    }

    /// Writes to `mask`, a byte a part, what `see` tells of the parts of a row of texels.
    #[inline(always)]
    pub(super) fn light(&self, row: usize, mask: &mut [u8], see: impl Fn(RowPart) -> Sight) {
        let Some(&[first, end]) = self.firsts.get(row..row + 2).and_then(|pair| pair.first_chunk()) else { return };
        for &part in &self.parts[first as usize..end as usize] {
            mask[part.part as usize] = see(part) as u8;
        }
    }
}

/// What a sweep knows of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Sight {
    Hidden = 0,
    Lit = 1,
    /// The lines on both sides of the ray disagree: to be cast.
    Unclear = 2,
}

/// A ray from a part towards the light.
pub(super) struct Ray {
    /// Columns along the row, and rows to the vertex row on the light's side.
    column: f32,
    rows: f32,
    height: f32,
    march: March,
}

impl Ray {
    #[inline(always)]
    pub(super) fn new(part: RowPart, march: March) -> Self {
        let [along, down] = part.within;
        let rows = if march.light_at_end { 1.0 - down } else { down };
        Self { column: part.column as f32 + along, rows, height: part.height, march }
    }

    /// Whether the ray passes over the edges of the cells of the part's own row and the next, and over the `shadow` that
    /// all vertex rows before these throw, line by line.
    ///
    /// `vertices` are the vertex rows from the one behind the part to the one before the next row of cells; a line stands
    /// at its own number's column on the vertex row on the light's side of row of cells `step` less its shear.
    #[inline(always)]
    pub(super) fn see(&self, vertices: [impl Fn(i64) -> f32; 3], shadow: impl Fn(i64) -> f32, step: f32) -> Sight {
        let March { shear, rise, .. } = self.march;
        let mut from = 0.0;
        for row in 0..2 {
            let to = self.rows + row as f32;
            let (far, near) = (&vertices[row], &vertices[row + 1]);
            if self.height + to * rise < interpolated(near, self.column + to * shear) {
                return Sight::Hidden;
            }
            // a column of vertices in between: shear is at most 1, so there is one at most
            let [a, b] = [from, to].map(|rows| (self.column + rows * shear).floor());
            if a != b {
                let edge = a.max(b);
                let rows = ((edge - self.column) / shear).clamp(from, to);
                let (near, far) = (near(edge as i64), far(edge as i64));
                if self.height + rows * rise < near + (to - rows) * (far - near) {
                    return Sight::Hidden;
                }
            }
            from = to;
        }
        let line = (self.column + (self.rows + step) * shear).floor() as i64;
        let (a, b) = (shadow(line), shadow(line + 1));
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        let height = self.height + (self.rows + 2.0) * rise;
        // what stands between two vertex rows is up to a row nearer than the lines know
        if height >= high + rise {
            Sight::Lit
        } else if height < low {
            Sight::Hidden
        } else {
            Sight::Unclear
        }
    }
}

/// The value at a position between two of a row.
#[inline(always)]
fn interpolated(row: &impl Fn(i64) -> f32, at: f32) -> f32 {
    let first = at.floor();
    let (a, b) = (row(first as i64), row(first as i64 + 1));
    a + (at - first) * (b - a)
}

/// A column of a map that repeats.
#[inline(always)]
pub(super) fn wrapped(column: i64, columns: usize) -> usize {
    let n = columns as i64;
    // all but lines of long shadows lie next to the map
    let near = if column < 0 {
        column + n
    } else if column >= n {
        column - n
    } else {
        column
    };
    (if (0..n).contains(&near) { near } else { near.rem_euclid(n) }) as usize
}
