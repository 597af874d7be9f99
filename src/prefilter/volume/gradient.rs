//! Stochastic gradient descent with gradients of fresh walks (\[WU19\] 3.18 to 3.20), preconditioned.
//!
//! Means and derivatives of an iteration come of two independent halves, so that their product is an unbiased gradient of
//! (3.16). Steps are preconditioned by a running mean of JᵀJ, which makes one step size fit all unknowns. Its diagonal alone is
//! not enough where clusters are seen through each other (`mixed` at 4×: a third of the gap was left after 90 steps).

use super::levenberg::{Linearised, PULL};
use crate::math::linear::solve_positive;

/// Iterations, and those over which the result is averaged: the last third.
const ITERATIONS: usize = 90;
const AVERAGED: usize = 30;
/// δ_t = FIRST·HALVED/(t + HALVED), \[WU19\] (3.20).
const FIRST: f64 = 0.7;
const HALVED: f64 = 15.0;
/// Weight of the past in the mean of JᵀJ.
const MEMORY: f64 = 0.8;
/// Added to the diagonal over itself: noise of a direction that is hardly seen must not look like knowledge.
const RIDGE: f64 = 1e-3;
/// Longest step of a logarithm.
const LONGEST: f64 = 0.3;

/// Minimises Σ residual² + pull from `start`; `halves(x, t)` gives two independent estimates of iteration `t` at `x`.
pub(super) fn minimise(start: &[f64], halves: impl Fn(&[f64], usize) -> [Linearised; 2]) -> Vec<f64> {
    let n = start.len();
    let mut unknowns = start.to_vec();
    let mut curvature = vec![0.0; n * n];
    let mut average = vec![0.0; n];
    for t in 0..ITERATIONS {
        let halves = halves(&unknowns, t);
        let pull = PULL * halves[0].residuals.len() as f64;
        let mut slope: Vec<f64> = unknowns.iter().map(|x| pull * x).collect();
        let mut products = vec![0.0; n * n];
        for [a, b] in [[&halves[0], &halves[1]], [&halves[1], &halves[0]]] {
            for row in 0..a.residuals.len() {
                for i in 0..n {
                    slope[i] += 0.5 * a.residuals[row] * b.jacobian[row][i];
                    // JᵀJ of one half: noise makes it larger, and the step more careful.
                    (0..n).for_each(|j| products[i * n + j] += 0.5 * a.jacobian[row][i] * a.jacobian[row][j]);
                }
            }
        }
        // An exponential mean that starts at its first value.
        let memory = MEMORY.min(t as f64 / (t as f64 + 1.0));
        curvature.iter_mut().zip(&products).for_each(|(mean, new)| *mean = memory * *mean + (1.0 - memory) * new);
        let mut damped = curvature.clone();
        (0..n).for_each(|i| damped[i * n + i] += pull + RIDGE * damped[i * n + i]);
        let Some(direction) = solve_positive(&damped, &slope) else { continue };
        let step = FIRST * HALVED / (t as f64 + HALVED);
        for (x, dx) in unknowns.iter_mut().zip(direction) {
            *x -= (step * dx).clamp(-LONGEST, LONGEST);
        }
        if t >= ITERATIONS - AVERAGED {
            (0..n).for_each(|i| average[i] += unknowns[i] / AVERAGED as f64);
        }
    }
    average
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Stream;

    #[test]
    fn noisy_halves_lead_to_the_minimum_that_is_there_without_noise() {
        // r = (e^x₀ − 0.5, 4(e^x₁ − 2)), with 5 % of noise in residuals and derivatives
        let halves = |x: &[f64], t: usize| {
            [0, 1].map(|half| {
                let rng = Stream::new(half, t as u64);
                let noise = |k| 0.05 * (f64::from(rng.uniform(k)) - 0.5);
                let [a, b] = [x[0].exp(), x[1].exp()];
                Linearised {
                    residuals: vec![a - 0.5 + noise(0), 4.0 * (b - 2.0 + noise(1))],
                    jacobian: vec![vec![a * (1.0 + noise(2)), 0.0], vec![0.0, 4.0 * b * (1.0 + noise(3))]],
                }
            })
        };
        let found = minimise(&[0.0, 0.0], halves);
        assert!((found[0] - 0.5_f64.ln()).abs() < 0.02 && (found[1] - 2_f64.ln()).abs() < 0.02, "{found:?}");
    }
}
