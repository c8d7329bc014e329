//! The findings of a checked recording as a page with pictures.

use dermis::skin::Skin;
use dermis::text::counted;
use dermis_calibrate::checks::{Checked, Figures};
use dermis_plot::chart::{Curves, HeatMap};
use dermis_plot::report::Report;
use dermis_plot::{Picture, Scale};

/// The page of a checked recording.
pub fn page(skin: &Skin, frames: usize, checked: &Checked) -> Report {
    let lead = format!(
        "{} of {} channels, compared with each other and with the model of the skin.",
        counted(frames, "frame"),
        checked.lags.len()
    );
    let mut report = Report::new(&format!("Check of a recording of {}", skin.design().name), &lead);
    report.findings(&checked.findings);
    let figures = &checked.figures;
    let pictures: Vec<(Picture, String)> =
        [untouched(figures), lags(figures), shifts(figures), trend(figures)].into_iter().flatten().collect();
    if !pictures.is_empty() {
        report.heading("Figures");
        report.pictures(&pictures);
    }
    let correlations = correlations(figures);
    if !correlations.is_empty() {
        report.heading("Correlation of the channels");
        report.paragraph(&format!(
            "Cosine between the two maps, in the order of the design: {:.3}. On a membrane whose coat is far from even it is \
             low; a wrong order lowers it further.",
            figures.correlation_cosine
        ));
        report.pictures(&correlations);
    }
    report
}

fn untouched(figures: &Figures) -> Option<(Picture, String)> {
    if figures.untouched.is_empty() {
        return None;
    }
    let curve =
        |values: &[f64]| values.iter().enumerate().map(|(channel, value)| [channel as f64, *value]).collect::<Vec<_>>();
    let chart = Curves {
        title: "Untouched frame",
        subtitle: &format!("cosine with the model {:.4}, values compressed by asinh", figures.untouched_cosine),
        below: "channel",
        left: "value (ohm)",
        logarithmic: false,
        shown: vec![0.0],
        curves: vec![("measured".into(), curve(&figures.untouched)), ("model".into(), curve(&figures.model_untouched))],
    };
    Some((chart.draw(), "The mean untouched frame and that of the model.".into()))
}

fn lags(figures: &Figures) -> Option<(Picture, String)> {
    let first = figures.lag_explained.first().filter(|explained| !explained.is_empty())?;
    let row = |lag: usize| figures.lag_explained.iter().map(|explained| explained[lag].max(0.0)).collect::<Vec<f64>>();
    let rows: Vec<Vec<f64>> = (0..first.len()).map(row).collect();
    let map = HeatMap {
        title: "How well the other channels predict a channel",
        subtitle: "",
        below: "channel",
        left: "lag (rows)",
        first: [0.0, f64::from(*figures.lags.first()?)],
        rows: &rows,
        scale: Scale::sequential([0.0, 1.0]),
        label: "explained part of the variance",
    };
    let caption =
        "A channel in time is bright at lag 0; one that is a row late at lag 1. A dead channel is dark at all lags.";
    Some((map.draw(), caption.into()))
}

fn shifts(figures: &Figures) -> Option<(Picture, String)> {
    if figures.shift_explained.is_empty() {
        return None;
    }
    let points = figures.shifts.iter().zip(&figures.shift_explained).map(|(shift, part)| [f64::from(*shift), *part]);
    let chart = Curves {
        title: "Positions against frames",
        subtitle: "",
        below: "shift of the truth (rows)",
        left: "explained part of the frames",
        logarithmic: false,
        shown: vec![0.0],
        curves: vec![("explained".into(), points.collect())],
    };
    Some((chart.draw(), "The largest value belongs at shift 0.".into()))
}

fn trend(figures: &Figures) -> Option<(Picture, String)> {
    if figures.trend.is_empty() {
        return None;
    }
    let chart = Curves {
        title: "Drift",
        subtitle: "",
        below: "row",
        left: "mean (standard deviations)",
        logarithmic: false,
        shown: vec![-0.5, 0.5],
        curves: vec![("trend".into(), figures.trend.clone())],
    };
    let caption = format!(
        "The component of the frames that drifts most, averaged over fiftieths of the rows. Of the median channel, {:.1} % of the \
         variance is drift.",
        100.0 * figures.drift.max(0.0)
    );
    Some((chart.draw(), caption))
}

fn correlations(figures: &Figures) -> Vec<(Picture, String)> {
    let map = |title: &str, rows: &[Vec<f64>]| {
        let map = HeatMap {
            title,
            subtitle: "",
            below: "channel of the design",
            left: "channel of the design",
            first: [0.0; 2],
            rows,
            scale: Scale::diverging([1.0]),
            label: "correlation",
        };
        map.draw()
    };
    if figures.correlation.len() < 2
        || figures.correlation.iter().flatten().all(|value| *value == 0.0 || value.is_nan())
    {
        return Vec::new();
    }
    vec![
        (map("Measured", &figures.correlation), "Over the rows, with late channels moved to their rows.".into()),
        (map("Model", &figures.model_correlation), "Over simulated single touches.".into()),
    ]
}
