//! Parallel views of a volume in smooth light, without pixels: what a fit of its weights compares.
//!
//! The images of one view under several environments and in three channels come of the same walks: a walk that leaves the
//! medium looks up every light. A view is a set of cells of the faces that the grid turns to it; walks start uniformly over
//! the area that the faces show, so that means over walks are means over the image, by area. An axis that repeats has no
//! faces: a cloth is seen from above and below, not cut open.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::walk::Walk;
use crate::math::rng::{Draws, Stream};
use crate::medium::{MAX_LOBES, Medium};

/// Cells along either edge of a face.
pub const CELLS: usize = 16;

/// Walks that share one task and one block of sums.
const BATCH: usize = 512;

/// An environment as a function of direction: constant + tilt·d + lobe·⟨axis, d⟩^exponent, in the frame of the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothLight {
    /// Radiance from everywhere.
    pub constant: f32,
    /// Radiance that grows along this vector.
    pub tilt: Vec3,
    /// A round lobe: unit axis, exponent, radiance at its middle.
    pub lobe: Option<(Vec3, i32, f32)>,
}

impl SmoothLight {
    /// 1 from everywhere.
    pub const ONE: Self = Self { constant: 1.0, tilt: Vec3::ZERO, lobe: None };

    /// (1 + axis·d)/2.
    pub fn tilted(axis: Vec3) -> Self {
        Self { constant: 0.5, tilt: 0.5 * axis, lobe: None }
    }

    /// ⟨axis, d⟩^exponent.
    pub fn lobe(axis: Vec3, exponent: i32) -> Self {
        Self { constant: 0.0, tilt: Vec3::ZERO, lobe: Some((axis, exponent, 1.0)) }
    }

    /// Radiance from the direction (unit).
    #[inline]
    pub fn radiance(&self, direction: Vec3) -> f32 {
        let lobe = self.lobe.map_or(0.0, |(axis, exponent, peak)| peak * axis.dot(direction).max(0.0).powi(exponent));
        self.constant + self.tilt.dot(direction) + lobe
    }
}

/// A parallel view: the unit vector to the viewer, in the frame of the grid.
pub type View = Vec3;

/// How many walks a view gets and where their numbers come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Walks {
    /// Walks a view.
    pub count: usize,
    /// Seed of their numbers.
    pub seed: u64,
}

/// What happens along the walks of a view; the default of a method is to take no notice.
pub trait Observer: Send {
    /// Flakes of an occupied voxel reflect, lobe by lobe in these shares.
    fn reflects(&mut self, _voxel: usize, _posterior: [f32; MAX_LOBES]) {}
    /// The walk leaves in `direction` with that throughput, in which 1/chance of roulette is `survival`.
    fn leaves(&mut self, _cell: usize, _direction: Vec3, _throughput: Vec3, _survival: f32) {}
    /// The walk ends in the dark: it met nothing, or roulette took it.
    fn ends(&mut self, _cell: usize) {}
}

/// Cells of a view: of the up to three faces that are seen.
pub const VIEW_CELLS: usize = 3 * CELLS * CELLS;

/// The faces of a grid as a view sees them.
struct Faces {
    extent: DVec3,
    /// Along the flight: away from the viewer.
    direction: DVec3,
    /// Share of the faces across x, y, z in the area shown, cumulated.
    shares: [f64; 3],
}

impl Faces {
    fn new(medium: &Medium, view: View) -> Self {
        let extent = DVec3::from_array(medium.shape().extent());
        let direction = -view.as_dvec3().normalize();
        let shown = |k: usize| {
            let face = extent[(k + 1) % 3] * extent[(k + 2) % 3];
            if medium.shape().repeat[k] { 0.0 } else { direction[k].abs() * face }
        };
        let total = shown(0) + shown(1) + shown(2);
        assert!(total > 0.0, "a view of a medium that has an end");
        let shares = [shown(0) / total, (shown(0) + shown(1)) / total, 1.0];
        Self { extent, direction, shares }
    }

