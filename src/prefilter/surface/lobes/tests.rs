use super::mixture::{Lobe, Mixture, exp_neg};
use super::*;
use crate::geometry::Boundary;
use glam::DVec3;

/// Rolling noise with detail down to the texel, a function of the vertex alone.
fn noise(size: [usize; 2], amplitude: f32) -> HeightField {
    let hash = |k: usize| ((k as u32).wrapping_mul(2_654_435_761).wrapping_add(12_345) >> 8) as f32 / (1 << 24) as f32;
    let height = |k: usize| {
        let [x, y] = [(k % size[0]) as f32, (k / size[0]) as f32];
        amplitude * (3.0 * (0.3 * x + 0.1 * y).sin() + 2.0 * (0.5 * y).cos() + 0.7 * hash(k))
    };
    HeightField::new((0..size[0] * size[1]).map(height).collect(), size, [1.0, 1.0], Boundary::Repeat)
}

/// The micro-normals of some cells of 8 × 8 texels.
fn some_cells() -> Vec<MicroNormals> {
    let fine = noise([128, 128], 0.5);
    let footprints = Footprints::new(&fine, [16, 16]);
    let gather = |k: usize| {
        let mut samples = MicroNormals::default();
        footprints.gather([k * 5 % 16, k * 3 % 16], &mut samples);
        samples
    };
    (0..12).map(gather).collect()
}

/// ln of weight times density of each lobe at a normal, in f64 and in none of the kernel's forms but that for e^x.
fn log_densities(normal: [f32; 3], lobes: &[Lobe]) -> Vec<f64> {
    let log = |l: &Lobe| {
        let kappa = f64::from(l.kappa);
        let peak = kappa / (2.0 * std::f64::consts::PI * -(-2.0 * kappa).exp_m1());
        let t = 0.5 * (DVec3::from_array(normal.map(f64::from)) - l.mean.as_dvec3()).length_squared();
        (f64::from(l.weight) * peak).ln() - kappa * t
    };
    lobes.iter().map(log).collect()
}

/// Mean log-likelihood of the samples under the mixture.
fn log_likelihood(samples: &MicroNormals, lobes: &[Lobe]) -> f64 {
    let total: f64 = lobes.iter().map(|l| f64::from(l.weight)).sum();
    let [mut sum, mut mass] = [0.0; 2];
    for k in 0..samples.len() {
        let (n, w) = samples.get(k);
        let logs = log_densities(n, lobes);
        let top = logs.iter().copied().fold(f64::MIN, f64::max);
        sum += f64::from(w) * (top + logs.iter().map(|log| (log - top).exp()).sum::<f64>().ln() - total.ln());
        mass += f64::from(w);
    }
    sum / mass
}

#[test]
fn the_exponential_is_exact_to_rounding() {
    for k in 0..200_000 {
        let x = -(k as f32) * 4.3e-4;
        let exact = f64::from(x).exp();
        // The argument times log₂e is rounded: 87 · 2^−24 relative at the far end.
        assert!((f64::from(exp_neg(x)) / exact - 1.0).abs() < 2e-7 + 1.2e-7 * f64::from(-x), "{x}");
    }
    assert!(exp_neg(-1e30) > 0.0 && exp_neg(-1e30) < 2e-38);
}

#[test]
fn one_iteration_is_that_of_the_textbook() {
    for mut samples in some_cells() {
        let before = start::split(&mut samples, 4);
        // Shares, then mean normal and weight of each lobe, then its concentration from 1 − |S̄|.
        let mut sums = [DVec3::ZERO; 4];
        let mut weights = [0.0; 4];
        for k in 0..samples.len() {
            let (n, w) = samples.get(k);
            let logs = log_densities(n, &before.lobes);
            let total: f64 = logs.iter().map(|log| log.exp()).sum();
            for (j, log) in logs.iter().enumerate() {
                let share = f64::from(w) * log.exp() / total;
                weights[j] += share;
                sums[j] += share * DVec3::from_array(n.map(f64::from));
            }
        }
        let mut after = Mixture { lobes: before.lobes.clone() };
        after.iterate(&samples);
        for (j, lobe) in after.lobes.iter().enumerate() {
            let mean = sums[j] / weights[j];
            let r = mean.length();
            assert!((lobe.mean.as_dvec3() - mean / r).length() < 2e-6);
            assert!((f64::from(lobe.weight) / weights[j] - 1.0).abs() < 1e-5);
            let found = f64::from(crate::math::vmf::one_minus_resultant(lobe.kappa));
            assert!((found - (1.0 - r)).abs() < 1e-6 + 1e-4 * (1.0 - r), "{found} {}", 1.0 - r);
        }
    }
}

