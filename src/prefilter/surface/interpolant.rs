//! S of which the interpolant is right, and not its nodes alone.
//!
//! A reader takes S linearly between nodes that lie 11° apart (N = 15), while R = F_fine/F_coarse bends from node to node:
//! under narrow lobes by as much as it is. An interpolant through the right nodes is wrong between them, and always to the
//! same side where R bends one way. So the nodes are moved until the interpolant is closest to R at places between them, by
//! least squares with the weight F_coarse², which is that of ε. No F is computed for that: F of either surface is smooth
//! enough to be had from a cubic (Catmull-Rom) through its table, and R is their ratio.
//!
//! ε off the nodes in %, below 75° and from 75° to 82°, nodes right → interpolant right (nodes free to rise, N = 15, M = 1, 128
//! random directions, the tables' own estimators): twill 8×, GGX 0.3 0.66 → 0.49, 3.1 → 2.3; twill 16×, GGX 0.1 3.9 → 3.1, 19 → 13; silk 16×,
//! GGX 0.3 1.7 → 1.2, 16 → 5.4; silk 16×, GGX 0.1 7.4 → 6.3, 16.6 → 14.5 (bias −7.8 → −1.0); bump 8×, GGX 0.3 1.3 → 1.1,
//! 6.3 → 5.6; fbm 8×, GGX 0.3 0.10 → 0.07, 0.6 → 0.3.

use rayon::prelude::*;

use super::LARGEST_STORED;
use super::fit::{PRIOR, full_table};
use super::reflectance::{PatchReflectance, TableDirections, pair};

/// Places between two neighbouring nodes, along each of the four axes.
const PLACES: usize = 2;

/// Where R is asked for beyond the outermost nodes, in steps between nodes: the table holds there, for half a step.
const BEYOND: f32 = 0.25;

/// Sweeps of the least squares: eight gain nothing but at grazing angles of twill 16×, GGX 0.1 (13 → 12 %).
const SWEEPS: usize = 4;

/// How far the cubic may lie below the linear interpolant, and above, as a part of it: past that it has overshot.
const BELOW: f32 = 0.5;
const ABOVE: f32 = 1.0;

/// The most that a node may rise: dark pairs beside bright ones would be brightened for the sake of these.
///
/// Light and viewer both at 70° to 82°, about: relative error of F, root mean square, with nodes right, any rise and this one:
/// twill 8×, GGX 0.1 0.20, 0.35, 0.22; twill 16× 0.29, 0.40, 0.30; silk 16× 0.35, 0.57, 0.38. ε loses nothing by it.
const RISE: f32 = 1.1;

/// S below which a node does not rise at all: the coarse surface shows far too much there already.
///
/// Mean of images, twill 8×, GGX 0.1, light at 58° from the other side, seen at 80°: +66 % where all may rise, +56 % with 0.5,
/// +52 % with 1, +51 % with nodes right. Silk 16×, area light at 80°, GGX 0.3 and 0.1: −1.2 and −9.1 %; −1.2 and −9.8 %; −2.1
/// and −11.6 %; −3.3 and −14.7 %.
const DARK: f32 = 0.5;

/// Moves the nodes of `angular`, `[rank][pair]`, to where their interpolants are closest to what they say of R.
pub(super) fn fit_between_nodes(
    angular: &mut [Vec<[f32; 3]>],
    coarse: &PatchReflectance,
    directions: &TableDirections,
) {
    let axis = Axis::new(directions.resolution);
    let may_be_negative = angular.len() > 1;
    for s in angular {
        let mut known: Vec<(Vec<f32>, Vec<f32>, Vec<f32>)> = Vec::new();
        for channel in 0..3 {
            let nodes: Vec<f32> = full_table(s, directions.len()).iter().map(|s| s[channel]).collect();
            let reflected = mean_table(coarse, channel, directions.len());
            // the channels of a grey material are found once
            let alike = known.iter().find(|other| other.0 == nodes && other.1 == reflected);
            let moved = match alike {
                Some((_, _, moved)) => moved.clone(),
                None => Places::new(&axis, &nodes, &reflected).fit(nodes.clone(), may_be_negative),
            };
            known.push((nodes, reflected, moved));
        }
        for i in 0..directions.len() {
            for o in 0..=i {
                s[pair(i, o)] = [0, 1, 2].map(|channel| known[channel].2[o * directions.len() + i]);
            }
        }
    }
}

