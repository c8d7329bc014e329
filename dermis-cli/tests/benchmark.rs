//! `dermis benchmark` and `dermis characterise`, as scripts use them.

use crate::workplace::Workplace;

#[test]
fn one_twin_is_assessed_alike_every_time() {
    let at = Workplace::new();
    let arguments = "benchmark disk.toml --quick --twins 1 --seed 2001 --json --curve curve.svg --map map.svg";
    let text = at.good(arguments);
    let told: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&told["twin"], told["twins"].as_array().map(Vec::len)), (&"lab".into(), Some(1)));
    let twin = &told["twins"][0];
    assert_eq!(twin["seed"], 2001);
    // Every seventh of the 60 pixels that overlap the disk, and 90 at random.
    assert_eq!((&twin["grid"]["presses"], &twin["random"]["presses"]), (&9.into(), &90.into()));
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
    };
    let force = &twin["force"];
    assert_eq!(numbers(&force["rank_correlations"]).len(), 10);
    // Despite the noise, peaks follow the force as the true strength of the twin does.
    assert!(numbers(&force["peak_ratios"]).iter().all(|ratio| (0.4..2.0).contains(ratio)), "{force}");
    assert!(numbers(&force["true_spread"]).iter().all(|spread| (0.1..0.5).contains(spread)), "{force}");
    for part in ["single", "two", "four"] {
        assert!((0.0..=1.0).contains(&twin["covered"][part].as_f64().unwrap()), "{twin}");
    }
    for picture in ["curve.svg", "map.svg"] {
        assert!(std::fs::read_to_string(at.path(picture)).unwrap().starts_with("<svg"), "{picture}");
    }
    assert_eq!(at.good(arguments), text, "the same seed, the same figures");
    // A disconnected electrode changes the frames and reduces the accuracy.
    let dead = at.good(&format!("{arguments} --dead 1"));
    assert_ne!(serde_json::from_str::<serde_json::Value>(&dead).unwrap()["twins"][0]["grid"], twin["grid"]);
}

#[test]
fn bodies_from_mesh_files_are_assessed() {
    let at = Workplace::new();
    at.plates();
    let told = at.json("benchmark obj.toml --quick --twins 1 --method noser --json");
    let bound = &told["bound"];
    assert!(bound.is_object() && bound["two_resolved"] == serde_json::json!([]), "{bound}");
    let few = at.refused("characterise obj.toml --method noser --samples 64");
    assert!(few.contains("ask for more --samples"), "{few}");
    at.good("experiment obj.toml --presses 8 --sets random --seed 1 -o shots");
}

#[test]
fn what_cannot_be_assessed_is_refused() {
    let at = Workplace::new();
    assert!(at.refused("benchmark disk.toml --quick --twins 1 --dead 8").contains("8 dead electrodes leave none of 8"));
    assert!(at.refused("benchmark disk.toml --twins 0").contains("--twins"));
    assert!(at.refused("benchmark disk.toml --twin labb").contains("did you mean `lab`?"));
    assert!(at.refused("benchmark nosuch --twins 1").contains("nosuch"));
    assert!(at.refused("benchmark disk.toml --quick --method ./nosuch").contains("nosuch"));
    assert!(at.refused("benchmark disk.toml --method spots --alpha 0.1").contains("no regularization parameter"));
}

#[test]
fn contacts_are_measured_against_their_touches() {
    let at = Workplace::new();
    let recipe = at.path("gaussian.toml");
    std::fs::write(&recipe, "[touch.gaussian]\nmost = 1\nwidth_m = [0.008, 0.012]\namplitude = [0.5, 2.0]\n").unwrap();
    let text = std::fs::read_to_string(&recipe).unwrap();
    std::fs::write(&recipe, format!("skins = \"even\"\n{text}")).unwrap();
    let arguments = "characterise disk.toml --recipe gaussian.toml --samples 640 --json -o contacts.csv";
    let text = at.good(arguments);
    let told: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(told["touches"], 640);
    let found = told["found"].as_u64().unwrap();
    assert!((300..=640).contains(&found), "{told}");
    let typical_m = told["detection"]["spread"]["typical_m"].as_f64().unwrap();
    assert!((1e-3..1.2e-2).contains(&typical_m), "{told}");
    let table = std::fs::read_to_string(at.path("contacts.csv")).unwrap();
    assert_eq!(table.lines().count() as u64, 1 + found);
    assert_eq!(at.good(arguments), text, "the same seed, the same figures");

    assert!(
        at.refused("characterise disk.toml --recipe gaussian.toml --samples 20").contains("too few for a calibration")
    );
    assert!(at.refused("characterise disk.toml --recipe nosuch.toml").contains("nosuch.toml"));
    assert!(at.refused("characterise disk.toml --samples 20 --peak-fraction 1.5").contains("--peak-fraction"));
    assert!(at.refused("characterise disk.toml --keep").contains("--method"));
}
