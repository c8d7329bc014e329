//! Real frames of a saline tank: every object is found at the electrode given in its recording.

use dermis::contact::{ConductanceChange, Contact};
use dermis::design::SkinDesign;
use dermis::detect::{DetectOptions, Detector};
use dermis::forward::ForwardModel;
use dermis::frame::read_frames;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::method::{Method, MethodOptions, Methods};
use dermis::protocol::Protocol;
use dermis::reconstruct::{OneStep, OneStepOptions, Reconstruct};
use dermis::skin::Skin;
use dermis::stats::rms;
use dermis_sim::evaluate::{AlignOptions, EvaluateError, Material, PressEstimates, TankObject, find_objects};
use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::path::PathBuf;
use std::sync::Arc;

fn folder() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../data/tank"))
}

fn recordings() -> BTreeMap<String, Vec<TankObject>> {
    let mut recordings: BTreeMap<String, Vec<TankObject>> = BTreeMap::new();
    let text = std::fs::read_to_string(folder().join("objects.csv")).expect("the objects");
    for line in text.lines().skip(1) {
        let [name, electrode, material] = line.split(',').collect::<Vec<_>>()[..] else { panic!("{line}") };
        let material = if material == "metal" { Material::Metal } else { Material::Plastic };
        let electrode = electrode.parse().expect("a number");
        recordings.entry(name.into()).or_default().push(TankObject { electrode, material });
    }
    recordings
}

#[test]
fn every_object_is_found_at_its_electrode() {
    let design = SkinDesign::shipped("tank16").expect("a shipped design");
    let mesh = Mesh::generate(&design).expect("a mesh");
    let forward = ForwardModel::new(&design, &mesh).expect("a model");
    let pixels = Arc::new(PixelSpace::for_design(&design, &mesh).expect("pixels"));
    let options = OneStepOptions { touch: design.sheet.touch, ..OneStepOptions::default() };
    let method = OneStep::new(&forward, pixels, &options).expect("a method");
    let recordings = recordings();
    assert_eq!(recordings.len(), 6);
    for (name, objects) in recordings {
        let read = |part: &str| {
            let path = folder().join(format!("{name}_{part}.csv"));
            read_frames(&path, &design.protocol).expect("frames").remove(0)
        };
        let image = method.reconstruct(&(&read("objects") - &read("empty"))).expect("an image");
        for found in find_objects(&image, &objects, 16) {
            println!("{name}: {:?} off by {:.2} spacings", found.object, found.off_spacings);
            assert!(found.is_at_its_electrode(), "{name}: {found:?}");
        }
    }
}

/// The contacts of both signs of each method, beside the 18 objects: a contact belongs to an object of its sign within
/// half an electrode's spacing. The recordings do not state the distance of the objects from the centre, so errors are
/// those along the rim.
#[test]
fn the_contacts_of_the_tank_are_its_objects() {
    let skin = Skin::load("tank16").expect("a shipped design");
    println!(
        "| method | objects found | false positives | with narrow peaks | error along the rim, mm | within 2 stated sd |"
    );
    for name in ["noser", "laplace", "tikhonov", "greit"] {
        let method = Methods::linear().method(&skin, name, &MethodOptions::default()).expect("a method");
        let options = method.reconstruct().detection();
        let (errors, false_positives) = contacts_of_the_tank(&skin, &method, options.clone());
        let (_, with_narrow) =
            contacts_of_the_tank(&skin, &method, DetectOptions { strength_fraction: 0.0, ..options });
        let found = errors.len();
        let rms_mm = 1e3 * rms(errors.iter().map(|(error_m, _)| *error_m));
        let held = errors.iter().filter(|(error_m, sd_m)| *error_m < 2.0 * sd_m).count();
        println!("| {name} | {found} of 18 | {false_positives} | {with_narrow} | {rms_mm:.1} | {held} of {found} |");
        // Tikhonov's spreads over the whole tank.
        let expected = usize::from(name == "tikhonov");
        assert_eq!((found, false_positives), (18, expected), "{name}: objects found, false positives");
        assert!(name == "greit" || with_narrow > false_positives, "{name}: no artefact to remove");
        assert!(held as f64 >= 0.8 * found as f64, "{name}: {errors:?}");
    }
}

