//! The harness for samplers of directions: chi-square of the samples against the integral of their density.
//!
//! The sphere is cut in (z, φ) around an axis, where areas are solid angles, at medians of a pilot run: every bin expects
//! about as many samples, however narrow the lobe. The horizon of the axis is an edge of bins, for densities may end there.
//! Bins are cut on into cells, over which densities are integrated. Samples that a sampler gives up are a bin of their own,
//! which expects 1 − ∫pdf of them.

use farfield::math::frame::Frame;
use farfield::math::rng::Stream;
use glam::Vec3;
use std::f64::consts::TAU;

use crate::budget;

/// Samples that bins and cells are cut by, and the most that one of each may hold.
const PILOT: u64 = 32_768;
const PILOT_PER_BIN: usize = 128;
const PILOT_PER_CELL: usize = 8;
/// Samples of the test.
const SAMPLES: u64 = 200_000;
/// Bins that expect fewer are pooled: below, counts are too far from normal for chi-square.
const LEAST_EXPECTED: f64 = 5.0;
/// Samples where fewer than [`LEAST_EXPECTED`] are expected that are a fault, though no term: Poisson's chance is 1e-19.
const MOST_RARE: f64 = 40.0;
/// Error of a cell's integral; all cells of a bin together are off by less than one of [`SAMPLES`].
const TOLERANCE: f64 = 1e-7;
/// Halvings per axis that a cell's integral must and may use.
const HALVINGS: [u32; 2] = [1, 20];
/// A cell is quartered where a value at a sample or on its rim is this many times its mean: a lobe has fallen between the
/// nodes, which mostly comes from a neighbour that it fills.
const SPIKE: f64 = 4.0;
/// Cuts after which a cell is as small as `f32` resolves; samplers of a single direction get there.
const MAX_CUTS: usize = 80;

/// A rectangle of (z, φ).
#[derive(Clone, Copy, Debug)]
struct Cell {
    from: [f64; 2],
    to: [f64; 2],
}

/// A cell to integrate over: its bin, and samples that show where lobes are.
struct Piece {
    cell: Cell,
    bin: usize,
    samples: Vec<[f64; 2]>,
}

/// Where a place lies: below or above cuts, down to its bin.
enum Node {
    Bin(usize),
    Cut { axis: usize, at: f64, sides: Box<[Node; 2]> },
}

/// The sphere in bins.
pub(crate) struct Bins {
    frame: Frame,
    root: Node,
    pieces: Vec<Piece>,
    count: usize,
}

/// Three uniform numbers for sample `k`.
pub(crate) fn uniform(rng: Stream, k: u64) -> [f32; 3] {
    let [a, b] = rng.uniform_pair(2 * k);
    [a, b, rng.uniform(2 * k + 1)]
}

impl Bins {
    /// Bins around `axis` that each hold about as many samples.
    pub(crate) fn new(axis: Vec3, seed: u64, sample: impl Fn([f32; 3]) -> Option<Vec3>) -> Self {
        let frame = Frame::around(axis);
        let rng = Stream::new(seed, 0);
        let places = (0..PILOT).filter_map(|k| sample(uniform(rng, k))).map(|w| place(&frame, w));
        let (mut above, mut below): (Vec<_>, Vec<_>) = places.partition(|at| at[0] >= 0.0);
        let mut bins = Self { frame, root: Node::Bin(0), pieces: Vec::new(), count: 0 };
        let sides = Box::new([
            bins.grow(Cell { from: [-1.0, 0.0], to: [0.0, TAU] }, &mut below, 0, None),
            bins.grow(Cell { from: [0.0, 0.0], to: [1.0, TAU] }, &mut above, 0, None),
        ]);
        bins.root = Node::Cut { axis: 0, at: 0.0, sides };
        bins
    }

    /// Cuts `cell` by the samples in it, along z and φ in turns, until it is a bin and on until it is a cell.
    fn grow(&mut self, cell: Cell, places: &mut [[f64; 2]], cuts: usize, bin: Option<usize>) -> Node {
        let is_small = |most| places.len() <= most || cuts >= MAX_CUTS;
        let bin = bin.or_else(|| is_small(PILOT_PER_BIN).then(|| self.add_bin()));
        if let Some(bin) = bin.filter(|_| is_small(PILOT_PER_CELL)) {
            self.pieces.push(Piece { cell, bin, samples: places.to_vec() });
            return Node::Bin(bin);
        }
        let axis = cuts % 2;
        places.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
        let at = cut(&cell, axis, places);
        let (low, high) = places.split_at_mut(places.partition_point(|place| place[axis] < at));
        let mut halves = [cell; 2];
        halves[0].to[axis] = at;
        halves[1].from[axis] = at;
        let sides = [self.grow(halves[0], low, cuts + 1, bin), self.grow(halves[1], high, cuts + 1, bin)];
        // All cells of a bin are that bin.
        bin.map_or_else(|| Node::Cut { axis, at, sides: Box::new(sides) }, Node::Bin)
    }

