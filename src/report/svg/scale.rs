//! Axes: where a value lies, and which values are named.

/// How values are spread along an axis.
#[derive(Clone, Debug, PartialEq)]
pub enum Scale {
    /// By their logarithm; values at 0 and below have no place.
    Log,
    /// By asinh(value / linear): linear well below `linear`, logarithmic on both sides well above it, 0 in the middle.
    Symmetric {
        /// Where the one becomes the other.
        linear: f64,
    },
    /// The number of a category, from 0; values between two lie between them.
    Categories(Vec<String>),
}

/// One axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What is measured, and its unit.
    pub label: String,
    scale: Scale,
    /// Values at both ends, the first below the second and both with a place on the scale.
    range: [f64; 2],
}

/// Least distance of two named values, as a share of the axis: a line of text on a plot of ten.
const TICK_DISTANCE: f64 = 0.07;

impl Axis {
    /// An axis that holds all `values` which have a place on its scale, with a little room at both ends.
    ///
    /// A symmetric axis always holds 0.
    pub fn covering(label: &str, scale: Scale, values: impl IntoIterator<Item = f64>) -> Self {
        let placed = values.into_iter().filter_map(|value| scale.place(value)).filter(|place| place.is_finite());
        let [low, high] = placed.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)]);
        let [low, high] = match &scale {
            Scale::Categories(names) => [-0.5, names.len() as f64 - 0.5],
            Scale::Symmetric { .. } => [low.min(-1.0), high.max(1.0)],
            // An axis without values has a decade, so that it is one.
            Scale::Log if low > high => [-0.5, 0.5],
            // Less than half a decade would name no power of ten.
            Scale::Log => [low.min((low + high) / 2.0 - 0.25), high.max((low + high) / 2.0 + 0.25)],
        };
        let room = if matches!(scale, Scale::Categories(_)) { 0.0 } else { 0.06 * (high - low) };
        let range = [scale.value(low - room), scale.value(high + room)];
        Self { label: label.to_owned(), scale, range }
    }

    /// Where a value lies between the ends of the axis, 0 to 1; `None` if it does not.
    pub fn place(&self, value: f64) -> Option<f64> {
        let [low, high] = self.range.map(|end| self.scale.place(end).expect("the ends have a place"));
        let fraction = (self.scale.place(value)? - low) / (high - low);
        // The ends themselves may be off by rounding.
        (-1e-9..=1.0 + 1e-9).contains(&fraction).then_some(fraction)
    }

    /// The values that are named, with their names, in increasing order.
    pub fn ticks(&self) -> Vec<(f64, String)> {
        let candidates = match &self.scale {
            Scale::Categories(names) => return names.iter().enumerate().map(|(i, n)| (i as f64, n.clone())).collect(),
            Scale::Log => self.decades(),
            Scale::Symmetric { linear } => symmetric(*linear),
        };
        let mut named: Vec<(f64, f64)> = Vec::new();
        for value in candidates {
            let place = self.place(value);
            let is_free = |place: f64| named.iter().all(|&(_, other)| (place - other).abs() >= TICK_DISTANCE);
            if let Some(place) = place.filter(|&place| is_free(place)) {
                named.push((value, place));
            }
        }
        named.sort_by(|a, b| a.0.total_cmp(&b.0));
        named.into_iter().map(|(value, _)| (value, number(value))).collect()
    }

    /// Whether values are categories.
    pub fn is_of_categories(&self) -> bool {
        matches!(self.scale, Scale::Categories(_))
    }

    /// Powers of ten; where there are fewer than three, their doubles and halves as well, powers first.
    fn decades(&self) -> Vec<f64> {
        let [first, last] = self.range.map(|end| end.log10().floor() as i32);
        let powers = |digit: f64| (first..=last).map(move |e| digit * 10f64.powi(e));
        let has_three = powers(1.0).filter(|&value| self.place(value).is_some()).count() > 2;
        let digits = if has_three { &[1.0][..] } else { &[1.0, 2.0, 5.0] };
        digits.iter().flat_map(|&digit| powers(digit)).collect()
    }
}

impl Scale {
    /// Coordinate in which the axis is uniform.
    fn place(&self, value: f64) -> Option<f64> {
        match self {
            Self::Log => (value > 0.0).then(|| value.log10()),
            Self::Symmetric { linear } => Some((value / linear).asinh()),
            Self::Categories(_) => Some(value),
        }
    }

