//! M, N and rank by the error that each saves.
//!
//! F of both surfaces is found once on few directions and the finest patches ([`Scout`]). Tables of any M are merged from
//! it and tables of any rank are fitted to it, so what T · S leaves is known for all of them. What interpolation costs is
//! found at directions between the nodes, with all of the nodes and with every other one, which tells how it falls with N.
//! The smallest tables are refined, always by what lowers ε most, until the target is met or nothing lowers ε by a tenth
//! of itself.
//!
//! ε is predicted over **one grid of patches**, the finest, whatever M is: over patches of T itself a level with M = 1 is
//! judged by the mean of the map, which any S can match, and looks better the less it can do. On the common grid T is
//! read as a renderer reads it, interpolated. The light is direct, for interreflection varies less over map and directions.

use super::coarse::{CoarseSurface, coarse_reflectance};
use super::fine::fine_reflectance;
use super::fit::{PRIOR, fit_scaling, node_error, part_means};
use super::reflectance::{PatchReflectance, TableDirections, ThinnedDirections, pair_count};
use super::{FineSurface, LevelSettings, LightTransport, smoothing};
use crate::geometry::HeightField;
use crate::math::rng::Stream;
use formats::lookup;
use std::collections::BTreeMap;

/// Patches per axis that are tried.
const PATCHES: [usize; 5] = [1, 2, 4, 8, 16];

/// Direction cells per axis that are tried.
const DIRECTIONS: [usize; 4] = [7, 11, 15, 21];

/// Ranks that are tried.
const RANKS: [usize; 3] = [1, 2, 3];

/// A refinement is kept if it leaves at most this share of ε.
const KEPT_SHARE: f64 = 0.9;

/// Pairs of directions over all patches, at most: 24 MB a table. M = 16 goes up to N = 11, 8 to 15, 4 to 21.
const MOST_VALUES: usize = 2_000_000;

/// Strata per axis of the directions between the nodes.
const STRATA: usize = 5;

/// Half the width of the square that they lie in, |2s − 1| <= 6/7: between the outermost nodes of N = 7, at 74.6°.
const REACH: f32 = 6.0 / 7.0;

/// Stream of their jitter.
const BETWEEN: u64 = 0x4e00;

/// Falling of the interpolation error with N: 2 where S is smooth, 1 where it has kinks.
const ORDERS: [f64; 2] = [1.0, 2.0];

/// Sizes of a level's tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TableSizes {
    /// Patches of T along u and v.
    pub patches: [usize; 2],
    /// Direction cells of S per axis (N).
    pub directions: usize,
    /// Terms of the product.
    pub rank: usize,
}

impl TableSizes {
    /// Bytes of T and S before compression: four half floats a texel.
    pub fn bytes(self) -> u64 {
        8 * self.rank as u64 * (self.directions.pow(4) + self.patches[0] * self.patches[1]) as u64
    }

    fn fit_memory(self) -> bool {
        self.patches[0] * self.patches[1] * pair_count(self.directions.pow(2)) <= MOST_VALUES
    }
}

/// Tables of certain sizes and what they would give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alternative {
    /// The sizes.
    pub sizes: TableSizes,
    /// Predicted ε below 75°, over the common grid of patches.
    pub error: f64,
}

/// What was chosen, and what was found on the way that the level is made of.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The sizes.
    pub sizes: TableSizes,
    /// Predicted ε below 75°; `None` where nothing was to be chosen.
    pub predicted: Option<f64>,
    /// What other sizes would have given, the chosen ones among them.
    pub alternatives: Vec<Alternative>,
    /// The coarse heights, smoothed where they fold, if they were found.
    pub heights: Option<HeightField>,
    /// F of the fine and of the coarse surface, where what the choice was made on serves as it is.
    pub tables: Option<[PatchReflectance; 2]>,
}

impl Choice {
    /// No choice.
    pub fn fixed(sizes: TableSizes) -> Self {
        Self { sizes, predicted: None, alternatives: Vec::new(), heights: None, tables: None }
    }
}

/// F of both surfaces under direct light, on few directions and the finest patches.
struct Scout {
    directions: TableDirections,
    patches: [usize; 2],
    f_fine: PatchReflectance,
    f_coarse: PatchReflectance,
    heights: HeightField,
    /// Texels of the fine surface.
    texels: [usize; 2],
    /// Interpolation error of S on these directions, and how it falls with N.
    interpolation: [f64; 2],
}

