//! Statistics of a live skin, as they are shown at its end.

use crate::console::{note, print_json};
use crate::failure::Outcome;
use dermis::stats::nearest_quantiles;
use dermis::text::counted;
use dermis_live::{LiveStatistics, LiveSummary};
use dermis_plot::chart::Histogram;
use dermis_plot::report::Table;
use serde_json::json;
use std::path::Path;

/// Prints the final statistics, and draws the latencies into a file (SVG).
pub fn show(statistics: &LiveStatistics, uncounted: u64, picture: Option<&Path>, as_json: bool) -> Outcome {
    let summary = statistics.summary(uncounted);
    if let Some(path) = picture {
        draw(statistics.latencies_ms(), path)?;
    }
    if as_json {
        return print_json(&json!(summary));
    }
    let LiveSummary { seconds, frames, skipped, left_out, latency_ms, .. } = &summary;
    let mut table = Table::new(&["quantity", "value"]);
    table.pair("frames", format!("{frames} in {seconds:.1} s"));
    table.pair("of them with contacts", summary.frames_with_contacts);
    table.pair("lost in transfer", summary.lost);
    table.pair("dropped before the pipeline", skipped);
    for (sink, count) in left_out {
        table.pair(&format!("dropped by {sink}"), count);
    }
    table.pair("repeated; reordered", format!("{}; {}", summary.repeated, summary.reordered));
    table.pair("damaged packets", summary.damaged);
    table.pair("from last byte to contacts, median", format!("{:.3} ms", latency_ms.median));
    table.pair("the same, 99 % within", format!("{:.3} ms", latency_ms.p99));
    table.pair("the same, longest", format!("{:.3} ms", latency_ms.worst));
    // Standard output may carry lines of JSON, and its writer may hold the lock while a reader does not read.
    note(&format!("\n{}", table.to_text()));
    Ok(())
}

fn draw(all_ms: &[f32], path: &Path) -> Outcome {
    let [median, p99] = nearest_quantiles(all_ms, [0.5, 0.99]).map(f64::from);
    // Rare outliers would compress the rest of the histogram.
    let shown: Vec<f64> = all_ms.iter().map(|&ms| f64::from(ms)).filter(|&ms| ms <= 3.0 * p99).collect();
    let marks = vec![(median, format!("median {median:.2} ms")), (p99, format!("99 % within {p99:.2} ms"))];
    let histogram = Histogram {
        title: &counted(all_ms.len(), "frame"),
        label: "from the last byte of a frame to its contacts (ms)",
        values: &shown,
        counted: "frames",
        step: (p99 / 40.0).max(0.005),
        marks,
    };
    Ok(histogram.draw().write_svg(path)?)
}
