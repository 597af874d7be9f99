//! Error against time: how much error the level leaves in the time that the original takes for an image.

use serde::Serialize;

use super::verification::{Light, View};

/// Samples a pixel of the original whose time is given to the level, too.
pub const COMPARED_SAMPLES: u32 = 64;

/// Original and level at increasing sample counts, of one light and view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EqualTime {
    /// The light.
    pub light: Light,
    /// The view.
    pub view: View,
    /// φ, the root of a pixel's footprint on the base surface in source texels.
    pub footprint_texels: f64,
    /// Samples a pixel of the reference, both halves.
    pub reference_samples: u32,
    /// What was rendered, by increasing sample count.
    pub points: Vec<EqualTimePoint>,
    /// What depends on the machine.
    pub timing: EqualTimeTiming,
}

/// Relative mean square error of two images with the same number of samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EqualTimePoint {
    /// Samples a pixel.
    pub samples: u32,
    /// Of the original, its noise. As the reference's noise is taken out, it may fall to 0 and below by chance.
    pub mse_full: f64,
    /// Of the level, noise and bias.
    pub mse_farfield: f64,
}

/// CPU seconds of the points and what follows from them.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct EqualTimeTiming {
    /// Of the original, a point each.
    pub full_cpu_seconds: Vec<f64>,
    /// Of the level, a point each.
    pub farfield_cpu_seconds: Vec<f64>,
    /// Both at the time of [`COMPARED_SAMPLES`]; `None` where the curves do not reach it.
    pub at_equal_time: Option<AtEqualTime>,
}

/// Both curves at one time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AtEqualTime {
    /// Samples a pixel that the original takes.
    pub samples: u32,
    /// CPU seconds that they take.
    pub cpu_seconds: f64,
    /// Error of the original.
    pub mse_full: f64,
    /// Error of the level, interpolated.
    pub mse_farfield: f64,
    /// `mse_farfield` / `mse_full`.
    pub ratio: f64,
}

/// The equal-time comparisons of a level taken together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LevelTiming {
    /// Geometric mean of the ratios; `None` without any.
    pub equal_time_ratio: Option<f64>,
}

impl EqualTime {
    /// The comparison of these points at a footprint of so many texels, timed as given: CPU seconds of original and level, a point each.
    pub fn timed(
        case: (Light, View),
        footprint_texels: f64,
        reference_samples: u32,
        points: Vec<EqualTimePoint>,
        seconds: [Vec<f64>; 2],
    ) -> Self {
        let [full_cpu_seconds, farfield_cpu_seconds] = seconds;
        assert!(full_cpu_seconds.len() == points.len() && farfield_cpu_seconds.len() == points.len(), "a time a point");
        let at_equal_time = at_equal_time(&points, &full_cpu_seconds, &farfield_cpu_seconds);
        let timing = EqualTimeTiming { full_cpu_seconds, farfield_cpu_seconds, at_equal_time };
        Self { light: case.0, view: case.1, footprint_texels, reference_samples, points, timing }
    }
}

impl LevelTiming {
    /// The verdict of all comparisons that reached their time.
    pub fn of(comparisons: &[EqualTime]) -> Self {
        let ratios = comparisons.iter().filter_map(|c| c.timing.at_equal_time).map(|at| at.ratio);
        Self { equal_time_ratio: geometric_mean(&ratios.collect::<Vec<_>>()) }
    }
}

/// Geometric mean of numbers above 0.
fn geometric_mean(values: &[f64]) -> Option<f64> {
    let logs: f64 = values.iter().map(|value| value.ln()).sum();
    (!values.is_empty()).then(|| (logs / values.len() as f64).exp())
}

/// Both curves at the time in which the original takes [`COMPARED_SAMPLES`].
fn at_equal_time(points: &[EqualTimePoint], full: &[f64], farfield: &[f64]) -> Option<AtEqualTime> {
    let at = points.iter().position(|point| point.samples == COMPARED_SAMPLES)?;
    let [cpu_seconds, mse_full] = [full[at], points[at].mse_full];
    let errors: Vec<f64> = points.iter().map(|point| point.mse_farfield).collect();
    let mse_farfield = log_log(farfield, &errors, cpu_seconds)?;
    (mse_full > 0.0).then(|| AtEqualTime {
        samples: COMPARED_SAMPLES,
        cpu_seconds,
        mse_full,
        mse_farfield,
        ratio: mse_farfield / mse_full,
    })
}

/// The curve through (`x`, `y`) at `at`, linear in both logarithms; `None` outside of it or where it is not above 0.
///
/// Noise falls as 1/x, a straight line there. Nothing is extrapolated: a bias would make any slope wrong.
fn log_log(x: &[f64], y: &[f64], at: f64) -> Option<f64> {
    let segment = (1..x.len()).find(|&i| x[i - 1] <= at && at <= x[i])?;
    let [x0, x1, y0, y1, at] = [x[segment - 1], x[segment], y[segment - 1], y[segment], at];
    if x0 <= 0.0 || y0 <= 0.0 || y1 <= 0.0 {
        return None;
    }
    // Two points of one time: the later one, of more samples.
    let weight = if x1 > x0 { (at / x0).ln() / (x1 / x0).ln() } else { 1.0 };
    Some((y0.ln() + weight * (y1 / y0).ln()).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Curves with variance 1 and 1/4 a sample, no bias, the level taking `cost` times the original's time.
    fn comparison(cost: f64) -> EqualTime {
        let counts = [4, 16, 64, 256, 1024];
        let point = |samples: u32| {
            let noise = 1.0 / f64::from(samples);
            EqualTimePoint { samples, mse_full: noise, mse_farfield: 0.25 * noise }
        };
        let full: Vec<f64> = counts.iter().map(|&n| 0.01 * f64::from(n)).collect();
        let farfield = full.iter().map(|t| cost * t).collect();
        EqualTime::timed((Light::Area, View::Normal), 64.0, 8192, counts.map(point).to_vec(), [full, farfield])
    }

    #[test]
    fn the_ratio_is_that_of_variance_times_cost() {
        for cost in [0.1, 1.0, 1.7] {
            let at = comparison(cost).timing.at_equal_time.unwrap();
            assert!((at.ratio - 0.25 * cost).abs() < 1e-12, "{cost}: {}", at.ratio);
            assert_eq!((at.samples, at.cpu_seconds), (64, 0.64));
        }
    }

    #[test]
    fn a_level_too_slow_or_too_fast_for_its_curve_has_no_ratio() {
        assert_eq!(comparison(20.0).timing.at_equal_time, None);
        assert_eq!(comparison(0.01).timing.at_equal_time, None);
    }

    #[test]
    fn ratios_of_a_level_have_a_geometric_mean() {
        let timing = LevelTiming::of(&[comparison(0.4), comparison(1.6), comparison(20.0)]);
        assert!((timing.equal_time_ratio.unwrap() - 0.2).abs() < 1e-12);
        assert_eq!(LevelTiming::of(&[]), LevelTiming::default());
    }

    #[test]
    fn an_error_that_chance_took_below_zero_has_no_logarithm() {
        assert_eq!(log_log(&[1.0, 2.0], &[1e-6, -1e-9], 1.5), None);
        assert_eq!(log_log(&[1.0, 1.0], &[4.0, 2.0], 1.0), Some(2.0));
    }
}
