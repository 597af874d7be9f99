//! One false-alarm budget for the whole suite, and the p-values that it is spent on.

use farfield::math::gaussian;

/// Chance that a suite without a fault fails; seeds are fixed, so it fails once and for all or never.
const FALSE_ALARMS: f64 = 0.01;

/// The p-value under which a test fails, by Šidák: 1 − (1 − budget)^(1/tests).
pub(crate) fn threshold() -> f64 {
    let tests = crate::brdfs::test_count() + crate::leadr::test_count() + crate::sggx::test_count();
    1.0 - (1.0 - FALSE_ALARMS).powf(1.0 / tests as f64)
}

/// Chance of a normal deviate to lie `deviations` or further out, on either side.
pub(crate) fn two_sided(deviations: f64) -> f64 {
    gaussian::erfc(deviations.abs() / 2f64.sqrt())
}

/// Chance of a chi-square value or a larger one: the regularised upper incomplete gamma function Q(freedom/2, value/2).
pub(crate) fn chi_square_tail(value: f64, freedom: usize) -> f64 {
    let (a, x) = (0.5 * freedom as f64, 0.5 * value);
    if x <= 0.0 {
        return 1.0;
    }
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        // P by its series: x^a e^−x/Γ(a) Σ x^n/(a (a + 1) … (a + n)).
        let (mut term, mut sum) = (1.0 / a, 1.0 / a);
        for n in 1..10_000 {
            term *= x / (a + f64::from(n));
            sum += term;
            if term < 1e-15 * sum {
                break;
            }
        }
        return 1.0 - front * sum;
    }
    // Q by its continued fraction, from the back: 1/(x + 1 − a − 1(1 − a)/(x + 3 − a − 2(2 − a)/(x + 5 − a − …))).
    let terms = (1..=2000).rev().map(f64::from);
    let tail = terms.fold(0.0, |tail, n| n * (n - a) / (x + 2.0 * n + 1.0 - a - tail));
    front / (x + 1.0 - a - tail)
}

/// ln Γ(a) for a >= 1/2: Stirling's series, after shifting a above 15.
fn ln_gamma(a: f64) -> f64 {
    let mut shift = 0.0;
    let mut z = a;
    while z < 15.0 {
        shift += z.ln();
        z += 1.0;
    }
    let series = 1.0 / (12.0 * z) - 1.0 / (360.0 * z.powi(3)) + 1.0 / (1260.0 * z.powi(5));
    (z - 0.5) * z.ln() - z + 0.5 * std::f64::consts::TAU.ln() + series - shift
}

#[test]
fn tails_are_those_of_the_tables() {
    for (value, freedom, tail) in [
        (3.841_459, 1, 0.05),
        (6.634_897, 1, 0.01),
        (18.307_038, 10, 0.05),
        (2.558_212, 10, 0.99),
        (140.169, 100, 0.005),
    ] {
        assert!((chi_square_tail(value, freedom) / tail - 1.0).abs() < 1e-4, "{value} with {freedom}");
    }
    // Two degrees are an exponential distribution, far out as well.
    assert!((chi_square_tail(60.0, 2) / (-30.0f64).exp() - 1.0).abs() < 1e-9);
    assert!((two_sided(1.959_964) - 0.05).abs() < 1e-6);
}
