//! Corrections of a method whose errors are known.

use dermis::design::SkinDesign;
use dermis::detect::Detector;
use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::geom::vector::{add, distance};
use dermis::method::{Method, MethodError, MethodOptions, MethodSource, Methods};
use dermis::reconstruct::Alpha;
use dermis::skin::Skin;
use dermis_calibrate::{Alternatives, CalibrateError, Calibrations, Correction, Fitted, Label};
use std::sync::Arc;

/// A touch of a size at each of some pixels, by the Jacobian.
fn frames(skin: &Skin, touches: &[(usize, f64)]) -> Vec<Frame> {
    let jacobian = &skin.linearised().unwrap().jacobian;
    let frame = |&(pixel, size): &(usize, f64)| {
        Frame((0..jacobian.rows).map(|channel| size * jacobian.at(channel, pixel)).collect())
    };
    touches.iter().map(frame).collect()
}

/// Radius of the disk, m.
const RADIUS_M: f64 = 0.1;

/// Touches of different sizes, each at another pixel, well inside the skin.
fn touches(skin: &Skin) -> Vec<(usize, f64)> {
    let inside = |pixel: &usize| {
        let [x, y, _] = skin.pixels().centres_m[*pixel];
        x.hypot(y) < 0.6 * RADIUS_M
    };
    let pixels: Vec<usize> = (0..skin.pixels().len()).filter(inside).collect();
    // Steps of a prime number visit every pixel once.
    (0..160).map(|k| (pixels[(997 * k) % pixels.len()], 0.3 + 0.1 * ((k * k) % 13) as f64)).collect()
}

/// The true position of a contact that the method reports at a place.
fn shifted([x, y, z]: Point3) -> Point3 {
    [x + 0.006 + 0.004 * (3.0 * x / RADIUS_M).sin(), y - 0.008 * (2.0 * y / RADIUS_M).cos(), z]
}

struct Case {
    skin: Skin,
    method: Method,
    detector: Detector,
    frames: Vec<Frame>,
    labels: Vec<Label>,
}

/// A method that is off by a smooth function of the position, and whose strengths are a power of the force.
fn case() -> Case {
    let skin = Skin::load("tank16").unwrap();
    let method = Methods::linear().method(&skin, "noser", &MethodOptions::default()).unwrap();
    let detector = method.detector(&[], &skin.design().protocol).unwrap();
    let frames = frames(&skin, &touches(&skin));
    let label = |(row, frame): (usize, &Frame)| {
        let contacts = method.contacts(frame, &detector).unwrap();
        let strongest = contacts.iter().max_by(|a, b| a.strength.total_cmp(&b.strength)).unwrap();
        let force_n = (1e4 * strongest.strength).powf(0.7) * (1.0 + 3.0 * strongest.position_m[0]);
        Label { row, position_m: shifted(strongest.position_m), force_n }
    };
    let labels = frames.iter().enumerate().map(label).collect();
    Case { skin, method, detector, frames, labels }
}

fn fit(case: &Case, count: usize) -> Result<Correction, CalibrateError> {
    Correction::fit(case.skin.pixels(), &case.method, &case.detector, &case.frames, &case.labels[..count])
}

#[test]
fn a_correction_removes_smooth_errors_and_learns_forces() {
    let case = case();
    let correction = fit(&case, 100).unwrap();
    let quality = *correction.quality();
    assert_eq!((quality.labels, quality.found), (100, 100));
    assert!(quality.mean_error_before_m > 3e-3, "{quality:?}");

    let folder = tempfile::tempdir().unwrap();
    correction.save(folder.path(), case.skin.design()).unwrap();
    let methods = Methods::linear().with(Calibrations::of(Methods::linear()));
    let name = format!("{}", folder.path().display());
    let corrected = methods.method(&case.skin, &name, &MethodOptions::default()).unwrap();
    let other = SkinDesign::shipped("skin16").unwrap();
    assert!(Correction::load(folder.path(), &other).is_err(), "a correction for another design");

    let (mut off_m, mut force_errors) = (Vec::new(), Vec::new());
    for (frame, label) in case.frames.iter().zip(&case.labels).skip(100) {
        let contacts = corrected.contacts(frame, &case.detector).unwrap();
        let strongest = contacts.iter().max_by(|a, b| a.strength.total_cmp(&b.strength)).unwrap();
        off_m.push(distance(strongest.position_m, label.position_m));
        force_errors.push((strongest.force_n / label.force_n - 1.0).abs());
    }
    let mean_m = dermis::stats::mean(&off_m);
    assert!(mean_m < 0.2 * quality.mean_error_before_m, "{mean_m} m, {quality:?}");
    assert!(mean_m < 3.0 * quality.mean_error_m, "{mean_m} m, {quality:?}");
    assert!(dermis::stats::mean(&force_errors) < 0.05, "{force_errors:?}");
}