    fn add_bin(&mut self) -> usize {
        self.count += 1;
        self.count - 1
    }

    /// ∫ value dω of each bin.
    pub(crate) fn integrals(&self, value: impl Fn(Vec3) -> f64) -> Vec<f64> {
        let at = |at: [f64; 2]| value(direction(&self.frame, at));
        let mut sums = vec![0.0; self.count];
        for Piece { cell, bin, samples } in &self.pieces {
            let samples: Vec<_> = samples.iter().map(|&place| (place, at(place))).collect();
            sums[*bin] += adaptive(cell, gauss(cell, &at), 0, &samples, &at);
        }
        sums
    }

    /// ∫ value dω over the sphere.
    pub(crate) fn integral(&self, value: impl Fn(Vec3) -> f64) -> f64 {
        self.integrals(value).iter().sum()
    }

    /// The bin that `w` lies in.
    fn index(&self, w: Vec3) -> usize {
        let place = place(&self.frame, w);
        let mut node = &self.root;
        loop {
            match node {
                Node::Bin(bin) => return *bin,
                Node::Cut { axis, at, sides } => node = &sides[usize::from(place[*axis] >= *at)],
            }
        }
    }
}

/// Where to cut a cell by the samples in it, sorted along `axis`: at their median; but first away from where none are, or
/// an integral would look for a narrow lobe in the corner of a wide cell.
fn cut(cell: &Cell, axis: usize, places: &[[f64; 2]]) -> f64 {
    let [first, last] = [places[0][axis], places[places.len() - 1][axis]];
    let [from, to] = [cell.from[axis], cell.to[axis]];
    let [below, above] = [2.0 * first - last, 2.0 * last - first]; // as much again on either side, for the tails
    let least = 0.25 * (to - from);
    if below - from > least {
        return below;
    }
    if to - above > least {
        return above;
    }
    let middle = places.len() / 2;
    0.5 * (places[middle - 1][axis] + places[middle][axis])
}

/// (z, φ) of a direction; z from x² + y², whose digits a narrow lobe around the axis needs.
fn place(frame: &Frame, w: Vec3) -> [f64; 2] {
    let [x, y, z] = frame.to_local(w).to_array().map(f64::from);
    let z = if z.abs() < 0.5 { z } else { (1.0 - (x * x + y * y) / (1.0 + z.abs())).copysign(z) };
    [z, y.atan2(x).rem_euclid(TAU)]
}

