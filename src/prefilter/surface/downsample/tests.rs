use super::*;
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// Heights that have nothing in common with the grid: a hash of the vertex in [0, 1).
fn rough(size: [usize; 2], spacing: [f32; 2], boundary: Boundary) -> HeightField {
    let hash = |k: usize| ((k as u32).wrapping_mul(2_654_435_761).wrapping_add(12_345) >> 8) as f32 / (1 << 24) as f32;
    HeightField::new((0..size[0] * size[1]).map(hash).collect(), size, spacing, boundary)
}

/// The objective written out row by row: (matrix, right side) with one row a residual.
///
/// For `clamp` only real cells, the Laplacian mirrored at the end vertices and weighted ½ a border, as documented.
fn dense_objective(
    slopes: &MeanSlopes,
    size: [usize; 2],
    spacing: [f64; 2],
    boundary: Boundary,
    w: f64,
) -> [DMatrix<f64>; 2] {
    let mut rows: Vec<(Vec<(usize, f64)>, f64)> = Vec::new();
    let at = |i: usize, j: usize| {
        let fold = |i: usize, n: usize| {
            if i < n {
                i
            } else if boundary == Boundary::Repeat {
                0
            } else {
                n - 1
            }
        };
        fold(j, size[1]) * size[0] + fold(i, size[0])
    };
    for j in 0..slopes.cells[1] {
        for i in 0..slopes.cells[0] {
            let [h00, h10, h01, h11] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            let [a, b] = spacing.map(|s| 0.5 / s);
            let k = j * slopes.cells[0] + i;
            // A clamped axis of one vertex has no slope of its own to match.
            rows.push((vec![(h10, a), (h11, a), (h01, -a), (h00, -a)], slopes.u[k]));
            rows.push((vec![(h01, b), (h11, b), (h10, -b), (h00, -b)], slopes.v[k]));
        }
    }
    let neighbours = |i: usize, n: usize| match boundary {
        Boundary::Repeat => [(i + n - 1) % n, (i + 1) % n],
        Boundary::Clamp if n == 1 => [0, 0],
        Boundary::Clamp if i == 0 => [1, 1],
        Boundary::Clamp if i == n - 1 => [n - 2, n - 2],
        Boundary::Clamp => [i - 1, i + 1],
    };
    let border = |i: usize, n: usize| {
        if boundary == Boundary::Clamp && n > 1 && (i == 0 || i == n - 1) { 0.5_f64 } else { 1.0 }
    };
    for j in 0..size[1] {
        for i in 0..size[0] {
            let scale = (w * border(i, size[0]) * border(j, size[1])).sqrt();
            let [a, b] = spacing.map(|s| scale / s);
            let centre = j * size[0] + i;
            let mut row = vec![(centre, -2.0 * (a + b))];
            row.extend(neighbours(i, size[0]).map(|i| (j * size[0] + i, a)));
            row.extend(neighbours(j, size[1]).map(|j| (j * size[0] + i, b)));
            rows.push((row, 0.0));
        }
    }
    let mut matrix = DMatrix::zeros(rows.len(), size[0] * size[1]);
    let mut right = DMatrix::zeros(rows.len(), 1);
    for (r, (row, value)) in rows.iter().enumerate() {
        row.iter().for_each(|&(k, c)| matrix[(r, k)] += c);
        right[(r, 0)] = *value;
    }
    [matrix, right]
}

/// Minimum of the dense objective, shifted to mean height `mean` of the bilinear surface.
fn dense_minimum([matrix, right]: &[DMatrix<f64>; 2], size: [usize; 2], boundary: Boundary, mean: f64) -> DVector<f64> {
    // The constant is its only null vector for w > 0: add it to make the normal equations definite.
    let n = matrix.ncols();
    let normal = matrix.transpose() * matrix + DMatrix::from_element(n, n, 1.0 / n as f64);
    let heights = normal.cholesky().expect("positive definite").solve(&(matrix.transpose() * right));
    let heights: DVector<f64> = heights.column(0).into();
    let shift = mean - mean_height(size, boundary, |i, j| heights[j * size[0] + i]);
    heights.add_scalar(shift)
}

