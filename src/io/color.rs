//! Colour maps: linear RGB, averaged over the texels of the height map that they lie on.

use super::raster::{Choice, Transfer, decode, expect_finite};
use super::{Error, SourceFile};

/// Decodes a colour map to linear RGB in [0, 1] and averages it over `size[0] × size[1]` texels, `[v][u]`.
///
/// Integers are taken as sRGB, floats as linear. The map may have any size: each texel gets the mean over its own area.
pub fn decode_color(file: &SourceFile, size: [usize; 2]) -> Result<Vec<[f32; 3]>, Error> {
    let raster = decode(file, Choice::Color)?;
    let mut averaged = Vec::with_capacity(3);
    for mut plane in raster.planes {
        expect_finite(file.name(), raster.width, &plane)?;
        if raster.transfer == Transfer::Srgb {
            plane.iter_mut().for_each(|value| *value = linear_from_srgb(*value));
        }
        expect_albedo(file, raster.width, &plane)?;
        averaged.push(area_average(&plane, [raster.width, raster.height], size));
    }
    let [r, g, b] = match averaged.as_slice() {
        [r, g, b] => [r, g, b],
        [y, ..] => [y, y, y],
        [] => unreachable!("at least one channel was chosen"),
    };
    Ok((0..size[0] * size[1]).map(|i| [r[i], g[i], b[i]]).collect())
}

/// Fails at the first value outside of [0, 1]: a factor of an albedo beyond it would make energy.
fn expect_albedo(file: &SourceFile, width: usize, plane: &[f32]) -> Result<(), Error> {
    match plane.iter().position(|v| !(0.0..=1.0).contains(v)) {
        None => Ok(()),
        Some(i) => Err(Error::Unsupported {
            file: file.name().into(),
            found: format!("{} at texel ({}, {})", plane[i], i % width, i / width),
            wanted: "colours from 0 to 1",
        }),
    }
}

/// Linear light of an sRGB value, both in [0, 1] (IEC 61966-2-1).
pub fn linear_from_srgb(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

/// sRGB value of linear light, both in [0, 1] (IEC 61966-2-1); the inverse of [`linear_from_srgb`].
pub fn srgb_from_linear(value: f32) -> f32 {
    if value <= 0.003_130_8 { value * 12.92 } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

/// The mean of `plane` (`from[0] × from[1]`) over each of `to[0] × to[1]` equal rectangles.
fn area_average(plane: &[f32], from: [usize; 2], to: [usize; 2]) -> Vec<f32> {
    if from == to {
        return plane.to_vec();
    }
    let columns: Vec<Footprint> = (0..to[0]).map(|i| Footprint::new(i, from[0], to[0])).collect();
    let mut out = Vec::with_capacity(to[0] * to[1]);
    let mut row = vec![0.0; from[0]];
    for v in 0..to[1] {
        // First down a strip of rows, then along it: each source texel is touched once a covering row.
        row.fill(0.0);
        Footprint::new(v, from[1], to[1]).each(|source, weight| {
            let line = &plane[source * from[0]..(source + 1) * from[0]];
            row.iter_mut().zip(line).for_each(|(sum, value)| *sum += weight * f64::from(*value));
        });
        out.extend(columns.iter().map(|footprint| {
            let mut sum = 0.0;
            footprint.each(|source, weight| sum += weight * row[source]);
            sum as f32
        }));
    }
    out
}

/// The source cells that target cell `index` covers on one axis, with weights of sum 1.
struct Footprint {
    first: usize,
    last: usize,
    /// In units of 1/`to` source cells, so that it is exact.
    start: usize,
    end: usize,
    to: usize,
}

impl Footprint {
    /// Target cell `index` of `to` over `from` source cells.
    fn new(index: usize, from: usize, to: usize) -> Self {
        let (start, end) = (index * from, (index + 1) * from);
        Self { first: start / to, last: (end - 1) / to, start, end, to }
    }

    /// Calls `visit` with each source cell and its weight.
    fn each(&self, mut visit: impl FnMut(usize, f64)) {
        for source in self.first..=self.last {
            let overlap = self.end.min((source + 1) * self.to) - self.start.max(source * self.to);
            visit(source, overlap as f64 / (self.end - self.start) as f64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averaging_keeps_the_mean_and_a_constant() {
        let plane: Vec<f32> = (0..35).map(|i| (i * 7 % 13) as f32).collect();
        let mean = |p: &[f32]| p.iter().map(|v| f64::from(*v)).sum::<f64>() / p.len() as f64;
        for to in [[7, 5], [14, 10], [3, 2], [1, 1], [9, 4]] {
            let averaged = area_average(&plane, [7, 5], to);
            assert!((mean(&averaged) - mean(&plane)).abs() < 1e-6, "{to:?}");
            assert!(area_average(&[0.25; 35], [7, 5], to).iter().all(|v| (v - 0.25).abs() < 1e-7));
        }
    }

    #[test]
    fn a_finer_grid_repeats_texels() {
        assert_eq!(area_average(&[1.0, 2.0], [2, 1], [4, 2]), [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0]);
    }

    #[test]
    fn srgb_becomes_linear_at_the_known_points() {
        assert_eq!(linear_from_srgb(0.0), 0.0);
        assert!((linear_from_srgb(0.5) - 0.214_041).abs() < 1e-6);
        assert!((linear_from_srgb(1.0) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn srgb_and_linear_undo_each_other() {
        for k in 0..=1000 {
            let value = k as f32 / 1000.0;
            // The two branches of the standard meet within 3e-8 of each other.
            assert!((linear_from_srgb(srgb_from_linear(value)) - value).abs() < 1e-6, "{value}");
        }
    }
}