impl Scout {
    fn new(fine: &FineSurface, settings: &LevelSettings, surface: &CoarseSurface<'_>) -> Self {
        let few = settings.directions.map_or(DIRECTIONS[0], |n| n.min(DIRECTIONS[0]));
        let directions = TableDirections::new(few);
        let between = directions_between();
        let all = directions.clone().with(&between);
        let patches = surface.heights.size().map(|cells| finest(settings.patches, cells));
        let f_fine = fine_reflectance(fine, patches, &all, &mut |_| {});
        let heights = smoothing::smoothed(&fine.heights, settings.factor, surface, &f_fine, &directions);
        let f_coarse = coarse_reflectance(&CoarseSurface { heights: &heights, ..*surface }, patches, &all);
        let interpolation = interpolation(&f_fine, &f_coarse, &all, between.len());
        let [f_fine, f_coarse] = [f_fine, f_coarse].map(|f| f.of_first(directions.len()));
        Self { directions, patches, f_fine, f_coarse, heights, texels: fine.heights.size(), interpolation }
    }

    /// Whether its own tables are what `sizes` and `light` ask for.
    fn serves(&self, sizes: TableSizes, light: LightTransport) -> bool {
        sizes.directions == self.directions.resolution && light == LightTransport::Direct
    }

    /// F of the fine and of the coarse surface over larger patches.
    fn merged(&self, patches: [usize; 2]) -> [PatchReflectance; 2] {
        [
            self.f_fine.merged(self.patches, patches, self.texels),
            self.f_coarse.merged(self.patches, patches, self.heights.size()),
        ]
    }

    /// ε at the nodes over the common grid, with T and S fitted to `patches`.
    fn factor_error(&self, patches: [usize; 2], rank: usize) -> f64 {
        let [f_fine, f_coarse] = self.merged(patches);
        let boundary = self.heights.boundary();
        let mut factors = fit_scaling(&f_fine, &f_coarse, &self.directions, rank);
        let stored = factors.stored_spatial(&f_coarse, patches, boundary);
        let read: Vec<_> = stored.iter().map(|t| part_means(t, patches, self.patches, boundary)).collect();
        node_error(&self.f_fine, &self.f_coarse, &self.directions, &read, &factors.angular)
    }

    /// What interpolation between `directions` cells per axis costs.
    fn interpolation_error(&self, directions: usize) -> f64 {
        let [error, order] = self.interpolation;
        error * (self.directions.resolution as f64 / directions as f64).powf(order)
    }
}

/// Directions below 75° that are no nodes of any table.
fn directions_between() -> Vec<[f32; 3]> {
    let stream = Stream::new(0, BETWEEN);
    let jittered = |k: usize| {
        let [u, v] = stream.uniform_pair(k as u64);
        let s = [k % STRATA, k / STRATA].map(|k| k as f32);
        let square = [s[0] + u, s[1] + v].map(|x| 0.5 + REACH * (x / STRATA as f32 - 0.5));
        lookup::direction_of(square)
    };
    (0..STRATA * STRATA).map(jittered).collect()
}

/// What interpolation of S = F_fine/F_coarse of the map's mean costs at the last `between` directions, over F_fine; and
/// the order that it falls with, from the error with every other node.
fn interpolation(
    f_fine: &PatchReflectance,
    f_coarse: &PatchReflectance,
    directions: &TableDirections,
    between: usize,
) -> [f64; 2] {
    let all: Vec<usize> = (0..directions.len()).collect();
    let [fine, coarse] = [f_fine, f_coarse].map(|f| smoothing::means(f, &all));
    let error = |step: usize| {
        let kept = directions.every(step);
        interpolation_error([&fine, &coarse], directions, &kept, between)
    };
    let [all, every_other] = [1, 2].map(error);
    let order = if all > 0.0 && every_other > 0.0 { (every_other / all).log2() } else { ORDERS[0] };
    [all, order.clamp(ORDERS[0], ORDERS[1])]
}

