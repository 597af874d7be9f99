//! Columns of text, and the table at the end of a build.

use formats::asset::Figure;

use crate::build::volume::VolumeRecord;
use crate::build::{LevelRecord, StageSeconds};

/// Rows as aligned columns, the last one ragged; the first row is the header.
pub(super) fn aligned(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| rows.iter().filter_map(|row| row.get(column)).map(|c| c.chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|column| width(column).unwrap_or(0)).collect();
    let line = |row: &Vec<String>| {
        let cells: Vec<String> = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:width$}")).collect();
        cells.join("  ").trim_end().to_owned() + "\n"
    };
    rows.iter().map(line).collect()
}

/// The levels that were built, one a row; empty where there are none.
pub fn level_table(records: &[LevelRecord]) -> String {
    if records.is_empty() {
        return String::new();
    }
    let header =
        ["name", "level", "factor", "cells", "lobes", "M", "N", "rank", "ε < 75°", "ε > 75°", "on node", "bytes"];
    let mut rows = vec![header.into_iter().chain(["CPU seconds"]).map(String::from).collect()];
    rows.extend(records.iter().map(row));
    aligned(&rows)
}

/// One level.
fn row(record: &LevelRecord) -> Vec<String> {
    vec![
        record.name.clone(),
        record.level.to_string(),
        factor(record.factor),
        format!("{} × {}", record.cells[0], record.cells[1]),
        record.lobes.to_string(),
        grid(record.patches),
        record.directions.to_string(),
        record.rank.to_string(),
        record.error.map_or("–".into(), |error| percent(error.below_75)),
        record.error.map_or("–".into(), |error| percent(error.above_75)),
        format!("{:.2} %", record.on_node * 100.0),
        record.bytes.values().sum::<u64>().to_string(),
        stages(&record.stages),
    ]
}

/// `4` or `4 × 2`.
pub(super) fn grid([u, v]: [usize; 2]) -> String {
    if u == v { u.to_string() } else { format!("{u} × {v}") }
}

/// The levels of volumes that were built, one a row; empty where there are none.
pub fn volume_table(records: &[VolumeRecord]) -> String {
    if records.is_empty() {
        return String::new();
    }
    let header = ["name", "level", "voxels", "occupied", "lobes", "averages", "error", "bytes", "CPU seconds"];
    let mut rows = vec![header.map(String::from).to_vec()];
    rows.extend(records.iter().map(|record| {
        let [x, y, z] = record.size;
        let error =
            |which: usize| record.validation.map_or("–".into(), |errors| format!("{:.2} %", errors[which] * 100.0));
        vec![
            record.name.clone(),
            record.level.to_string(),
            format!("{x} × {y} × {z}"),
            record.occupied.to_string(),
            record.lobes.to_string(),
            error(0),
            error(1),
            record.bytes.values().sum::<u64>().to_string(),
            stages(&record.stages),
        ]
    }));
    aligned(&rows)
}

/// `8` or `8.03 × 7.97`.
pub(super) fn factor([u, v]: [f64; 2]) -> String {
    let short = |f: f64| {
        let text = format!("{f:.2}");
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    };
    if u == v { short(u) } else { format!("{} × {}", short(u), short(v)) }
}

/// A figure with its standard error, in percent.
pub(super) fn percent(figure: Figure) -> String {
    format!("{:.2} ± {:.2} %", figure.value * 100.0, figure.standard_error * 100.0)
}

/// `1.25: read 0.05, fit 1.20`.
pub(super) fn stages(stages: &[StageSeconds]) -> String {
    let total: f64 = stages.iter().map(|stage| stage.cpu_seconds).sum();
    let parts: Vec<String> = stages.iter().map(|s| format!("{} {:.2}", s.stage, s.cpu_seconds)).collect();
    format!("{total:.2}: {}", parts.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let rows = [["a", "ε"], ["long", "x"]].map(|row| row.map(String::from).to_vec());
        assert_eq!(aligned(&rows), "a     ε\nlong  x\n");
    }

    #[test]
    fn factors_are_short() {
        assert_eq!(factor([8.0, 8.0]), "8");
        assert_eq!(factor([100.0, 8.031]), "100 × 8.03");
    }
}
