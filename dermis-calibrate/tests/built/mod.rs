//! Digital twins of a design with one fault each, and whether the check names it.

use dermis::design::{Body, ElectrodeShape, SkinDesign};
use dermis::finding::FindingKind;
use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::skin::Skin;
use dermis_calibrate::build::{BuildCheck, BuildChecker, Fault};
use dermis_sim::random::{log_uniform, sample_rng};
use dermis_sim::twin::{CutOptions, FaultOptions, ReferenceOptions, ShortOptions, Twin, TwinOptions};
use rand::{Rng, RngExt};
use std::f64::consts::{PI, TAU};

/// The random stream of a fault; those of the twin are others.
const CASE_STREAM: u64 = 1 << 61;
/// Untouched frames of each skin.
const FRAMES: u64 = 32;
/// Largest factor of the sheet resistance from that of the design.
const SHEET_FACTOR: f64 = 3.0;
/// Least and largest resistance of a short, ohm.
const SHORT_OHM: [f64; 2] = [0.1, 30.0];
/// Least and largest factor of a wrong reference resistor, or its inverse.
const REFERENCE: [f64; 2] = [1.1, 3.0];
/// Shortest and longest cut, m.
const CUT_M: [f64; 2] = [0.04, 0.10];
/// A cut is found if its middle is this close, m: a third of the distance between electrodes.
pub const NEAR_M: f64 = 0.02;

/// Of skins that are sound although a builder has varied them: the radius of the electrodes, the contact impedance and the
/// diameter of the cylinder over those of the design, and the most unevenness of the coat.
const RADIUS: [f64; 2] = [3.5 / 4.0, 4.7 / 4.0];
const CONTACT: [f64; 2] = [0.1, 10.0];
const DIAMETER: [f64; 2] = [0.99, 1.01];
const COAT_RMS: f64 = 0.3;
/// One in so many of them is computed on a mesh of this edge everywhere, m.
const FINE: u64 = 20;
const FINE_EDGE_M: f64 = 1e-3;
/// The kinds of faults, and none: `varied` is sound, in `late` frames every value or every drive is in the place of another.
pub const KINDS: [&str; 8] = ["sound", "varied", "open", "short", "exchanged", "reference", "cut", "late"];

/// A fault of a twin.
#[derive(Debug, Clone)]
pub struct Case {
    pub kind: &'static str,
    pub faults: FaultOptions,
    pub cut_m: Option<Point3>,
}

/// A fault of a kind on the paper's skin.
pub fn case(kind: &'static str, design: &SkinDesign, rng: &mut impl Rng) -> Case {
    let count = design.electrodes.len();
    let first = rng.random_range(0..count);
    let second = (first + rng.random_range(1..count)) % count;
    let mut faults = FaultOptions::default();
    let mut cut_m = None;
    match kind {
        "open" if rng.random::<bool>() => faults.dead_electrodes = vec![first],
        "open" => faults.torn_wires = vec![first],
        "short" => faults.shorts = vec![ShortOptions { electrodes: [first, second], ohm: log_uniform(rng, SHORT_OHM) }],
        "exchanged" => faults.exchanged_wires = vec![[first, second]],
        "reference" => {
            let factor = log_uniform(rng, REFERENCE);
            let factor = if rng.random::<bool>() { factor } else { 1.0 / factor };
            faults.references = vec![ReferenceOptions { drive: Some(first), factor }];
        }
        "cut" => {
            let (cut, centre_m) = random_cut(rng);
            faults.cuts = vec![cut];
            cut_m = Some(centre_m);
        }
        _ => {}
    }
    Case { kind, faults, cut_m }
}

/// A cut anywhere on the cylinder of 300 x 100 mm.
fn random_cut(rng: &mut impl Rng) -> (CutOptions, Point3) {
    let half_m = 0.5 * (CUT_M[0] + (CUT_M[1] - CUT_M[0]) * rng.random::<f64>());
    let angle = PI * rng.random::<f64>();
    let (along_m, round_m) = (half_m * angle.cos(), half_m * angle.sin());
    let z = along_m.abs() + (0.3 - 2.0 * along_m.abs()) * rng.random::<f64>();
    let theta = TAU * rng.random::<f64>();
    let s = 0.05 * theta;
    let cut = CutOptions { from_m: [z - along_m, s - round_m], to_m: [z + along_m, s + round_m] };
    (cut, [0.05 * theta.cos(), 0.05 * theta.sin(), z])
}

