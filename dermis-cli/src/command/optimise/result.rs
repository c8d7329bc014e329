//! What `dermis optimise` prints and writes.

use super::Arguments;
use super::state::Found;
use crate::console::{print, print_json};
use crate::failure::{Failure, Outcome};
use crate::skin;
use dermis::design::SkinDesign;
use dermis::frame::write_whole;
use dermis::protocol::Protocol;
use dermis::text::counted;
use dermis_plot::chart::Curves;
use dermis_plot::report::Table;
use dermis_plot::{Drawing, Key, Scale, View};
use dermis_sim::optimise::Judgement;
use serde::Serialize;
use std::path::Path;

/// Readings that were chosen.
#[derive(Debug)]
pub(super) struct Pattern {
    /// Values and currents.
    pub(super) slots: usize,
    /// Frames that the instrument reads a second, Hz.
    pub(super) rate_hz: f64,
    pub(super) protocol: Protocol,
    pub(super) judgement: Judgement,
}

/// Everything that was found.
pub(super) struct Result<'a> {
    pub(super) given: &'a SkinDesign,
    pub(super) new: &'a SkinDesign,
    /// Of the given design and of the new one.
    pub(super) bounds: [Judgement; 2],
    /// The best layout for each number of electrodes.
    pub(super) found: Vec<Found>,
    pub(super) patterns: Vec<Pattern>,
}

/// A row of a curve: a number of electrodes or of readings, and the bounds, m.
#[derive(Debug, Serialize)]
struct Row {
    count: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    rate_hz: Option<f64>,
    worst_m: Option<f64>,
    mean_m: Option<f64>,
}

/// The format of a curve.
#[derive(Debug, Clone, Copy)]
pub(super) enum CurveFormat {
    Csv,
    Svg,
}

impl CurveFormat {
    /// The format by the ending of a path.
    pub(super) fn of(path: &Path) -> Outcome<Self> {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("csv") => Ok(CurveFormat::Csv),
            Some("svg") => Ok(CurveFormat::Svg),
            _ => {
                Err(Failure::given(format!("{}: no kind of curve known", path.display()), Some("name it .csv or .svg")))
            }
        }
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

impl Result<'_> {
    fn electrode_rows(&self) -> Vec<Row> {
        let row = |found: &Found| Row {
            count: found.start.electrodes_m.len(),
            rate_hz: None,
            worst_m: found.worst_m,
            mean_m: found.mean_m,
        };
        self.found.iter().map(row).collect()
    }

    fn pattern_rows(&self) -> Vec<Row> {
        let row = |pattern: &Pattern| Row {
            count: pattern.slots,
            rate_hz: Some(pattern.rate_hz),
            worst_m: finite(pattern.judgement.worst_m),
            mean_m: finite(pattern.judgement.mean_m),
        };
        self.patterns.iter().map(row).collect()
    }

    /// Whether a search has ended at the given places.
    fn keeps_given(&self) -> bool {
        let given_m: Vec<[f64; 3]> = self.given.electrodes.iter().map(|electrode| electrode.centre_m).collect();
        self.found.iter().any(|found| found.start.electrodes_m == given_m)
    }

    fn to_json(&self) -> serde_json::Value {
        let bounds = |index: usize, design: &SkinDesign| {
            let Judgement { worst_m, mean_m, places } = &self.bounds[index];
            let place = |(position_m, sd_m): &([f64; 3], f64)| serde_json::json!({ "position_m": position_m, "sd_m": finite(*sd_m) });
            serde_json::json!({
                "design": design.name,
                "electrodes": design.electrodes.len(),
                "worst_m": finite(*worst_m),
                "mean_m": finite(*mean_m),
                "places": places.iter().map(place).collect::<Vec<_>>(),
            })
        };
        serde_json::json!({
            "given": bounds(0, self.given),
            "optimised": bounds(1, self.new),
            "given_kept": self.keeps_given(),
            "electrodes": self.electrode_rows(),
            "readings": self.pattern_rows(),
        })
    }
}

impl Arguments {
    /// Prints the result and writes its files.
    pub(super) fn tell(&self, result: &Result<'_>) -> Outcome {
        let curves = [
            (&self.curve, result.electrode_rows(), "electrodes"),
            (&self.slots_curve, result.pattern_rows(), "readings"),
        ];
        for (path, rows, what) in curves {
            if let Some(path) = path {
                write_curve(path, &rows, what, &self.conditions())?;
            }
        }
        self.draw(result)?;
        if self.json {
            return print_json(&result.to_json());
        }
        let mut text = format!("{}\n\n{}", self.conditions(), compared(result).to_text());
        for (rows, what) in [(result.electrode_rows(), "electrodes"), (result.pattern_rows(), "readings")] {
            if rows.len() > 1 {
                text += &format!("\n{}", table(&rows, what).to_text());
            }
        }
        if result.keeps_given() {
            text += "\nNo better layout was found: the electrodes are those of the given design. More --starts, --moves and \
                     --rounds search longer.\n";
        }
        print(&format!("{text}\nwritten to {}\n", self.output.display()))
    }

