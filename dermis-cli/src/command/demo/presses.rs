//! The paper's 900 indentations, simulated.

use super::PAPER_LINEAR;
use crate::console::Progress;
use crate::failure::{Failure, Outcome};
use crate::report::Table;
use dermis::contact::Contact;
use dermis::design::SkinDesign;
use dermis::detect::{DetectOptions, Detector, ImageNoise};
use dermis::evaluate::{Score, Summary, score};
use dermis::experiment::{Recording, record};
use dermis::forward::ForwardModel;
use dermis::geom::Point3;
use dermis::image::{Image, PixelSpace};
use dermis::mesh::Mesh;
use dermis::reconstruct::{Linearised, OneStep, OneStepOptions, Reconstruct};
use dermis::twin::{GaussianOptions, Press, TouchOptions, Twin, TwinOptions};
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// Relative rise of conductance in the middle of a press. The paper does not state its own; doubled conductance is what
/// a fabric of the sheet's own resistance gives when it is pressed on.
pub const AMPLITUDE: f64 = 1.0;
/// Standard deviation of a press along the surface: a fingertip of about 20 mm at half its height.
pub const WIDTH_M: f64 = 0.008;
/// The mesh that simulates is finer than the one that reconstructs by this factor in every length, so that the model
/// that makes the images is not the one that made the frames.
const FINER: f64 = 0.5;
/// White noise of every reading, dB.
pub const SNR_DB: f64 = 50.0;

/// What keeps the rows of the table from being compared without a thought.
pub const CAVEAT: &str = "\
The paper's row was measured: a real skin, a real indenter, real electronics. The rows above it are simulated, on an\n\
even sheet with white noise at 50 dB and presses of one size; they show that the chain from frames to contacts works,\n\
not that this skin beats that one.";

/// The demo's experiment and what came of it.
pub struct Demo {
    /// The paper's skin.
    pub design: SkinDesign,
    /// The mesh that reconstructs.
    pub mesh: Mesh,
    /// Nodes of the mesh that simulates.
    pub simulation_nodes: usize,
    /// Seed of the noise.
    pub seed: u64,
    /// Change of the frame by each pixel, per area.
    pub sensitivity: Vec<f64>,
    /// Where each frame was touched.
    pub truth: Vec<Vec<Contact>>,
    /// The image of each frame.
    pub images: Vec<Image>,
    /// The contacts found in each image.
    pub contacts: Vec<Vec<Contact>>,
    /// The same for a frame with four touches at once, as in the paper's Fig. 9.
    pub four: (Vec<Contact>, Image, Vec<Contact>),
    /// The score over the frames of one touch.
    pub score: Score,
    /// How long all of it took.
    pub seconds: f64,
}

impl Demo {
    /// Presses every pixel of the paper's skin once, and four places at once at the end.
    pub fn run(seed: u64) -> Outcome<Self> {
        let begun = Instant::now();
        let design = SkinDesign::load("cylinder30")?;
        let mesh = Mesh::generate(&design)?;
        let forward = ForwardModel::new(&design, &mesh)?;
        let pixels = Arc::new(PixelSpace::for_design(&design, &mesh)?);
        let mut truth: Vec<Vec<Contact>> =
            pixels.centres_m.iter().zip(&pixels.normals).map(|(&at, &normal)| vec![touch(at, normal)]).collect();
        truth.push(four_touches(&design));

        let twin = twin(&design, seed)?;
        let recording = record_presses(&twin, &truth)?;

        let model = Linearised::new(&forward, &pixels)?;
        let options = OneStepOptions { touch: design.sheet.touch, ..OneStepOptions::default() };
        let method = OneStep::from_linearised(&model, Arc::clone(&pixels), &options)?;
        let mut images = images(&method, &recording)?;
        let detector = detector(&method, twin.noise().map_or(0.0, |noise| noise.sd_ohm));
        let mut contacts: Vec<Vec<Contact>> = images.par_iter().map(|image| detector.detect(image)).collect();
        let last = "the list ends with the four touches";
        let four = (truth.pop().expect(last), images.pop().expect(last), contacts.pop().expect(last));
        let score = score(&images, &truth, &detector, &method.name(), Some(method.alpha()))?;
        Ok(Demo {
            sensitivity: model.sensitivity(&pixels),
            simulation_nodes: twin.mesh().node_count(),
            seconds: begun.elapsed().as_secs_f64(),
            design,
            mesh,
            seed,
            truth,
            images,
            contacts,
            four,
            score,
        })
    }

