//! Real frames of a saline tank: every object is found at the electrode given in its recording.

use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::frame::read_frames;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::protocol::Protocol;
use dermis::reconstruct::{OneStep, OneStepOptions, Reconstruct};
use dermis_sim::evaluate::{AlignOptions, EvaluateError, Material, PressEstimates, TankObject, find_objects};
use std::collections::BTreeMap;
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