    /// A uniformly random point of the area shown, and its cell.
    fn start(&self, draws: &mut Draws) -> (DVec3, usize) {
        let choice = f64::from(draws.uniform());
        let k = self.shares.iter().position(|&share| choice < share).unwrap_or(2);
        let [u, v] = draws.pair();
        let [a, b] = [(k + 1) % 3, (k + 2) % 3];
        let mut point = DVec3::ZERO;
        point[k] = if self.direction[k] < 0.0 { self.extent[k] } else { 0.0 };
        point[a] = f64::from(u) * self.extent[a];
        point[b] = f64::from(v) * self.extent[b];
        let cell = |u: f32| (u * CELLS as f32) as usize;
        (point, (k * CELLS + cell(v)) * CELLS + cell(u))
    }
}

/// Follows walks from `view` into the medium; one observer a batch, returned in the order of the batches.
///
/// The result does not depend on the number of threads.
pub fn follow<O: Observer>(medium: &Medium, view: View, walks: Walks, observer: impl Fn() -> O + Sync) -> Vec<O> {
    let faces = Faces::new(medium, view);
    let batches = walks.count.div_ceil(BATCH);
    let follow_batch = |batch: usize| {
        let mut observer = observer();
        for k in batch * BATCH..walks.count.min((batch + 1) * BATCH) {
            let mut draws = Draws::new(Stream::new(walks.seed, k as u64));
            let (point, cell) = faces.start(&mut draws);
            match Walk::enter(medium, point, faces.direction) {
                Some(walk) => follow_one(walk, cell, &mut draws, &mut observer),
                None => observer.ends(cell),
            }
        }
        observer
    };
    (0..batches).into_par_iter().map(follow_batch).collect()
}

fn follow_one(mut walk: Walk<'_>, cell: usize, draws: &mut Draws, observer: &mut impl Observer) {
    let mut is_scattered = false;
    while let Some(meeting) = walk.fly(draws) {
        let posterior = walk.scatter(&meeting, draws);
        observer.reflects(meeting.voxel, posterior);
        is_scattered = true;
        if !walk.survives(draws) {
            return observer.ends(cell);
        }
    }
    // What shines through is not the volume's appearance.
    if is_scattered {
        observer.leaves(cell, walk.direction, walk.throughput, walk.survival);
    } else {
        observer.ends(cell);
    }
}

/// Which cells of a view show which voxel clusters: those whose first meeting lies in the cluster with a probability of at
/// least [`LEAST_SHARE`] (design 11).
#[derive(Clone, Debug, PartialEq)]
pub struct Masks {
    /// One bit a cluster, `[cell]`.
    pub clusters: Vec<u32>,
}

/// Probability of the first meeting above which a cell shows a cluster.
pub const LEAST_SHARE: f64 = 0.05;

/// Most voxel clusters.
pub const MAX_CLUSTERS: usize = 8;

impl Masks {
    /// The masks of `view`; `cluster` gives the cluster of each occupied voxel, below [`MAX_CLUSTERS`].
    pub fn new(medium: &Medium, cluster: &[u8], view: View, walks: Walks) -> Self {
        let faces = Faces::new(medium, view);
        // `[cell]`: walks, and of these first meetings by cluster.
        let mut cells = vec![(0, [0; MAX_CLUSTERS]); VIEW_CELLS];
        for k in 0..walks.count {
            let mut draws = Draws::new(Stream::new(walks.seed, k as u64));
            let (point, cell) = faces.start(&mut draws);
            let (count, first) = &mut cells[cell];
            *count += 1;
            let meeting = Walk::enter(medium, point, faces.direction).and_then(|mut walk| walk.fly(&mut draws));
            if let Some(meeting) = meeting {
                first[usize::from(cluster[meeting.voxel])] += 1;
            }
        }
        let mask = |&(walks, first): &(u32, [u32; MAX_CLUSTERS])| {
            let is_shown = |k: usize| first[k] > 0 && f64::from(first[k]) >= LEAST_SHARE * f64::from(walks);
            (0..MAX_CLUSTERS).filter(|&k| is_shown(k)).map(|k| 1 << k).sum()
        };
        Self { clusters: cells.iter().map(mask).collect() }
    }
}

