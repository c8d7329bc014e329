//! Comparison of priors and rules for alpha on several bodies: single Gaussian touches at random positions, simulated
//! on a finer mesh.

use dermis::design::{Body, Electrode, ElectrodeShape, ImageLayout, SkinDesign};
use dermis::detect::{DetectOptions, Detector, ImageNoise};
use dermis::forward::ForwardModel;
use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::image::{Image, PixelSpace};
use dermis::mesh::{Cells, Mesh, export};
use dermis::protocol::Protocol;
use dermis::reconstruct::{
    Alpha, Greit, GreitOptions, Linearised, OneStep, OneStepOptions, Prior, Reconstruct, default_prior,
};
use dermis_sim::evaluate::{Score, score};
use dermis_sim::experiment::{Presses, record, truth};
use dermis_sim::twin::{GaussianOptions, TouchOptions, Twin, TwinOptions};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Number of touches on each body.
const TOUCHES: usize = 60;
/// Signal-to-noise ratio of a frame, dB.
const SNR_DB: f64 = 50.0;
/// At 2 N a touch takes 90 % of the conductance of a skin whose conductance falls.
const TOUCH: GaussianOptions = GaussianOptions { amplitude_per_n: 0.45, width_m: 0.008 };

/// A flat round skin with electrodes on its rim.
fn disk(electrodes: usize) -> SkinDesign {
    let text = format!(
        "[body.disk]\ndiameter_m = 0.08\n[sheet]\nsheet_resistance_ohm = 1000.0\ntouch = \"conductance_rises\"\n\
         [electrodes]\nshape.arc.length_m = 0.006\ncontact_impedance_ohm_m = 0.002\n[electrodes.layout.rim]\ncount = {electrodes}\n\
         [protocol]\npattern = \"adjacent\"\n[image.grid]\nrows = 24\ncolumns = 24\n"
    );
    SkinDesign::parse(&text, &format!("disk{electrodes}.toml")).expect("a valid design")
}

/// A flat skin with a grid of electrodes.
fn rectangle() -> SkinDesign {
    let text = "[body.rectangle]\nwidth_m = 0.12\nheight_m = 0.08\n[sheet]\nsheet_resistance_ohm = 1000.0\n\
                touch = \"conductance_rises\"\n[electrodes]\nshape.disc.radius_m = 0.003\ncontact_impedance_ohm_m2 = 2e-5\n\
                [electrodes.layout.grid]\nrows = 4\ncolumns = 5\n[protocol]\npattern = \"adjacent\"\n\
                [image.grid]\nrows = 20\ncolumns = 30\n";
    SkinDesign::parse(text, "rectangle.toml").expect("a valid design")
}

/// A hemisphere of 100 mm from an STL file, 16 electrodes in two rings and one at the top.
fn hemisphere() -> SkinDesign {
    const ROUND: usize = 40;
    const UP: usize = 12;
    let radius_m = 0.05;
    let at = |up: f64, theta: f64| {
        let latitude = up * TAU / 4.0;
        [radius_m * latitude.cos() * theta.cos(), radius_m * latitude.cos() * theta.sin(), radius_m * latitude.sin()]
    };
    let mut nodes: Vec<Point3> =
        (0..UP * ROUND).map(|k| at((k / ROUND) as f64 / UP as f64, TAU * (k % ROUND) as f64 / ROUND as f64)).collect();
    nodes.push([0.0, 0.0, radius_m]);
    let mut triangles = Vec::new();
    for k in 0..ROUND {
        let next = (k + 1) % ROUND;
        for row in 0..UP - 1 {
            let (low, high) = (row * ROUND, (row + 1) * ROUND);
            triangles.extend([[low + k, low + next, high + k], [low + next, high + next, high + k]]);
        }
        triangles.push([(UP - 1) * ROUND + k, (UP - 1) * ROUND + next, UP * ROUND]);
    }
    let mesh = Mesh { nodes, cells: Cells::Triangles(triangles), electrodes: Vec::new(), regions: Vec::new() };
    let path = std::env::temp_dir().join(format!("dermis-hemisphere-{}.stl", std::process::id()));
    export::save(&mesh, &path, None).expect("a file in the folder for temporary ones");
    let electrode = |centre_m: Point3| Electrode {
        centre_m,
        shape: ElectrodeShape::Disc { radius_m: 0.003 },
        contact_impedance: 2e-5,
    };
    let mut design = disk(16);
    design.name = "hemisphere".into();
    design.body = Body::Mesh { file: path.into(), unit_m: 1.0 };
    let ring = |count: usize, up: f64| (0..count).map(move |k| at(up, TAU * k as f64 / count as f64));
    design.electrodes = ring(9, 0.15).chain(ring(6, 0.5)).chain([at(1.0, 0.0)]).map(electrode).collect();
    design.protocol = Protocol::adjacent(16).expect("enough electrodes");
    design.image = ImageLayout::Cells;
    design.mesh.max_edge_m = 0.006;
    design.mesh.electrode_edge_m = 0.0015;
    design
}

/// The forearm of `dermis/designs`.
fn forearm() -> SkinDesign {
    SkinDesign::load(concat!(env!("CARGO_MANIFEST_DIR"), "/../dermis/designs/forearm.toml")).expect("a shipped design")
}

