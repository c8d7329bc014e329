//! Charts: histograms, cumulative distributions, curves and heat maps.
//!
//! ```
//! use dermis_plot::chart::Curves;
//!
//! let loss = (1..=40).map(|epoch| [f64::from(epoch), 0.3 / f64::from(epoch * epoch)]).collect();
//! let chart = Curves {
//!     title: "Loss",
//!     subtitle: "",
//!     below: "epoch",
//!     left: "mean square error",
//!     logarithmic: true,
//!     shown: vec![],
//!     curves: vec![("training".into(), loss)],
//! };
//! assert!(chart.draw().to_svg().contains(">0.001</text>"));
//! ```

use crate::colour::{Colour, FAINT, INK, Scale};
use crate::frame::{self, Axis};
use crate::scene::{Key, Mark};
use crate::svg::{Anchor, Picture, Place, Style, Text, text_width};
use dermis::stats::sorted;

const WIDTH: f64 = 470.0;
const HEIGHT: f64 = 230.0;
const LEFT: f64 = 66.0;
const BELOW: f64 = 52.0;
/// Height of a row with the label of a mark, pixels.
const MARK_ROW: f64 = 16.0;
const BARS: Colour = [66, 113, 158];

/// A histogram with uniform bins, and vertical lines that mark numbers of interest.
pub struct Histogram<'a> {
    /// The title.
    pub title: &'a str,
    /// The quantity of the values, with its unit.
    pub label: &'a str,
    /// The values.
    pub values: &'a [f64],
    /// What is counted, for example "frames".
    pub counted: &'a str,
    /// Bin width.
    pub step: f64,
    /// Marked numbers and their labels.
    pub marks: Vec<(f64, String)>,
}

impl Histogram<'_> {
    /// The picture. Values beyond the larger of the 99.5th percentile and the last mark are counted in the last bin.
    pub fn draw(&self) -> Picture {
        let steps = self.step_count();
        let mut counts = vec![0usize; steps];
        for &value in self.values.iter().filter(|value| value.is_finite()) {
            counts[((value / self.step).max(0.0) as usize).min(steps - 1)] += 1;
        }
        let highest = counts.iter().copied().max().unwrap_or(0).max(1) as f64 * 1.12;
        // The labels of the marks are above the bars, one row each.
        let head = frame::title_height(self.title, "");
        let top = head + MARK_ROW * self.marks.len() as f64;
        let mut picture = Picture::new(LEFT + WIDTH + 24.0, top + HEIGHT + BELOW);
        frame::title(&mut picture, self.title, "");
        let x = |value: f64| LEFT + WIDTH * value / (steps as f64 * self.step);
        let y = |count: f64| top + HEIGHT * (1.0 - count / highest);
        for (index, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let (from, to) = (x(index as f64 * self.step) + 0.5, x((index + 1) as f64 * self.step) - 0.5);
            let bar = [[from, y(0.0)], [to, y(0.0)], [to, y(count as f64)], [from, y(count as f64)]];
            picture.polygon(&bar, Style::fill(BARS));
        }
        draw_marks(&mut picture, &self.marks, x, [head, y(0.0)]);
        frame::border(&mut picture, [LEFT, top], WIDTH, HEIGHT);
        let below = Axis { range: [0.0, steps as f64 * self.step], logarithmic: false, label: self.label, wanted: 8 };
        frame::axis_below(&mut picture, [LEFT, top + HEIGHT], WIDTH, &below);
        let left = Axis { range: [0.0, highest], logarithmic: false, label: self.counted, wanted: 5 };
        frame::axis_left(&mut picture, [LEFT, top + HEIGHT], HEIGHT, &left);
        picture
    }

    fn step_count(&self) -> usize {
        (largest_shown(&sorted(self.values.iter().copied().filter(|value| value.is_finite())), &self.marks) / self.step)
            as usize
            + 1
    }
}

