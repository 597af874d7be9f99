//! A small plot writer: what was measured, with its intervals, on axes that say what they are.
//!
//! A [`Plot`] is one SVG drawing of fixed size in user units, a pixel each at its natural size; it scales with its box.
//! Colours are the palette of Okabe and Ito, safe for colour-blind readers, and every style has a marker of its own, so
//! that no reading depends on colour. They are CSS variables with these as their defaults: a page may redefine them for a
//! dark ground, and a drawing on its own is right as well.

mod scale;

use maud::{Markup, html};

pub use scale::{Axis, Scale};

/// Size of a drawing, user units.
const WIDTH: f64 = 400.0;
const HEIGHT: f64 = 300.0;
/// Space left of, above, right of and below the area of the data, for labels.
const MARGINS: [f64; 4] = [56.0, 14.0, 14.0, 46.0];
/// Half the size of a marker.
const MARKER: f64 = 4.0;
/// Height of a line of the legend.
const LEGEND_LINE: f64 = 17.0;

const INK: &str = "var(--plot-ink, #1b1d20)";
const MUTED: &str = "var(--plot-muted, #5c6370)";
const RULE: &str = "var(--plot-rule, #dcdedb)";
const BAND: &str = "var(--plot-band, #e9efe6)";

/// Look of a series: colour and marker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Style {
    /// Blue circle.
    First,
    /// Green square.
    Second,
    /// Purple diamond.
    Third,
    /// Vermilion triangle.
    Fourth,
    /// Grey circle, hollow: what the others are compared with.
    Baseline,
}

/// A measured value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Where on the x axis.
    pub x: f64,
    /// The value.
    pub y: f64,
    /// Ends of its interval, if it has one.
    pub interval: Option<[f64; 2]>,
}

/// Values that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// What they are of.
    pub name: String,
    /// Their look.
    pub style: Style,
    /// Whether a line runs from point to point.
    pub line: Line,
    /// The values, in the order of the line.
    pub points: Vec<Point>,
}

/// What joins the points of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// A straight line in the drawing.
    Joined,
    /// Nothing: what lies between has no meaning.
    None,
}

/// A vertical line at a place of the x axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// Where.
    pub x: f64,
    /// What is there.
    pub label: String,
}

/// One drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// What it shows, for readers who do not see it.
    pub description: String,
    /// The x axis.
    pub x: Axis,
    /// The y axis.
    pub y: Axis,
    /// Range of y that is marked as background, if any.
    pub band: Option<[f64; 2]>,
    /// A place on the x axis to point out.
    pub mark: Option<Mark>,
    /// The values.
    pub series: Vec<Series>,
    /// Whether the drawing names its series.
    pub legend: Legend,
}

/// Where series are named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Legend {
    /// In the corner of the drawing at its top right.
    Inside,
    /// By the page around, with [`swatch`].
    Outside,
}

impl Style {
    /// CSS colour.
    fn colour(self) -> &'static str {
        match self {
            Self::First => "var(--plot-1, #0072b2)",
            Self::Second => "var(--plot-2, #009e73)",
            Self::Third => "var(--plot-3, #aa4499)",
            Self::Fourth => "var(--plot-4, #d55e00)",
            Self::Baseline => "var(--plot-0, #5c6370)",
        }
    }

    /// The marker about a point.
    fn marker(self, [x, y]: [f64; 2]) -> Markup {
        let m = MARKER;
        let fill = format!("fill:{}", self.colour());
        match self {
            Self::First => html! { circle cx=(short(x)) cy=(short(y)) r=(m) style=(fill) {} },
            Self::Baseline => {
                let hollow = format!("fill:var(--plot-ground, #ffffff);stroke:{};stroke-width:1.75", self.colour());
                html! { circle cx=(short(x)) cy=(short(y)) r=(m - 0.5) style=(hollow) {} }
            }
            Self::Second => polygon(&[[x - m, y - m], [x + m, y - m], [x + m, y + m], [x - m, y + m]], &fill),
            Self::Third => {
                let m = 1.35 * m; // as much ink as the square
                polygon(&[[x, y - m], [x + m, y], [x, y + m], [x - m, y]], &fill)
            }
            Self::Fourth => {
                let m = 1.2 * m;
                polygon(&[[x, y - m], [x + m, y + 0.8 * m], [x - m, y + 0.8 * m]], &fill)
            }
        }
    }
}

