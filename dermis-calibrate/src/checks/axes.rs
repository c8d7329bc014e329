//! Positions of presses on the skin whose axes are reversed or exchanged, or that are turned.

use crate::checks::correlation::{cosine, standardised, unit_rows};
use crate::checks::model::{ModelChannels, compressed};
use crate::checks::truth::{SHIFTS, shifted_by};
use crate::forward_map::spread_over;
use crate::matching::{MIN_EVIDENCE, evidence_of};
use dermis::design::Body;
use dermis::finding::{Finding, FindingKind};
use dermis::geom::vector::distance;
use dermis::geom::{Chart, Point2, Point3, Shape};
use dermis::stats::mean;
use faer::Mat;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Fewest presses that are judged.
const MIN_ROWS: usize = 20;
/// Presses that are compared with the model, at most.
const MOST: usize = 300;
/// Other axes are stated if the frames correlate with the model by at least this much, ...
const MIN_AGREEMENT: f64 = 0.25;
/// ... by this much more than with the axes as given, ...
const MORE: f64 = 0.15;
/// ... and more in this part of the frames.
const PART: f64 = 0.75;

/// Turned positions are tried at this many angles of a turn, and may leave the body by this part of its size: presses at an edge,
/// turned by half a step more than is right, leave it by less.
const TURNS: usize = 24;
const OFF: f64 = 0.15;

/// A change of the axes of positions.
#[derive(Default)]
struct Axes {
    /// Whether the two coordinates are exchanged before they are reversed.
    exchanged: bool,
    /// The coordinates that are reversed.
    reversed: [bool; 2],
    /// In place of both: by how many of [`TURNS`] they are turned, on a flat skin about its middle, else about its axis.
    turned: usize,
}