/// F of the coarse surface between all directions, `[o][i]`, mean over patches, and [`PRIOR`] of the mean over all.
fn mean_table(coarse: &PatchReflectance, channel: usize, directions: usize) -> Vec<f32> {
    let patches = coarse.patch_count();
    let mean = |k: usize| (0..patches).map(|patch| coarse.channel(patch, channel)[k]).sum::<f32>() / patches as f32;
    let pairs: Vec<[f32; 3]> = (0..coarse.pair_count()).map(|k| [mean(k), 0.0, 0.0]).collect();
    let table: Vec<f32> = full_table(&pairs, directions).iter().map(|f| f[0]).collect();
    let all = table.iter().map(|&f| f64::from(f)).sum::<f64>() / table.len() as f64;
    let prior = (PRIOR * all) as f32 + f32::MIN_POSITIVE;
    table.into_iter().map(|f| f + prior).collect()
}

/// The places between the nodes of one axis: which nodes each is interpolated from, and with which weights.
struct Axis {
    nodes: usize,
    linear: Vec<[(usize, f32); 2]>,
    cubic: Vec<[(usize, f32); 4]>,
}

impl Axis {
    fn new(nodes: usize) -> Self {
        let between = (0..(nodes - 1) * PLACES).map(|k| (k as f32 + 0.5) / PLACES as f32);
        let last = (nodes - 1) as f32;
        let places: Vec<f32> = [-BEYOND].into_iter().chain(between).chain([last + BEYOND]).collect();
        let linear = places.iter().map(|&place| {
            let place = place.clamp(0.0, last);
            let first = (place as usize).min(nodes.saturating_sub(2));
            let t = place - first as f32;
            [(first, 1.0 - t), ((first + 1).min(nodes - 1), t)]
        });
        let cubic = places.iter().map(|&place| {
            let place = place.clamp(0.0, last);
            let first = (place as usize).min(nodes.saturating_sub(2));
            let weights = catmull_rom(place - first as f32);
            // the table is held beyond its ends, as a reader does
            std::array::from_fn(|k| ((first + k).saturating_sub(1).min(nodes - 1), weights[k]))
        });
        Self { nodes, linear: linear.collect(), cubic: cubic.collect() }
    }

    fn places(&self) -> usize {
        self.linear.len()
    }
}

/// Weights of the nodes −1, 0, 1 and 2 at `t` of the way from 0 to 1.
fn catmull_rom(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2]
}

/// What is known at every pair of places, `[o][i]`: R and its weight.
struct Places<'a> {
    axis: &'a Axis,
    ratio: Vec<f32>,
    weight: Vec<f32>,
}

impl<'a> Places<'a> {
    /// From S and F_coarse at the nodes, `[o][i]`; F_fine is their product.
    fn new(axis: &'a Axis, nodes: &[f32], coarse: &[f32]) -> Self {
        let fine: Vec<f32> = nodes.iter().zip(coarse).map(|(s, f)| s * f).collect();
        let rows = axis.places() * axis.places();
        let (mut ratio, mut weight) = (vec![0.0; rows * rows], vec![0.0; rows * rows]);
        ratio.par_chunks_mut(rows).zip(weight.par_chunks_mut(rows)).enumerate().for_each(|(o, (ratio, weight))| {
            let [fine, coarse] = [&fine, coarse].map(|table| axis.bounded_cubic(table, o));
            for k in 0..rows {
                ratio[k] = fine[k] / coarse[k];
                weight[k] = coarse[k] * coarse[k];
            }
        });
        Self { axis, ratio, weight }
    }

    /// S whose interpolant is closest to R, from `start` on: S += Lᵀ w (R − L S) / Lᵀ w, L the interpolation.
    ///
    /// The rows of L sum to 1 and hold no negative weight, so the iteration converges.
    fn fit(&self, start: Vec<f32>, may_be_negative: bool) -> Vec<f32> {
        let rows = self.axis.places() * self.axis.places();
        let of_place = |o: usize| o * rows..(o + 1) * rows;
        let total = self.gathered(&|o, out| out.copy_from_slice(&self.weight[of_place(o)]));
        let limits: Vec<f32> =
            start.iter().map(|s| (if s.abs() < DARK { s.abs() } else { RISE * s.abs() }).min(LARGEST_STORED)).collect();
        let mut s = start;
        for _ in 0..SWEEPS {
            let step = self.gathered(&|o, out| {
                out.copy_from_slice(&self.axis.linear_at(&s, o));
                let known = self.ratio[of_place(o)].iter().zip(&self.weight[of_place(o)]);
                out.iter_mut().zip(known).for_each(|(s, (ratio, weight))| *s = weight * (ratio - *s));
            });
            for (((s, step), total), limit) in s.iter_mut().zip(step).zip(&total).zip(&limits) {
                let least = if may_be_negative { -limit } else { 0.0 };
                *s = (*s + step / total.max(f32::MIN_POSITIVE)).clamp(least, *limit);
            }
        }
        s
    }