fn surface_mean(field: &HeightField) -> f64 {
    mean_height(field.size(), field.boundary(), |i, j| f64::from(field.vertex(i, j)))
}

#[test]
fn the_solution_is_that_of_a_dense_least_squares_solve() {
    let cases: [([usize; 2], [f32; 2], [usize; 2]); 8] = [
        ([32, 32], [1.0, 1.0], [8, 8]),
        ([24, 40], [1.0, 1.0], [6, 10]),
        ([32, 32], [0.5, 2.0], [8, 8]),
        ([30, 37], [1.0, 1.3], [7, 11]),
        ([10, 64], [3.0, 0.4], [1, 16]),
        ([64, 1], [1.0, 1.0], [16, 1]),
        ([9, 8], [1.0, 1.0], [2, 2]),
        ([5, 5], [1.0, 1.0], [5, 5]),
    ];
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        for (size, spacing, cells) in cases {
            for w in [0.01, 1.0] {
                let fine = rough(size, spacing, boundary);
                let coarse = downsample_to(&fine, cells, w);
                let spacing = [0, 1].map(|axis| coarse_spacing(&fine, cells, axis));
                let slopes = MeanSlopes::of(&fine, cells, spacing);
                let dense = dense_objective(&slopes, cells, spacing, boundary, w);
                let expected = dense_minimum(&dense, cells, boundary, surface_mean(&fine));
                for (k, (&h, e)) in coarse.heights().iter().zip(expected.iter()).enumerate() {
                    // One rounding to f32 of values below 2.
                    assert!(
                        (f64::from(h) - e).abs() < 3e-7,
                        "{boundary:?} {size:?} {cells:?} w {w}: vertex {k} {h} {e}"
                    );
                }
            }
        }
    }
}

#[test]
fn reference_slopes_are_the_means_over_many_points_of_the_bilinear_surface() {
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        let fine = rough([10, 7], [0.5, 2.0], boundary);
        let cells = [4, 3];
        let spacing = [0, 1].map(|axis| coarse_spacing(&fine, cells, axis));
        let slopes = MeanSlopes::of(&fine, cells, spacing);
        // 140 midpoints a cell and axis: no texel border (2.5 and 7/3 texels a cell) falls inside an interval.
        let points = 140;
        for cell in 0..slopes.cells[0] * slopes.cells[1] {
            let [ci, cj] = [cell % slopes.cells[0], cell / slopes.cells[0]];
            let [mut u, mut v] = [0.0, 0.0];
            for k in 0..points * points {
                let x = (ci as f64 + ((k % points) as f64 + 0.5) / points as f64) * 10.0 / 4.0;
                let y = (cj as f64 + ((k / points) as f64 + 0.5) / points as f64) * 7.0 / 3.0;
                let slope = fine.slope(x as usize, y as usize, x.fract() as f32, y.fract() as f32);
                u += f64::from(slope[0]) / (points * points) as f64;
                v -= f64::from(slope[1]) / (points * points) as f64;
            }
            // f32 slopes averaged over 19600 points.
            assert!((u - slopes.u[cell]).abs() < 2e-6, "{boundary:?} cell {cell}: {u} {}", slopes.u[cell]);
            assert!((v - slopes.v[cell]).abs() < 2e-6, "{boundary:?} cell {cell}: {v} {}", slopes.v[cell]);
        }
    }
}

#[test]
fn mean_height_and_extent_are_kept() {
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        for (size, factor) in [([64, 48], 8.0), ([33, 70], 3.7), ([1, 90], 8.0), ([16, 16], 100.0), ([5, 6], 1.0)] {
            let fine = rough(size, [0.25, 0.75], boundary);
            let coarse = downsample(&fine, factor);
            assert_eq!(coarse.size(), size.map(|n| ((n as f32 / factor).round() as usize).max(1)));
            assert!((surface_mean(&coarse) - surface_mean(&fine)).abs() < 1e-7, "{boundary:?} {size:?} {factor}");
            for axis in 0..2 {
                assert!((coarse.extent()[axis] / fine.extent()[axis] - 1.0).abs() < 1e-6);
            }
        }
    }
}

