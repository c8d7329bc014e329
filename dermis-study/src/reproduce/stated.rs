//! The figures in the paper, one by one, next to those of the reproduction.

use super::benchmarked::Benchmarked;
use super::results::Results;
use crate::comparison::Named;
use dermis::design::{Body, ImageLayout};
use dermis_learn::TrainingRecord;
use dermis_plot::report::Table;
use serde::Serialize;

/// A figure in the paper and in the reproduction.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Row {
    /// The quantity, with its unit.
    pub what: String,
    /// The section of the paper.
    pub paper_section: &'static str,
    /// The values in the paper, one per column of its table; a dash where there is no value.
    pub paper: Vec<String>,
    /// The values of the reproduction, one per column of its table.
    pub ours: Vec<String>,
    /// The differences between the paper and the reproduction.
    pub differs: String,
}

const NONE: &str = "\u{2013}";

/// A table of rows: the columns of the paper, those of the reproduction, and the differences.
pub(super) fn table(paper: &[&str], ours: &[&str], rows: &[Row]) -> Table {
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

/// Rows on the sensor, its instrument and its data.
pub(super) fn facts(results: &Results<'_>) -> Vec<Row> {
    let design = results.bench.skin.design();
    let row = |what: &str, paper_section, paper: &str, ours: String, differs: &str| Row {
        what: what.into(),
        paper_section,
        paper: vec![paper.into()],
        ours: vec![ours],
        differs: differs.into(),
    };
    let mm = |length_m: f64| format!("{:.0} mm", length_m * 1e3);
    let size = match design.body {
        Body::Cylinder { length_m, diameter_m } => format!("{}, {}", mm(length_m), mm(diameter_m)),
        Body::Rectangle { width_m, height_m } => format!("flat, {} x {}", mm(width_m), mm(height_m)),
        Body::Disk { diameter_m } => format!("flat disk, {}", mm(diameter_m)),
        Body::Mesh { .. } => "a mesh file".into(),
    };
    let area_cm2 = results.bench.skin.pixels().areas.iter().sum::<f64>() * 1e4;
    let image = match design.image {
        ImageLayout::Grid { rows, columns } => format!("{rows} x {columns}"),
        ImageLayout::Cells => format!("{} cells", results.bench.skin.pixels().len()),
    };
    let electronics = &results.bench.twin.electronics;
    let presses = results.bench.skin.pixels().len().div_ceil(results.scale.result().sizes.grid_step);
    let [nodes, twin_nodes] = [results.bench.skin.mesh().node_count(), results.gallery.pressed.nodes];
    let sheet_ohm = 1.0 / design.sheet.conductance;
    vec![
        row("length and diameter of the body", "III.A", "300 mm, 100 mm", size, "nothing"),
        row(
            "sensing area",
            "V",
            "30 cm x 31.4 cm = 942 cm\u{b2}",
            format!("{area_cm2:.0} cm\u{b2}"),
            "nothing; the 90 cm\u{b2} of the paper's abstract is an error",
        ),
        row(
            "electrodes",
            "III.A",
            "30, in 6 rings of 5, rings 60 mm apart, a triangular grid",
            design.electrodes.len().to_string(),
            "the electrodes' size is not stated: ours have a radius of 4 mm, and six rings 60 mm apart put the outer ones on \
             the rims, as half discs",
        ),
        row(
            "sheet resistance",
            "III.B",
            "\u{201c}suitable\u{201d}",
            format!("{sheet_ohm:.0} ohm per square, uneven by {:.0} %", 100.0 * results.bench.twin.coat.rms),
            "not stated; ours is one coat of many, uneven over each twin as a sprayed coat is",
        ),
        row(
            "model",
            "III.A, Fig. 3",
            "a mesh of EIDORS; nodes not stated",
            format!("{nodes} nodes; the twins {twin_nodes}"),
            "frames come from meshes of their own, on which no image is made",
        ),
        row(
            "voltages of a frame",
            "II.C",
            "870",
            design.protocol.channel_count().to_string(),
            "nothing: adjacent pairs drive, all others measure",
        ),
        row("image", "II.C", "30 x 30", image, "nothing"),
        row(
            "frames a second",
            "III.C",
            "120",
            format!("{:.0}", electronics.frame_rate_hz),
            "ours is the instrument's own model: it includes the settling of switches, 12-bit quantization and noise",
        ),
        row(
            "readings a second",
            "III.C",
            "up to 120,000",
            format!("{:.0},000", electronics.slot_rate_hz / 1e3),
            "nothing; 870 values and 30 currents fill 7.5 ms of 8.3",
        ),
        row(
            "presses",
            "IV.A",
            "900, on a 30 x 30 grid, on one skin",
            format!("{presses} on each of {}", results.twins()),
            "their forces are not stated: ours lie between 1 and 5 N, log-uniform, independent of the place. Ours press fabric \
             patches under foam on a twin whose coat, electrodes and contacts are unknown to all methods",
        ),
    ]
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

/// Rows of results.
pub(super) fn results(results: &Results<'_>) -> Vec<Row> {
    let ours = |of: &dyn Fn(&Benchmarked) -> String| results.assessed.iter().map(of).collect::<Vec<String>>();
    let row = |what: &str, paper_section, paper: [&str; 2], ours: Vec<String>, differs: &str| Row {
        what: what.into(),
        paper_section,
        paper: paper.map(String::from).to_vec(),
        ours,
        differs: differs.into(),
    };
    let plain = |what, key, factor, decimals, differs| {
        row(what, "", [NONE, NONE], ours(&|one| cell(one, key, factor, decimals)), differs)
    };
    let with_sd = |set: &str| {
        ours(&|one| {
            let [mean, worst] = one.figure(&format!("{set}_localisation_mean_m")).map(|value| value * 1e3);
            let sd = one.figure(&format!("{set}_localisation_sd_m"))[0] * 1e3;
            let worst = if one.twins.len() > 1 { format!(" ({worst:.1})") } else { String::new() };
            format!("{mean:.1} \u{b1} {sd:.1}{worst}")
        })
    };
    let best_linear = |key: &str| results.linear().map(|one| one.figure(key)[0]).fold(f64::INFINITY, f64::min);
    let over_linear = |key: &str| {
        let best = best_linear(key);
        ours(&|one| format!("{:.2}", one.figure(key)[0] / best))
    };
    let mut rows = vec![
        row(
            "localisation, presses on the grid, mm",
            "IV.B",
            ["5.5 \u{b1} 3.2", "5.2 \u{b1} 3.3"],
            with_sd("grid"),
            "the paper's were measured on a real skin, by the centroid of the whole image; ours are simulated, the place of the \
             contact that one detector finds in every method's image",
        ),
        row(
            "the same, by the centroid of the whole image (Eq. 11), mm",
            "IV.B",
            ["5.5", "5.2"],
            ours(&|one| cell(one, "grid_eq11_mean_m", 1e3, 1)),
            "the paper's formula on the whole image, without a threshold: ringing and noise far from the press weigh in. The \
             paper does not say how its own images were cut to keep them out",
        ),
        row(
            "localisation over that of the best linear method",
            "IV.B",
            ["1", "0.95"],
            over_linear("grid_localisation_mean_m"),
            "on the same frames",
        ),
        plain("presses at random places, mm", "random_localisation_mean_m", 1e3, 1, "patches shifted against the grid"),
        plain("95th percentile, grid, mm", "grid_localisation_p95_m", 1e3, 1, "not stated in the paper"),
        plain("rim and seam, mm", "rim_and_seam_mean_m", 1e3, 1, "within 20 mm of a rim or 15 mm of the seam"),
        plain("misses on the grid", "grid_misses", 1.0, 1, "no contact within 20 mm"),
        plain("false positives on the grid", "grid_ghosts", 1.0, 1, "a contact where nothing touched"),
        row(
            "sensitivity spread, sd over mean",
            "IV.C",
            ["0.45", "0.39"],
            ours(&|one| cell(one, "grid_sensitivity_spread", 1.0, 2)),
            "peak of the image over the force (Eq. 12). Twins are pressed with forces from 1 to 5 N on contacts that saturate \
             and on patches with gaps, so that strength per newton itself differs from press to press; the paper's forces are not \
             stated",
        ),
        row(
            "sensitivity spread over that of the best linear method",
            "IV.C",
            ["1", "0.87"],
            over_linear("grid_sensitivity_spread"),
            "on the same frames",
        ),
        row(
            "four touches: all four found, no false positive, % of frames",
            "IV.D, Fig. 9",
            ["not resolved", "resolved"],
            ours(&|one| cell(one, "four_all_found", 100.0, 0)),
            "the paper shows one picture, pressed by hand; ours are counted, at random places at least 60 mm apart with forces \
             between 1 and 5 N, each found within 15 mm",
        ),
        plain(
            "two touches: 90 % resolved from, mm",
            "two_resolved_from_m",
            1e3,
            0,
            "shown by the paper's Fig. 9 alone",
        ),
        plain("two touches: resolved at 40 mm, %", "two_resolved_at_40_mm", 100.0, 0, "not stated in the paper"),
        plain("smallest force found, median, N", "least_force_median_n", 1.0, 3, "not stated in the paper"),
        plain(
            "smallest force found, 95th percentile over places, N",
            "least_force_p95_n",
            1.0,
            3,
            "found 90 % of the time at no more than one false contact an hour at 120 frames a second",
        ),
    ];
    rows.push(row(
        "left unexplained of Gaussian touches, % of their variance",
        "",
        [NONE, NONE],
        ours(&|one| one.unexplained.map_or(NONE.to_string(), |part| format!("{:.1}", 100.0 * part))),
        "fresh samples of what the paper's network learned from, with noise from 54 to 42 dB, each method's images times its one best \
         gain; the best network makes an image of touches and not of conductance",
    ));
    let seconds = results.gallery.seconds_a_frame.iter();
    rows.push(row(
        "time for a frame",
        "III.C",
        ["8.3 ms", "8.3 ms"],
        seconds.map(|&seconds| format!("{:.2} ms", seconds * 1e3)).collect(),
        "the paper's is the time between two of its 120 frames a second, measuring included; ours is the processing of one frame on one thread, \
         median, on the machine that made this page",
    ));
    rows.extend(structure_rows(results));
    rows.extend(loss_rows(results));
    rows
}

/// Rows of losses, if there are networks.
fn loss_rows(results: &Results<'_>) -> Vec<Row> {
    if results.methods.iter().all(|method| method.card.is_none()) {
        return Vec::new();
    }
    let row = |what: &str, paper: &str, of: &dyn Fn(&TrainingRecord) -> Option<String>, differs: &str| {
        let one =
            |method: &Named| method.card.as_ref().and_then(|card| of(&card.training)).unwrap_or_else(|| NONE.into());
        Row {
            what: what.into(),
            paper_section: if paper == NONE { "" } else { "II.C" },
            paper: vec![NONE.into(), paper.into()],
            ours: results.methods.iter().map(one).collect(),
            differs: differs.into(),
        }
    };
    let loss = |loss: f64| format!("{loss:.2e}");
    vec![
        row(
            "training samples",
            "about 1,100,000",
            &|record| Some(record.samples.to_string()),
            "the paper's are of one skin; ours of many, whose coats and electrodes differ",
        ),
        row("test samples", "40,000", &|record| Some(record.test_samples.to_string()), "simulated, as the paper's"),
        row("minibatch", "360", &|record| Some(record.options.batch.to_string()), "nothing"),
        row(
            "loss on training samples",
            "6.17e-4",
            &|record| record.epochs.last().map(|epoch| loss(epoch.training_loss)),
            "the paper does not state the scale of its target; ours is the relative change of conductance, for the best network each touch \
             as a Gaussian of one width and of the strength of the touch",
        ),
        row(
            "loss on test samples",
            "6.42e-4",
            &|record| record.epochs.last().map(|epoch| loss(epoch.test_loss)),
            "the same; ours with noise on the input",
        ),
        row(
            "test loss over the variance of the target, %",
            NONE,
            &|record| {
                record.epochs.last().map(|epoch| format!("{:.1}", 100.0 * epoch.test_loss / record.target_variance))
            },
            "what the network leaves unexplained, whatever the scale",
        ),
    ]
}

/// Rows on the paper's claims on structure.
fn structure_rows(results: &Results<'_>) -> Vec<Row> {
    let Some(study) = &results.structure else { return Vec::new() };
    let of = |design: &str, format: &dyn Fn(&super::bias::Structure) -> String| {
        let one = |assessed: &Benchmarked| study.of(design, &assessed.key).map_or(NONE.to_string(), format);
        results.assessed.iter().map(one).collect::<Vec<String>>()
    };
    let signed = |along_m: f64, round_m: f64| format!("{:+.2}, {:+.2}", along_m * 1e3, round_m * 1e3);
    let row = |what: &str, paper_section, paper: &str, ours, differs: &str| Row {
        what: what.into(),
        paper_section,
        paper: vec![NONE.into(), paper.into()],
        ours,
        differs: differs.into(),
    };
    vec![
        row(
            "bias towards the middle, along and round, mm",
            "IV.B",
            "none",
            of("designed", &|one| signed(one.bias_along_m, one.bias_round_m)),
            "the paper states it for its Fig. 7 without a figure. Round means away from a line 18 degrees beside the seam; on a closed \
             skin it should vanish",
        ),
        row(
            "the same on the skin cut open, mm",
            "IV.B",
            "not tried",
            of("cut", &|one| signed(one.bias_along_m, one.bias_round_m)),
            "the control of that claim: see the section on structure",
        ),
        row(
            "missed in the middle third of the length, %",
            "",
            NONE,
            of("designed", &|one| format!("{:.1}", 100.0 * one.missed_middle)),
            "presses at random places",
        ),
        row(
            "the same with all electrodes on the rims, %",
            "III.A",
            "poor there",
            of("rims-across", &|one| format!("{:.1}", 100.0 * one.missed_middle)),
            "the paper cites its predecessor, without a figure; ours is the same skin with its electrodes on the rims, driven from \
             rim to rim, each method made anew for it",
        ),
    ]
}