    /// Lᵀ x at every pair of nodes, `[o][i]`; `row` writes x of one place of ωo for all places of ωi.
    fn gathered(&self, row: &(dyn Fn(usize, &mut [f32]) + Sync)) -> Vec<f32> {
        let (axis, places, n) = (self.axis, self.axis.places(), self.axis.nodes);
        let mut half = vec![0.0; places * places * n * n];
        half.par_chunks_mut(n * n).enumerate().for_each(|(o, out)| {
            let mut x = vec![0.0; places * places];
            row(o, &mut x);
            axis.gather(&x, out);
        });
        let mut all = vec![0.0; n * n * n * n];
        all.par_chunks_mut(n * n).enumerate().for_each(|(node, out)| {
            for (v, row) in axis.linear.iter().enumerate() {
                for (u, column) in axis.linear.iter().enumerate() {
                    let weight = weight_of(row, node / n) * weight_of(column, node % n);
                    if weight > 0.0 {
                        let from = &half[(v * places + u) * n * n..][..n * n];
                        out.iter_mut().zip(from).for_each(|(out, from)| *out += weight * from);
                    }
                }
            }
        });
        all
    }
}

fn weight_of(taps: &[(usize, f32); 2], node: usize) -> f32 {
    taps.iter().filter(|tap| tap.0 == node).map(|tap| tap.1).sum()
}

impl Axis {
    /// The linear interpolant of a table over both directions at the place `o` of one, for all places of the other.
    fn linear_at(&self, table: &[f32], o: usize) -> Vec<f32> {
        let (v, u) = (o / self.places(), o % self.places());
        spread(&self.linear, self.nodes, &row_of(table, self.nodes, &self.linear[v], &self.linear[u]))
    }

    /// The cubic through it, within bounds about the linear one.
    fn bounded_cubic(&self, table: &[f32], o: usize) -> Vec<f32> {
        let (v, u) = (o / self.places(), o % self.places());
        let linear = self.linear_at(table, o);
        let cubic = spread(&self.cubic, self.nodes, &row_of(table, self.nodes, &self.cubic[v], &self.cubic[u]));
        let bound = |(linear, cubic): (f32, f32)| {
            let size = linear.abs();
            linear + (cubic - linear).clamp(-BELOW * size, ABOVE * size)
        };
        linear.into_iter().zip(cubic).map(bound).collect()
    }

    /// From the places of one direction to its nodes: the transpose of what [`spread`] does with linear taps.
    fn gather(&self, places: &[f32], out: &mut [f32]) {
        let n = self.nodes;
        let mut columns = vec![0.0; self.places() * n];
        for (line, columns) in places.chunks(self.places()).zip(columns.chunks_mut(n)) {
            for (x, taps) in line.iter().zip(&self.linear) {
                taps.iter().for_each(|&(node, weight)| columns[node] += weight * x);
            }
        }
        for (columns, taps) in columns.chunks(n).zip(&self.linear) {
            for &(node, weight) in taps {
                out[node * n..][..n].iter_mut().zip(columns).for_each(|(out, x)| *out += weight * x);
            }
        }
    }
}

/// The row of a table, `[o][i]`, at a place of ωo.
fn row_of<const K: usize>(table: &[f32], n: usize, v: &[(usize, f32); K], u: &[(usize, f32); K]) -> Vec<f32> {
    let mut row = vec![0.0; n * n];
    for &(j, weight_v) in v {
        for &(i, weight_u) in u {
            let (from, weight) = (&table[(j * n + i) * n * n..][..n * n], weight_v * weight_u);
            row.iter_mut().zip(from).for_each(|(row, from)| *row += weight * from);
        }
    }
    row
}