    /// The value at a coordinate.
    fn value(&self, place: f64) -> f64 {
        match self {
            Self::Log => 10f64.powf(place),
            Self::Symmetric { linear } => linear * place.sinh(),
            Self::Categories(_) => place,
        }
    }
}

/// 0 and powers of ten times 1, 3 on both sides of it, from `linear` on; outward, powers first.
fn symmetric(linear: f64) -> Vec<f64> {
    let first = linear.log10().floor() as i32;
    let sizes = [1.0, 3.0].into_iter().flat_map(|digit| (first..first + 7).map(move |e| digit * 10f64.powi(e)));
    [0.0].into_iter().chain(sizes.flat_map(|size| [size, -size])).collect()
}

/// A round number as short as it goes: `0.05`, `−30`, `2·10⁻⁴`.
fn number(value: f64) -> String {
    let exponent = if value == 0.0 { 0 } else { (value.abs().log10() + 1e-9).floor() as i32 };
    if (-2..5).contains(&exponent) {
        let text = format!("{:.*}", (-exponent).max(0) as usize, value.abs());
        return if value < 0.0 { format!("−{text}") } else { text };
    }
    let digit = (value / 10f64.powi(exponent)).round();
    let factor = if digit == 1.0 { String::new() } else { format!("{digit}·") };
    format!("{factor}10{}", superscript(exponent))
}

fn superscript(exponent: i32) -> String {
    let digits = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let raised = |c: char| c.to_digit(10).map_or('⁻', |digit| digits[digit as usize]);
    exponent.to_string().chars().map(raised).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(axis: &Axis) -> Vec<String> {
        axis.ticks().into_iter().map(|(_, name)| name).collect()
    }

    #[test]
    fn an_axis_holds_what_it_covers() {
        for scale in [Scale::Log, Scale::Symmetric { linear: 1.0 }] {
            let axis = Axis::covering("x", scale, [0.02, 7.0, 300.0]);
            let places = [0.02, 7.0, 300.0].map(|value| axis.place(value).unwrap());
            assert!(0.0 < places[0] && places[0] < places[1] && places[1] < places[2] && places[2] < 1.0);
            assert_eq!(axis.place(1e9), None);
        }
    }

    #[test]
    fn powers_of_ten_are_named_and_what_lies_between_them_where_they_are_few() {
        let long = names(&Axis::covering("x", Scale::Log, [1.5e-6, 0.3]));
        assert_eq!(long, ["10⁻⁶", "10⁻⁵", "10⁻⁴", "10⁻³", "0.01", "0.1"]);
        let short = names(&Axis::covering("x", Scale::Log, [0.3, 4.0]));
        assert_eq!(short, ["0.5", "1", "2"]);
    }

    #[test]
    fn a_symmetric_axis_has_zero_and_both_signs() {
        let axis = Axis::covering("x", Scale::Symmetric { linear: 1.0 }, [-0.4, 45.0]);
        let names = names(&axis);
        assert!(
            names.contains(&"0".into()) && names.contains(&"−1".into()) && names.contains(&"30".into()),
            "{names:?}"
        );
        let zero = axis.place(0.0).unwrap();
        assert!((axis.place(1.0).unwrap() - zero - (zero - axis.place(-1.0).unwrap())).abs() < 1e-12);
    }

    #[test]
    fn an_axis_without_a_value_is_still_one() {
        for scale in [Scale::Log, Scale::Symmetric { linear: 1.0 }, Scale::Categories(vec!["a".into()])] {
            let axis = Axis::covering("x", scale, [f64::NAN]);
            assert!(!axis.ticks().is_empty(), "{axis:?}");
            assert!(axis.ticks().iter().all(|(value, _)| axis.place(*value).is_some_and(f64::is_finite)));
        }
    }

    #[test]
    fn numbers_are_short() {
        let wanted = [(0.0, "0"), (0.05, "0.05"), (-30.0, "−30"), (2e-4, "2·10⁻⁴"), (1e-12, "10⁻¹²"), (1e3, "1000")];
        assert_eq!(wanted.map(|(value, _)| number(value)), wanted.map(|(_, name)| name));
    }
}
