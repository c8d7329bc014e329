//! The paper's 900 indentations, simulated.

use super::{PAPER_LINEAR, PAPER_NETWORK};
use crate::Result;
use crate::comparison::{self, Shown};
use crate::plots::four_touches;
use crate::progress::Progress;
use dermis::contact::Contact;
use dermis::design::SkinDesign;
use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::skin::Skin;
use dermis::stats::Summary;
use dermis::text::counted;
use dermis_plot::report::Table;
use dermis_sim::experiment::{Recording, record};
use dermis_sim::twin::{GaussianOptions, Press, TouchOptions, Twin, TwinOptions};
use std::time::Instant;

/// Relative increase of conductance at the centre of a press. The paper does not state its value; a fabric with the
/// resistance of the sheet doubles the conductance when it is pressed on it.
pub(super) const AMPLITUDE: f64 = 1.0;
/// Standard deviation of a press along the surface: about a fingertip with a full width at half maximum of 20 mm.
pub(super) const WIDTH_M: f64 = 0.008;
/// Ratio of the mesh sizes of simulation and reconstruction. The simulation mesh is finer, so that the same model does
/// not generate and reconstruct the frames (inverse crime).
const FINER: f64 = 0.5;
/// White noise of every reading, dB.
pub(super) const SNR_DB: f64 = 50.0;

/// Limits of the comparison between the rows of the table.
pub(super) const CAVEAT: &str = "\
The paper's network is ahead of the best network here because these frames are of the kind that it was trained on:\n\
Gaussian touches of the same simulation. The best network is trained for touches on conductive patches, as on digital\n\
twins and on a built skin (`dermis benchmark`, `dermis reproduce`).\n\
\n\
The paper's rows were measured: a real skin, a real indenter, real electronics. The rows above are simulated, on a\n\
uniform sheet with white noise at 50 dB and presses of one size; they show that the chain from frames to contacts\n\
works, not that this skin is better than that one.";

/// The demo's experiment and its results.
pub(super) struct Demo {
    /// The paper's skin.
    pub skin: Skin,
    /// Number of nodes of the simulation mesh.
    pub simulation_nodes: usize,
    /// Seed of the noise.
    pub seed: u64,
    /// Sensitivity of the frame to each pixel, per area.
    pub sensitivity: Vec<f64>,
    /// True positions of the touches in each frame.
    pub truth: Vec<Vec<Contact>>,
    /// The results of each method.
    pub shown: Vec<Shown>,
    /// Four simultaneous touches, as in the paper's Fig. 9.
    pub four_truth: Vec<Contact>,
    /// The results of each method on that frame.
    pub four: Vec<Shown>,
    /// Total time, s.
    pub seconds: f64,
}

impl Demo {
    /// Simulates one press on every pixel of the paper's skin, and a final frame with four touches.
    pub(super) fn run(seed: u64, progress: &dyn Progress) -> Result<Self> {
        let begun = Instant::now();
        let skin = Skin::load("cylinder30")?;
        let pixels = skin.pixels();
        // All presses have the same strength, as for a force of 1 N.
        let press = |(&at, &normal): (&Point3, &Point3)| vec![Contact::truth(at, normal, 1.0)];
        let mut truth: Vec<Vec<Contact>> = pixels.centres_m.iter().zip(&pixels.normals).map(press).collect();
        truth.push(four_touches(skin.design(), 1.0).expect("the paper's skin is a cylinder"));

        let twin = twin(skin.design(), seed)?;
        let recording = record_presses(&twin, &truth, progress)?;
        let untouched: Vec<Frame> = recording.untouched.iter().map(|frame| frame - &recording.baseline).collect();
        let (recording, four) = recording.split_last().expect("the four touches were pressed last");
        let four_truth = truth.pop().expect("and their true places are the last");

        let (mut shown, mut of_four) = (Vec::new(), Vec::new());
        for method in comparison::shipped(&skin)? {
            let detector = method.method.detector(&untouched, &skin.design().protocol)?;
            shown.push(Shown::of(&method, &recording, &truth, &detector, progress)?);
            of_four.push(Shown::of(&method, &four, std::slice::from_ref(&four_truth), &detector, progress)?);
        }
        Ok(Demo {
            sensitivity: skin.linearised()?.sensitivity(pixels),
            simulation_nodes: twin.mesh().node_count(),
            seconds: begun.elapsed().as_secs_f64(),
            skin,
            seed,
            truth,
            shown,
            four_truth,
            four: of_four,
        })
    }