/// The coordinates of the positions on a body; reversed ones are mirrored in the middle of their range.
struct Coordinates {
    chart: Chart,
    names: [&'static str; 2],
    /// How the reversed coordinates are written.
    reversed: [&'static str; 2],
}

impl Coordinates {
    /// The coordinates of a body; `None` for a mesh, whose symmetries are not known.
    fn of(body: &Body) -> Option<Self> {
        let chart = body.chart()?.with_seam(-PI);
        let (names, reversed) = match chart.shape() {
            Shape::Wall { .. } => (["theta_rad", "z_m"], ["-theta_rad", "length_m - z_m"]),
            Shape::Disk { .. } => (["x_m", "y_m"], ["-x_m", "-y_m"]),
            _ => (["x_m", "y_m"], ["width_m - x_m", "height_m - y_m"]),
        };
        Some(Coordinates { chart, names, reversed })
    }

    /// All changes of the axes but none. Of equal ones the last is named: half a turn is both axes reversed.
    fn changes(&self) -> impl Iterator<Item = Axes> {
        let exchanged = if self.chart.period_m().is_some() { &[false][..] } else { &[false, true] };
        let all = exchanged.iter().flat_map(|&exchanged| {
            let reversed = [[false, false], [true, false], [false, true], [true, true]];
            reversed.map(|reversed| Axes { exchanged, reversed, turned: 0 })
        });
        let turned = (1..TURNS).map(|turned| Axes { turned, ..Axes::default() });
        turned.chain(all.filter(|axes| axes.exchanged || axes.reversed != [false; 2]))
    }

    /// Positions with other axes; `None` where one of them is off the body.
    fn changed(&self, axes: &Axes, positions_m: &[Point3]) -> Option<Vec<Point3>> {
        let [low, high] = self.chart.bounds_m();
        let turn = |[a, b]: Point2| match (axes.turned as f64 / TURNS as f64, self.chart.period_m()) {
            (part, Some(period_m)) => [a + part * period_m, b],
            (part, None) => {
                let (sin, cos) = (part * TAU).sin_cos();
                let middle = [0, 1].map(|k| 0.5 * (low[k] + high[k]));
                let [x, y] = [a - middle[0], b - middle[1]];
                [middle[0] + cos * x - sin * y, middle[1] + sin * x + cos * y]
            }
        };
        let change = |position_m: &Point3| {
            let [a, b] = self.chart.unroll(*position_m);
            if axes.turned > 0 {
                let turned = self.chart.wrap(turn([a, b]));
                let inside = (0..2).all(|k| {
                    let off = OFF * (high[k] - low[k]);
                    (low[k] - off..=high[k] + off).contains(&turned[k])
                });
                return inside.then(|| self.chart.roll([0, 1].map(|k| turned[k].clamp(low[k], high[k]))));
            }
            let given = if axes.exchanged { [b, a] } else { [a, b] };
            let mirror = |k: usize| if axes.reversed[k] { low[k] + high[k] - given[k] } else { given[k] };
            let changed = [mirror(0), mirror(1)];
            let slack = |k: usize| 1e-6 * (high[k] - low[k]);
            let inside = (0..2).all(|k| changed[k] >= low[k] - slack(k) && changed[k] <= high[k] + slack(k));
            inside.then(|| self.chart.roll(changed))
        };
        positions_m.iter().map(change).collect()
    }

    /// What to do, where the positions fit with other axes.
    fn fix(&self, axes: &Axes) -> String {
        let [first, second] = self.names;
        if axes.turned > 0 {
            let degrees = 360.0 * axes.turned as f64 / TURNS as f64;
            let degrees = if degrees > 180.0 { degrees - 360.0 } else { degrees };
            let about = if self.chart.period_m().is_some() { "the axis" } else { "the middle of the skin" };
            return format!(
                "turn the positions by about {degrees:.0} degrees about {about}, counter-clockwise if positive; if they are \
                 right, the electrodes are elsewhere on the skin"
            );
        }
        let mut steps = Vec::new();
        if axes.exchanged {
            steps.push(format!("exchange the columns {first} and {second} of the truth"));
        }
        for k in 0..2 {
            if axes.reversed[k] {
                let then = if axes.exchanged { "then write" } else { "write" };
                steps.push(format!("{then} {} in place of {} in the truth", self.reversed[k], self.names[k]));
            }
        }
        let turns = usize::from(axes.exchanged) + axes.reversed.iter().filter(|reversed| **reversed).count();
        let electrodes = match turns % 2 {
            1 => "if the positions are right, the electrodes are numbered the other way round",
            _ => "if the positions are right, the first electrode is elsewhere",
        };
        format!("{}; {electrodes}", steps.join(", "))
    }
}

/// Frames with the positions of their presses.
pub(crate) struct Labelled<'a> {
    /// The frames in standardised units, rows x channels of the design.
    pub values: &'a Mat<f64>,
    /// The position of the press of each frame on the skin, m.
    pub positions_m: &'a [Point3],
    /// Channels of the design that are compared.
    pub channels: &'a [usize],
}

/// The presses of a recording and those of the model at the places that are stated.
struct Compared<'a> {
    model: &'a ModelChannels,
    channels: &'a [usize],
    /// The compared frames, standardised, rows x channels.
    frames: Mat<f64>,
    /// The touches of the model, compressed as the frames.
    touches: Mat<f64>,
    positions_m: Vec<Point3>,
}

/// What is wrong with the positions, by the model: the frames fit it clearly better with other axes or rows, or no better than with
/// the positions in a random order. `is_explained` says that the positions explain the frames without the model.
pub(crate) fn other_places(
    labelled: &Labelled<'_>,
    model: &ModelChannels,
    body: &Body,
    is_explained: bool,
) -> Option<Finding> {
    let count = labelled.positions_m.len();
    if count < MIN_ROWS || labelled.channels.is_empty() {
        return None;
    }
    let rows = spread_over(count, MOST);
    let frames =
        Mat::from_fn(rows.len(), labelled.channels.len(), |i, j| labelled.values[(rows[i], labelled.channels[j])]);
    let at = |shift: i32| -> Vec<Point3> {
        let row =
            |&row: &usize| labelled.positions_m[(row as i64 + i64::from(shift)).rem_euclid(count as i64) as usize];
        rows.iter().map(row).collect()
    };
    let compared = Compared {
        model,
        channels: labelled.channels,
        frames: standardised(&frames),
        touches: compressed(&model.touches),
        positions_m: at(0),
    };
    let given = compared.fit(&compared.positions_m);
    compared
        .other_axes(body, &given)
        .or_else(|| compared.other_rows(&at, &given))
        .or_else(|| (!is_explained).then(|| compared.unrelated(&given)).flatten())
}

