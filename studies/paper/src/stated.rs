//! The figures in the paper, one by one, next to those of the reproduction: `stated.toml` has the rows, with what the
//! paper states and what differs; this module computes their values.

use crate::benchmarked::Benchmarked;
use crate::bias::Structure;
use crate::results::Results;
use dermis::design::{Body, ImageLayout};
use dermis_learn::{Epoch, TrainingRecord};
use dermis_plot::report::Table;
use serde::{Deserialize, Serialize};

/// A figure in the paper and in the reproduction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Row {
    /// The name of the computed values.
    #[serde(skip_serializing)]
    key: String,
    /// The quantity, with its unit.
    pub what: String,
    /// The section of the paper; empty where it has no such figure.
    #[serde(default)]
    pub paper_section: String,
    /// The values in the paper, one per column of its table; a dash where there is no value.
    #[serde(default = "not_in_the_paper")]
    pub paper: Vec<String>,
    /// The values of the reproduction, one per column of its table.
    #[serde(skip_deserializing)]
    pub ours: Vec<String>,
    /// The differences between the paper and the reproduction.
    pub differs: String,
}

/// The rows of `stated.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Stated {
    facts: Vec<Row>,
    results: Vec<Row>,
}

const NONE: &str = "\u{2013}";

/// The paper's columns of a result that it does not state: linear method and network.
fn not_in_the_paper() -> Vec<String> {
    vec![NONE.into(); 2]
}

impl Stated {
    fn read() -> Self {
        toml::from_str(include_str!("stated.toml")).expect("a file of this crate, read in its tests")
    }
}

/// A table of rows: the columns of the paper, those of the reproduction, and the differences.
pub(crate) fn table(paper: &[&str], ours: &[&str], rows: &[Row]) -> Table {
    let header: Vec<&str> = ["figure"].iter().chain(paper).chain(ours).chain(&["what differs"]).copied().collect();
    let mut table = Table::with_remarks(&header);
    for row in rows {
        let what = [format!("{} ({})", row.what, row.paper_section)];
        let what = if row.paper_section.is_empty() { [row.what.clone()] } else { what };
        let cells = what.iter().chain(&row.paper).chain(&row.ours).chain([&row.differs]);
        table.push(cells.cloned().collect());
    }
    table
}

/// The rows that have values, in the order of the file.
fn filled(rows: Vec<Row>, ours: impl Fn(&str) -> Option<Vec<String>>) -> Vec<Row> {
    rows.into_iter().filter_map(|row| Some(Row { ours: ours(&row.key)?, ..row })).collect()
}

/// Rows on the sensor, its instrument and its data.
pub(crate) fn facts(results: &Results<'_>) -> Vec<Row> {
    filled(Stated::read().facts, |key| Some(vec![FACTS.iter().find(|fact| fact.0 == key)?.1(results)]))
}

/// Rows of results: those of the benchmark, and of structure and losses where there are any.
pub(crate) fn results(results: &Results<'_>) -> Vec<Row> {
    filled(Stated::read().results, |key| RESULTS.iter().find(|value| value.0 == key)?.1.of_all(key, results))
}