/// A style's marker alone, for a legend in the text.
pub fn swatch(style: Style) -> Markup {
    html! {
        svg.swatch viewBox="0 0 16 16" width="16" height="16" aria-hidden="true" { (style.marker([8.0, 8.0])) }
    }
}

impl Plot {
    /// The drawing as an `svg` element; it stands alone as a file, too.
    pub fn draw(&self) -> Markup {
        html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img"
                aria-label=(self.description) font-family="system-ui, sans-serif" font-size="12" {
                (self.band())
                (self.x_axis())
                (self.y_axis())
                (self.mark())
                @for series in &self.series { (self.series(series)) }
                @if self.legend == Legend::Inside { (self.names()) }
            }
        }
    }

    /// Where a point of the data lies in the drawing; `None` outside the axes or where it has no place on them.
    fn place(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        Some([self.x_place(x)?, self.y_place(y)?])
    }

    fn x_place(&self, x: f64) -> Option<f64> {
        let [left, _, right, _] = MARGINS;
        self.x.place(x).map(|fraction| left + fraction * (WIDTH - left - right))
    }

    fn y_place(&self, y: f64) -> Option<f64> {
        let [_, top, _, bottom] = MARGINS;
        self.y.place(y).map(|fraction| HEIGHT - bottom - fraction * (HEIGHT - top - bottom))
    }

    fn band(&self) -> Markup {
        let [left, _, right, _] = MARGINS;
        let ends = self.band.and_then(|[low, high]| Some([self.y_place(low)?, self.y_place(high)?]));
        html! {
            @if let Some([low, high]) = ends {
                rect x=(left) y=(short(high)) width=(WIDTH - left - right) height=(short(low - high)) style={ "fill:" (BAND) } {}
            }
        }
    }

    fn x_axis(&self) -> Markup {
        let [left, top, right, bottom] = MARGINS;
        let base = HEIGHT - bottom;
        html! {
            @for (value, text) in self.x.ticks() {
                @if let Some(x) = self.x_place(value) {
                    @if !self.x.is_of_categories() { (stroke([[x, top], [x, base]], RULE, 1.0)) }
                    (label([x, base + 17.0], "middle", MUTED, &text))
                }
            }
            (stroke([[left, base], [WIDTH - right, base]], MUTED, 1.0))
            (label([(left + WIDTH - right) / 2.0, HEIGHT - 8.0], "middle", INK, &self.x.label))
        }
    }

    fn y_axis(&self) -> Markup {
        let [left, top, right, bottom] = MARGINS;
        let middle = (top + HEIGHT - bottom) / 2.0;
        html! {
            @for (value, text) in self.y.ticks() {
                @if let Some(y) = self.y_place(value) {
                    @let ink = if value == 0.0 { MUTED } else { RULE };
                    (stroke([[left, y], [WIDTH - right, y]], ink, 1.0))
                    (label([left - 7.0, y + 4.0], "end", MUTED, &text))
                }
            }
            g transform=(format!("rotate(-90 14 {middle})")) { (label([14.0, middle], "middle", INK, &self.y.label)) }
        }
    }

    fn mark(&self) -> Markup {
        let [left, top, right, bottom] = MARGINS;
        let placed = self.mark.as_ref().and_then(|mark| Some((self.x_place(mark.x)?, &mark.label)));
        html! {
            @if let Some((x, text)) = placed {
                // The label stands on the side that has more room.
                @let is_left = x - left < WIDTH - right - x;
                @let (dx, anchor) = if is_left { (6.0, "start") } else { (-6.0, "end") };
                g stroke-dasharray="4 3" { (stroke([[x, top], [x, HEIGHT - bottom]], INK, 1.25)) }
                (label([x + dx, HEIGHT - bottom - 8.0], anchor, INK, text))
            }
        }
    }

    /// Line, intervals and markers of a series, in this order.
    fn series(&self, series: &Series) -> Markup {
        let colour = series.style.colour();
        let placed: Vec<[f64; 2]> = series.points.iter().filter_map(|point| self.place(point.x, point.y)).collect();
        html! {
            @if series.line == Line::Joined && placed.len() > 1 {
                polyline points=(path(&placed)) style={ "fill:none;stroke:" (colour) ";stroke-width:1.75" } {}
            }
            @for point in &series.points { (self.interval(point, colour)) }
            @for &at in &placed { (series.style.marker(at)) }
        }
    }

    fn interval(&self, point: &Point, colour: &str) -> Markup {
        let ends = point.interval.and_then(|[low, high]| Some([self.place(point.x, low)?, self.place(point.x, high)?]));
        html! {
            @if let Some(ends) = ends {
                (stroke(ends, colour, 1.75))
                @for [x, y] in ends { (stroke([[x - 3.0, y], [x + 3.0, y]], colour, 1.75)) }
            }
        }
    }

    /// The legend, on a ground that covers the grid.
    fn names(&self) -> Markup {
        let [_, top, right, _] = MARGINS;
        let longest = self.series.iter().map(|series| series.name.chars().count()).max().unwrap_or(0);
        let width = 26.0 + 6.6 * longest as f64; // a letter of 12 px is 6 to 7 wide
        let height = LEGEND_LINE * self.series.len() as f64 + 6.0;
        let left = WIDTH - right - width - 4.0;
        html! {
            rect x=(short(left)) y=(top + 4.0) width=(short(width)) height=(height) rx="3"
                style="fill:var(--plot-ground, #ffffff);fill-opacity:0.9" {}
            @for (i, series) in self.series.iter().enumerate() {
                @let y = top + 7.0 + LEGEND_LINE * (i as f64 + 0.5);
                (series.style.marker([left + 10.0, y]))
                (label([left + 22.0, y + 4.0], "start", INK, &series.name))
            }
        }
    }
}

