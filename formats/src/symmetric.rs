//! Symmetric 3 × 3 matrices in the order xx yy zz xy xz yz: eigenvalues, eigenvectors, functions of them.

/// Sweeps of Jacobi's method; it converges quadratically, and five are enough for 53 bits.
const SWEEPS: usize = 8;

/// Eigenvalues and unit eigenvectors of a symmetric matrix, largest eigenvalue first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eigen {
    /// Eigenvalues, falling.
    pub values: [f64; 3],
    /// `vectors[k]` belongs to `values[k]`; orthonormal.
    pub vectors: [[f64; 3]; 3],
}

impl Eigen {
    /// By Jacobi rotations; exact to a few rounding errors of the largest eigenvalue. `matrix` is finite.
    pub fn of(matrix: [f64; 6]) -> Self {
        let [xx, yy, zz, xy, xz, yz] = matrix;
        let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let scale = xx.abs().max(yy.abs()).max(zz.abs());
        for _ in 0..SWEEPS {
            // Smaller than the square of a rounding error turns nothing.
            if a[0][1].abs().max(a[0][2].abs()).max(a[1][2].abs()) <= f64::EPSILON * f64::EPSILON * scale {
                break;
            }
            for (p, q) in [(0, 1), (0, 2), (1, 2)] {
                rotate(&mut a, &mut v, p, q);
            }
        }
        let mut order = [0, 1, 2];
        order.sort_by(|&i, &j| a[j][j].total_cmp(&a[i][i]));
        Self { values: order.map(|k| a[k][k]), vectors: order.map(|k| [v[0][k], v[1][k], v[2][k]]) }
    }

    /// Σ_k g(λ_k) v_k v_kᵀ.
    pub fn map(&self, g: impl Fn(f64) -> f64) -> [f64; 6] {
        let mut sum = [0.0; 6];
        for (value, [x, y, z]) in self.values.iter().zip(self.vectors) {
            let value = g(*value);
            let products = [x * x, y * y, z * z, x * y, x * z, y * z];
            (0..6).for_each(|k| sum[k] += value * products[k]);
        }
        sum
    }
}

/// Turns the axes p and q of `a` so that their product vanishes; `v` gathers the turns in its columns.
fn rotate(a: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    // t = tan of the smaller angle that solves t² + 2θt − 1 = 0; a huge θ gives t = 0.
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    for row in a.iter_mut().chain(v.iter_mut()) {
        let [x, y] = [row[p], row[q]];
        [row[p], row[q]] = [c * x - s * y, s * x + c * y];
    }
    let [x, y] = [a[p], a[q]];
    a[p] = std::array::from_fn(|k| c * x[k] - s * y[k]);
    a[q] = std::array::from_fn(|k| s * x[k] + c * y[k]);
    [a[p][q], a[q][p]] = [0.0; 2];
}

/// M² of a symmetric matrix.
pub fn square([xx, yy, zz, xy, xz, yz]: [f64; 6]) -> [f64; 6] {
    [
        xx * xx + xy * xy + xz * xz,
        xy * xy + yy * yy + yz * yz,
        xz * xz + yz * yz + zz * zz,
        xx * xy + xy * yy + xz * yz,
        xx * xz + xy * yz + xz * zz,
        xy * xz + yy * yz + yz * zz,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spread(seed: u64) -> impl Iterator<Item = f64> {
        (0..).map(move |k| (((k * 2 + 1) as f64 * 0.618_033_988_749 + seed as f64 * 0.414_213_562).fract() - 0.5) * 2.0)
    }

    #[test]
    fn eigenvalues_and_vectors_put_the_matrix_together_again() {
        for seed in 0..200 {
            // Scales apart by up to 1e6, so that small eigenvalues are tried too.
            let scale = [1.0, 1e-3, 1e-6][seed as usize % 3];
            let numbers: Vec<f64> = spread(seed).take(6).collect();
            let matrix = [numbers[0], numbers[1] * scale, numbers[2], numbers[3], numbers[4] * scale, numbers[5]];
            let eigen = Eigen::of(matrix);
            assert!(eigen.values[0] >= eigen.values[1] && eigen.values[1] >= eigen.values[2]);
            let again = eigen.map(|value| value);
            assert!((0..6).all(|k| (again[k] - matrix[k]).abs() < 1e-14), "{matrix:?} {again:?}");
            for i in 0..3 {
                for j in 0..3 {
                    let dot: f64 = (0..3).map(|k| eigen.vectors[i][k] * eigen.vectors[j][k]).sum();
                    assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-14, "{matrix:?}");
                }
            }
        }
    }

    #[test]
    fn a_root_squared_is_the_matrix() {
        for seed in 0..50 {
            let numbers: Vec<f64> = spread(seed).take(6).collect();
            let matrix = square(numbers.try_into().unwrap());
            let again = square(Eigen::of(matrix).map(|value| value.max(0.0).sqrt()));
            assert!((0..6).all(|k| (again[k] - matrix[k]).abs() < 1e-14), "{matrix:?} {again:?}");
        }
        assert_eq!(Eigen::of([0.0; 6]).values, [0.0; 3]);
        assert_eq!(Eigen::of([3.0, 1.0, 2.0, 0.0, 0.0, 0.0]).values, [3.0, 2.0, 1.0]);
    }
}
