//! The shipped network for `skin16`: its stated accuracy, on real presses. The recordings have no licence, so they are
//! searched for next to the project or in `DERMIS_DATA`; without them the test prints that it was skipped.

use dermis::detect::Detector;
use dermis::frame::{Frame, Truth, read_frames, read_truth};
use dermis::reconstruct::Reconstruct;
use dermis::skin::Skin;
use dermis_learn::{LearnError, Model};
use dermis_sim::evaluate::{AlignMethod, AlignOptions, PressEstimates, Screen};
use std::path::PathBuf;

fn shipped() -> (Skin, Model) {
    let skin = Skin::load("skin16").unwrap();
    let model = Model::named("shapes", &skin).unwrap();
    (skin, model)
}

fn is_near(image: &[f64], expected: &[f64]) -> bool {
    let size = expected.iter().fold(0.0, |size: f64, value| size.max(value.abs()));
    image.iter().zip(expected).all(|(a, b)| (a - b).abs() <= 1e-4 * size)
}

#[test]
fn images_scale_with_the_unit_and_twins_replace_excluded_channels() {
    let (_, model) = shipped();
    let value = |channel: usize| (0.7 * (channel % 96) as f64).sin();
    let difference = Frame((0..192).map(value).collect());
    let image = model.reconstruct(&difference).unwrap().values;
    let thrice = Frame(difference.iter().map(|value| 3.0 * value).collect());
    let expected: Vec<f64> = image.iter().map(|value| 3.0 * value).collect();
    assert!(is_near(&model.reconstruct(&thrice).unwrap().values, &expected));
    assert!(is_near(&model.images(&[thrice]).unwrap()[0].values, &expected));
    let mut broken = difference.clone();
    broken[30] = 1e5;
    assert!(!is_near(&model.reconstruct(&broken).unwrap().values, &image));
    let without = model.without(&[30]).unwrap();
    assert!(is_near(&without.reconstruct(&broken).unwrap().values, &image));
    assert!(model.reconstruct(&Frame(vec![0.0; 192])).unwrap().values.iter().all(|value| *value == 0.0));
}

#[test]
fn the_even_skin_is_localised_by_a_network_that_saw_simulations_alone() {
    let data = std::env::var_os("DERMIS_DATA")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")), PathBuf::from);
    let folder = data.join("skins_real");
    if !folder.is_dir() {
        return println!("skipped: no recordings of real skins at {}", folder.display());
    }
    let (skin, model) = shipped();
    let frames = read_frames(&folder.join("inp_noPattern.csv"), &skin.design().protocol).unwrap();
    let limits = skin.place_limits();
    let truth = read_truth(&folder.join("out_noPattern.csv"), &limits, frames.len()).unwrap();
    let Truth::Elsewhere { positions_m: truth, .. } = truth else { panic!("the presses have no header") };
    let options = AlignOptions {
        detector: Detector::new(model.detection()),
        left_out: (0..24).collect(),
        screens: vec![Screen::Disagreeing, Screen::PolarityBlind],
        ..AlignOptions::new(skin.design().sheet.touch)
    };
    let methods = |cut: &[Frame], left_out: &[usize]| -> Result<Vec<AlignMethod>, LearnError> {
        Ok(vec![(Box::new(model.without(left_out)?.matched(cut)), None)])
    };
    let estimates = PressEstimates::by(skin.forward(), skin.pixels(), &frames, &options, methods).unwrap();
    let aligned = estimates.align(&truth, &(0..2000).collect::<Vec<_>>()).unwrap();
    let few = estimates.align_by_few(&truth, 20, 200).unwrap();
    let (many_m, few_m) = (aligned.score.localisation_m.mean, 0.5 * (few[99] + few[100]));
    println!("noPattern: {:.2} mm, {:.2} mm", 1e3 * many_m, 1e3 * few_m);
    // The error of the linear method on the same presses.
    assert!(many_m <= 5.65e-3 && few_m <= 5.79e-3, "{:.2} mm, {:.2} mm", 1e3 * many_m, 1e3 * few_m);
}