#[test]
fn a_correction_needs_presses_that_the_method_finds() {
    let case = case();
    let few = fit(&case, 10).unwrap_err();
    assert!(matches!(few, CalibrateError::TooFewFound { found: 10, labels: 10, .. }), "{few}");
}

/// Several frames of a press promise no more than one.
#[test]
fn frames_of_one_press_are_one_press() {
    let case = case();
    let repeated = |presses: usize, each: usize| {
        let rows: Vec<usize> = (0..presses).flat_map(|press| vec![press; each]).collect();
        let frames: Vec<Frame> = rows.iter().map(|&row| case.frames[row].clone()).collect();
        let label = |(row, &of): (usize, &usize)| Label { row, ..case.labels[of] };
        let labels: Vec<Label> = rows.iter().enumerate().map(label).collect();
        Correction::fit(case.skin.pixels(), &case.method, &case.detector, &frames, &labels)
    };
    let few = repeated(15, 8).unwrap_err();
    assert!(matches!(few, CalibrateError::TooFewFound { found: 15, labels: 120, .. }), "{few}");
    let (one, four) = (repeated(40, 1).unwrap(), repeated(40, 4).unwrap());
    let error_m = |correction: &Correction| correction.quality().mean_error_m;
    assert!(error_m(&four) > 0.5 * error_m(&one), "{:?} {:?}", four.quality(), one.quality());
}

/// Equal forces, and those of other presses, are no forces.
#[test]
fn forces_that_say_nothing_are_not_used() {
    let mut case = case();
    let known = case.labels.clone();
    for (force_n, expected) in [
        ((|_| 2.0) as fn(usize) -> f64, "their standard deviation is below 5 %"),
        (|index| 1.0 + ((index * index * 37 + 11 * index) % 101) as f64, "does not grow with the force"),
    ] {
        case.labels =
            known.iter().enumerate().map(|(index, label)| Label { force_n: force_n(index), ..*label }).collect();
        let correction = fit(&case, 100).unwrap();
        let fitted = Fitted::Correction(Box::new(correction));
        assert_eq!(
            fitted.unused_forces(&case.labels[..100]).map(|reason| reason.to_string().contains(expected)),
            Some(true)
        );
    }
}

/// A correction is of one model: another image or contact impedance is another method.
#[test]
fn a_correction_of_another_model_is_refused() {
    let case = case();
    let folder = tempfile::tempdir().unwrap();
    let mut design = case.skin.design().clone();
    fit(&case, 100).unwrap().save(folder.path(), &design).unwrap();
    assert!(Correction::load(folder.path(), &design).is_ok());
    design.electrodes[0].contact_impedance *= 2.0;
    let error = Correction::load(folder.path(), &design).unwrap_err().to_string();
    assert!(error.contains("contact impedances") && error.contains("calibrate again"), "{error}");
}

/// Labels that are off alike are doubted, and those of which most are elsewhere are refused.
#[test]
fn labels_beside_their_contacts_are_told() {
    let anything = Alternatives { guess_m: f64::INFINITY, uncalibrated: None };
    let mut case = case();
    let known = case.labels.clone();
    let mut moved = |of: &dyn Fn(usize) -> Point3| {
        let label = |(row, label): (usize, &Label)| Label { position_m: add(label.position_m, of(row)), ..*label };
        case.labels = known.iter().enumerate().map(label).collect();
        let fitted = Fitted::Correction(Box::new(fit(&case, 100).unwrap()));
        (anything.reason(&fitted), fitted.doubts(&case.skin, &case.labels[..100]))
    };
    let (reason, doubts) = moved(&|_| [0.01, 0.0, 0.0]);
    assert_eq!(reason, None);
    assert!(matches!(&doubts[..], [shift] if shift.contains("in one direction from the contacts")), "{doubts:?}");
    let (reason, _) = moved(&|row| [if row % 3 == 0 { 0.0 } else { 0.05 }, 0.0, 0.0]);
    assert!(reason.unwrap().contains("66 of 100 touched frames"));
}