/// The larger of the 99.5th percentile of ascending values and a number somewhat beyond the last mark.
fn largest_shown(sorted: &[f64], marks: &[(f64, String)]) -> f64 {
    let nearly_all = sorted.get((sorted.len() as f64 * 0.995) as usize).or(sorted.last()).copied().unwrap_or(0.0);
    let marked = marks.iter().map(|(value, _)| *value).fold(0.0, f64::max);
    nearly_all.max(1.3 * marked)
}

/// Vertical lines at some numbers, from the top to the bottom, with their labels one below the other.
fn draw_marks(picture: &mut Picture, marks: &[(f64, String)], x: impl Fn(f64) -> f64, [head, bottom]: [f64; 2]) {
    for (index, (value, name)) in marks.iter().enumerate() {
        let at = x(*value);
        let row = head + MARK_ROW * index as f64;
        picture.line(&[[at, row], [at, bottom]], Style::line(INK, 1.2).dashed(4.0));
        let fits = at + 10.0 + text_width(name, 12.0) < LEFT + WIDTH;
        let (x, anchor) = if fits { (at + 5.0, Anchor::Start) } else { (at - 5.0, Anchor::End) };
        picture.text([x, row + 12.0], name, Text::new(12.0, anchor).rimmed());
    }
}

/// The cumulative distribution of some values: the fraction of them that is at most as large.
///
/// ```
/// use dermis_plot::chart::Cumulative;
///
/// let marks = vec![(2.0, "median 2 mm".to_string())];
/// let values = &[1.0, 2.0, 4.0];
/// let chart = Cumulative { title: "", subtitle: "", below: "error (mm)", left: "fraction", values, total: 4, marks };
/// assert!(chart.draw().to_svg().contains(">median 2 mm</text>"));
/// ```
pub struct Cumulative<'a> {
    /// The title.
    pub title: &'a str,
    /// A second, smaller line.
    pub subtitle: &'a str,
    /// Label of the horizontal axis, with its unit.
    pub below: &'a str,
    /// Label of the vertical axis.
    pub left: &'a str,
    /// The values.
    pub values: &'a [f64],
    /// What 1 is on the vertical axis: the number of values, or more where some are missing.
    pub total: usize,
    /// Marked numbers and their labels.
    pub marks: Vec<(f64, String)>,
}

impl Cumulative<'_> {
    /// The picture, from 0 to the larger of the 99.5th percentile and the last mark.
    pub fn draw(&self) -> Picture {
        const TALL: f64 = 0.8 * WIDTH;
        const HIGHEST: f64 = 1.04;
        let values = sorted(self.values.iter().copied().filter(|value| value.is_finite()));
        let largest = largest_shown(&values, &self.marks);
        let across = [0.0, if largest > 0.0 { largest } else { 1.0 }];
        let head = frame::title_height(self.title, self.subtitle);
        let top = head + MARK_ROW * self.marks.len() as f64;
        let mut picture = Picture::new(LEFT + WIDTH + 24.0, top + TALL + BELOW);
        frame::title(&mut picture, self.title, self.subtitle);
        let x = |value: f64| LEFT + WIDTH * value / across[1];
        let y = |fraction: f64| top + TALL * (1.0 - fraction / HIGHEST);
        picture.line(&[[LEFT, y(1.0)], [LEFT + WIDTH, y(1.0)]], Style::line(FAINT, 1.0));
        draw_marks(&mut picture, &self.marks, x, [head, y(0.0)]);
        let line: Vec<Place> = self.steps(&values, across[1]).iter().map(|&[a, b]| [x(a), y(b)]).collect();
        picture.line(&line, Style::line(BARS, 2.0));
        frame::border(&mut picture, [LEFT, top], WIDTH, TALL);
        let below = Axis { range: across, logarithmic: false, label: self.below, wanted: 8 };
        frame::axis_below(&mut picture, [LEFT, top + TALL], WIDTH, &below);
        let left = Axis { range: [0.0, HIGHEST], logarithmic: false, label: self.left, wanted: 6 };
        frame::axis_left(&mut picture, [LEFT, top + TALL], TALL, &left);
        picture
    }

    /// The corners of the steps up to the end of the axis.
    fn steps(&self, sorted: &[f64], end: f64) -> Vec<[f64; 2]> {
        let fraction = |count: usize| count as f64 / self.total.max(1) as f64;
        let shown = sorted.partition_point(|value| *value <= end);
        let step = |index: usize| [[sorted[index], fraction(index)], [sorted[index], fraction(index + 1)]];
        let first = std::iter::once([0.0, 0.0]);
        first.chain((0..shown).flat_map(step)).chain(std::iter::once([end, fraction(shown)])).collect()
    }
}