    /// What was done, in two lines.
    pub fn heading(&self) -> String {
        format!(
            "{} presses on {}, SIMULATED on {} nodes with noise at {} dB (seed {}), reconstructed on {} nodes by {}\n\
             (alpha {:.3}), in {:.0} s.\n",
            self.score.presses,
            self.design.name,
            self.simulation_nodes,
            SNR_DB,
            self.seed,
            self.mesh.node_count(),
            self.score.method,
            self.score.alpha.unwrap_or(f64::NAN),
            self.seconds
        )
    }

    /// The results beside the paper's linear row.
    pub fn table(&self) -> Table {
        let header = ["localisation error", "mean \u{b1} sd (mm)", "median", "95th pct", "misses", "ghosts", "spread"];
        let mut table = Table::new(&header);
        let mm = |value_m: f64| format!("{:.1}", value_m * 1e3);
        let pair = |mean_m: f64, sd_m: f64| format!("{} \u{b1} {}", mm(mean_m), mm(sd_m));
        let none = || "\u{2013}".to_string();
        let cells = |summary: &Summary| (pair(summary.mean, summary.sd), mm(summary.median), mm(summary.p95));
        let (error, median, p95) = cells(&self.score.localisation_m);
        let counts = (self.score.misses.to_string(), self.score.ghosts.to_string());
        let spread = format!("{:.2}", self.score.sensitivity_spread);
        table.row(["contacts found, simulated".into(), error, median, p95, counts.0, counts.1, spread]);
        let (error, median, p95) = cells(&self.score.eq11_m);
        table.row(["whole-image centroid (Eq. 11), simulated".into(), error, median, p95, none(), none(), none()]);
        let error = pair(PAPER_LINEAR.mean_m, PAPER_LINEAR.sd_m);
        let spread = format!("{:.2}", PAPER_LINEAR.sensitivity_spread);
        table.row(["paper, linear method (Eq. 11), measured".into(), error, none(), none(), none(), none(), spread]);
        table
    }
}

/// A press as the truth holds it; all are equally strong, as if of 1 N.
fn touch(at: Point3, normal: Point3) -> Contact {
    Contact::truth(at, normal, 1.0)
}

/// Four touches at once, one of them on the seam; the nearest two are 95 mm apart.
fn four_touches(design: &SkinDesign) -> Vec<Contact> {
    let surface = design.body.surface();
    let place = |z_m: f64, degrees: f64| {
        let at = surface.at(z_m, degrees.to_radians()).expect("the paper's skin is a cylinder");
        touch(at, surface.normal(at).expect("a cylinder has normals everywhere"))
    };
    vec![place(0.075, 2.0), place(0.215, 64.0), place(0.105, 148.0), place(0.225, 260.0)]
}

/// A twin without an error but white noise, touched as the paper trains.
fn twin(design: &SkinDesign, seed: u64) -> Outcome<Twin> {
    let mut options = TwinOptions::shipped("ideal").expect("a shipped twin");
    options.mesh_scale = FINER;
    options.touch = TouchOptions::Gaussian(GaussianOptions { amplitude_per_n: AMPLITUDE, width_m: WIDTH_M });
    options.electronics.snr_db = Some(SNR_DB);
    Ok(Twin::new(design, &options, seed)?)
}

fn record_presses(twin: &Twin, truth: &[Vec<Contact>]) -> Outcome<Recording> {
    let tip_radius_m = twin.options().press.tip_radius_m;
    let press = |touch: &Contact| Press { centre_m: touch.position_m, force_n: touch.force_n, tip_radius_m };
    let presses: Vec<Vec<Press>> = truth.iter().map(|frame| frame.iter().map(press).collect()).collect();
    let progress = Progress::new("pressing", presses.len());
    Ok(record(twin, &presses, 0, || progress.step())?)
}

fn images(method: &OneStep, recording: &Recording) -> Outcome<Vec<Image>> {
    let progress = Progress::new("reconstructing", recording.frames.len());
    let image = |frame| {
        let image = method.reconstruct(&(frame - &recording.baseline));
        progress.step();
        image.map_err(Failure::from)
    };
    recording.frames.par_iter().map(image).collect()
}

/// The shipped detector with the noise of this method's images.
fn detector(method: &OneStep, noise_ohm: f64) -> Detector {
    let detector = Detector::new(DetectOptions::default());
    match method.matrix() {
        Some(matrix) => {
            let noise = ImageNoise::from_matrix(matrix, &vec![noise_ohm; matrix.columns]);
            detector.with_noise(noise)
        }
        None => detector,
    }
}