#[test]
fn the_likelihood_never_falls() {
    for mut samples in some_cells() {
        for count in [1, 2, 4, 8] {
            let mut mixture = start::split(&mut samples, count);
            let mut last = log_likelihood(&samples, &mixture.lobes);
            for iteration in 0..20 {
                mixture.iterate(&samples);
                let next = log_likelihood(&samples, &mixture.lobes);
                // f32 moments.
                assert!(next > last - 1e-5, "{count} lobes, iteration {iteration}: {last} to {next}");
                last = next;
            }
        }
    }
}

#[test]
fn four_iterations_come_near_the_best_of_many_restarts() {
    for (count, margin) in [(1, 1e-4), (2, 0.1), (4, 0.15), (6, 0.2)] {
        let cells = some_cells();
        let mut short = 0.0;
        for mut samples in cells {
            let best = (0..60).map(|seed| restart(&samples, count, seed)).fold(f64::MIN, f64::max);
            let mut mixture = start::split(&mut samples, count);
            mixture.refine(&samples);
            short += (best - log_likelihood(&samples, &mixture.lobes)) / 12.0;
        }
        // In nats a normal, mean over the cells; the best overfits: a lobe of 8 × 8 texels may sit on one of them.
        assert!(short < margin, "{count} lobes: {short} below the best");
    }
}

/// Likelihood after 60 iterations from lobes around random normals of the cell.
fn restart(samples: &MicroNormals, count: usize, seed: u32) -> f64 {
    let lobe = |j: usize| {
        let k = (seed * 37 + j as u32 * 101 + 11).wrapping_mul(2_654_435_761) as usize >> 8;
        Lobe { weight: 1.0, mean: samples.get(k % samples.len()).0.into(), kappa: 20.0 }
    };
    let mut mixture = Mixture { lobes: (0..count).map(lobe).collect() };
    (0..60).for_each(|_| mixture.iterate(samples));
    log_likelihood(samples, &mixture.lobes)
}

#[test]
fn samples_carry_the_area_and_the_slopes_of_their_cell() {
    let fine = noise([30, 23], 2.0);
    let footprints = Footprints::new(&fine, [7, 4]);
    let mut samples = MicroNormals::default();
    let mut micro_area = 0.0;
    for cell in 0..28 {
        footprints.gather([cell % 7, cell / 7], &mut samples);
        let sum = |component: &[f32]| -> f64 {
            component.iter().zip(&samples.weight).map(|(&c, &w)| f64::from(c) * f64::from(w)).sum()
        };
        assert!((sum(&samples.z) - 1.0).abs() < 1e-6);
        assert!((0..samples.len()).all(|k| (glam::Vec3::from(samples.get(k).0).length() - 1.0).abs() < 1e-6));
        micro_area += samples.weight.iter().map(|&w| f64::from(w)).sum::<f64>() / 28.0;
    }
    // Against 20 × 20 points a texel.
    let mut direct = 0.0;
    for k in 0..30 * 23 * 400 {
        let [texel, point] = [k / 400, k % 400];
        let at = [(point % 20) as f32 / 20.0 + 0.025, (point / 20) as f32 / 20.0 + 0.025];
        let [du, dv] = fine.slope(texel % 30, texel / 30, at[0], at[1]);
        direct += f64::from((1.0 + du * du + dv * dv).sqrt()) / (30.0 * 23.0 * 400.0);
    }
    // One or four points a texel against 400: curvature within texels.
    assert!((micro_area / direct - 1.0).abs() < 0.01, "{micro_area} {direct}");
}
