//! What is done to heights before they are compiled, and what is said about them: tilt, terraces, seams.

use rayon::prelude::*;

use crate::geometry::Boundary;
use crate::io::heights::RawHeights;

/// Codes per texel-scale slope standard deviation under which terraces show in the normals.
const MIN_CODES: f64 = 32.0;

/// How much rougher than the roughest line of neighbours inside of the map a seam may be. Tileable maps stay under 1.1,
/// those with cliffs included; photographs and measurements that do not tile begin at 2.
const MAX_SEAM: f64 = 1.5;

/// Rounds of smoothing of `dequantize`: 64 rounds spread over 6 texels, which closes terraces of up to a dozen.
const DEQUANTIZE_ROUNDS: usize = 64;

/// Smooths the steps between codes away, moving no value by more than half a code.
///
/// Repeated binomial smoothing (1 2 1)/4 along u and v, each round projected back to value ± half a code: the flow of
/// a membrane between two obstacles. Flat terraces become ramps; a step of several codes stays where it was.
pub(super) fn dequantize(raw: &mut RawHeights, bits: u8, boundary: Boundary) {
    let half = (0.5 / ((1_u64 << bits) - 1) as f64) as f32;
    let original = raw.values.clone();
    let [w, h] = [raw.width, raw.height];
    let mut current = original.clone();
    for _ in 0..DEQUANTIZE_ROUNDS {
        let source = &current;
        raw.values.par_chunks_mut(w).enumerate().for_each(|(v, row)| {
            let rows = [before(v, h, boundary), v, after(v, h, boundary)].map(|v| &source[v * w..(v + 1) * w]);
            let column = |u: usize| rows[0][u] + 2.0 * rows[1][u] + rows[2][u];
            for (u, value) in row.iter_mut().enumerate() {
                let sum = column(before(u, w, boundary)) + 2.0 * column(u) + column(after(u, w, boundary));
                let code = original[v * w + u];
                *value = (sum / 16.0).clamp(code - half, code + half);
            }
        });
        current.copy_from_slice(&raw.values);
    }
}

/// Index of the vertex before `i` of `n`.
fn before(i: usize, n: usize, boundary: Boundary) -> usize {
    match (i, boundary) {
        (0, Boundary::Repeat) => n - 1,
        (0, Boundary::Clamp) => 0,
        _ => i - 1,
    }
}

/// Index of the vertex after `i` of `n`.
fn after(i: usize, n: usize, boundary: Boundary) -> usize {
    match boundary {
        _ if i + 1 < n => i + 1,
        Boundary::Repeat => 0,
        Boundary::Clamp => n - 1,
    }
}

/// Removes the mean plane: the slopes of the least-squares plane, turning about the centre, so that the mean stays.
///
/// On a grid the slopes decouple: b_u = Σ (u − ū) h / Σ (u − ū)², likewise for v.
pub(super) fn detrend(raw: &mut RawHeights) {
    let [w, h] = [raw.width, raw.height];
    let centre = [(w as f64 - 1.0) / 2.0, (h as f64 - 1.0) / 2.0];
    let (mut along_u, mut along_v) = (0.0, 0.0);
    for (v, row) in raw.values.chunks_exact(w).enumerate() {
        let sum: f64 = row.iter().map(|&x| f64::from(x)).sum();
        along_u += row.iter().enumerate().map(|(u, &x)| (u as f64 - centre[0]) * f64::from(x)).sum::<f64>();
        along_v += (v as f64 - centre[1]) * sum;
    }
    // Σ (i − ī)² = n (n² − 1) / 12, once for each line of the other axis; 0 for a single vertex, which has no slope.
    let spread = |n: usize, lines: usize| lines as f64 * n as f64 * ((n * n) as f64 - 1.0) / 12.0;
    let slope = |moment: f64, spread: f64| if spread > 0.0 { moment / spread } else { 0.0 };
    let (b_u, b_v) = (slope(along_u, spread(w, h)), slope(along_v, spread(h, w)));
    for (v, row) in raw.values.chunks_exact_mut(w).enumerate() {
        for (u, value) in row.iter_mut().enumerate() {
            let plane = b_u * (u as f64 - centre[0]) + b_v * (v as f64 - centre[1]);
            *value = (f64::from(*value) - plane) as f32;
        }
    }
}

/// Differences between neighbours along one axis, in stored units.
struct Differences {
    /// Mean absolute difference of the roughest line inside of the map.
    roughest: f64,
    /// Standard deviation of all differences inside of the map.
    deviation: f64,
    /// Mean absolute difference across the seam.
    seam: f64,
}

