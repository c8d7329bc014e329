use super::*;
use crate::contact::Contact;
use crate::design::{SkinDesign, TouchEffect};
use crate::reconstruct::{Alpha, Difference};
use dermis_sim::random::{sample_rng, standard_normal};

fn skin() -> Skin {
    Skin::load("tank16").unwrap()
}

#[test]
fn every_linear_method_reconstructs_and_knows_its_name() {
    let skin = skin();
    let methods = Methods::linear();
    let zero = Frame(vec![0.0; skin.design().protocol.channel_count()]);
    for &name in Methods::LINEAR {
        let method = methods.method(&skin, name, &MethodOptions::default()).unwrap();
        assert_eq!(method.name(), name);
        let image = method.image(&zero).unwrap();
        assert!(image.values.iter().all(|value| value.abs() < 1e-9), "{name}: no change gives no image");
    }
    assert_eq!(methods.default_name(&skin).unwrap(), "refined");
    assert_eq!(methods.method(&skin, Methods::BEST, &MethodOptions::default()).unwrap().name(), "refined");
}

#[test]
fn names_and_options_that_do_not_fit_are_refused_in_words() {
    let skin = skin();
    let error = |name: &str, options: MethodOptions| {
        Methods::linear().method(&skin, name, &options).expect_err("refused").to_string()
    };
    let unknown = error("unknown", MethodOptions::default());
    assert!(
        unknown.contains("no method `unknown` for the skin `tank16`: give one of refined, noser, laplace"),
        "{unknown}"
    );
    assert!(unknown.contains("./unknown"), "{unknown}");
    let excluded = error("noser", MethodOptions { excluded: vec![208], ..MethodOptions::default() });
    assert!(excluded.contains("channel 208") && excluded.contains("0 to 207"), "{excluded}");
    let rule = error("tv", MethodOptions { alpha: Alpha::Gcv, ..MethodOptions::default() });
    assert!(rule.contains("tv has no rule for alpha"), "{rule}");
    let scaled = error("greit", MethodOptions { difference: Difference::Normalised, ..MethodOptions::default() });
    assert!(scaled.contains("greit takes plain differences only"), "{scaled}");
}

#[test]
fn a_method_without_channels_ignores_them() {
    let skin = skin();
    let masked = [3, 17];
    let mut frame = Frame((0..208).map(|channel| (channel as f64).sin()).collect());
    for name in ["noser", "greit"] {
        let whole = Methods::linear().method(&skin, name, &MethodOptions::default()).unwrap();
        let method = whole.without_channels(&skin, &masked).unwrap();
        let before = method.image(&frame).unwrap();
        masked.iter().for_each(|&channel| frame.0[channel] += 1e3);
        assert_eq!(method.image(&frame).unwrap().values, before.values, "{name}");
        assert_ne!(whole.image(&frame).unwrap().values, before.values, "{name}");
    }
}

#[test]
fn a_set_has_the_default_and_the_method_that_is_asked_for() {
    let set = MethodSet::new(&Methods::linear(), skin(), Some("greit")).unwrap();
    assert_eq!(set.names().collect::<Vec<_>>(), ["refined", "noser", "laplace", "greit"]);
    assert_eq!((set.method("").unwrap().name(), set.extra().unwrap().name()), ("refined", "greit"));
    assert_eq!(set.method(Methods::BEST).unwrap().name(), "refined");
    assert!(set.method("tv").unwrap_err().to_string().contains("refined, noser, laplace, greit"));
}

/// On a skin without other methods the contacts of the best linear one are refined.
#[test]
fn refined_is_the_default_where_all_methods_are_linear() {
    let skin = skin();
    let names = Methods::linear().names(&skin).unwrap();
    assert_eq!(names[..2], [Methods::REFINED, "noser"]);
    let method = Methods::linear().method(&skin, Methods::REFINED, &MethodOptions::default()).unwrap();
    assert_eq!((method.name(), method.label()), (Methods::REFINED, "one-step NOSER, refined"));
    assert_eq!(Methods::linear().unrefined_name(&skin).unwrap(), "noser");
}

