//! A sweep and a study as text.

use formats::asset::Figure;
use serde_json::json;

use super::study::Study;
use super::{LevelTradeoff, Row, TablesRow, Tradeoff};
use crate::report::table::{aligned, grid, percent};

/// The sweep as a table, one row a target.
pub fn table(tradeoff: &Tradeoff) -> String {
    let header = [
        "name",
        "level",
        "target",
        "M",
        "N",
        "rank",
        "lobes",
        "ε < 75° (own M)",
        "ε < 75°",
        "ε > 75°",
        "image",
        "mean",
    ];
    let header = header.into_iter().chain(["CPU seconds", "bytes"]);
    let mut rows = vec![header.map(String::from).collect()];
    for level in &tradeoff.levels {
        rows.extend(level.rows.iter().map(|row| cells(&tradeoff.name, level, row)));
    }
    aligned(&rows)
}

fn cells(name: &str, level: &LevelTradeoff, row: &Row) -> Vec<String> {
    let image = row.image.map_or("–".into(), |mse| format!("{:.2} %", 100.0 * mse.value.max(0.0).sqrt()));
    let mean = row
        .image_mean
        .map_or("–".into(), |mean| format!("{:+.2} ± {:.2} %", 100.0 * mean.value, 100.0 * mean.standard_error()));
    let mut cells = vec![name.into(), level.level.to_string(), format!("{} %", shortest(100.0 * row.target))];
    cells.extend(sizes(&row.tables));
    cells.extend([percent(row.own), percent(row.tables.below_75), percent(row.tables.above_75), image, mean]);
    cells.extend([format!("{:.2}", row.tables.cpu_seconds), row.tables.bytes.to_string()]);
    cells
}

/// M, N, rank and lobes.
fn sizes(tables: &TablesRow) -> [String; 4] {
    [grid(tables.patches), tables.directions.to_string(), tables.rank.to_string(), tables.lobes.to_string()]
}

/// A number without the digits that `f64` alone has.
fn shortest(x: f64) -> String {
    format!("{x:.4}").trim_end_matches('0').trim_end_matches('.').into()
}

/// The levels of a sweep as JSON, one row of the table a line.
pub fn level_lines(tradeoff: &Tradeoff) -> String {
    let line = |level: &LevelTradeoff, row: &Row| {
        format!("{}\n", json!({ "name": tradeoff.name, "level": level.level, "factor": level.factor, "row": row }))
    };
    tradeoff.levels.iter().flat_map(|level| level.rows.iter().map(move |row| line(level, row))).collect()
}

/// The study as three tables.
pub fn study_tables(study: &Study) -> String {
    let [m, n] = study.compared_on;
    let head = |names: &[&str]| names.iter().map(|name| name.to_string()).collect::<Vec<String>>();
    let shares: Vec<String> = study.singular_shares.iter().map(|share| shortest(100.0 * share)).collect();
    let mut sizes = vec![head(&["varied", "M", "N", "rank", "lobes", "ε < 75°", "ε > 75°", "CPU seconds", "bytes"])];
    sizes.extend(study.sizes.iter().map(|row| {
        let [below, above]: [Figure; 2] = [row.tables.below_75, row.tables.above_75];
        let mut cells = vec![row.varied.to_string()];
        cells.extend(self::sizes(&row.tables));
        cells.extend([percent(below), percent(above)]);
        cells.extend([format!("{:.2}", row.tables.cpu_seconds), row.tables.bytes.to_string()]);
        cells
    }));
    let mut methods = vec![head(&["method", "ε < 75°", "bias", "ε > 75°"])];
    methods.extend(study.methods.iter().map(|row| {
        let figures = [row.below_75, row.bias, row.above_75].map(|x| format!("{:.2} %", 100.0 * x));
        [row.method.clone()].into_iter().chain(figures).collect()
    }));
    let (name, level) = (&study.name, study.level);
    format!(
        "{name}, level {level}\n\nsingular values of F_fine/F_coarse below 75°, M {m}, N {n}: % of the squared energy\n{}\n\n\
         one size varied at a time, ε by ray casts over one grid\n{}\nways to T and S, on the nodes, M {m}, N {n}\n{}",
        shares.join("  "),
        aligned(&sizes),
        aligned(&methods)
    )
}
