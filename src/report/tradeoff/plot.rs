//! A sweep as a drawing.

use maud::{Markup, html};

use super::{LevelTradeoff, Row, Tradeoff};
use crate::report::metrics::NORMAL_95;
use crate::report::svg::{Axis, Legend, Line, Plot, Point, Scale, Series, Style};

/// Size of one plot, and height of the line above a level's plots.
const PLOT: [u32; 2] = [400, 300];
const TITLE: u32 = 24;

/// What the x axis of a plot shows of a row.
type Cost = (&'static str, fn(&Row) -> f64);

const COSTS: [Cost; 2] =
    [("CPU seconds to compile", |row| row.tables.cpu_seconds), ("KB on disk", |row| row.tables.bytes as f64 / 1000.0)];

/// The sweep as an SVG file: a line of plots a level, error against CPU seconds and against bytes.
pub fn plots(tradeoff: &Tradeoff) -> String {
    let height = (PLOT[1] + TITLE) * tradeoff.levels.len() as u32;
    let width = PLOT[0] * COSTS.len() as u32;
    let drawing = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox=(format!("0 0 {width} {height}")) width=(width) height=(height) {
            rect width="100%" height="100%" fill="#ffffff" {}
            @for (place, level) in tradeoff.levels.iter().enumerate() {
                @let top = (PLOT[1] + TITLE) * place as u32;
                text x="16" y=(top + 18) font-family="system-ui, sans-serif" font-size="14" {
                    (tradeoff.name) ", level " (level.level) ", factor " (format!("{:.3}", level.factor[0]))
                }
                @for (column, cost) in COSTS.into_iter().enumerate() {
                    svg x=(PLOT[0] * column as u32) y=(top + TITLE) width=(PLOT[0]) height=(PLOT[1]) {
                        (plot(level, cost))
                    }
                }
            }
        }
    };
    format!("{}\n", drawing.into_string())
}

/// Both errors against one cost.
fn plot(level: &LevelTradeoff, (label, cost): Cost) -> Markup {
    let epsilon = |row: &Row| {
        let figure = row.tables.below_75;
        let reach = NORMAL_95 * figure.standard_error;
        Some([figure.value, figure.value - reach, figure.value + reach])
    };
    let image = |row: &Row| row.image.map(|mse| [mse.value, mse.low, mse.high].map(|x| x.max(0.0).sqrt()));
    let series = |name: &str, style: Style, error: &dyn Fn(&Row) -> Option<[f64; 3]>| {
        let point = |row: &Row| {
            let [y, low, high] = error(row)?.map(|x| 100.0 * x);
            Some(Point { x: cost(row), y, interval: (low > 0.0).then_some([low, high]) })
        };
        let points = level.rows.iter().filter_map(point).collect();
        Series { name: name.into(), style, line: Line::Joined, points }
    };
    let series = vec![
        series("ε below 75°, one grid", Style::First, &epsilon),
        series("image, root of relative MSE", Style::Second, &image),
    ];
    let values = series.iter().flat_map(|series| &series.points).flat_map(|point| {
        let [low, high] = point.interval.unwrap_or([point.y; 2]);
        [point.y, low, high]
    });
    let y = Axis::covering("error, %", Scale::Log, values);
    let x = Axis::covering(label, Scale::Log, level.rows.iter().map(cost));
    let description = format!("Level {}: error against {label}, one point a target", level.level);
    Plot { description, x, y, band: None, mark: None, series, legend: Legend::Inside }.draw()
}