/// Means of an image over all of its foreground and over the cells of each cluster.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewMeans {
    /// `[cluster][light][rgb]`; the last cluster stands for the whole foreground.
    pub means: Vec<Vec<[f64; 3]>>,
    /// Squared standard errors of these.
    pub variances: Vec<Vec<[f64; 3]>>,
    /// Share of the foreground's walks in the cells of each cluster; last the foreground's own, 1.
    pub shares: Vec<f64>,
}

/// Sums what walks bring, by cluster and light.
struct Sums<'a> {
    masks: &'a Masks,
    clusters: usize,
    lights: &'a [SmoothLight],
    walks: Vec<u64>,
    /// `[cluster][light]`: Σ and Σ² a channel.
    sums: Vec<[[f64; 3]; 2]>,
}

impl Sums<'_> {
    /// Cluster numbers that the cell shows; the last is the foreground.
    fn shown(&self, cell: usize) -> impl Iterator<Item = usize> + use<> {
        shown_clusters(self.masks.clusters[cell], self.clusters)
    }
}

/// Numbers of the clusters in the mask, and `clusters` for the foreground if there is any.
pub fn shown_clusters(mask: u32, clusters: usize) -> impl Iterator<Item = usize> {
    (0..=clusters).filter(move |&k| if k == clusters { mask != 0 } else { mask >> k & 1 == 1 })
}

impl Observer for Sums<'_> {
    fn leaves(&mut self, cell: usize, direction: Vec3, throughput: Vec3, _survival: f32) {
        for k in self.shown(cell) {
            self.walks[k] += 1;
            for (l, light) in self.lights.iter().enumerate() {
                let value = (throughput * light.radiance(direction)).as_dvec3().to_array();
                let [sum, squares] = &mut self.sums[k * self.lights.len() + l];
                (0..3).for_each(|c| sum[c] += value[c]);
                (0..3).for_each(|c| squares[c] += value[c] * value[c]);
            }
        }
    }

    fn ends(&mut self, cell: usize) {
        for k in self.shown(cell) {
            self.walks[k] += 1;
        }
    }
}

impl ViewMeans {
    /// The means of `view` under `lights`, over the cells of `clusters` clusters as `masks` has them.
    pub fn new(
        medium: &Medium,
        view: View,
        lights: &[SmoothLight],
        (masks, clusters): (&Masks, usize),
        walks: Walks,
    ) -> Self {
        let empty = || Sums {
            masks,
            clusters,
            lights,
            walks: vec![0; clusters + 1],
            sums: vec![[[0.0; 3]; 2]; (clusters + 1) * lights.len()],
        };
        let mut total = empty();
        for batch in follow(medium, view, walks, empty) {
            for (sum, part) in total.walks.iter_mut().zip(batch.walks) {
                *sum += part;
            }
            for (sum, part) in total.sums.as_flattened_mut().iter_mut().zip(batch.sums.as_flattened()) {
                (0..3).for_each(|c| sum[c] += part[c]);
            }
        }
        let count = |k: usize| (total.walks[k] as f64).max(1.0);
        let table = |value: &dyn Fn(usize, usize, usize) -> f64| -> Vec<Vec<[f64; 3]>> {
            let light = |k: usize, l: usize| std::array::from_fn(|c| value(k, k * lights.len() + l, c));
            (0..=clusters).map(|k| (0..lights.len()).map(|l| light(k, l)).collect()).collect()
        };
        let mean = |k: usize, at: usize, c: usize| total.sums[at][0][c] / count(k);
        Self {
            means: table(&mean),
            variances: table(&|k, at, c| {
                // Rounding may leave a hair less than nothing where all walks bring the same.
                (total.sums[at][1][c] / count(k) - mean(k, at, c).powi(2)).max(0.0) / count(k)
            }),
            shares: total.walks.iter().map(|&walks| walks as f64 / count(clusters)).collect(),
        }
    }
}