/// Differences along axis 0 (u) or 1 (v); `None` where there are fewer than 3 vertices.
fn differences(raw: &RawHeights, axis: usize) -> Option<Differences> {
    let [w, h] = [raw.width, raw.height];
    let (n, lines) = if axis == 0 { (w, h) } else { (h, w) };
    if n < 3 {
        return None;
    }
    let mut absolute = vec![0.0; n];
    let [mut squares, mut sum] = [0.0; 2];
    for (v, row) in raw.values.chunks_exact(w).enumerate() {
        let below = &raw.values[(v + 1) % h * w..];
        for (u, &value) in row.iter().enumerate() {
            let (i, next) = if axis == 0 { (u, row[(u + 1) % w]) } else { (v, below[u]) };
            let difference = f64::from(next) - f64::from(value);
            absolute[i] += difference.abs();
            if i + 1 < n {
                squares += difference * difference;
                sum += difference;
            }
        }
    }
    let count = ((n - 1) * lines) as f64;
    let variance = (squares / count - (sum / count).powi(2)).max(0.0); // rounding of a constant slope
    let roughest = absolute[..n - 1].iter().fold(0.0_f64, |most, &line| most.max(line)) / lines as f64;
    Some(Differences { roughest, deviation: variance.sqrt(), seam: absolute[n - 1] / lines as f64 })
}

/// Warnings about a map as it was stored: one line each.
pub(super) fn warnings(raw: &RawHeights, boundary: Boundary, dequantized: bool) -> Vec<String> {
    let axes = [differences(raw, 0), differences(raw, 1)];
    let mut warnings = Vec::new();
    for (axis, found) in ["u", "v"].iter().zip(&axes) {
        let Some(found) = found else { continue };
        let ratio = found.seam / found.roughest;
        if boundary == Boundary::Repeat && found.roughest > 0.0 && ratio > MAX_SEAM {
            warnings.push(format!(
                "the seam along {axis} is {ratio:.1} times rougher than any line of the map; wanted a tileable map, \
                 or `boundary = \"clamp\"`"
            ));
        }
    }
    let deviation = axes.iter().flatten().map(|found| found.deviation).fold(0.0, f64::max);
    if let Some(bits) = raw.bits.filter(|bits| *bits <= 16 && !dequantized) {
        let codes = deviation * ((1_u64 << bits) - 1) as f64;
        if deviation > 0.0 && codes < MIN_CODES {
            warnings.push(format!(
                "slopes are terraced: their standard deviation is {codes:.1} codes a texel at {bits} bits; wanted \
                 {MIN_CODES} or more: use a map of more bits, or `dequantize = true`"
            ));
        }
    }
    warnings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(width: usize, height: usize, bits: Option<u8>, value: impl Fn(usize, usize) -> f32) -> RawHeights {
        let values = (0..width * height).map(|i| value(i % width, i / width)).collect();
        RawHeights { values, width, height, bits }
    }

    #[test]
    fn detrending_flattens_a_plane_and_keeps_its_mean() {
        for (w, h) in [(7, 5), (1, 9), (9, 1), (1, 1)] {
            let mut plane = raw(w, h, None, |u, v| 0.5 * u as f32 - 0.25 * v as f32 + 3.0);
            let mean = plane.values.iter().sum::<f32>() / (w * h) as f32;
            detrend(&mut plane);
            assert!(plane.values.iter().all(|value| (value - mean).abs() < 1e-5), "{w} × {h}");
        }
    }

    #[test]
    fn dequantizing_turns_terraces_into_a_ramp_within_half_a_code() {
        let ramp = |u: usize| u as f32 / 8.0;
        let mut map = raw(64, 4, Some(8), |u, _| ramp(u).floor() / 255.0);
        let before = map.values.clone();
        dequantize(&mut map, 8, Boundary::Clamp);
        for (value, code) in map.values.iter().zip(&before) {
            assert!((value - code).abs() <= 0.5001 / 255.0);
        }
        let steps = map.values[16..48].windows(2).map(|pair| (pair[1] - pair[0]) * 255.0 * 8.0);
        assert!(steps.into_iter().all(|slope| (0.5..1.6).contains(&slope)), "slopes near 1");
    }

    #[test]
    fn a_seam_and_terraces_are_reported_and_a_smooth_tileable_map_is_not() {
        let wave = |u: usize| (u as f32 / 64.0 * std::f32::consts::TAU).sin() * 0.4 + 0.5;
        let smooth = raw(64, 64, Some(16), |u, v| 0.5 * (wave(u) + wave(v)));
        assert_eq!(warnings(&smooth, Boundary::Repeat, false), Vec::<String>::new());
        let ramp = raw(64, 64, None, |u, _| u as f32);
        assert_eq!(warnings(&ramp, Boundary::Repeat, false).len(), 1);
        assert_eq!(warnings(&ramp, Boundary::Clamp, false).len(), 0);
        let coarse = raw(64, 64, Some(8), |u, _| (wave(u) * 255.0).round() / 255.0);
        assert!(warnings(&coarse, Boundary::Repeat, false)[0].contains("terraced"));
        assert_eq!(warnings(&coarse, Boundary::Repeat, true), Vec::<String>::new());
        assert_eq!(warnings(&raw(8, 8, Some(8), |_, _| 0.5), Boundary::Repeat, false), Vec::<String>::new());
    }
}