/// The direction at (z, φ).
fn direction(frame: &Frame, [z, phi]: [f64; 2]) -> Vec3 {
    let r = (1.0 - z * z).sqrt();
    frame.to_outer(Vec3::new((r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32))
}

/// ∫ over the cell by 3 × 3 Gauss-Legendre nodes.
fn gauss(cell: &Cell, value: &impl Fn([f64; 2]) -> f64) -> f64 {
    let nodes = [(-0.6f64.sqrt(), 5.0 / 18.0), (0.0, 4.0 / 9.0), (0.6f64.sqrt(), 5.0 / 18.0)];
    let size = [0, 1].map(|k| cell.to[k] - cell.from[k]);
    let at = |k: usize, x: f64| cell.from[k] + 0.5 * size[k] * (1.0 + x);
    let row = |&(x, a): &(f64, f64)| nodes.iter().map(|&(y, b)| a * b * value([at(0, x), at(1, y)])).sum::<f64>();
    nodes.iter().map(row).sum::<f64>() * size[0] * size[1]
}

/// ∫ over the cell, quartered until the quarters agree with the whole and no value sticks out.
fn adaptive(
    cell: &Cell,
    whole: f64,
    halvings: u32,
    samples: &[([f64; 2], f64)],
    value: &impl Fn([f64; 2]) -> f64,
) -> f64 {
    let parts = quarters(cell);
    let values = parts.map(|part| gauss(&part, value));
    let sum = values.iter().sum::<f64>();
    let area = (cell.to[0] - cell.from[0]) * (cell.to[1] - cell.from[1]);
    let inside = |place: &[f64; 2]| (0..2).all(|k| (cell.from[k]..cell.to[k]).contains(&place[k]));
    let seen = samples.iter().filter(|(place, _)| inside(place)).map(|sample| sample.1);
    let peak = seen.chain(rim(cell).map(value)).fold(0.0, f64::max);
    let is_settled = (sum - whole).abs() < TOLERANCE && peak * area < SPIKE * sum + TOLERANCE;
    if halvings == HALVINGS[1] || halvings >= HALVINGS[0] && is_settled {
        return sum;
    }
    parts.iter().zip(values).map(|(part, whole)| adaptive(part, whole, halvings + 1, samples, value)).sum()
}

/// Corners and middles of the sides, a hair inside: a density may end on the rim.
fn rim(cell: &Cell) -> impl Iterator<Item = [f64; 2]> {
    let at = [0, 1].map(|k| [1e-6, 0.5, 1.0 - 1e-6].map(|x| cell.from[k] + x * (cell.to[k] - cell.from[k])));
    (0..9).filter(|&k| k != 4).map(move |k| [at[0][k % 3], at[1][k / 3]])
}

/// The four quarters of a cell.
fn quarters(cell: &Cell) -> [Cell; 4] {
    let middle = [0, 1].map(|k| 0.5 * (cell.from[k] + cell.to[k]));
    [0, 1, 2, 3].map(|q| {
        let is_upper = |k: usize| q >> k & 1 == 1;
        Cell {
            from: [0, 1].map(|k| if is_upper(k) { middle[k] } else { cell.from[k] }),
            to: [0, 1].map(|k| if is_upper(k) { cell.to[k] } else { middle[k] }),
        }
    })
}

/// Fails unless the samples follow the density, those given up included.
pub(crate) fn expect_samples_match_pdf(
    name: &str,
    axis: Vec3,
    sample: impl Fn([f32; 3]) -> Option<Vec3>,
    pdf: impl Fn(Vec3) -> f32,
) {
    let p = p_value(axis, &sample, &pdf);
    assert!(p > budget::threshold(), "{name}: p = {p:.2e}, wanted over {:.2e}", budget::threshold());
}

/// Chance that samples of this density look as unlike it as these or worse.
fn p_value(axis: Vec3, sample: &impl Fn([f32; 3]) -> Option<Vec3>, pdf: &impl Fn(Vec3) -> f32) -> f64 {
    let bins = Bins::new(axis, 1, sample);
    let shares = bins.integrals(|w| f64::from(pdf(w)));
    let lost = 1.0 - shares.iter().sum::<f64>();
    let mut counts = vec![0.0; shares.len() + 1];
    let rng = Stream::new(2, 0);
    for k in 0..SAMPLES {
        counts[sample(uniform(rng, k)).map_or(shares.len(), |w| bins.index(w))] += 1.0;
    }
    let expected: Vec<f64> = shares.iter().chain([&lost]).map(|share| share * SAMPLES as f64).collect();
    chi_square(&expected, &counts)
}

/// p of Pearson's statistic, bins that expect little pooled.
fn chi_square(expected: &[f64], counts: &[f64]) -> f64 {
    let (rare, common): (Vec<_>, Vec<_>) =
        expected.iter().zip(counts).map(|(&e, &n)| [e, n]).partition(|[e, _]| *e < LEAST_EXPECTED);
    let pooled = rare.iter().fold([0.0; 2], |[e, n], bin| [e + bin[0], n + bin[1]]);
    let term = |[e, n]: &[f64; 2]| (n - e).powi(2) / e;
    let mut statistic = common.iter().map(term).sum::<f64>();
    let mut freedom = common.len() - 1;
    if pooled[0] >= LEAST_EXPECTED {
        statistic += term(&pooled);
        freedom += 1;
    } else if pooled[1] >= MOST_RARE {
        return 0.0;
    }
    budget::chi_square_tail(statistic, freedom)
}

#[test]
fn the_harness_accepts_the_cosine_and_rejects_what_is_slightly_off() {
    let axis = Vec3::new(0.36, -0.48, 0.8);
    let frame = Frame::around(axis);
    let sample = |u: [f32; 3]| Some(frame.to_outer(farfield::math::warp::cosine_hemisphere([u[0], u[1]])));
    let cosine = |w: Vec3| axis.dot(w).max(0.0) / std::f32::consts::PI;
    assert!(p_value(axis, &sample, &cosine) > 1e-3);
    // 5 % more towards one side; 1 % too much everywhere; 1 % of samples given up unannounced.
    assert!(p_value(axis, &sample, &|w| cosine(w) * (1.0 + 0.05 * frame.x.dot(w).signum())) < 1e-6);
    assert!(p_value(axis, &sample, &|w| cosine(w) * 0.99) < 1e-6);
    assert!(p_value(axis, &|u| sample(u).filter(|_| u[2] > 0.01), &cosine) < 1e-6);
}