/// A table over the nodes of one direction, interpolated at all places.
fn spread<const K: usize>(taps: &[[(usize, f32); K]], n: usize, row: &[f32]) -> Vec<f32> {
    let mut out = Vec::with_capacity(taps.len() * taps.len());
    let mut line = vec![0.0; n];
    for of_row in taps {
        line.fill(0.0);
        for &(node, weight) in of_row {
            line.iter_mut().zip(&row[node * n..][..n]).for_each(|(line, from)| *line += weight * from);
        }
        out.extend(taps.iter().map(|taps| taps.iter().map(|&(node, weight)| weight * line[node]).sum::<f32>()));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 7;

    /// A table `[o][i]` of a function of the four coordinates, in steps between nodes.
    fn table(value: impl Fn([f32; 4]) -> f32) -> Vec<f32> {
        let place = |k: usize| [k / (N * N * N), k / (N * N) % N, k / N % N, k % N].map(|x| x as f32);
        (0..N.pow(4)).map(|k| value(place(k))).collect()
    }

    fn fitted(nodes: &[f32], coarse: &[f32]) -> Vec<f32> {
        Places::new(&Axis::new(N), nodes, coarse).fit(nodes.to_vec(), false)
    }

    /// The interpolant's errors against `exact` in the middle of the cells of four steps that have nodes all around.
    fn errors(nodes: &[f32], exact: impl Fn([f32; 4]) -> f32) -> Vec<f32> {
        const T: [f32; 3] = [0.1, 0.4, 0.8];
        let mut errors = Vec::new();
        for cell in 0..(N - 3).pow(4) {
            let corner = [0, 1, 2, 3].map(|axis| 1 + cell / (N - 3).pow(axis) % (N - 3));
            for t in 0..T.len().pow(4) {
                let t = [0, 1, 2, 3].map(|axis| T[t / T.len().pow(axis) % T.len()]);
                let read = |bits: usize| -> f32 {
                    let at = |axis: usize| corner[axis] + (bits >> axis & 1);
                    let weight = |axis: usize| if bits >> axis & 1 == 1 { t[axis] } else { 1.0 - t[axis] };
                    (0..4).map(weight).product::<f32>() * nodes[((at(0) * N + at(1)) * N + at(2)) * N + at(3)]
                };
                let place = [0, 1, 2, 3].map(|axis| corner[axis] as f32 + t[axis]);
                errors.push((0..16).map(read).sum::<f32>() - exact(place));
            }
        }
        errors
    }

    fn rms(values: &[f32]) -> f32 {
        (values.iter().map(|x| x * x).sum::<f32>() / values.len() as f32).sqrt()
    }

    #[test]
    fn the_cubic_goes_through_its_nodes_and_keeps_straight_lines() {
        assert_eq!(catmull_rom(0.0), [0.0, 1.0, 0.0, 0.0]);
        for t in [0.1, 0.25, 0.5, 0.9] {
            let weights = catmull_rom(t);
            let at: f32 = weights.iter().zip([-1.0, 0.0, 1.0, 2.0]).map(|(w, x)| w * x).sum();
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6 && (at - t).abs() < 1e-6, "{t}: {weights:?}");
        }
    }

    #[test]
    fn a_scaling_that_is_linear_stays_as_it_is() {
        let nodes = table(|[a, b, c, d]| 0.5 + 0.1 * a + 0.02 * b + 0.1 * c + 0.05 * d);
        let moved = fitted(&nodes, &table(|_| 0.3));
        // at the rim the cubic sees the table held, and bends a little
        let worst = nodes.iter().zip(&moved).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 0.02, "{worst} of steps of 0.1");
        assert!(
            errors(&moved, |[a, b, c, d]| 0.5 + 0.1 * a + 0.02 * b + 0.1 * c + 0.05 * d).iter().all(|e| e.abs() < 5e-3)
        );
    }

    #[test]
    fn a_bent_scaling_is_read_with_less_than_half_of_the_error_and_none_of_the_bias() {
        // along an axis the error t(1 − t)/2 δ² has the mean δ²/12 and the mean square δ⁴/120: without its mean 0.41 of itself;
        // four axes add up, and their means with them
        let exact = |x: [f32; 4]| 1.0 + 0.02 * x.iter().map(|x| (x - 3.0) * (x - 3.0)).sum::<f32>();
        let nodes = table(exact);
        let moved = fitted(&nodes, &table(|[a, b, ..]| 0.3 + 0.02 * (a + b)));
        let [before, after] = [&nodes, &moved].map(|nodes| errors(nodes, exact));
        let mean = |errors: &[f32]| errors.iter().sum::<f32>() / errors.len() as f32;
        println!("rms {:.4} → {:.4}, mean {:.4} → {:.4}", rms(&before), rms(&after), mean(&before), mean(&after));
        assert!(rms(&after) < 0.5 * rms(&before));
        assert!(mean(&after).abs() < 0.1 * mean(&before));
    }

    #[test]
    fn no_node_becomes_negative_or_more_than_can_be_stored() {
        let spike = table(|x| if x == [3.0; 4] { LARGEST_STORED } else { 0.01 * x[0] });
        let dark = table(|[a, ..]| if a < 3.0 { f32::MIN_POSITIVE } else { 1.0 });
        for coarse in [table(|_| 1.0), dark, table(|_| f32::MIN_POSITIVE)] {
            assert!(fitted(&spike, &coarse).iter().all(|s| (0.0..=LARGEST_STORED).contains(s)));
        }
    }

    #[test]
    fn tables_of_one_or_two_nodes_have_something_between_them_or_nothing() {
        for n in [1, 2] {
            let axis = Axis::new(n);
            let nodes: Vec<f32> = (0..n.pow(4)).map(|k| 1.0 + k as f32).collect();
            let moved = Places::new(&axis, &nodes, &vec![1.0; n.pow(4)]).fit(nodes.clone(), false);
            assert!(moved.iter().all(|s| s.is_finite() && *s > 0.0), "{moved:?}");
        }
    }
}