    fn conditions(&self) -> String {
        format!("presses of {} N with a tip of {} mm, noise of `{}`", self.force, 1e3 * self.tip_radius, self.twin)
    }

    /// Maps of the bounds of both designs, with the same colours.
    fn draw(&self, result: &Result<'_>) -> Outcome {
        let of = |judgement: &Judgement| judgement.places.iter().map(|place| 1e3 * place.1).collect::<Vec<f64>>();
        let both = || result.bounds.iter().flat_map(of);
        let given = self.design.clone();
        let new = self.output.to_string_lossy().into_owned();
        for ((path, design), judgement) in [(&self.given_map, given), (&self.map, new)].into_iter().zip(&result.bounds)
        {
            let Some(path) = path else { continue };
            let skin = skin::load(&design)?;
            let drawing = Drawing::new(skin.design(), skin.mesh());
            let key = Key { scale: Scale::sequential(both()), label: "standard deviation of the position (mm)".into() };
            let title = format!("Bound of the position, {}", counted(skin.design().electrodes.len(), "electrode"));
            let scene = drawing.field(skin.pixels(), &of(judgement), key).titled(title, self.conditions());
            let drawn = View::of(skin.design()).draw(&scene, skin.design());
            let picture = drawn.map_err(|error| Failure::Ours(error.to_string()))?;
            write_whole(path, |out| out.write_all(picture.to_svg().as_bytes()))?;
        }
        Ok(())
    }
}

fn millimetres(value_m: Option<f64>) -> String {
    value_m.map_or("none".into(), |value_m| format!("{:.3}", 1e3 * value_m))
}

fn compared(result: &Result<'_>) -> Table {
    let mut table = Table::new(&["design", "electrodes", "values", "worst place (mm)", "mean (mm)"]);
    for (design, judgement) in [result.given, result.new].into_iter().zip(&result.bounds) {
        let [worst, mean] = [judgement.worst_m, judgement.mean_m].map(|value| millimetres(finite(value)));
        let counts = [design.electrodes.len(), design.protocol.channel_count()].map(|count| count.to_string());
        let [electrodes, values] = counts;
        table.row([design.name.clone(), electrodes, values, worst, mean]);
    }
    table
}

fn table(rows: &[Row], what: &str) -> Table {
    let rates = rows.iter().any(|row| row.rate_hz.is_some()).then_some("frames a second");
    let columns: Vec<&str> = [what].into_iter().chain(rates).chain(["worst place (mm)", "mean (mm)"]).collect();
    let mut table = Table::new(&columns);
    for Row { count, rate_hz, worst_m, mean_m } in rows {
        let (count, [worst, mean]) = (count.to_string(), [*worst_m, *mean_m].map(millimetres));
        match rate_hz {
            Some(rate_hz) => table.row([count, format!("{rate_hz:.1}"), worst, mean]),
            None => table.row([count, worst, mean]),
        }
    }
    table
}

fn write_curve(path: &Path, rows: &[Row], what: &str, conditions: &str) -> Outcome {
    let text = match CurveFormat::of(path)? {
        CurveFormat::Csv => {
            let text = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
            let row = |row: &Row| format!("{},{},{}\n", row.count, text(row.worst_m), text(row.mean_m));
            format!("{what},worst_m,mean_m\n{}", rows.iter().map(row).collect::<String>())
        }
        CurveFormat::Svg => {
            let points = |value: fn(&Row) -> Option<f64>| {
                let point = |row: &Row| Some([row.count as f64, 1e3 * value(row)?]);
                let mut points: Vec<[f64; 2]> = rows.iter().filter_map(point).collect();
                points.sort_by(|a, b| a[0].total_cmp(&b[0]));
                points
            };
            Curves {
                title: &format!("Bound of the position against the number of {what}"),
                subtitle: conditions,
                below: what,
                left: "standard deviation (mm)",
                logarithmic: false,
                shown: vec![0.0],
                curves: vec![
                    ("worst place".into(), points(|row| row.worst_m)),
                    ("mean".into(), points(|row| row.mean_m)),
                ],
            }
            .draw()
            .to_svg()
        }
    };
    Ok(write_whole(path, |out| out.write_all(text.as_bytes()))?)
}