/// The value of a row on the sensor, its instrument or its data.
type Fact = fn(&Results<'_>) -> String;

/// These values, by key.
const FACTS: [(&str, Fact); 10] = [
    ("body", |results| match results.bench.skin.design().body {
        Body::Cylinder { length_m, diameter_m } => format!("{}, {}", mm(length_m), mm(diameter_m)),
        Body::Rectangle { width_m, height_m } => format!("flat, {} x {}", mm(width_m), mm(height_m)),
        Body::Disk { diameter_m } => format!("flat disk, {}", mm(diameter_m)),
        Body::Mesh { .. } => "a mesh file".into(),
    }),
    ("area", |results| format!("{:.0} cm\u{b2}", results.bench.skin.pixels().areas.iter().sum::<f64>() * 1e4)),
    ("electrodes", |results| results.bench.skin.design().electrodes.len().to_string()),
    ("sheet_resistance", |results| {
        let sheet_ohm = 1.0 / results.bench.skin.design().sheet.conductance;
        format!("{sheet_ohm:.0} ohm per square, uneven by {:.0} %", 100.0 * results.bench.twin.coat.rms)
    }),
    ("model", |results| {
        format!("{} nodes; the twins {}", results.bench.skin.mesh().node_count(), results.gallery.pressed.nodes)
    }),
    ("voltages", |results| results.bench.skin.design().protocol.channel_count().to_string()),
    ("image", |results| match results.bench.skin.design().image {
        ImageLayout::Grid { rows, columns } => format!("{rows} x {columns}"),
        ImageLayout::Cells | ImageLayout::Patches => format!("{} pixels", results.bench.skin.pixels().len()),
    }),
    ("frame_rate", |results| format!("{:.0}", results.bench.twin.electronics.frame_rate_hz)),
    ("reading_rate", |results| format!("{:.0},000", results.bench.twin.electronics.slot_rate_hz / 1e3)),
    ("presses", |results| {
        let presses = results.bench.skin.pixels().len().div_ceil(results.scale.result().sizes.grid_step);
        format!("{presses} on each of {}", results.twins())
    }),
];

/// The values of a result, one per method.
enum Value {
    /// The benchmark's figure of the same key: the factor to its unit, and the number of decimals.
    Figure(f64, usize),
    /// A figure of the benchmark over that of the best linear method.
    OverLinear(&'static str),
    /// Of the results by the number of the method.
    Method(fn(&Results<'_>, usize) -> String),
    /// Of the method on a design of the study of structure.
    Structure(&'static str, fn(&Structure) -> String),
    /// Of the training of a network.
    Training(fn(&TrainingRecord) -> Option<String>),
}

/// The values of the results, by key.
const RESULTS: [(&str, Value); 27] = [
    ("localisation", Value::Method(|results, method| localisation(&results.assessed[method]))),
    ("grid_eq11_mean_m", Value::Figure(1e3, 1)),
    ("localisation_over_linear", Value::OverLinear("grid_localisation_mean_m")),
    ("random_localisation_mean_m", Value::Figure(1e3, 1)),
    ("grid_localisation_p95_m", Value::Figure(1e3, 1)),
    ("rim_and_seam_mean_m", Value::Figure(1e3, 1)),
    ("grid_misses", Value::Figure(1.0, 1)),
    ("grid_ghosts", Value::Figure(1.0, 1)),
    ("grid_sensitivity_spread", Value::Figure(1.0, 2)),
    ("sensitivity_spread_over_linear", Value::OverLinear("grid_sensitivity_spread")),
    ("four_all_found", Value::Figure(100.0, 0)),
    ("two_resolved_from_m", Value::Figure(1e3, 0)),
    ("two_resolved_at_40_mm", Value::Figure(100.0, 0)),
    ("least_force_median_n", Value::Figure(1.0, 3)),
    ("least_force_p95_n", Value::Figure(1.0, 3)),
    ("unexplained", Value::Method(|results, method| results.assessed[method].unexplained.map_or(NONE.into(), percent))),
    (
        "seconds_a_frame",
        Value::Method(|results, method| format!("{:.2} ms", results.gallery.seconds_a_frame[method] * 1e3)),
    ),
    ("bias", Value::Structure("designed", bias)),
    ("bias_cut_open", Value::Structure("cut", bias)),
    ("missed_middle", Value::Structure("designed", |one| percent(one.missed_middle))),
    ("missed_middle_rims", Value::Structure("rims-across", |one| percent(one.missed_middle))),
    ("training_samples", Value::Training(|record| Some(record.samples.to_string()))),
    ("test_samples", Value::Training(|record| Some(record.test_samples.to_string()))),
    ("minibatch", Value::Training(|record| Some(record.options.batch.to_string()))),
    ("training_loss", Value::Training(|record| last(record, |epoch| format!("{:.2e}", epoch.training_loss)))),
    ("test_loss", Value::Training(|record| last(record, |epoch| format!("{:.2e}", epoch.test_loss)))),
    (
        "unexplained_loss",
        Value::Training(|record| last(record, |epoch| percent(epoch.test_loss / record.target_variance))),
    ),
];

impl Value {
    /// The values of all methods; `None` without a study of structure, or without networks.
    fn of_all(&self, key: &str, results: &Results<'_>) -> Option<Vec<String>> {
        let exists = match self {
            Value::Structure(..) => results.structure.is_some(),
            Value::Training(_) => results.methods.iter().any(|method| method.card.is_some()),
            _ => true,
        };
        exists.then(|| (0..results.assessed.len()).map(|method| self.of(key, results, method)).collect())
    }

    fn of(&self, key: &str, results: &Results<'_>, method: usize) -> String {
        let assessed = &results.assessed[method];
        let found = match self {
            Value::Figure(factor, decimals) => Some(cell(assessed, key, *factor, *decimals)),
            Value::OverLinear(figure) => {
                let best = results.linear().map(|one| one.figure(figure)[0]).fold(f64::INFINITY, f64::min);
                Some(format!("{:.2}", assessed.figure(figure)[0] / best))
            }
            Value::Method(of) => Some(of(results, method)),
            Value::Structure(design, of) => {
                results.structure.as_ref().and_then(|study| study.of(design, &assessed.key)).map(of)
            }
            Value::Training(of) => results.methods[method].card.as_ref().and_then(|card| of(&card.training)),
        };
        found.unwrap_or_else(|| NONE.into())
    }
}

/// Mean over the twins, and the worst twin in parentheses.
fn cell(assessed: &Benchmarked, key: &str, factor: f64, decimals: usize) -> String {
    let [mean, worst] = assessed.figure(key).map(|value| factor * value);
    match mean.is_nan() {
        true => "none".into(),
        false if assessed.twins.len() == 1 => format!("{mean:.decimals$}"),
        false => format!("{mean:.decimals$} ({worst:.decimals$})"),
    }
}

/// Mean and standard deviation of the localisation on the grid in mm, the mean of the worst twin in parentheses.
fn localisation(assessed: &Benchmarked) -> String {
    let [mean, worst] = assessed.figure("grid_localisation_mean_m").map(|value| value * 1e3);
    let sd = assessed.figure("grid_localisation_sd_m")[0] * 1e3;
    let worst = if assessed.twins.len() > 1 { format!(" ({worst:.1})") } else { String::new() };
    format!("{mean:.1} \u{b1} {sd:.1}{worst}")
}

fn mm(length_m: f64) -> String {
    format!("{:.0} mm", length_m * 1e3)
}

fn percent(part: f64) -> String {
    format!("{:.1}", 100.0 * part)
}

fn bias(one: &Structure) -> String {
    format!("{:+.2}, {:+.2}", one.bias_along_m * 1e3, one.bias_round_m * 1e3)
}

fn last(record: &TrainingRecord, of: impl Fn(&Epoch) -> String) -> Option<String> {
    record.epochs.last().map(of)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis_study::metrics::figures;

    fn keys<'a>(keys: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
        let mut keys: Vec<&str> = keys.collect();
        keys.sort_unstable();
        keys
    }

    #[test]
    fn every_row_has_its_value_and_every_value_its_row() {
        let Stated { facts, results } = Stated::read();
        assert_eq!(keys(facts.iter().map(|row| &row.key[..])), keys(FACTS.iter().map(|fact| fact.0)));
        assert_eq!(keys(results.iter().map(|row| &row.key[..])), keys(RESULTS.iter().map(|value| value.0)));
        assert!(facts.iter().all(|row| row.paper.len() == 1) && results.iter().all(|row| row.paper.len() == 2));
    }

    #[test]
    fn the_figures_are_those_of_the_benchmark() {
        for (key, value) in &RESULTS {
            let figure = match value {
                Value::Figure(..) => key,
                Value::OverLinear(figure) => figure,
                _ => continue,
            };
            assert!(figures().any(|one| one.key == *figure), "{figure}");
        }
    }
}
