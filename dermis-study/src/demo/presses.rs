//! The paper's 900 indentations, simulated.

use super::{PAPER_LINEAR, PAPER_NETWORK};
use crate::Result;
use crate::comparison::{self, Shown};
use crate::plots::four_touches;
use crate::progress::Progress;
use dermis::contact::Contact;
use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::skin::Skin;
use dermis::stats::Summary;
use dermis::text::counted;
use dermis_plot::report::Table;
use dermis_sim::experiment::{Recording, record};
use dermis_sim::twin::{Press, Twin, TwinOptions};
use std::time::Instant;

/// The twin that is pressed.
pub(super) const TWIN: &str = "lab";
/// Force of every press, N: an everyday touch.
pub(super) const FORCE_N: f64 = 2.0;

/// What the comparison with the paper is worth.
pub(super) const CAVEAT: &str = "\
The first rows are simulated: the twin `lab` has fabric patches under foam, an uneven coat, displaced electrodes, noise,\n\
quantization and drift, on a finer mesh than the one that is used to reconstruct. The paper's rows were measured on a\n\
real skin, as centroids of whole images. The table shows what the chain from frames to contacts does, not that this skin\n\
is better than that one.";

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
        let press = |(&at, &normal): (&Point3, &Point3)| vec![Contact::truth(at, normal, FORCE_N)];
        let mut truth: Vec<Vec<Contact>> = pixels.centres_m.iter().zip(&pixels.normals).map(press).collect();
        truth.push(four_touches(skin.design(), FORCE_N).expect("the paper's skin is a cylinder"));

        let options = TwinOptions::shipped(TWIN).expect("a shipped twin");
        let twin = Twin::new(skin.design(), &options, seed)?;
        let recording = record_presses(&twin, &truth, progress)?;
        let untouched: Vec<Frame> = recording.untouched.iter().map(|frame| frame - &recording.baseline).collect();
        let (recording, four) = recording.split_last().expect("the four touches were pressed last");
        let four_truth = truth.pop().expect("and their true places are the last");

        let (mut shown, mut of_four) = (Vec::new(), Vec::new());
        for method in comparison::for_the_demo(&skin)? {
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
        format!(
            "{} of {FORCE_N} N on the twin `{TWIN}` of {}, SIMULATED on {} nodes (seed {}), reconstructed on {} nodes,\n\
             in {:.0} s.\n",
            counted(self.truth.len(), "press"),
            self.skin.design().name,
            self.simulation_nodes,
            self.seed,
            self.skin.mesh().node_count(),
            self.seconds
        )
    }

    /// The contacts of each method next to the results of the paper.
    pub(super) fn table(&self) -> Table {
        let header =
            ["method", "mean \u{b1} sd (mm)", "median", "95 % within", "missed", "false", "spread of the strength"];
        let mut table = Table::new(&header);
        let none = || "\u{2013}".to_string();
        for Shown { name, score, .. } in &self.shown {
            let [error, median, p95] = cells(&score.localisation_m);
            let counts = [score.misses, score.false_positives].map(|count| count.to_string());
            let spread = format!("{:.2}", score.sensitivity_spread);
            table.push(
                [format!("{name}, simulated"), error, median, p95].into_iter().chain(counts).chain([spread]).collect(),
            );
        }
        for (name, row) in [("linear method", PAPER_LINEAR), ("network", PAPER_NETWORK)] {
            let error = format!("{} \u{b1} {}", mm(row.mean_m), mm(row.sd_m));
            let spread = format!("{:.2}", row.sensitivity_spread);
            table.row([format!("paper's {name}, measured"), error, none(), none(), none(), none(), spread]);
        }
        table
    }

    /// The errors of the centroids of whole images, by which the paper locates.
    pub(super) fn whole_images(&self) -> Table {
        let mut table = Table::new(&["whole image (Eq. 11)", "mean \u{b1} sd (mm)", "median", "95 % within"]);
        for Shown { name, score, .. } in &self.shown {
            let [error, median, p95] = cells(&score.eq11_m);
            table.row([format!("{name}, simulated"), error, median, p95]);
        }
        table
    }
}

/// Mean and standard deviation, median and 95th percentile, mm.
fn cells(summary: &Summary) -> [String; 3] {
    [format!("{} \u{b1} {}", mm(summary.mean), mm(summary.sd)), mm(summary.median), mm(summary.p95)]
}

fn mm(value_m: f64) -> String {
    format!("{:.1}", value_m * 1e3)
}

fn record_presses(twin: &Twin, truth: &[Vec<Contact>], progress: &dyn Progress) -> Result<Recording> {
    let tip_radius_m = twin.options().press.tip_radius_m;
    let press = |touch: &Contact| Press { centre_m: touch.position_m, force_n: touch.force_n, tip_radius_m };
    let presses: Vec<Vec<Press>> = truth.iter().map(|frame| frame.iter().map(press).collect()).collect();
    let task = progress.begin("pressing", presses.len());
    Ok(record(twin, &presses, 0, || task.advance(1))?)
}