/// Colours of curves that can be distinguished with any kind of colour vision (Okabe and Ito 2008).
const CURVE_COLOURS: [Colour; 5] = [[0, 114, 178], [213, 94, 0], [0, 158, 115], [204, 121, 167], [86, 180, 233]];

/// Line plots of several curves.
#[derive(Debug, Clone, Default)]
pub struct Curves<'a> {
    /// The title.
    pub title: &'a str,
    /// A second, smaller line.
    pub subtitle: &'a str,
    /// Label of the horizontal axis, with its unit.
    pub below: &'a str,
    /// Label of the vertical axis, with its unit.
    pub left: &'a str,
    /// Whether the vertical axis is logarithmic; values that are not positive are then omitted.
    pub logarithmic: bool,
    /// Numbers that the vertical axis always includes.
    pub shown: Vec<f64>,
    /// The name and the points of each line.
    pub curves: Vec<(String, Vec<[f64; 2]>)>,
}

impl Curves<'_> {
    /// The picture; points that are not finite are omitted.
    pub fn draw(&self) -> Picture {
        let upward = |value: f64| if self.logarithmic { value.log10() } else { value };
        let finite = |places: &[[f64; 2]]| {
            let places = places.iter().map(|&[across, up]| [across, upward(up)]);
            places.filter(|place| place.iter().all(|value| value.is_finite())).collect::<Vec<_>>()
        };
        let curves: Vec<Vec<[f64; 2]>> = self.curves.iter().map(|curve| finite(&curve.1)).collect();
        let places = || curves.iter().flatten();
        let across = range(places().map(|place| place[0]));
        let [low, high] = range(places().map(|place| place[1]).chain(self.shown.iter().map(|&value| upward(value))));
        // A small margin above and below the lines.
        let margin = 0.04 * (high - low);
        let upward = [low - margin, high + margin];
        let legend: Vec<(Mark, String)> = if self.curves.len() > 1 {
            self.curves.iter().enumerate().map(|(k, curve)| (Mark::Line(colour(k)), curve.0.clone())).collect()
        } else {
            Vec::new()
        };
        let top = frame::title_height(self.title, self.subtitle);
        let legend_height = frame::legend_height(&legend, WIDTH);
        let mut picture = Picture::new(LEFT + WIDTH + 24.0, top + HEIGHT + BELOW + legend_height);
        frame::title(&mut picture, self.title, self.subtitle);
        let x = |value: f64| LEFT + WIDTH * (value - across[0]) / (across[1] - across[0]);
        let y = |value: f64| top + HEIGHT * (upward[1] - value) / (upward[1] - upward[0]);
        if upward[0] < 0.0 && upward[1] > 0.0 && !self.logarithmic {
            picture.line(&[[LEFT, y(0.0)], [LEFT + WIDTH, y(0.0)]], Style::line(FAINT, 1.0));
        }
        for (number, places) in curves.iter().enumerate() {
            let line: Vec<Place> = places.iter().map(|&[a, b]| [x(a), y(b)]).collect();
            // A thick line through many values would look like a band.
            let width = if line.len() > 100 { 0.8 } else { 2.0 };
            if line.len() > 1 {
                picture.line(&line, Style::line(colour(number), width));
            }
        }
        frame::border(&mut picture, [LEFT, top], WIDTH, HEIGHT);
        frame::axis_below(
            &mut picture,
            [LEFT, top + HEIGHT],
            WIDTH,
            &Axis { range: across, logarithmic: false, label: self.below, wanted: 7 },
        );
        frame::axis_left(
            &mut picture,
            [LEFT, top + HEIGHT],
            HEIGHT,
            &Axis { range: upward, logarithmic: self.logarithmic, label: self.left, wanted: 5 },
        );
        frame::legend(&mut picture, [LEFT, top + HEIGHT + BELOW - 6.0], WIDTH, &legend);
        picture
    }
}

