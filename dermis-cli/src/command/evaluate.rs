//! `dermis evaluate`: contacts against what truly touched the skin.

use crate::console::{print, print_json};
use crate::failure::{Failure, Outcome};
use crate::frames::FrameArguments;
use crate::method::MethodArguments;
use crate::skin::{Per, Skin};
use clap::Args;
use dermis::evaluate::{Score, Summary, score};
use dermis::frame::{Truth, read_truth};
use std::path::PathBuf;

/// The arguments of `dermis evaluate`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The design: a path, or a shipped name.
    design: String,
    #[command(flatten)]
    frames: FrameArguments,
    #[command(flatten)]
    method: MethodArguments,
    /// Where the skin was touched, a row per touch: frame,z_m,theta_rad on a cylinder, frame,x_m,y_m on a flat skin,
    /// frame,x_m,y_m,z_m on a mesh; force_n may follow.
    #[arg(long, value_name = "FILE")]
    truth: PathBuf,
    /// Print JSON (lengths in m) in place of a table (mm).
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Makes images, finds contacts and scores them.
    pub fn run(self) -> Outcome {
        let skin = Skin::load(&self.design)?;
        let differences = self.frames.read(&skin.design.protocol)?;
        let truth = read_truth(&self.truth, &skin.design.body.surface(), differences.frames.len())?;
        let Truth::OnSkin(truth) = truth else {
            let message = format!("{} has no header: its frame of space is unknown", self.truth.display());
            return Err(Failure::given(message, Some("name the columns in the first row")));
        };
        let method = self.method.prepare(&skin, Per::Pixel, &differences)?;
        let detector = method.detector(&differences)?;
        let images = method.images(&differences.frames)?;
        let score = score(&images, &truth, &detector, &method.reconstruct.name(), method.alpha)?;
        if self.json { print_json(&score) } else { print(&table(&skin.design.name, &score)) }
    }
}

/// A score for people.
fn table(skin: &str, score: &Score) -> String {
    let alpha = score.alpha.map(|alpha| format!(", alpha {alpha:.4}")).unwrap_or_default();
    let spread = if score.sensitivity_spread.is_finite() {
        format!("{:.2} (standard deviation over mean)", score.sensitivity_spread)
    } else {
        "not known without forces".to_string()
    };
    format!(
        "{skin}: {}{alpha}\n  presses             {}, of which {} missed; {} ghosts\n  localisation        {}\n  \
         whole-image (Eq 11) {}\n  sensitivity spread  {spread}\n",
        score.method,
        score.presses,
        score.misses,
        score.ghosts,
        millimetres(&score.localisation_m),
        millimetres(&score.eq11_m),
    )
}

/// A summary of distances in mm.
fn millimetres(summary: &Summary) -> String {
    if summary.mean.is_nan() {
        return "no value".into();
    }
    let [mean, sd, median, p95] =
        [summary.mean, summary.sd, summary.median, summary.p95].map(|value_m| value_m * 1000.0);
    format!("{mean:.2} +- {sd:.2} mm, median {median:.2} mm, 95 % within {p95:.2} mm")
}