/// Root mean square error of S between the nodes `kept` times F_coarse, over that of F_fine; `means` are the means of
/// both over the map, `[i][o]`.
fn interpolation_error(
    [fine, coarse]: [&[[f64; 3]]; 2],
    directions: &TableDirections,
    kept: &ThinnedDirections,
    between: usize,
) -> f64 {
    let count = directions.len();
    let taps = |w: [f32; 3]| -> Vec<(usize, f64)> {
        let n = directions.resolution as f32;
        let size = kept.directions.resolution;
        // the kept nodes are the first of every `step`, so that their grid is wider than the square by a part of a step
        let step = if size > 1 { (kept.nodes[1] - kept.nodes[0]) as f32 } else { 1.0 };
        let square = lookup::square_of(w).map(|s| ((s * n - 0.5) / step + 0.5) / size as f32);
        let taps = lookup::bilinear_taps(square, [size, size], lookup::Boundary::Clamp);
        taps.into_iter().map(|(k, weight)| (kept.nodes[k], f64::from(weight))).collect()
    };
    let first = count - between;
    let taps: Vec<_> = directions.vectors[first..].iter().map(|&w| taps(w)).collect();
    let [mut error, mut total] = [0.0; 2];
    for channel in 0..3 {
        let prior = PRIOR * coarse.iter().map(|f| f[channel]).sum::<f64>() / coarse.len() as f64 + f64::MIN_POSITIVE;
        let s = |k: usize| (fine[k][channel] + prior) / (coarse[k][channel] + prior);
        for i in 0..between {
            for o in 0..i {
                let read = |&(a, wa): &(usize, f64)| -> f64 {
                    taps[o].iter().map(|&(b, wb)| wa * wb * s(a * count + b)).sum()
                };
                let k = (first + i) * count + first + o;
                error += (taps[i].iter().map(read).sum::<f64>() * coarse[k][channel] - fine[k][channel]).powi(2);
                total += fine[k][channel].powi(2);
            }
        }
    }
    if total > 0.0 { (error / total).sqrt() } else { 0.0 }
}

/// Patches along an axis of so many cells on the common grid: a multiple of all that are tried.
fn finest(wanted: Option<usize>, cells: usize) -> usize {
    let mut patches = wanted.unwrap_or(1).clamp(1, cells);
    while 2 * patches <= cells.min(PATCHES[4]) {
        patches *= 2;
    }
    patches
}

/// Chooses what `settings` leave open, for a level whose heights before smoothing are those of `surface`.
pub fn choose(
    fine: &FineSurface,
    settings: &LevelSettings,
    surface: &CoarseSurface<'_>,
    on_stage: &mut dyn FnMut(&'static str),
) -> Choice {
    if let Some(sizes) = settings.fixed_sizes(surface.heights.size()) {
        return Choice::fixed(sizes);
    }
    on_stage("choose");
    let scout = Scout::new(fine, settings, surface);
    let (sizes, predicted, alternatives) = best_sizes(&scout, settings);
    let tables = scout.serves(sizes, settings.light).then(|| scout.merged(sizes.patches));
    Choice { sizes, predicted: Some(predicted), alternatives, heights: Some(scout.heights), tables }
}

/// The sizes, the ε that is predicted for them, and what others would have given.
fn best_sizes(scout: &Scout, settings: &LevelSettings) -> (TableSizes, f64, Vec<Alternative>) {
    let mut search = Search::new(scout, settings);
    let mut sizes = search.first();
    loop {
        let error = search.error(sizes);
        if error <= settings.error {
            break;
        }
        let refined = search.refinements(sizes).into_iter().map(|refined| (search.error(refined), refined));
        let kept: Vec<_> = refined.filter(|(refined, _)| *refined <= KEPT_SHARE * error).collect();
        match kept.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) {
            Some((_, best)) => sizes = best,
            None => break,
        }
    }
    (sizes, search.error(sizes), search.alternatives(sizes))
}

/// What may be chosen, and what has been found of it.
struct Search<'a> {
    scout: &'a Scout,
    patches: Vec<[usize; 2]>,
    directions: Vec<usize>,
    ranks: Vec<usize>,
    /// ε at the nodes by patches and rank.
    known: BTreeMap<([usize; 2], usize), f64>,
}

impl<'a> Search<'a> {
    fn new(scout: &'a Scout, settings: &LevelSettings) -> Self {
        let on_grid = |m: usize| scout.patches.map(|most| m.min(most));
        let cells = scout.heights.size();
        let mut patches = match settings.patches {
            Some(fixed) => vec![cells.map(|cells| fixed.clamp(1, cells))],
            None => PATCHES.map(on_grid).to_vec(),
        };
        patches.dedup();
        Self {
            scout,
            patches,
            directions: settings.directions.map_or(DIRECTIONS.to_vec(), |fixed| vec![fixed]),
            ranks: settings.rank.map_or(RANKS.to_vec(), |fixed| vec![fixed]),
            known: BTreeMap::new(),
        }
    }

    /// The smallest tables.
    fn first(&self) -> TableSizes {
        TableSizes { patches: self.patches[0], directions: self.directions[0], rank: self.ranks[0] }
    }

    /// Predicted ε over the common grid: the parts are independent.
    fn error(&mut self, sizes: TableSizes) -> f64 {
        let scout = self.scout;
        let factors = self
            .known
            .entry((sizes.patches, sizes.rank))
            .or_insert_with(|| scout.factor_error(sizes.patches, sizes.rank));
        factors.hypot(scout.interpolation_error(sizes.directions))
    }