#[test]
fn a_constant_map_stays_exactly_constant() {
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        for (size, factor) in [([64, 48], 8.0), ([33, 70], 3.7), ([1, 90], 8.0), ([16, 16], 100.0), ([1, 1], 1.0)] {
            let fine = HeightField::new(vec![0.1; size[0] * size[1]], size, [1.0, 1.0], boundary);
            assert!(downsample(&fine, factor).heights().iter().all(|&h| h == 0.1), "{boundary:?} {size:?} {factor}");
        }
    }
}

#[test]
fn a_clamped_plane_keeps_its_slopes_in_the_interior() {
    let [nu, nv] = [320, 240];
    let heights = (0..nu * nv).map(|k| 0.3 * (k % nu) as f32 - 0.2 * (k / nu) as f32).collect();
    let fine = HeightField::new(heights, [nu, nv], [1.0, 1.0], Boundary::Clamp);
    let coarse = downsample(&fine, 8.0);
    // The mirrored map has a crease at its end vertices; the Laplacian smooths it over a few cells.
    for (i, j) in (8..31).flat_map(|i| (8..21).map(move |j| (i, j))) {
        let [du, dv] = coarse.slope(i, j, 0.5, 0.5);
        assert!((du - 0.3).abs() < 1e-4 && (dv - 0.2).abs() < 1e-4, "cell {i}, {j}: {du} {dv}");
    }
}

#[test]
fn factor_one_without_smoothing_gives_the_map_back_but_for_its_checkerboard() {
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        for size in [[16, 12], [15, 9], [1, 16], [2, 2]] {
            let fine = rough(size, [1.0, 1.5], boundary);
            let same = downsample_to(&fine, size, 0.0);
            let sign = |k: usize| if (k % size[0] + k / size[0]).is_multiple_of(2) { 1.0 } else { -1.0 };
            let lost: Vec<f32> = same.heights().iter().zip(fine.heights()).map(|(a, b)| a - b).collect();
            // The mean of the clamped surface does not weigh the checkerboard equally: a constant may remain.
            let [second, first] = [lost[1], lost[0]];
            let [constant, pattern] = [0.5 * (first + second), 0.5 * (first - second)];
            for (k, &difference) in lost.iter().enumerate() {
                let expected = constant + pattern * sign(k);
                assert!((difference - expected).abs() < 2e-6, "{boundary:?} {size:?} vertex {k}: {difference}");
            }
        }
    }
}

#[test]
fn a_sinusoid_is_scaled_by_the_closed_form() {
    // One mode sampled exactly at the cuts: s̃* is its own finite difference times a known mean along the edges.
    let ([n, cells], periods) = ([256, 32], 3.0);
    let wave = |x: f64| (2.0 * PI * periods * x / n as f64).sin();
    let heights = (0..n * n).map(|k| wave((k % n) as f64) as f32).collect();
    let fine = HeightField::new(heights, [n, n], [1.0, 1.0], Boundary::Repeat);
    let coarse = downsample(&fine, 8.0);
    // Constant along v: AᵀA = 4x/a² and Δ² = 16x²/a², so h = wave / (1 + 4wx) with x = sin²(π·periods/cells).
    let x = (PI * periods / cells as f64).sin().powi(2);
    for i in 0..cells {
        let expected = wave(8.0 * i as f64) / (1.0 + 4.0 * LAPLACIAN_WEIGHT * x);
        assert!((f64::from(coarse.vertex(i, 5)) - expected).abs() < 2e-7, "vertex {i}");
    }
}

#[test]
fn thread_counts_change_no_bit() {
    for boundary in [Boundary::Repeat, Boundary::Clamp] {
        let fine = rough([200, 150], [1.0, 1.0], boundary);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| downsample(&fine, 3.3))
        };
        assert_eq!(on(1), on(4));
    }
}
