//! Small dense linear algebra in `f64`: symmetric 3 × 3 eigenvalues, and the normal equations of a fit.

/// Eigenvalues, rising, and unit eigenvectors of the symmetric matrix in the order xx yy zz xy xz yz.
///
/// Cyclic Jacobi rotations: no cancellation in small eigenvalues, unlike the roots of the characteristic polynomial.
pub fn eigen_symmetric(s: [f64; 6]) -> ([f64; 3], [[f64; 3]; 3]) {
    let [xx, yy, zz, xy, xz, yz] = s;
    let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut vectors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    // Convergence is quadratic: six sweeps leave nothing of 3 × 3.
    for _ in 0..8 {
        for [p, q] in [[0, 1], [0, 2], [1, 2]] {
            rotate(&mut a, &mut vectors, p, q);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    (order.map(|k| a[k][k]), order.map(|k| vectors[k]))
}

/// The largest eigenvalue of the symmetric matrix in the order xx yy zz xy xz yz, in closed form.
///
/// With q = tr/3 and p² = |A − q|²/6 it is q + 2p·cos(acos(det((A − q)/p)/2)/3): the large root is the well-conditioned one.
pub fn largest_eigenvalue(s: [f64; 6]) -> f64 {
    let [xx, yy, zz, xy, xz, yz] = s;
    let q = (xx + yy + zz) / 3.0;
    let [a, b, c] = [xx - q, yy - q, zz - q];
    let p = ((a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0).sqrt();
    if p == 0.0 {
        return q;
    }
    let det = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz);
    let half = (0.5 * det / (p * p * p)).clamp(-1.0, 1.0); // a cosine, but for rounding
    q + 2.0 * p * (half.acos() / 3.0).cos()
}

/// Zeroes a[p][q] by a rotation, which is applied to the rows of `vectors` too.
fn rotate(a: &mut [[f64; 3]; 3], vectors: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    // the smaller root; for huge theta it tends to 1/(2 theta)
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    for row in a.iter_mut() {
        let [x, y] = [row[p], row[q]];
        [row[p], row[q]] = [c * x - s * y, s * x + c * y];
    }
    for k in 0..3 {
        let [x, y] = [a[p][k], a[q][k]];
        [a[p][k], a[q][k]] = [c * x - s * y, s * x + c * y];
        let [x, y] = [vectors[p][k], vectors[q][k]];
        [vectors[p][k], vectors[q][k]] = [c * x - s * y, s * x + c * y];
    }
    [a[p][q], a[q][p]] = [0.0; 2];
}

/// Solves A·x = b for a symmetric positive definite A (row-major, n × n) by Cholesky; `None` where A is not.
pub fn solve_positive(a: &[f64], b: &[f64]) -> Option<Vec<f64>> {
    let n = b.len();
    assert_eq!(a.len(), n * n, "a square matrix");
    let mut l = a.to_vec();
    for i in 0..n {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
            let rest = l[i * n + j] - dot;
            if i > j {
                l[i * n + j] = rest / l[j * n + j];
            } else if rest > 0.0 {
                l[i * n + i] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    let mut x = b.to_vec();
    for i in 0..n {
        let dot: f64 = (0..i).map(|k| l[i * n + k] * x[k]).sum();
        x[i] = (x[i] - dot) / l[i * n + i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| l[k * n + i] * x[k]).sum();
        x[i] = (x[i] - dot) / l[i * n + i];
    }
    x.iter().all(|value| value.is_finite()).then_some(x)
}

/// Eigenvalues, rising, of a symmetric matrix (row-major, n × n), by cyclic Jacobi rotations.
pub fn eigenvalues(a: &[f64], n: usize) -> Vec<f64> {
    assert_eq!(a.len(), n * n, "a square matrix");
    let mut a = a.to_vec();
    // Quadratic convergence again; a fit has some tens of unknowns at most.
    for _ in 0..12 {
        for p in 0..n {
            for q in p + 1..n {
                jacobi_step(&mut a, n, p, q);
            }
        }
    }
    let mut values: Vec<f64> = (0..n).map(|k| a[k * n + k]).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Zeroes a[p][q] of an n × n matrix by a rotation.
fn jacobi_step(a: &mut [f64], n: usize, p: usize, q: usize) {
    let off = a[p * n + q];
    if off == 0.0 {
        return;
    }
    let theta = (a[q * n + q] - a[p * n + p]) / (2.0 * off);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    for k in 0..n {
        let [x, y] = [a[k * n + p], a[k * n + q]];
        [a[k * n + p], a[k * n + q]] = [c * x - s * y, s * x + c * y];
    }
    for k in 0..n {
        let [x, y] = [a[p * n + k], a[q * n + k]];
        [a[p * n + k], a[q * n + k]] = [c * x - s * y, s * x + c * y];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_are_those_of_the_matrix_down_to_tiny_eigenvalues() {
        let rows = [[2.0, -1.0, 0.5], [1.0, 2.0, 0.3], [-0.4, 0.2, 3.0]];
        for least in [1.0, 1e-3, 1e-8] {
            // S = Σ λ v vᵀ over an orthonormal basis by Gram-Schmidt
            let mut basis: Vec<[f64; 3]> = Vec::new();
            for row in rows {
                let mut v: [f64; 3] = row;
                for b in &basis {
                    let dot: f64 = (0..3).map(|k| v[k] * b[k]).sum();
                    (0..3).for_each(|k| v[k] -= dot * b[k]);
                }
                let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
                basis.push(v.map(|x| x / length));
            }
            let lambdas = [least, 0.5, 2.0];
            let entry = |i: usize, j: usize| (0..3).map(|k| lambdas[k] * basis[k][i] * basis[k][j]).sum::<f64>();
            let s = [entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)];
            let (values, vectors) = eigen_symmetric(s);
            let mut sorted = lambdas;
            sorted.sort_by(f64::total_cmp);
            for k in 0..3 {
                assert!((values[k] - sorted[k]).abs() < 1e-14, "{values:?}");
                let place = lambdas.iter().position(|&l| l == sorted[k]).unwrap();
                let along: f64 = (0..3).map(|i| vectors[k][i] * basis[place][i]).sum();
                assert!((along.abs() - 1.0).abs() < 1e-6);
            }
            assert!((largest_eigenvalue(s) - sorted[2]).abs() < 1e-14);
            let full = [s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]];
            for (a, b) in eigenvalues(&full, 3).iter().zip(sorted) {
                assert!((a - b).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn normal_equations_are_solved_and_indefinite_ones_refused() {
        let a = [4.0, 1.0, 0.5, 1.0, 3.0, -0.2, 0.5, -0.2, 2.0];
        let x = [1.0, -2.0, 0.25];
        let b: Vec<f64> = (0..3).map(|i| (0..3).map(|k| a[i * 3 + k] * x[k]).sum()).collect();
        let found = solve_positive(&a, &b).unwrap();
        (0..3).for_each(|k| assert!((found[k] - x[k]).abs() < 1e-14));
        assert_eq!(solve_positive(&[1.0, 2.0, 2.0, 1.0], &[1.0, 1.0]), None);
    }
}
