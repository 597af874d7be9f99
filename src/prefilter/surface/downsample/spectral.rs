//! The normal equations of the coarse heights, diagonal in the frequency domain.
//!
//! Both operators of the objective are even in each axis, so real transforms do: cas (Hartley) on the torus, DCT-I on
//! the mirrored map. Each is its own inverse up to the period, and both are read off one complex FFT of a period.

use super::slopes::MeanSlopes;
use crate::geometry::Boundary;
use rayon::prelude::*;
use rustfft::{Fft, FftPlannerScalar, num_complex::Complex64};
use std::f64::consts::PI;
use std::sync::Arc;

/// A field of vertices, transformed along both axes; stored transposed (`[u][v]`).
pub(super) struct Spectrum {
    values: Vec<f64>,
    axes: [Axis; 2],
}

impl Spectrum {
    /// Transform of Aᵀs̃*, A the operator that takes heights to mean slopes.
    pub(super) fn of_adjoint(slopes: &MeanSlopes, size: [usize; 2], spacing: [f64; 2], boundary: Boundary) -> Self {
        let axes = size.map(|n| Axis::new(n, boundary));
        let mut values = vec![0.0; size[0] * size[1]];
        values.par_chunks_mut(size[0]).enumerate().for_each(|(j, row)| adjoint_row(slopes, &axes, spacing, j, row));
        axes[0].transform_rows(&mut values);
        let mut values = transposed(&values, size);
        axes[1].transform_rows(&mut values);
        Self { values, axes }
    }

    /// Solves (AᵀA + w Δ²) h = Aᵀs̃*, mode by mode; the modes that no operator sees become 0.
    ///
    /// With x = sin²(α/2), y = sin²(β/2) for the frequencies α along u and β along v, and cells of a × b metres:
    /// AᵀA = 4x(1 − y)/a² + 4(1 − x)y/b² and Δ = −4x/a − 4y/b.
    pub(super) fn divide(&mut self, spacing: [f64; 2], laplacian_weight: f64) {
        let [x, y] = [0, 1].map(|axis| self.axes[axis].half_angle_sines());
        let scale = 1.0 / (self.axes[0].period() * self.axes[1].period()) as f64;
        let [a, b] = spacing;
        for (row, &x) in self.values.chunks_mut(y.len()).zip(&x) {
            for (value, &y) in row.iter_mut().zip(&y) {
                let slopes = 4.0 * x * (1.0 - y) / (a * a) + 4.0 * (1.0 - x) * y / (b * b);
                let laplacian = 4.0 * x / a + 4.0 * y / b;
                let system = slopes + laplacian_weight * laplacian * laplacian;
                // Both are exact zeros for the constant and the checkerboard: see `half_angle_sines`.
                *value = if slopes > 0.0 { *value * scale / system } else { 0.0 };
            }
        }
    }

    /// Back to heights, row-major.
    pub(super) fn into_heights(mut self) -> Vec<f64> {
        self.axes[1].transform_rows(&mut self.values);
        let mut values = transposed(&self.values, [self.axes[1].len, self.axes[0].len]);
        self.axes[0].transform_rows(&mut values);
        values
    }
}

/// Row `j` of Aᵀs̃*: each vertex gathers from the four cells around it, mirrored ones where the map ends.
fn adjoint_row(slopes: &MeanSlopes, axes: &[Axis; 2], spacing: [f64; 2], j: usize, row: &mut [f64]) {
    let around_v = axes[1].cells_around(j);
    for (i, value) in row.iter_mut().enumerate() {
        let around_u = axes[0].cells_around(i);
        let [mut u, mut v] = [0.0, 0.0];
        for (before_u, &(i, sign_u)) in [0.5, -0.5].iter().zip(&around_u) {
            for (before_v, &(j, sign_v)) in [0.5, -0.5].iter().zip(&around_v) {
                let cell = j * slopes.cells[0] + i;
                u += before_u * sign_u * slopes.u[cell];
                v += before_v * sign_v * slopes.v[cell];
            }
        }
        *value = u / spacing[0] + v / spacing[1];
    }
}

