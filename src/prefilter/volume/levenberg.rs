//! Levenberg-Marquardt on a function of the logarithms of weights.
//!
//! The function comes as an argument: recorded walks in the compiler, a formula in the tests.

use crate::math::linear::{eigenvalues, solve_positive};

/// Residuals and their Jacobian, `[row][unknown]`.
pub(super) struct Linearised {
    /// Weighed differences.
    pub(super) residuals: Vec<f64>,
    /// Derivatives of these.
    pub(super) jacobian: Vec<Vec<f64>>,
}

/// Pull of the logarithms towards 0 over the number of rows: what the data does not say (the gauge of w and s, lobes that
/// no walk meets) stays at 1. A weight of ½ costs 5e-5 of an image's squared error.
pub(super) const PULL: f64 = 1e-4;

/// Steps at most, damping at first, its change after a good and a bad step.
const STEPS: usize = 30;
const DAMPING: f64 = 1e-3;
const EASIER: f64 = 0.2;
const HARDER: f64 = 5.0;
/// Longest step of a logarithm: a factor of two.
const LONGEST: f64 = std::f64::consts::LN_2;
/// Change of the objective over itself at which a fit has converged.
const CONVERGED: f64 = 1e-6;

/// Where a fit ended.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Fit {
    /// The logarithms of the weights.
    pub(super) unknowns: Vec<f64>,
    /// Eigenvalues of JᵀJ there, rising: directions that the data says nothing of are near 0.
    pub(super) eigenvalues: Vec<f64>,
}

/// Minimises Σ residual² + pull from `start`, within a factor of `radius` (a logarithm) of it in every unknown.
pub(super) fn minimise(start: &[f64], radius: f64, linearise: impl Fn(&[f64]) -> Linearised) -> Fit {
    let mut unknowns = start.to_vec();
    let mut here = linearise(&unknowns);
    let pull = PULL * here.residuals.len() as f64;
    let cost = |at: &[f64], residuals: &[f64]| {
        let sum = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>();
        sum(residuals) + pull * sum(at)
    };
    let mut best = cost(&unknowns, &here.residuals);
    let mut damping = DAMPING;
    for _ in 0..STEPS {
        let Some(step) = damped_step(&unknowns, &here, pull, damping) else { break };
        let next: Vec<f64> = unknowns
            .iter()
            .zip(&step)
            .zip(start)
            .map(|((x, dx), x0)| (x + dx.clamp(-LONGEST, LONGEST)).clamp(x0 - radius, x0 + radius))
            .collect();
        let there = linearise(&next);
        let cost = cost(&next, &there.residuals);
        if cost > best || !cost.is_finite() {
            damping *= HARDER;
            continue;
        }
        let gain = best - cost;
        (unknowns, here, best) = (next, there, cost);
        damping *= EASIER;
        if gain <= CONVERGED * best {
            break;
        }
    }
    let eigenvalues = eigenvalues(&normal_matrix(&here, unknowns.len()), unknowns.len());
    Fit { unknowns, eigenvalues }
}

/// JᵀJ of `n` unknowns, row-major; 0 where no row is.
fn normal_matrix(here: &Linearised, n: usize) -> Vec<f64> {
    let mut a = vec![0.0; n * n];
    for row in &here.jacobian {
        for i in 0..n {
            (0..n).for_each(|j| a[i * n + j] += row[i] * row[j]);
        }
    }
    a
}

/// −(JᵀJ + pull + damping·diag)⁻¹ (Jᵀr + pull·x).
fn damped_step(unknowns: &[f64], here: &Linearised, pull: f64, damping: f64) -> Option<Vec<f64>> {
    let n = unknowns.len();
    let mut a = normal_matrix(here, n);
    let mut slope: Vec<f64> = unknowns.iter().map(|x| -pull * x).collect();
    for (row, residual) in here.jacobian.iter().zip(&here.residuals) {
        (0..n).for_each(|i| slope[i] -= row[i] * residual);
    }
    (0..n).for_each(|i| a[i * n + i] += pull + damping * (a[i * n + i] + pull));
    solve_positive(&a, &slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nonlinear_minimum_is_found_from_afar_and_what_the_data_leaves_open_stays() {
        // r_i = exp(x₀ + x₁)·t_i − 0.3·t_i: only the sum of the unknowns is known
        let linearise = |x: &[f64]| {
            let value = (x[0] + x[1]).exp();
            let rows = (1..50).map(|i| f64::from(i) / 10.0);
            Linearised {
                residuals: rows.clone().map(|t| (value - 0.3) * t).collect(),
                jacobian: rows.map(|t| vec![value * t, value * t]).collect(),
            }
        };
        let fit = minimise(&[0.0, 0.0], 3.0, linearise);
        // the pull of 49e-4 against 400 · 0.3²: 1e-4 of the way
        assert!((fit.unknowns[0] + fit.unknowns[1] - 0.3_f64.ln()).abs() < 1e-3, "{fit:?}");
        assert!((fit.unknowns[0] - fit.unknowns[1]).abs() < 1e-6);
        assert!(fit.eigenvalues[0] < 1e-9 * fit.eigenvalues[1]);
        let near = minimise(&[0.0, 0.0], 0.1, linearise);
        assert!(near.unknowns.iter().all(|x| (x + 0.1).abs() < 1e-12), "the region of trust is kept: {near:?}");
    }
}