/// A straight line.
fn stroke([[x0, y0], [x1, y1]]: [[f64; 2]; 2], colour: &str, width: f64) -> Markup {
    let style = format!("stroke:{colour};stroke-width:{width}");
    html! { line x1=(short(x0)) y1=(short(y0)) x2=(short(x1)) y2=(short(y1)) style=(style) {} }
}

/// A filled polygon.
fn polygon(corners: &[[f64; 2]], style: &str) -> Markup {
    html! { polygon points=(path(corners)) style=(style) {} }
}

/// A line of text.
fn label([x, y]: [f64; 2], anchor: &str, colour: &str, text: &str) -> Markup {
    html! { text x=(short(x)) y=(short(y)) text-anchor=(anchor) style={ "fill:" (colour) } { (text) } }
}

/// Points as an attribute.
fn path(points: &[[f64; 2]]) -> String {
    points.iter().map(|&[x, y]| format!("{},{}", short(x), short(y))).collect::<Vec<_>>().join(" ")
}

/// A coordinate to a twentieth of a pixel, which no screen resolves.
fn short(coordinate: f64) -> String {
    let text = format!("{coordinate:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(y: Vec<f64>) -> Plot {
        let points = y.iter().enumerate().map(|(i, &y)| Point {
            x: 10f64.powi(i as i32),
            y,
            interval: Some([y / 2.0, 2.0 * y]),
        });
        let series = Series { name: "a < b".into(), style: Style::First, line: Line::Joined, points: points.collect() };
        Plot {
            description: "errors & \"times\"".into(),
            x: Axis::covering("CPU seconds", Scale::Log, [1.0, 100.0]),
            y: Axis::covering("MSE", Scale::Log, y),
            band: None,
            mark: Some(Mark { x: 10.0, label: "64 samples".into() }),
            series: vec![series],
            legend: Legend::Inside,
        }
    }

    #[test]
    fn every_text_is_escaped() {
        let svg = plot(vec![1.0, 0.1, 0.01]).draw().into_string();
        assert!(svg.contains("a &lt; b") && svg.contains("errors &amp; &quot;times&quot;"), "{svg}");
        assert!(!svg.contains("a < b"));
    }

    #[test]
    fn larger_values_lie_higher_and_further_right() {
        let plot = plot(vec![1.0, 0.1, 0.01]);
        let [a, b] = [plot.place(1.0, 1.0).unwrap(), plot.place(100.0, 0.01).unwrap()];
        assert!(a[0] < b[0] && a[1] < b[1], "{a:?} {b:?}: y runs down in a drawing");
    }

    #[test]
    fn a_value_without_a_place_is_left_out() {
        let svg = plot(vec![1.0, -1.0, 0.01]).draw().into_string();
        // Two markers and that of the legend.
        assert_eq!(svg.matches("<circle").count(), 3, "{svg}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
