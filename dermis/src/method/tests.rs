use super::*;
use crate::reconstruct::{Alpha, Difference};

fn skin() -> Skin {
    Skin::load("tank16").unwrap()
}

#[test]
fn every_linear_method_reconstructs_and_knows_its_name() {
    let skin = skin();
    let methods = Methods::linear();
    let zero = Frame(vec![0.0; skin.design().protocol.channel_count()]);
    for name in Methods::LINEAR {
        let method = methods.method(&skin, name, &MethodOptions::default()).unwrap();
        assert_eq!(method.name(), name);
        let image = method.image(&zero).unwrap();
        assert!(image.values.iter().all(|value| value.abs() < 1e-9), "{name}: no change gives no image");
    }
    assert_eq!(methods.default_name(&skin).unwrap(), "noser");
}

#[test]
fn names_and_options_that_do_not_fit_are_refused_in_words() {
    let skin = skin();
    let error = |name: &str, options: MethodOptions| {
        Methods::linear().method(&skin, name, &options).expect_err("refused").to_string()
    };
    let unknown = error("best", MethodOptions::default());
    assert!(unknown.contains("no method `best` for the skin `tank16`: give one of noser, laplace"), "{unknown}");
    assert!(unknown.contains("./best"), "{unknown}");
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
    assert_eq!(set.names().collect::<Vec<_>>(), ["noser", "laplace", "greit"]);
    assert_eq!((set.default_method().name(), set.extra().unwrap().name()), ("noser", "greit"));
    assert!(set.method("tv").unwrap_err().to_string().contains("noser, laplace, greit"));
}