impl Compared<'_> {
    /// The simulated touches nearest to some positions, standardised, rows x channels.
    fn expected(&self, positions_m: &[Point3]) -> Mat<f64> {
        let nearest = |position_m: &Point3| {
            let apart = |touch: &usize| distance(self.model.places_m[*touch], *position_m);
            (0..self.model.places_m.len()).min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("a model has touches")
        };
        let at: Vec<usize> = positions_m.par_iter().map(nearest).collect();
        standardised(&Mat::from_fn(at.len(), self.channels.len(), |i, j| self.touches[(at[i], self.channels[j])]))
    }

    /// The correlation of each frame with a simulated touch at its position, both relative to the mean over the positions.
    fn fit(&self, positions_m: &[Point3]) -> Vec<f64> {
        let expected = self.expected(positions_m);
        let of_row = |i: usize| cosine(self.frames.row(i).iter().copied(), expected.row(i).iter().copied());
        (0..positions_m.len()).map(of_row).collect()
    }

    /// Whether other positions fit clearly better than the given ones.
    fn is_clear(best: &[f64], given: &[f64]) -> bool {
        let better = best.iter().zip(given).filter(|(best, given)| best > given).count() as f64;
        let (value, as_given) = (mean(best), mean(given));
        value >= MIN_AGREEMENT && value - as_given >= MORE && better >= PART * given.len() as f64
    }

    fn other_axes(&self, body: &Body, given: &[f64]) -> Option<Finding> {
        let coordinates = Coordinates::of(body)?;
        let fit = |axes: Axes| Some((self.fit(&coordinates.changed(&axes, &self.positions_m)?), axes));
        let (best, axes) = coordinates.changes().filter_map(fit).max_by(|a, b| mean(&a.0).total_cmp(&mean(&b.0)))?;
        let evidence =
            format!("mean correlation of a frame with the model at the changed positions; {:.3} as given", mean(given));
        Self::is_clear(&best, given)
            .then(|| Finding::new(FindingKind::TruthAxes, mean(&best), evidence, coordinates.fix(&axes)))
    }

    fn other_rows(&self, at: &dyn Fn(i32) -> Vec<Point3>, given: &[f64]) -> Option<Finding> {
        let shifts = SHIFTS.filter(|shift| *shift != 0);
        let (best, shift) =
            shifts.map(|shift| (self.fit(&at(shift)), shift)).max_by(|a, b| mean(&a.0).total_cmp(&mean(&b.0)))?;
        let evidence = format!(
            "mean correlation of a frame with the model at the shifted positions; {:.3} without a shift",
            mean(given)
        );
        Self::is_clear(&best, given).then(|| shifted_by(shift, mean(&best), evidence))
    }

    fn unrelated(&self, given: &[f64]) -> Option<Finding> {
        let (frames, expected) = (unit_rows(&self.frames), unit_rows(&self.expected(&self.positions_m)));
        // Presses at few places tell nothing from chance even where they are right.
        let of = |frames: &Mat<f64>| evidence_of(&-(frames * expected.transpose()));
        let evidence = Some(of(&frames)).filter(|_| of(&expected) >= MIN_EVIDENCE)?;
        let text = format!(
            "mean correlation of a frame with the model at its position, by {evidence:.1} standard deviations better than \
             in a random order"
        );
        let fix = "check that the positions are those of these frames, in their order, units and coordinates";
        (evidence < MIN_EVIDENCE).then(|| Finding::new(FindingKind::TruthUnrelated, mean(given), text, fix))
    }
}
