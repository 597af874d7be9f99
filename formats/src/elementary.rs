//! Elementary functions out of plain arithmetic: the same bits on every machine, which those of a platform's
//! mathematics library are not. [`crate::cell_brdf::exp_neg`] is their sister.

use crate::cell_brdf::exp_neg;

/// (4/π)·atan(x) for |x| <= 1, within 2e-7; exactly ±1 for ±1.
///
/// An odd polynomial through nine Chebyshev points of x², one of them moved to 1.
#[inline(always)]
pub(crate) fn atan_in_octants(x: f32) -> f32 {
    let z = x * x;
    // Pairs instead of one long chain: every step of a chain waits for the one before.
    let (z2, z4) = (z * z, z * z * z * z);
    let low = (1.273_239_5 - 4.244_073_3e-1 * z) + z2 * (2.545_021_8e-1 - 1.804_421_7e-1 * z);
    let high = (1.339_266_8e-1 - 9.227_586_5e-2 * z) + z2 * (5.054_012_3e-2 - 1.813_651_3e-2 * z);
    x * (low + z4 * (high + z4 * 3.053_405_3e-3))
}

/// 1 − e^(−x) for x >= 0, with a relative error under 1e-6 down to 0.
#[inline(always)]
pub(crate) fn one_minus_exp_neg(x: f32) -> f32 {
    // The difference cancels for small x; the series is 3e-9 off at ¼.
    let series = x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x * (1.0 / 720.0))))));
    if x < 0.25 { series } else { 1.0 - exp_neg(-x) }
}

/// ln x for normal x > 0, with a relative error under 2e-7, near x = 1 too (Cephes' `logf`).
#[inline]
pub(crate) fn ln(x: f32) -> f32 {
    debug_assert!(x >= f32::MIN_POSITIVE, "ln of {x}");
    // x = 2^exponent · (1 + f) with 1 + f in [√½, √2)
    const SQRT_HALF: u32 = 0x3f35_04f3;
    let shifted = x.to_bits().wrapping_sub(SQRT_HALF);
    let exponent = ((shifted as i32) >> 23) as f32;
    let f = f32::from_bits((shifted & 0x007f_ffff) + SQRT_HALF) - 1.0;
    let z = f * f;
    let p = 7.037_683_6e-2_f32;
    let p = p * f - 1.151_461e-1;
    let p = p * f + 1.167_699_9e-1;
    let p = p * f - 1.242_014_1e-1;
    let p = p * f + 1.424_932_3e-1;
    let p = p * f - 1.666_805_8e-1;
    let p = p * f + 2.000_071_5e-1;
    let p = p * f - 2.499_999_4e-1;
    let p = p * f + 3.333_333e-1;
    // ln 2 in two parts, the first of few bits: its products with exponents are exact.
    let small = f * z * p - 2.121_944_4e-4 * exponent - 0.5 * z;
    small + f + 0.693_359_4 * exponent
}

/// (sin, cos) of `turns`·2π for `turns` ∈ [0, 1], within 2e-7 (Cephes' `sinf` and `cosf`).
#[inline]
pub(crate) fn sin_cos_turns(turns: f32) -> [f32; 2] {
    debug_assert!((0.0..=1.0).contains(&turns), "{turns} turns");
    let quarters = turns * 4.0;
    let nearest = (quarters + 0.5) as u32;
    let x = (quarters - nearest as f32) * std::f32::consts::FRAC_PI_2;
    let z = x * x;
    let sin = x + x * z * (-1.666_665_5e-1 + z * (8.332_161e-3 - z * 1.951_529_6e-4));
    let cos = 1.0 - 0.5 * z + z * z * (4.166_664_6e-2 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5));
    match nearest & 3 {
        0 => [sin, cos],
        1 => [cos, -sin],
        2 => [-sin, -cos],
        _ => [-cos, sin],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fractions of [0, 1] that hit both ends.
    fn fractions() -> impl Iterator<Item = f32> {
        (0..=100_000).map(|k| k as f32 / 100_000.0)
    }

    #[test]
    fn arc_tangents_are_right_and_odd() {
        assert_eq!([atan_in_octants(1.0), atan_in_octants(-1.0), atan_in_octants(0.0)], [1.0, -1.0, 0.0]);
        for x in fractions() {
            let exact = f64::from(x).atan() / std::f64::consts::FRAC_PI_4;
            assert!((f64::from(atan_in_octants(x)) - exact).abs() < 2e-7, "{x}");
            assert_eq!(atan_in_octants(-x), -atan_in_octants(x));
        }
    }

    #[test]
    fn what_exponentials_lack_of_one_keeps_its_digits() {
        for x in (0..=2000).map(|k| 10f32.powf(k as f32 / 200.0 - 8.0)) {
            let exact = -(-f64::from(x)).exp_m1();
            // a difference of numbers near 1 above ¼: 1e-7 of rounding over 0.22, and `exp_neg`'s own 3e-7
            assert!((f64::from(one_minus_exp_neg(x)) / exact - 1.0).abs() < 1.5e-6, "{x}");
        }
        assert_eq!(one_minus_exp_neg(0.0), 0.0);
    }

    #[test]
    fn logarithms_are_right_also_near_one() {
        let wide = (0..=4000).map(|k| 10f32.powf(k as f32 / 100.0 - 36.0));
        let near = fractions().filter(|&x| x > 0.5);
        let last = (1..100).map(|k| 1.0 - k as f32 / (1u32 << 24) as f32);
        for x in wide.chain(near).chain(last) {
            let exact = f64::from(x).ln();
            assert!((f64::from(ln(x)) - exact).abs() <= 2e-7 * exact.abs(), "ln {x} = {}, wanted {exact}", ln(x));
        }
    }

    #[test]
    fn sines_and_cosines_are_right_over_a_turn() {
        for turns in fractions() {
            let [sin, cos] = sin_cos_turns(turns);
            let exact = (f64::from(turns) * std::f64::consts::TAU).sin_cos();
            assert!((f64::from(sin) - exact.0).abs() < 2e-7 && (f64::from(cos) - exact.1).abs() < 2e-7, "{turns}");
        }
    }
}
