//! What `dermis optimise` prints and writes.

use super::Arguments;
use crate::console::{print, print_json};
use crate::failure::{Failure, Outcome};
use crate::picture::save;
use crate::skin;
use dermis::frame::write_whole;
use dermis::text::counted;
use dermis_plot::chart::Curves;
use dermis_plot::report::Table;
use dermis_plot::{Key, Scale, skin_map};
use dermis_sim::optimise::{CurvePoint, JudgedDesign, Optimised};
use std::path::Path;

/// Whether a curve is drawn, and not written as a table: by the ending of its path.
pub(super) fn is_picture(path: &Path) -> Outcome<bool> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("csv") => Ok(false),
        Some("svg") => Ok(true),
        _ => Err(Failure::given(format!("{}: no kind of curve known", path.display()), Some("name it .csv or .svg"))),
    }
}

impl Arguments {
    /// Prints the result and writes its files.
    pub(super) fn show(&self, found: &Optimised) -> Outcome {
        let curves = [(&self.curve, &found.electrodes, "electrodes"), (&self.slots_curve, &found.readings, "readings")];
        for (path, points, what) in &curves {
            if let Some(path) = path {
                write_curve(path, points, what, &self.conditions())?;
            }
        }
        self.draw(found)?;
        if self.json {
            return print_json(&serde_json::json!(found));
        }
        let mut text = format!("{}\n\n{}", self.conditions(), compared(found).to_text());
        for (_, points, what) in curves {
            if points.len() > 1 {
                text += &format!("\n{}", table(points, what).to_text());
            }
        }
        if found.given_kept {
            text += "\nNo better layout was found: the electrodes are those of the given design. More --starts, --moves and \
                     --rounds search longer.\n";
        }
        print(&format!("{text}\nwritten to {}\n", self.output.display()))
    }

    fn conditions(&self) -> String {
        format!("presses of {} N with a tip of {} mm, noise of `{}`", self.force, 1e3 * self.tip_radius, self.twin.name)
    }

    /// Maps of the bounds of both designs, with the same colours.
    fn draw(&self, found: &Optimised) -> Outcome {
        let of =
            |judged: &JudgedDesign| judged.judgement.places.iter().map(|place| 1e3 * place.sd_m).collect::<Vec<f64>>();
        let (given, new) = (of(&found.given), of(&found.optimised));
        let both = || given.iter().chain(&new).copied();
        let files =
            [(&self.given_map, self.design.clone(), &given), (&self.map, self.output.display().to_string(), &new)];
        for (path, design, values) in files {
            let Some(path) = path else { continue };
            let skin = skin::load(&design)?;
            let key = Key { scale: Scale::sequential(both()), label: "standard deviation of the position (mm)".into() };
            let title = format!("Bound of the position, {}", counted(skin.design().electrodes.len(), "electrode"));
            save(&skin_map(&skin, values, key, title, self.conditions())?, path)?;
        }
        Ok(())
    }
}

fn millimetres(value_m: Option<f64>) -> String {
    value_m.map_or("none".into(), |value_m| format!("{:.3}", 1e3 * value_m))
}

fn compared(found: &Optimised) -> Table {
    let mut table = Table::new(&["design", "electrodes", "values", "worst place (mm)", "mean (mm)"]);
    for JudgedDesign { name, electrodes, values, judgement } in [&found.given, &found.optimised] {
        let bounds = [judgement.worst_m, judgement.mean_m].map(|value| Some(value).filter(|value| value.is_finite()));
        let [worst, mean] = bounds.map(millimetres);
        table.row([name.clone(), electrodes.to_string(), values.to_string(), worst, mean]);
    }
    table
}

fn table(points: &[CurvePoint], what: &str) -> Table {
    let rates = points.iter().any(|point| point.rate_hz.is_some()).then_some("frames a second");
    let columns: Vec<&str> = [what].into_iter().chain(rates).chain(["worst place (mm)", "mean (mm)"]).collect();
    let mut table = Table::new(&columns);
    for CurvePoint { count, rate_hz, worst_m, mean_m } in points {
        let rate = rate_hz.map(|rate_hz| format!("{rate_hz:.1}"));
        let bounds = [*worst_m, *mean_m].map(millimetres);
        table.push([count.to_string()].into_iter().chain(rate).chain(bounds).collect());
    }
    table
}

fn write_curve(path: &Path, points: &[CurvePoint], what: &str, conditions: &str) -> Outcome {
    if !is_picture(path)? {
        let text = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
        return Ok(write_whole(path, |out| {
            writeln!(out, "{what},worst_m,mean_m")?;
            let mut row = |CurvePoint { count, worst_m, mean_m, .. }: &CurvePoint| {
                writeln!(out, "{count},{},{}", text(*worst_m), text(*mean_m))
            };
            points.iter().try_for_each(&mut row)
        })?);
    }
    let curve = |value: fn(&CurvePoint) -> Option<f64>| {
        let place = |point: &CurvePoint| Some([point.count as f64, 1e3 * value(point)?]);
        let mut curve: Vec<[f64; 2]> = points.iter().filter_map(place).collect();
        curve.sort_by(|a, b| a[0].total_cmp(&b[0]));
        curve
    };
    let picture = Curves {
        title: &format!("Bound of the position against the number of {what}"),
        subtitle: conditions,
        below: what,
        left: "standard deviation (mm)",
        logarithmic: false,
        shown: vec![0.0],
        curves: vec![
            ("worst place".into(), curve(|point| point.worst_m)),
            ("mean".into(), curve(|point| point.mean_m)),
        ],
    };
    Ok(picture.draw().write_svg(path)?)
}