/// Touches that lower the conductance are refined as those that raise it: a contact 4 mm off moves to the touch.
#[test]
fn contacts_are_refined_whichever_way_a_touch_changes_the_conductance() {
    for touch in [TouchEffect::ConductanceRises, TouchEffect::ConductanceFalls] {
        let mut design = SkinDesign::shipped("cylinder30").unwrap();
        design.sheet.touch = touch;
        let skin = Skin::new(design).unwrap();
        let (forward, surface) = (skin.forward(), skin.design().body.surface());
        let place = surface.at(0.14, 1.0).unwrap();
        let touched: Vec<f64> = (forward.rest_conductivity().iter().enumerate())
            .map(|(cell, s)| {
                let d = surface.distance_m(skin.mesh().cell_centre(cell), place) / 4e-3;
                s * (1.0 + touch.sign() * 0.3 * (-0.5 * d * d).exp())
            })
            .collect();
        let rest = forward.solve(forward.rest_conductivity()).unwrap();
        let noisy = |frame: u64| {
            let mut rng = sample_rng(71, frame);
            Frame(rest.iter().map(|value| value + 0.03 * standard_normal(&mut rng)).collect())
        };
        let frame = forward.solve(&touched).unwrap();
        let differences = Differences::new(vec![frame], (0..20).map(noisy).collect());
        let method = Methods::linear().method(&skin, Methods::REFINED, &MethodOptions::default()).unwrap();
        let mut contacts = vec![Contact::truth(surface.walk(place, [3e-3, -2.6e-3]), [f64::NAN; 3], f64::NAN)];
        method.reconstruct().correct(&differences.frames[0], &mut contacts);
        assert!(surface.distance_m(contacts[0].position_m, place) > 3.9e-3, "before it is adapted");
        let adapted = method.adapted(&differences).unwrap();
        adapted.reconstruct().correct(&differences.frames[0], &mut contacts);
        let off_m = surface.distance_m(contacts[0].position_m, place);
        println!("{touch:?}: {off_m:.2e} m");
        assert!(off_m < 5e-4, "{touch:?}: {off_m}");
    }
}

/// The frames of another skin, here with its electrodes in the reverse order, are not those of the model: the method says so
/// and keeps the contacts.
#[test]
fn frames_that_the_model_does_not_explain_are_named_in_a_warning() {
    let skin = Skin::load("cylinder30").unwrap();
    let rest = skin.forward().solve(skin.forward().rest_conductivity()).unwrap();
    let noisy = |frame: u64| {
        let mut rng = sample_rng(72, frame);
        Frame(rest.iter().rev().map(|value| value + 0.03 * standard_normal(&mut rng)).collect())
    };
    let differences = Differences::new(vec![rest.clone()], (0..20).map(noisy).collect());
    let method = Methods::linear().method(&skin, Methods::REFINED, &MethodOptions::default()).unwrap();
    assert_eq!(method.reconstruct().warning(), None, "before it is adapted");
    let adapted = method.adapted(&differences).unwrap();
    let without_channels = adapted.without_channels(&skin, &[]).unwrap();
    let warning = without_channels.reconstruct().warning().unwrap();
    assert!(warning.starts_with("contacts are not refined: no skin of the model explains"), "{warning}");
    let mut contacts = vec![Contact::truth([0.05, 0.0, 0.1], [f64::NAN; 3], f64::NAN)];
    adapted.reconstruct().correct(&differences.frames[0], &mut contacts);
    assert_eq!((contacts.len(), contacts[0].position_m), (1, [0.05, 0.0, 0.1]));
}

/// Noise that is three times that of the untouched frames is no touch by any method, and a touch beside it is found.
#[test]
fn noise_that_has_risen_is_no_touch() {
    let skin = Skin::load("cylinder30").unwrap();
    let (forward, surface) = (skin.forward(), skin.design().body.surface());
    let place = surface.at(0.14, 1.0).unwrap();
    let change = |cell: usize| {
        let away = surface.distance_m(skin.mesh().cell_centre(cell), place) / 8e-3;
        1.0 + (-0.5 * away * away).exp()
    };
    let touched: Vec<f64> = forward.rest_conductivity().iter().enumerate().map(|(cell, s)| s * change(cell)).collect();
    let [rest, touched] = [forward.rest_conductivity(), &touched].map(|sheet| forward.solve(sheet).unwrap());
    let noisy = |of: &Frame, sd_ohm: f64, frame: u64| {
        let mut rng = sample_rng(73, frame);
        Frame(of.iter().map(|value| value + sd_ohm * standard_normal(&mut rng)).collect())
    };
    let untouched = (0..40).map(|frame| noisy(&rest, 0.03, frame)).collect();
    let frames = (40..60).map(|frame| noisy(&rest, 0.09, frame)).chain([noisy(&touched, 0.09, 60)]).collect();
    let differences = Differences::new(frames, untouched);
    for name in ["noser", "tv", Methods::REFINED] {
        let method = Methods::linear().method(&skin, name, &MethodOptions::default()).unwrap();
        let method = method.adapted(&differences).unwrap();
        let detector = method.detector_of(&differences, &skin.design().protocol).unwrap();
        let found = |frame: &Frame| method.contacts(frame, &detector).unwrap();
        let (last, noise) = differences.frames.split_last().unwrap();
        assert!(noise.iter().all(|frame| found(frame).is_empty()), "{name}");
        let contacts = found(last);
        assert_eq!(contacts.len(), 1, "{name}");
        assert!(surface.distance_m(contacts[0].position_m, place) < 0.01, "{name}");
    }
}