    /// On from `sizes`: the next N; or this and the next rank, with this and each larger M, for M alone may save little, and
    /// rank is nothing without M.
    fn refinements(&self, sizes: TableSizes) -> Vec<TableSizes> {
        let ranks: Vec<usize> = self.ranks.iter().copied().filter(|rank| *rank >= sizes.rank).take(2).collect();
        let directions = self.directions.iter().find(|&&n| n > sizes.directions);
        let directions = directions.map(|&directions| self.within_memory(TableSizes { directions, ..sizes }));
        let patches = self.patches.iter().skip_while(|&&patches| patches != sizes.patches);
        let factors = patches.flat_map(|&patches| ranks.iter().map(move |&rank| TableSizes { patches, rank, ..sizes }));
        directions.into_iter().chain(factors.filter(|refined| *refined != sizes && refined.fit_memory())).collect()
    }

    /// `sizes` with fewer patches where memory asks for it.
    fn within_memory(&self, sizes: TableSizes) -> TableSizes {
        let no_more = self.patches.iter().rev().skip_while(|&&patches| patches != sizes.patches);
        let mut tried = no_more.map(|&patches| TableSizes { patches, ..sizes });
        tried.find(|sizes| sizes.fit_memory()).unwrap_or(TableSizes { patches: self.patches[0], ..sizes })
    }

    /// What every other M, N and rank would have given, one changed at a time.
    fn alternatives(&mut self, chosen: TableSizes) -> Vec<Alternative> {
        let patches = self.patches.iter().map(|&patches| self.within_memory(TableSizes { patches, ..chosen }));
        let directions = self.directions.iter();
        let directions = directions.map(|&directions| self.within_memory(TableSizes { directions, ..chosen }));
        let ranks = self.ranks.iter().map(|&rank| TableSizes { rank, ..chosen });
        let mut all: Vec<TableSizes> = patches.chain(directions).chain(ranks).collect();
        all.sort();
        all.dedup();
        all.into_iter().map(|sizes| Alternative { sizes, error: self.error(sizes) }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Means of F over the map at all nodes and the directions between them: F_coarse = 1, F_fine = S.
    fn tables(directions: &TableDirections, s: impl Fn([f32; 2]) -> f64) -> [Vec<[f64; 3]>; 2] {
        let squares: Vec<[f32; 2]> = directions.vectors.iter().map(|&w| lookup::square_of(w)).collect();
        let pairs = || squares.iter().flat_map(|&i| squares.iter().map(move |&o| (i, o)));
        [pairs().map(|(i, o)| [s(i) + s(o); 3]).collect(), pairs().map(|_| [1.0; 3]).collect()]
    }

    fn errors(s: impl Fn([f32; 2]) -> f64) -> [f64; 2] {
        let between = directions_between();
        let directions = TableDirections::new(7).with(&between);
        let [fine, coarse] = tables(&directions, s);
        [1, 2].map(|step| interpolation_error([&fine, &coarse], &directions, &directions.every(step), between.len()))
    }

    #[test]
    fn a_linear_scaling_is_read_without_error_between_the_nodes() {
        // the directions themselves are rounded to f32, and the prior is a millionth
        assert!(errors(|s| 1.0 + f64::from(s[0]) - 0.5 * f64::from(s[1])).iter().all(|error| *error < 1e-5));
    }

    #[test]
    fn a_smooth_scaling_falls_with_the_square_of_n() {
        let [all, every_other] = errors(|s| 1.0 + f64::from(s[0]).powi(2) + f64::from(s[1]).powi(2));
        // 25 directions only, and t(1 − t) of each is another on either grid
        assert!(all > 1e-4 && (1.5..2.5).contains(&(every_other / all).log2()), "{all} {every_other}");
    }

    #[test]
    fn directions_between_the_nodes_are_below_75_degrees() {
        let directions = directions_between();
        assert_eq!(directions.len(), STRATA * STRATA);
        assert!(directions.iter().all(|w| w[2] > super::super::fit::COS_75));
    }

    #[test]
    fn the_common_grid_holds_whole_patches_of_every_choice() {
        for cells in 1..40 {
            let grid = finest(None, cells);
            assert!(
                grid <= cells && PATCHES.iter().all(|&m| grid.is_multiple_of(m.min(grid))),
                "{cells} cells: {grid}"
            );
            for wanted in [1, 3, 5, 16, 64] {
                let grid = finest(Some(wanted), cells);
                assert!(
                    grid <= cells && grid.is_multiple_of(wanted.min(cells)),
                    "{cells} cells, {wanted} patches: {grid}"
                );
            }
        }
    }
}
