//! K-means of weighted points.

use crate::math::rng::Stream;

/// Rounds of Lloyd's iteration: prototypes of a few thousand points settle in about ten.
const ROUNDS: usize = 20;

/// The index of the centre nearest to `point`; the first of equals.
pub(crate) fn nearest<const D: usize>(centres: &[[f64; D]], point: &[f64; D]) -> usize {
    let mut best = (f64::INFINITY, 0);
    for (k, centre) in centres.iter().enumerate() {
        let distance = squared_distance(centre, point);
        if distance < best.0 {
            best = (distance, k);
        }
    }
    best.1
}

/// |a − b|².
pub(crate) fn squared_distance<const D: usize>(a: &[f64; D], b: &[f64; D]) -> f64 {
    (0..D).map(|k| (a[k] - b[k]).powi(2)).sum()
}

/// Up to `count` centres of the points with these weights; fewer where there are not as many different points.
///
/// Starts as k-means++ does, each centre drawn by weight times squared distance to those before; then Lloyd's iteration.
pub(crate) fn centres<const D: usize>(points: &[([f64; D], f64)], count: usize, seed: u64) -> Vec<[f64; D]> {
    let mut centres: Vec<[f64; D]> = Vec::new();
    let stream = Stream::new(seed, 0);
    while centres.len() < count {
        let far = |(point, weight): &([f64; D], f64)| {
            let distance = centres.iter().map(|centre| squared_distance(centre, point)).fold(f64::INFINITY, f64::min);
            weight * if centres.is_empty() { 1.0 } else { distance }
        };
        let total: f64 = points.iter().map(far).sum();
        if total <= 0.0 {
            break;
        }
        let mut left = f64::from(stream.uniform(centres.len() as u64)) * total;
        let chosen = points.iter().find(|point| {
            left -= far(point);
            left < 0.0
        });
        // Rounding may leave a hair beyond the last point.
        centres.push(chosen.unwrap_or(&points[points.len() - 1]).0);
    }
    for _ in 0..ROUNDS {
        let mut sums = vec![([0.0; D], 0.0); centres.len()];
        for (point, weight) in points {
            let (sum, total) = &mut sums[nearest(&centres, point)];
            (0..D).for_each(|k| sum[k] += weight * point[k]);
            *total += weight;
        }
        let moved = centres.iter().zip(sums).map(
            |(&old, (sum, total))| {
                if total > 0.0 { sum.map(|value| value / total) } else { old }
            },
        );
        let moved: Vec<_> = moved.collect();
        if moved == centres {
            break;
        }
        centres = moved;
    }
    centres
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn well_separated_groups_are_found_and_more_centres_than_points_are_not_made_up() {
        let rng = Stream::new(4, 4);
        let groups = [[0.0, 0.0], [5.0, 1.0], [-3.0, 4.0]];
        let point = |k: u64| {
            let [a, b] = rng.uniform_pair(k).map(f64::from);
            let group = groups[k as usize % 3];
            ([group[0] + a - 0.5, group[1] + b - 0.5], 1.0 + a)
        };
        let points: Vec<_> = (0..3000).map(point).collect();
        let found = centres(&points, 3, 1);
        for group in groups {
            let off = squared_distance(&found[nearest(&found, &group)], &group);
            // means of 1000 points with a deviation of 0.3, and a tilt of the weights of 1/18
            assert!(off.sqrt() < 0.1, "{found:?}");
        }
        assert_eq!(centres(&[([1.0, 2.0], 1.0), ([1.0, 2.0], 3.0)], 3, 1), [[1.0, 2.0]]);
    }
}