/// The errors along the rim and stated standard deviations of the objects that a method finds in all recordings, m, and
/// the number of its other contacts.
fn contacts_of_the_tank(skin: &Skin, method: &Method, options: DetectOptions) -> (Vec<(f64, f64)>, usize) {
    let detector = Detector::new(options).with_both_signs(ConductanceChange::Rises);
    let (mut errors, mut others) = (Vec::new(), 0);
    for (recording, objects) in recordings() {
        let read = |part: &str| {
            let path = folder().join(format!("{recording}_{part}.csv"));
            read_frames(&path, &skin.design().protocol).expect("frames").remove(0)
        };
        let contacts = method.contacts(&(&read("objects") - &read("empty")), &detector).expect("contacts");
        let nearest = |object: &TankObject| {
            let own = contacts.iter().filter_map(|contact| along_the_rim(contact, object));
            own.min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let found: Vec<_> = objects.iter().filter_map(nearest).collect();
        others += contacts.len() - found.len();
        errors.extend(found);
    }
    (errors, others)
}

/// The error of a contact along the rim and its stated standard deviation, m, if it is the image of the object.
fn along_the_rim(contact: &Contact, object: &TankObject) -> Option<(f64, f64)> {
    const SPACING_RAD: f64 = TAU / 16.0;
    let sign = if object.material == Material::Metal { ConductanceChange::Rises } else { ConductanceChange::Falls };
    let [x, y, _] = contact.position_m;
    let turn = (y.atan2(x) - object.electrode as f64 * SPACING_RAD + PI).rem_euclid(TAU) - PI;
    let is_it = contact.conductance == Some(sign) && turn.abs() < 0.5 * SPACING_RAD;
    is_it.then(|| (turn.abs() * x.hypot(y), contact.sd_m))
}

#[test]
fn the_channel_table_is_the_designs_protocol() {
    let design = SkinDesign::shipped("tank16").expect("a shipped design");
    let table = Protocol::load(&folder().join("channels.csv"), 16).expect("a table");
    assert_eq!(table.channels(), design.protocol.channels());
}

#[test]
fn presses_that_cannot_be_aligned_are_errors_that_say_why() {
    let design = SkinDesign::shipped("tank16").expect("a shipped design");
    let mesh = Mesh::generate(&design).expect("a mesh");
    let forward = ForwardModel::new(&design, &mesh).expect("a model");
    let pixels = Arc::new(PixelSpace::for_design(&design, &mesh).expect("pixels"));
    let differences: Vec<_> = recordings()
        .keys()
        .map(|name| {
            let path = folder().join(format!("{name}_objects.csv"));
            read_frames(&path, &design.protocol).expect("frames").remove(0)
        })
        .collect();
    let estimates = PressEstimates::new(&forward, &pixels, &differences, &AlignOptions::new(design.sheet.touch))
        .expect("estimates");
    let mut presses: Vec<[f64; 3]> = (0..6).map(|k| [0.01 * k as f64, 0.005 * (k * k) as f64, 0.0]).collect();
    assert_eq!(estimates.align(&presses[..5], &[0, 1, 2]).unwrap_err(), EvaluateError::Count { images: 6, truths: 5 });
    let all: Vec<usize> = (0..6).collect();
    let nothing = EvaluateError::NothingToScore { align: 6, presses: 6 };
    assert_eq!(estimates.align(&presses, &all).unwrap_err(), nothing);
    assert!(matches!(estimates.align(&presses, &[0, 9]), Err(EvaluateError::NoSuchPress { press: 9, presses: 6 })));
    let few = EvaluateError::TooFewPresses { presses: 2, places: 2 };
    assert_eq!(estimates.align(&presses, &[0, 1]).unwrap_err(), few);
    presses[3][1] = f64::NAN;
    assert!(matches!(estimates.align(&presses, &[0, 1, 2]), Err(EvaluateError::Press { press: 3, .. })));
}
