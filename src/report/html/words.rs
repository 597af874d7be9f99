//! Numbers and verdicts in words. Numbers have the digits that their intervals warrant, and claims round against us.

use crate::report::equal_time::COMPARED_SAMPLES;
use crate::report::metrics::Interval;
use crate::report::summary::{ModelSummary, WorstCase};
use crate::report::verification::{LevelVerification, Light, Model, View};

/// What stands for a figure that has no value.
pub(super) const NONE: &str = "–";

/// `1 level`, `3 levels`.
pub(super) fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// A name as the beginning of a line.
pub(super) fn capital(name: &str) -> String {
    let mut letters = name.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

/// `image, 45°`.
pub(super) fn case(light: Light, view: View) -> String {
    format!("{}, {}", light.name(), view.name())
}

/// A share in percent with its sign, two digits: `+0.43 %`.
pub(super) fn signed_percent(value: f64) -> String {
    let percent = 100.0 * value;
    format!("{}\u{a0}%", signed(percent, decimals(percent)))
}

/// A relative error in percent with its interval: `+0.43 %` and `+0.31 … +0.55`, with two digits of
/// the interval's reach, at most two decimals.
pub(super) fn percent_interval(interval: Interval) -> [String; 2] {
    let [value, low, high] = [interval.value, interval.low, interval.high].map(|x| 100.0 * x);
    let decimals = decimals(high - low).min(2);
    let [low, value, high] = [low, value, high].map(|x| signed(x, decimals));
    [format!("{value}\u{a0}%"), format!("{low} … {high}")]
}

/// A mean square error: `3.1e-4`.
pub(super) fn error(value: f64) -> String {
    minus(format!("{value:.1e}"))
}

/// A mean square error with its interval.
pub(super) fn error_interval(interval: Interval) -> [String; 2] {
    [error(interval.value), format!("{} … {}", error(interval.low), error(interval.high))]
}

/// A factor, two digits: `0.026`, `1.7`, `38`, `4.2e-4`.
pub(super) fn factor(value: f64) -> String {
    if value.abs() < 1e-3 && value != 0.0 { error(value) } else { format!("{value:.*}", decimals(value)) }
}

/// A round number of a scale, as it is: `0.125`.
pub(super) fn round_number(value: f32) -> String {
    let text = format!("{value:.5}");
    minus(text.trim_end_matches('0').trim_end_matches('.').to_owned())
}

/// A radiance or the like, three digits: `0.123`, `45.6`.
pub(super) fn three_digits(value: f64) -> String {
    minus(format!("{value:.*}", decimals(value) + usize::from(value.abs() < 100.0)))
}

/// CPU seconds.
pub(super) fn seconds(value: f64) -> String {
    format!("{value:.2}")
}

/// `8` or `8.03 × 7.97`.
pub(super) fn pair([u, v]: [f64; 2]) -> String {
    let short = |x: f64| format!("{x:.2}").trim_end_matches('0').trim_end_matches('.').to_owned();
    if u == v { short(u) } else { format!("{} × {}", short(u), short(v)) }
}

/// What a level's figures say, a sentence each.
pub(super) fn verdict(level: &LevelVerification) -> Vec<String> {
    let Some(ours) = level.summary.iter().find(|summary| summary.model == Model::Farfield) else {
        return vec!["The level itself was not compared.".into()];
    };
    [mean_sentence(ours), error_sentence(ours, &level.summary), time_sentence(level)].into_iter().flatten().collect()
}

fn mean_sentence(ours: &ModelSummary) -> Option<String> {
    let within = |worst: WorstCase| format!("within {}", at_most_percent(worst.mean_error.value.abs()));
    match (ours.worst_mean_error_below_75.map(within), ours.worst_mean_error_above_75.map(within)) {
        (Some(below), Some(above)) => Some(format!("Mean {below} of the original below 75°, {above} at 80°.")),
        (Some(below), None) => Some(format!("Mean {below} of the original.")),
        (None, Some(above)) => Some(format!("Mean {above} of the original at 80°.")),
        (None, None) => None,
    }
}

fn error_sentence(ours: &ModelSummary, all: &[ModelSummary]) -> Option<String> {
    let bias = ours.relative_mse_bias?;
    if bias.low <= 0.0 {
        let bound = error(bias.high);
        return Some(format!("No error of the image shows above the noise (relative mean square below {bound})."));
    }
    let others: Vec<String> = [Model::Naive, Model::Leadr, Model::Lobes]
        .iter()
        .filter_map(|&model| all.iter().find(|summary| summary.model == model))
        .filter_map(|other| Some(compared(other.farfield_ratio?, other.model)))
        .collect();
    (!others.is_empty()).then(|| format!("Squared error of the image, noise aside: {}.", others.join(", ")))
}

/// Our error against another's.
fn compared(ratio: f64, other: Model) -> String {
    let other = other.title();
    if ratio < 1.0 {
        format!("{} times less than {other}", factor(1.0 / ratio))
    } else {
        format!("{} times that of {other}", factor(ratio))
    }
}

fn time_sentence(level: &LevelVerification) -> Option<String> {
    let ratio = factor(level.timing.equal_time_ratio?);
    Some(format!(
        "In the time that the original takes for {COMPARED_SAMPLES} samples a pixel, the level leaves {ratio} of its squared \
         error, noise included."
    ))
}

/// A share in percent, rounded up at its second digit: what is claimed as a bound must be one.
fn at_most_percent(value: f64) -> String {
    let percent = 100.0 * value;
    let decimals = decimals(percent);
    let step = 10f64.powi(decimals as i32);
    // What is round already but for the last bits stays as it is; adding 0 turns the −0 of an exact figure into 0.
    format!("{:.decimals$}\u{a0}%", (percent * step - 1e-9).ceil() / step + 0.0)
}

/// Decimals that give a value two digits, at most four.
fn decimals(value: f64) -> usize {
    if value == 0.0 || !value.is_finite() {
        return 0;
    }
    (1 - value.abs().log10().floor() as i32).clamp(0, 4) as usize
}

/// `+0.43`, `−1.2`, `0`.
fn signed(value: f64, decimals: usize) -> String {
    let text = format!("{value:+.decimals$}");
    if text.bytes().any(|b| b.is_ascii_digit() && b != b'0') { minus(text) } else { text[1..].to_owned() }
}

/// A typographic minus in front; that of an exponent stays, so that it can be pasted.
fn minus(text: String) -> String {
    text.strip_prefix('-').map_or(text.clone(), |size| format!("−{size}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_rounded_up() {
        assert_eq!(at_most_percent(0.004301), "0.44\u{a0}%");
        assert_eq!(at_most_percent(0.0043), "0.43\u{a0}%");
        assert_eq!(at_most_percent(0.1201), "13\u{a0}%");
        assert_eq!(at_most_percent(0.0), "0\u{a0}%");
    }

    #[test]
    fn figures_have_the_digits_of_their_interval() {
        let interval = Interval { value: 0.00432, low: 0.00312, high: 0.00552 };
        assert_eq!(percent_interval(interval), ["+0.43\u{a0}%", "+0.31 … +0.55"]);
        let wide = Interval { value: -0.4321, low: -0.55, high: -0.31 };
        assert_eq!(percent_interval(wide), ["−43\u{a0}%", "−55 … −31"]);
        let exact = Interval { value: 0.0, low: 0.0, high: 0.0 };
        assert_eq!(percent_interval(exact), ["0\u{a0}%", "0 … 0"]);
    }

    #[test]
    fn numbers_are_two_digits_and_typographic() {
        assert_eq!([factor(0.0263), factor(1.71), factor(38.4), factor(4.2e-4)], ["0.026", "1.7", "38", "4.2e-4"]);
        assert_eq!([round_number(0.2 / 4.0), round_number(-100.0), round_number(0.0)], ["0.05", "−100", "0"]);
        assert_eq!([error(3.14e-4), error(-3.14e-4)], ["3.1e-4", "−3.1e-4"]);
        assert_eq!([signed_percent(-0.0123), signed_percent(0.5)], ["−1.2\u{a0}%", "+50\u{a0}%"]);
        assert_eq!([three_digits(0.12345), three_digits(45.67), three_digits(1234.5)], ["0.123", "45.7", "1234"]);
        assert_eq!([pair([8.0, 8.0]), pair([8.0, 8.031])], ["8", "8 × 8.03"]);
    }
}