/// A table of numbers as colours: rows from the top, columns from the left. Numbers that are not finite are grey.
///
/// ```
/// use dermis_plot::Scale;
/// use dermis_plot::chart::HeatMap;
///
/// let rows = [vec![0.0, 1.0], vec![-1.0, 0.5]];
/// let scale = Scale::diverging([1.0]);
/// let (rows, first) = (&rows[..], [0.0, -1.0]);
/// let map = HeatMap { title: "", subtitle: "", below: "channel", left: "lag", first, rows, scale, label: "" };
/// assert!(map.draw().to_svg().contains(">channel</text>"));
/// ```
pub struct HeatMap<'a> {
    /// The title.
    pub title: &'a str,
    /// A second, smaller line.
    pub subtitle: &'a str,
    /// Label of the horizontal axis, with its unit.
    pub below: &'a str,
    /// Label of the vertical axis, with its unit.
    pub left: &'a str,
    /// The numbers of the first column and of the first row; the others follow by one.
    pub first: [f64; 2],
    /// The rows, all of one length.
    pub rows: &'a [Vec<f64>],
    /// The colours.
    pub scale: Scale,
    /// What the colours are, with the unit.
    pub label: &'a str,
}

impl HeatMap<'_> {
    /// The picture; of more than 128 rows or columns, evenly spaced ones are drawn.
    pub fn draw(&self) -> Picture {
        const MAX: usize = 128;
        let (rows, columns) = (self.rows.len(), self.rows.first().map_or(0, Vec::len));
        let head = frame::title_height(self.title, self.subtitle);
        let height = if rows * 2 > columns { 0.8 * WIDTH } else { HEIGHT };
        let mut picture = Picture::new(LEFT + WIDTH + 24.0 + frame::KEY_WIDTH, head + height + BELOW);
        frame::title(&mut picture, self.title, self.subtitle);
        let drawn = [rows.min(MAX), columns.min(MAX)];
        let step = [height / drawn[0].max(1) as f64, WIDTH / drawn[1].max(1) as f64];
        for i in 0..drawn[0] {
            for j in 0..drawn[1] {
                let value = self.rows[i * rows / drawn[0]][j * columns / drawn[1]];
                let (x, y) = (LEFT + j as f64 * step[1], head + i as f64 * step[0]);
                // A little overlap hides the gaps between the cells.
                let (right, below) = ((x + step[1] + 0.4).min(LEFT + WIDTH), (y + step[0] + 0.4).min(head + height));
                picture
                    .polygon(&[[x, y], [right, y], [right, below], [x, below]], Style::fill(self.scale.colour(value)));
            }
        }
        frame::border(&mut picture, [LEFT, head], WIDTH, height);
        let across = [self.first[0] - 0.5, self.first[0] + columns as f64 - 0.5];
        let below = Axis { range: across, logarithmic: false, label: self.below, wanted: 8 };
        frame::axis_below(&mut picture, [LEFT, head + height], WIDTH, &below);
        // Rows count downwards.
        let down = Axis {
            range: [self.first[1] + rows as f64 - 0.5, self.first[1] - 0.5],
            logarithmic: false,
            label: self.left,
            wanted: 8,
        };
        frame::axis_left(&mut picture, [LEFT, head + height], height, &down);
        let key = Key { scale: self.scale, label: self.label.into() };
        frame::colour_bar(&mut picture, [LEFT + WIDTH + 18.0, head], height, &key);
        picture
    }
}

fn colour(number: usize) -> Colour {
    CURVE_COLOURS[number % CURVE_COLOURS.len()]
}

/// The minimum and the maximum of some numbers; if they are equal, a range that also contains 0.
fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    match low < high {
        true => [low, high],
        false => [low.min(0.0), low.max(0.0) + 1.0].map(|v| if v.is_finite() { v } else { 0.0 }),
    }
}