/// The transform of one axis.
struct Axis {
    len: usize,
    boundary: Boundary,
    fft: Arc<dyn Fft<f64>>,
}

impl Axis {
    fn new(len: usize, boundary: Boundary) -> Self {
        let period = match boundary {
            Boundary::Repeat => len,
            Boundary::Clamp => (2 * (len - 1)).max(1),
        };
        // The scalar planner: the same bytes on every machine of a platform, whatever its vector units.
        let fft = FftPlannerScalar::new().plan_fft_forward(period);
        Self { len, boundary, fft }
    }

    fn period(&self) -> usize {
        self.fft.len()
    }

    /// The cells before and after vertex `i`, with the sign that mirroring gives the slope along this axis.
    fn cells_around(&self, i: usize) -> [(usize, f64); 2] {
        match self.boundary {
            _ if self.period() == 1 => [(0, 1.0); 2],
            Boundary::Repeat => [((i + self.len - 1) % self.len, 1.0), (i, 1.0)],
            Boundary::Clamp if i == 0 => [(0, -1.0), (0, 1.0)],
            Boundary::Clamp if i == self.len - 1 => [(i - 1, 1.0), (i - 1, -1.0)],
            Boundary::Clamp => [(i - 1, 1.0), (i, 1.0)],
        }
    }

    /// sin²(πk/period) of each mode, exactly 0 and 1 for the constant and the alternating one.
    fn half_angle_sines(&self) -> Vec<f64> {
        let period = self.period();
        let sine = |k: usize| match k {
            _ if 2 * k == period => 1.0,
            _ => (PI * k as f64 / period as f64).sin().powi(2),
        };
        (0..self.len).map(sine).collect()
    }

    /// Transforms all rows, two real ones in each complex FFT.
    fn transform_rows(&self, values: &mut [f64]) {
        let work = || {
            let zero = Complex64::default();
            (vec![zero; self.period()], vec![zero; self.fft.get_inplace_scratch_len()])
        };
        values.par_chunks_mut(2 * self.len).for_each_init(work, |(line, scratch), rows| {
            let (first, second) = rows.split_at_mut(self.len);
            self.load(first, second, line);
            self.fft.process_with_scratch(line, scratch);
            self.unload(line, first, second);
        });
    }

    /// One period of first + i·second; `second` may be empty.
    fn load(&self, first: &[f64], second: &[f64], line: &mut [Complex64]) {
        let period = line.len();
        for (k, z) in line.iter_mut().enumerate() {
            let k = if k < self.len { k } else { period - k };
            *z = Complex64::new(first[k], second.get(k).copied().unwrap_or(0.0));
        }
    }

    /// Splits Z = A + iB: A_k = (Z_k + Z̄_−k)/2, B_k = (Z_k − Z̄_−k)/2i; the cas transform of a is Re A − Im A.
    ///
    /// On a mirrored line A and B are real and this is the cosine transform.
    fn unload(&self, line: &[Complex64], first: &mut [f64], second: &mut [f64]) {
        let period = line.len();
        for (k, value) in first.iter_mut().enumerate() {
            let [z, w] = [line[k], line[(period - k) % period]];
            *value = 0.5 * (z.re + w.re - z.im + w.im);
        }
        for (k, value) in second.iter_mut().enumerate() {
            let [z, w] = [line[k], line[(period - k) % period]];
            *value = 0.5 * (z.im + w.im + z.re - w.re);
        }
    }
}

/// `values`, `size[0]` wide and `size[1]` high, with rows and columns exchanged.
fn transposed(values: &[f64], size: [usize; 2]) -> Vec<f64> {
    const BLOCK: usize = 32; // 8 KiB of source rows and as much of target: both stay in the first-level cache
    let mut target = vec![0.0; values.len()];
    target.par_chunks_mut(size[1] * BLOCK).enumerate().for_each(|(block, rows)| {
        for j0 in (0..size[1]).step_by(BLOCK) {
            for (i, row) in rows.chunks_mut(size[1]).enumerate() {
                for j in j0..(j0 + BLOCK).min(size[1]) {
                    row[j] = values[j * size[0] + block * BLOCK + i];
                }
            }
        }
    });
    target
}