/// Labels in one place say nothing of others: there the contacts are those of the method, and not more certain.
#[test]
fn labels_describe_the_skin_around_them() {
    let case = case();
    let middle = [0.03, 0.0, 0.0];
    let near = |label: &&Label| distance(label.position_m, middle) < 0.025;
    let labels: Vec<Label> = case.labels.iter().filter(near).copied().collect();
    let correction = Correction::fit(case.skin.pixels(), &case.method, &case.detector, &case.frames, &labels).unwrap();
    let folder = tempfile::tempdir().unwrap();
    correction.save(folder.path(), case.skin.design()).unwrap();
    let methods = Methods::linear().with(Calibrations::of(Methods::linear()));
    let name = folder.path().display().to_string();
    let corrected = methods.method(&case.skin, &name, &MethodOptions::default()).unwrap();
    let (mut at_labels_m, mut far_m) = (Vec::new(), Vec::new());
    for frame in &case.frames {
        let [before, after] = [&case.method, &corrected].map(|method| {
            let contacts = method.contacts(frame, &case.detector).unwrap();
            contacts.into_iter().max_by(|a, b| a.strength.total_cmp(&b.strength)).unwrap()
        });
        let moved_m = distance(before.position_m, after.position_m);
        match distance(before.position_m, middle) {
            away_m if away_m < 0.015 => at_labels_m.push(moved_m),
            away_m if away_m > 0.075 => {
                far_m.push(moved_m);
                assert!(after.sd_m >= before.sd_m, "{} of {}", after.sd_m, before.sd_m);
            }
            _ => {}
        }
    }
    let (near_m, far_m) = (dermis::stats::mean(&at_labels_m), dermis::stats::mean(&far_m));
    assert!(near_m > 4e-3 && far_m < 0.3 * near_m, "{near_m} m, far from the labels {far_m} m");
    let doubts = Fitted::Correction(Box::new(correction)).doubts(&case.skin, &labels);
    assert!(doubts.iter().any(|doubt| doubt.contains("of the skin lie within")), "{doubts:?}");
}

/// A network that was trained again is another method, and so is a method with other options.
#[test]
fn a_correction_of_another_network_is_refused() {
    struct Network(&'static str);
    impl MethodSource for Network {
        fn names(&self, _: &Skin) -> Result<Vec<String>, MethodError> {
            Ok(vec!["network".into()])
        }

        fn method(&self, skin: &Skin, name: &str, options: &MethodOptions) -> Result<Option<Method>, MethodError> {
            if name != "network" {
                return Ok(None);
            }
            let linear = Methods::linear().method(skin, "noser", options)?;
            Ok(Some(Method::new(name, name, Arc::clone(linear.reconstruct())).with_card(self.0.into())))
        }
    }

    let mut case = case();
    let methods = |card| Methods::linear().with(Network(card));
    case.method = methods("first").method(&case.skin, "network", &MethodOptions::default()).unwrap();
    let fitted = Fitted::Correction(Box::new(fit(&case, 100).unwrap()));
    let corrected = |card, options: &MethodOptions| {
        fitted
            .clone()
            .into_method(&methods(card), &case.skin, "corrected", options)
            .map(|_| ())
            .map_err(|e| e.to_string())
    };
    assert_eq!(corrected("first", &MethodOptions::default()), Ok(()));
    assert!(corrected("second", &MethodOptions::default()).unwrap_err().contains("trained again"));
    let other = MethodOptions { alpha: Alpha::Given(0.1), ..MethodOptions::default() };
    assert!(corrected("first", &other).unwrap_err().contains("leave alpha out"));
}
