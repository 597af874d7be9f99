//! The factorisation taken apart: how many products the ratio needs, what each size brings, and other ways to T and S.

use std::path::Path;

use nalgebra::DMatrix;
use serde::Serialize;

use super::{TablesRow, Trial};
use crate::build::{Input, SurfaceSpec, input};
use crate::prefilter::surface::fit::rivals::{averages_of_ratios, rank_one, ratio_of_averages, ratios};
use crate::prefilter::surface::fit::{COS_75, Factors, Polar, fit_scaling, node_figures};
use crate::prefilter::surface::{LevelSettings, LevelTables, LightTransport, level_tables};

/// The sizes about which one at a time is varied.
const MIDDLE: [usize; 3] = [4, 15, 1];

/// Values of N, M, rank and lobes.
const DIRECTIONS: [usize; 5] = [5, 7, 11, 15, 21];
const PATCHES: [usize; 5] = [1, 2, 4, 8, 16];
const RANKS: [usize; 3] = [1, 2, 3];
const LOBES: [usize; 8] = [1, 2, 3, 4, 5, 6, 7, 8];

/// Tables that factorisations are compared on: patches as fine as published, and directions that leave them small.
const COMPARED: [usize; 2] = [16, 11];

/// Singular values that are written.
const SINGULAR_VALUES: usize = 12;

/// What was found of one level.
#[derive(Clone, Debug, Serialize)]
pub struct Study {
    /// Surface.
    pub name: String,
    /// Number of the level.
    pub level: u32,
    /// Singular values of R = F_fine/F_coarse below 75°, green, as shares of the whole squared energy, largest first.
    pub singular_shares: Vec<f64>,
    /// Patches and directions of the tables that these and the methods are of.
    pub compared_on: [usize; 2],
    /// ε of levels in which one size is varied, by exact ray casts over one grid of patches.
    pub sizes: Vec<SizeRow>,
    /// Ways to T and S, by their error at the nodes.
    pub methods: Vec<MethodRow>,
}

/// A level of certain sizes.
#[derive(Clone, Debug, Serialize)]
pub struct SizeRow {
    /// What was varied.
    pub varied: &'static str,
    /// Sizes, cost and errors.
    #[serde(flatten)]
    pub tables: TablesRow,
}

/// A way to T and S.
#[derive(Clone, Debug, Serialize)]
pub struct MethodRow {
    /// Its name.
    pub method: String,
    /// ε at the nodes, both directions below 75°.
    pub below_75: f64,
    /// Σ difference / Σ F_fine, below 75°.
    pub bias: f64,
    /// ε at the nodes with a direction above 75°.
    pub above_75: f64,
}

/// Studies level `index` of `spec`; `on_step` hears what is done. The error is one line.
pub fn study(spec: &SurfaceSpec, folder: &Path, index: usize, on_step: &mut dyn FnMut(&str)) -> Result<Study, String> {
    let input = input::read(spec, folder).map_err(|error| error.to_string())?;
    on_step(&format!("{}: level {index}, factorisations", spec.name));
    let [patches, directions] = COMPARED;
    let settings = LevelSettings {
        patches: Some(patches),
        directions: Some(directions),
        rank: Some(1),
        // paths of interreflection are too noisy over so many patches
        light: LightTransport::Direct,
        ..spec.levels[index - 1]
    };
    let tables = level_tables(&input.fine, &settings);
    let (singular_shares, svd) = singular_values(&tables);
    let methods = methods(&tables, svd);
    let sizes = sizes(spec, &input, index, on_step)?;
    let (name, level) = (spec.name.clone(), index as u32);
    Ok(Study { name, level, singular_shares, compared_on: COMPARED, sizes, methods })
}