/// Touches on a body and the readings of its instrument.
struct Touched {
    design: SkinDesign,
    forward: ForwardModel,
    model: Linearised,
    pixels: Arc<PixelSpace>,
    differences: Vec<Frame>,
    truth: Vec<Vec<dermis::contact::Contact>>,
    noise_ohm: f64,
}

impl Touched {
    fn new(design: SkinDesign) -> dermis_sim::Result<Self> {
        let mesh = Mesh::generate(&design)?;
        let forward = ForwardModel::new(&design, &mesh)?;
        let pixels = Arc::new(PixelSpace::for_design(&design, &mesh)?);
        let mut options = TwinOptions::shipped("ideal").expect("a shipped twin");
        options.touch = TouchOptions::Gaussian(TOUCH);
        options.electronics.snr_db = Some(SNR_DB);
        options.mesh_scale = 0.7;
        (options.press.least_force_n, options.press.greatest_force_n) = (0.5, 2.0);
        let twin = Twin::new(&design, &options, 1)?;
        let presses = Presses::new(&design, &mesh, &pixels, options.press, 3).at_random(TOUCHES).presses;
        let recording = record(&twin, &presses, 0, || ())?;
        Ok(Touched {
            model: Linearised::new(&forward, &pixels)?,
            differences: recording.frames.iter().map(|frame| frame - &recording.baseline).collect(),
            truth: presses.iter().map(|presses| truth(&design.body.surface(), presses)).collect(),
            noise_ohm: twin.noise().expect("a twin with noise").sd_ohm,
            design,
            forward,
            pixels,
        })
    }

    fn one_step(&self, prior: Prior, alpha: Alpha) -> Result<OneStep, dermis::reconstruct::ReconstructError> {
        let examples = self.differences[..20].to_vec();
        let touch = self.design.sheet.touch;
        let options = OneStepOptions { prior, alpha, examples, touch, ..OneStepOptions::default() };
        OneStep::from_linearised(&self.model, Arc::clone(&self.pixels), &options)
    }

    fn score(&self, method: &dyn Reconstruct) -> dermis_sim::Result<Score> {
        let images = self.differences.iter().map(|difference| method.reconstruct(difference));
        let images: Vec<Image> = images.collect::<Result<_, _>>()?;
        let matrix = method.matrix().expect("a linear method");
        let noise = ImageNoise::from_matrix(matrix, &vec![self.noise_ohm; matrix.columns]);
        let detector = Detector::new(DetectOptions::default()).with_noise(noise);
        Ok(score(&images, &self.truth, &detector, &method.name(), None)?)
    }

    fn report(&self, name: &str, alpha: f64, method: &dyn Reconstruct) -> dermis_sim::Result<()> {
        let score = self.score(method)?;
        println!(
            "{:12} {name:24} {alpha:9.2e}  {:6.2}  {:6.2}   {:3}  {:3}",
            self.design.name,
            1e3 * score.localisation_m.mean,
            1e3 * score.localisation_m.p95,
            score.misses,
            score.false_positives
        );
        Ok(())
    }
}

fn heading() {
    println!(
        "{TOUCHES} touches, {SNR_DB} dB\nbody         method                       alpha    mean     95 % missed false positives"
    );
}

/// NOSER, Tikhonov, Laplace and GREIT with the automatic alpha.
pub fn compare_priors() -> dermis_sim::Result<()> {
    heading();
    let shipped = |name: &str| SkinDesign::shipped(name).expect("a shipped design");
    for design in [shipped("cylinder30"), shipped("skin16"), disk(16), rectangle(), hemisphere(), forearm()] {
        let touched = Touched::new(design)?;
        for prior in [Prior::default(), Prior::Tikhonov, Prior::Laplace] {
            match touched.one_step(prior, Alpha::Auto) {
                Ok(one_step) => {
                    let mark = if prior == default_prior(&touched.design) { " (default)" } else { "" };
                    touched.report(&format!("{}{mark}", prior.name()), one_step.alpha(), &one_step)?;
                }
                Err(error) => println!("{:12} {}: {error}", touched.design.name, prior.name()),
            }
        }
        let greit = Greit::new(
            &touched.forward,
            Arc::clone(&touched.pixels),
            &GreitOptions { touch: touched.design.sheet.touch, ..GreitOptions::default() },
        );
        match greit {
            Ok(greit) => touched.report("GREIT", f64::NAN, &greit)?,
            Err(error) => println!("{:12} GREIT: {error}", touched.design.name),
        }
    }
    Ok(())
}

/// Alphas and the rules that choose them, on disks with few electrodes.
pub fn compare_rules() -> dermis_sim::Result<()> {
    heading();
    for electrodes in [4, 5, 6, 8, 10, 12, 16] {
        let touched = Touched::new(disk(electrodes))?;
        for prior in [Prior::default(), Prior::Laplace] {
            let mut rules: Vec<Alpha> =
                (-7..=2).map(|power| Alpha::Given(10.0_f64.powf(0.5 * f64::from(power)))).collect();
            rules.extend([0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0].map(Alpha::NoiseFigure));
            rules.extend([Alpha::Auto, Alpha::Gcv]);
            for alpha in rules {
                let name = format!("{} {alpha:?}", prior.name());
                match touched.one_step(prior, alpha) {
                    Ok(one_step) => touched.report(&name, one_step.alpha(), &one_step)?,
                    Err(error) => println!("{:12} {name}: {error}", touched.design.name),
                }
            }
        }
    }
    Ok(())
}