    /// The first method.
    pub(super) fn first(&self) -> &Shown {
        self.shown.first().expect("there is the linear method at least")
    }

    /// A summary of the experiment, in two lines.
    pub(super) fn heading(&self) -> String {
        let methods: Vec<&str> = self.shown.iter().map(|shown| shown.how.as_str()).collect();
        format!(
            "{} on {}, SIMULATED on {} nodes with noise at {} dB (seed {}), reconstructed on {} nodes\n\
             ({}), in {:.0} s.\n",
            counted(self.truth.len(), "press"),
            self.skin.design().name,
            self.simulation_nodes,
            SNR_DB,
            self.seed,
            self.skin.mesh().node_count(),
            methods.join("; "),
            self.seconds
        )
    }

    /// The results next to the paper's linear row.
    pub(super) fn table(&self) -> Table {
        let header =
            ["localisation error", "mean \u{b1} sd (mm)", "median", "95th pct", "misses", "false positives", "spread"];
        let mut table = Table::new(&header);
        let mm = |value_m: f64| format!("{:.1}", value_m * 1e3);
        let pair = |mean_m: f64, sd_m: f64| format!("{} \u{b1} {}", mm(mean_m), mm(sd_m));
        let none = || "\u{2013}".to_string();
        let cells = |summary: &Summary| (pair(summary.mean, summary.sd), mm(summary.median), mm(summary.p95));
        for Shown { name, score, .. } in &self.shown {
            let (error, median, p95) = cells(&score.localisation_m);
            let counts = (score.misses.to_string(), score.false_positives.to_string());
            let spread = format!("{:.2}", score.sensitivity_spread);
            table.row([format!("{name}: contacts, simulated"), error, median, p95, counts.0, counts.1, spread]);
            let (error, median, p95) = cells(&score.eq11_m);
            let what = format!("{name}: whole image (Eq. 11), simulated");
            table.row([what, error, median, p95, none(), none(), none()]);
        }
        for (name, row) in [("linear method", PAPER_LINEAR), ("network", PAPER_NETWORK)] {
            let error = pair(row.mean_m, row.sd_m);
            let spread = format!("{:.2}", row.sensitivity_spread);
            table.row([format!("paper, {name} (Eq. 11), measured"), error, none(), none(), none(), none(), spread]);
        }
        table
    }
}

/// A twin with white noise as its only error, touched as in the training of the paper.
fn twin(design: &SkinDesign, seed: u64) -> Result<Twin> {
    let mut options = TwinOptions::shipped("ideal").expect("a shipped twin");
    options.mesh_scale = FINER;
    options.touch = TouchOptions::Gaussian(GaussianOptions { amplitude_per_n: AMPLITUDE, width_m: WIDTH_M });
    options.electronics.snr_db = Some(SNR_DB);
    Ok(Twin::new(design, &options, seed)?)
}

fn record_presses(twin: &Twin, truth: &[Vec<Contact>], progress: &dyn Progress) -> Result<Recording> {
    let tip_radius_m = twin.options().press.tip_radius_m;
    let press = |touch: &Contact| Press { centre_m: touch.position_m, force_n: touch.force_n, tip_radius_m };
    let presses: Vec<Vec<Press>> = truth.iter().map(|frame| frame.iter().map(press).collect()).collect();
    let task = progress.begin("pressing", presses.len());
    Ok(record(twin, &presses, 0, || task.advance(1))?)
}