/// Levels about the middle, one size varied at a time; the middle itself is built once.
fn sizes(
    spec: &SurfaceSpec,
    input: &Input,
    index: usize,
    on_step: &mut dyn FnMut(&str),
) -> Result<Vec<SizeRow>, String> {
    let [patches, directions, rank] = MIDDLE.map(Some);
    let middle = LevelSettings { patches, directions, rank, lobes: None, ..spec.levels[index - 1] };
    let mut tried = vec![("–", middle)];
    tried.extend(others(DIRECTIONS, MIDDLE[1]).map(|n| ("N", LevelSettings { directions: Some(n), ..middle })));
    tried.extend(others(PATCHES, MIDDLE[0]).map(|m| ("M", LevelSettings { patches: Some(m), ..middle })));
    tried.extend(others(RANKS, MIDDLE[2]).map(|r| ("rank", LevelSettings { rank: Some(r), ..middle })));
    tried.extend(LOBES.into_iter().map(|j| ("lobes", LevelSettings { lobes: Some(j), ..middle })));
    tried
        .into_iter()
        .map(|(varied, settings)| {
            let LevelSettings { patches, directions, rank, lobes, .. } = settings;
            let [m, n, rank] = [patches, directions, rank].map(|size| size.unwrap_or(0));
            let lobes = lobes.map_or("auto".into(), |lobes| lobes.to_string());
            on_step(&format!("{}: level {index}, M {m}, N {n}, rank {rank}, {lobes} lobes", spec.name));
            let mut tried = spec.clone();
            tried.levels[index - 1] = settings;
            Ok(SizeRow { varied, tables: Trial::build(&tried, input, index)?.row(input) })
        })
        .collect()
}

/// The values apart from that of the middle.
fn others<const K: usize>(values: [usize; K], middle: usize) -> impl Iterator<Item = usize> {
    values.into_iter().filter(move |value| *value != middle)
}

/// Shares of the squared singular values of R below 75°, and the factors of the largest one of each channel.
///
/// A pair of different directions stands for both orders, so its column is scaled by √2.
fn singular_values(tables: &LevelTables) -> (Vec<f64>, Factors) {
    let count = tables.directions.len();
    let below = |i: usize| tables.directions.vectors[i][2] > COS_75;
    let pairs = (0..count).flat_map(|i| (0..=i).map(move |o| (i, o)));
    let is_below: Vec<bool> = pairs.clone().map(|(i, o)| below(i) && below(o)).collect();
    let scale: Vec<f64> = pairs.map(|(i, o)| if i == o { 1.0 } else { 2.0_f64.sqrt() }).collect();
    let mut shares = Vec::new();
    let channels = [0, 1, 2].map(|channel| {
        let ratios = ratios(&tables.fine, &tables.coarse, channel);
        let kept: Vec<usize> = (0..is_below.len()).filter(|&k| is_below[k]).collect();
        let matrix = DMatrix::from_fn(ratios.len(), kept.len(), |p, k| ratios[p][kept[k]] * scale[kept[k]]);
        // R Rᵀ is small, and its eigenvalues are the squares
        let eigen = (&matrix * matrix.transpose()).symmetric_eigen();
        let total: f64 = eigen.eigenvalues.iter().sum();
        let mut values: Vec<f64> = eigen.eigenvalues.iter().map(|value| value.max(0.0) / total).collect();
        let largest = eigen.eigenvalues.imax();
        let vector = eigen.eigenvectors.column(largest);
        let mean = vector.iter().sum::<f64>() / vector.len() as f64;
        let spatial: Vec<f64> = vector.iter().map(|t| t / mean).collect();
        let square: f64 = spatial.iter().map(|t| t * t).sum();
        // S = Tᵀ R / |T|² for all pairs, those above 75° included
        let angular: Vec<f64> = (0..is_below.len())
            .map(|k| ratios.iter().zip(&spatial).map(|(row, t)| row[k] * t).sum::<f64>() / square)
            .collect();
        values.sort_by(|a, b| b.total_cmp(a));
        values.truncate(SINGULAR_VALUES);
        if channel == 1 {
            shares = values;
        }
        (spatial, angular)
    });
    let factors = rank_one([0, 1, 2].map(|c| &channels[c].0[..]), [0, 1, 2].map(|c| &channels[c].1[..]));
    (shares, factors)
}

/// All ways side by side.
fn methods(tables: &LevelTables, svd: Factors) -> Vec<MethodRow> {
    let LevelTables { directions, fine, coarse } = tables;
    let least_squares = [1, 2, 3]
        .map(|rank| (format!("alternating least squares, rank {rank}"), fit_scaling(fine, coarse, directions, rank)));
    let others = [
        ("ratio of averages".to_string(), ratio_of_averages(fine, coarse)),
        ("averages of ratios (4.22–4.24)".to_string(), averages_of_ratios(fine, coarse)),
        ("singular value decomposition of the ratio".to_string(), svd),
    ];
    let row = |(method, factors): (String, Factors)| {
        let of = |polar| node_figures(fine, coarse, directions, [&factors.spatial, &factors.angular], polar);
        let ([below_75, bias], [above_75, _]) = (of(Polar::Below75), of(Polar::Above75));
        MethodRow { method, below_75, bias, above_75 }
    };
    least_squares.into_iter().chain(others).map(row).collect()
}