/// The untouched frames of a twin with a fault, drawn from a seed.
pub fn frames(twin: &str, design: &SkinDesign, kind: &'static str, seed: u64) -> (Case, Vec<Frame>) {
    let mut rng = sample_rng(seed, CASE_STREAM);
    let mut built = design.clone();
    built.sheet.conductance *= log_uniform(&mut rng, [1.0 / SHEET_FACTOR, SHEET_FACTOR]);
    let case = case(kind, design, &mut rng);
    let mut options = TwinOptions::shipped(twin).expect("a shipped twin");
    options.faults = case.faults.clone();
    if kind == "varied" {
        vary(&mut built, &mut options, &mut rng);
        if seed.is_multiple_of(FINE) {
            (built.mesh.max_edge_m, built.mesh.electrode_edge_m) = (FINE_EDGE_M, FINE_EDGE_M);
            options.mesh_scale = 1.0;
        }
    }
    // The fabric does not touch an untouched skin: the frames are the same without it, and are computed faster.
    options.touch = TwinOptions::shipped("ideal").expect("a shipped twin").touch;
    let twin = Twin::new(&built, &options, seed).expect("a twin");
    let mut frames: Vec<Frame> = (0..FRAMES).map(|index| twin.frame(&[], index).expect("a frame")).collect();
    if kind == "late" {
        // By one value or by the values of one drive, in both directions.
        let count = frames[0].len();
        let by = if rng.random::<bool>() { 1 } else { count / design.protocol.drives().0.len() };
        let by = if rng.random::<bool>() { by } else { count - by };
        frames.iter_mut().for_each(|frame| frame.0.rotate_left(by));
    }
    (case, frames)
}

/// Varies what a builder may vary.
fn vary(built: &mut SkinDesign, options: &mut TwinOptions, rng: &mut impl Rng) {
    let [radius, contact, diameter] = [RADIUS, CONTACT, DIAMETER].map(|range| log_uniform(rng, range));
    if let Body::Cylinder { diameter_m, .. } = &mut built.body {
        *diameter_m *= diameter;
    }
    for electrode in &mut built.electrodes {
        electrode.contact_impedance *= contact;
        (0..2).for_each(|axis| electrode.centre_m[axis] *= diameter);
        if let ElectrodeShape::Disc { radius_m } = &mut electrode.shape {
            *radius_m *= radius;
        }
    }
    options.coat.rms = COAT_RMS * rng.random::<f64>();
}

/// Whether a check names the fault of a case, its place, and nothing else.
pub fn is_right(case: &Case, skin: &Skin, check: &BuildCheck) -> bool {
    let sorted = |[a, b]: [usize; 2]| [a.min(b), a.max(b)];
    match (case.kind, &check.faults[..]) {
        // Some sheets are beyond a factor of three.
        ("sound" | "varied", []) => {
            check.findings.iter().all(|found| !found.is_fault() || found.kind == FindingKind::Resistance)
        }
        ("late", []) => check.findings.iter().any(|found| found.kind == FindingKind::Order),
        ("open", [Fault::OpenElectrode { electrode }]) => {
            case.faults.dead_electrodes.iter().chain(&case.faults.torn_wires).eq([electrode])
        }
        ("short", [Fault::Short { electrodes, .. }]) => *electrodes == sorted(case.faults.shorts[0].electrodes),
        ("exchanged", [Fault::ExchangedWires { electrodes }]) => *electrodes == sorted(case.faults.exchanged_wires[0]),
        ("reference", [Fault::Reference { drive, .. }]) => case.faults.references[0].drive == Some(*drive),
        ("cut", [Fault::Cut(cut)]) => {
            let surface = skin.design().body.surface();
            case.cut_m.is_some_and(|at| surface.distance_m(at, cut.centre_m) <= NEAR_M)
        }
        _ => false,
    }
}

/// The check of a twin of the paper's skin.
pub fn checked(checker: &BuildChecker, skin: &Skin, twin: &str, kind: &'static str, seed: u64) -> (Case, BuildCheck) {
    let (case, frames) = frames(twin, skin.design(), kind, seed);
    let check = checker.check(&frames).expect("frames of the design");
    (case, check)
}
