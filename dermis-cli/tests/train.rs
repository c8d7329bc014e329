//! `dermis train`: a killed run continues with the same losses, and unsuitable inputs are rejected.

use crate::workplace::{DISK, Workplace};
use serde_json::Value;
use std::time::{Duration, Instant};

/// A dataset of 1,200 samples in the folder `data`.
fn with_data() -> Workplace {
    let at = Workplace::new();
    at.good("simulate disk.toml --seed 1 --samples 1200 -o data");
    at.good("simulate --finish data");
    at
}

/// Both losses of each epoch.
fn losses(told: &Value) -> Vec<[f64; 2]> {
    let loss = |epoch: &Value, name: &str| epoch[name].as_f64().unwrap();
    let epochs = told["epochs"].as_array().unwrap().iter();
    epochs.map(|epoch| [loss(epoch, "training_loss"), loss(epoch, "test_loss")]).collect()
}

#[test]
fn a_killed_training_goes_on_with_the_same_losses_and_makes_the_same_model() {
    let at = with_data();
    let train = |folder: &str| format!("train disk.toml --data data --epochs 40 --json -o {folder}");
    let whole = at.json(&train("whole"));
    assert_eq!((&whole["samples"], &whole["test_samples"]), (&1160.into(), &40.into()));
    let last = losses(&whole).last().unwrap()[1];
    assert!(last < 0.7 * whole["target_variance"].as_f64().unwrap(), "it learns: {whole}");

    let mut process = at.command(&train("killed")).spawn().unwrap();
    let (checkpoint, begun) = (at.path("killed/checkpoint.safetensors"), Instant::now());
    while !checkpoint.exists() {
        assert!(begun.elapsed() < Duration::from_secs(60), "no checkpoint in a minute");
        std::thread::sleep(Duration::from_millis(1));
    }
    process.kill().unwrap();
    process.wait().unwrap();
    assert!(!at.path("killed/card.json").exists(), "it was killed before its end");
    assert_eq!(losses(&at.json(&train("killed"))), losses(&whole));
    let weights = |folder: &str| std::fs::read(at.path(folder).join("weights.safetensors")).unwrap();
    assert!(weights("killed") == weights("whole"), "the weights differ");
    let picture = std::fs::read_to_string(at.path("killed/losses.svg")).unwrap();
    assert!(picture.starts_with("<svg") && picture.contains("test"));
}

#[test]
fn samples_may_be_streamed_and_ingredients_left_out() {
    let at = Workplace::new();
    let told = at.json("train disk.toml --stream gaussian --epoch-samples 720 --epochs 2 --half --json -o streamed");
    assert_eq!((losses(&told).len(), &told["samples"]), (2, &720.into()));
    let card = |folder: &str| -> Value {
        serde_json::from_slice(&std::fs::read(at.path(folder).join("card.json")).unwrap()).unwrap()
    };
    let train = "train disk.toml --stream gaussian --epoch-samples 360 --epochs 1 --network";
    at.good(&format!("{train} spots -o spots"));
    let without = "--without symmetries --without touches --without reciprocity --without disturbance";
    at.good(&format!("{train} spots {without} -o plain"));
    assert_eq!(
        (&card("plain")["target"], card("spots")["target"]["touches"].is_object()),
        (&"conductance".into(), true)
    );
    let inputs = |folder: &str| card(folder)["input"]["channels"].as_array().unwrap().len();
    assert_eq!((inputs("spots"), inputs("plain")), (20, 40));
    assert_eq!(card("plain")["noise"]["factor"], serde_json::json!([1.0, 1.0]));
    // A skin with symmetries: these move touches, so that a network that is trained without touches has none.
    at.write(
        "cylinder.toml",
        include_str!("../../dermis/designs/cylinder30.toml").replace("max_edge_m = 0.006", "max_edge_m = 0.012"),
    );
    let train_cylinder = "train cylinder.toml --stream gaussian --epoch-samples 360 --epochs 1 --network spots";
    for (more, symmetries) in [("", 20), ("--without symmetries", 1), ("--without touches", 1)] {
        let folder = format!("cylinder{}", more.replace(' ', "-"));
        at.good(&format!("{train_cylinder} {more} -o {folder}"));
        assert_eq!(card(&folder)["symmetries"], symmetries);
    }
    at.good(&format!("{train} paper-norm-first -o otherwise"));
    assert_eq!(card("otherwise")["plan"]["trunk"].as_array().unwrap().len(), 9);
    assert!(at.refused(&format!("{train} paper --without touches -o no")).contains("--network spots"));
}

#[test]
fn what_cannot_be_learned_from_is_refused_and_a_good_checkpoint_stays() {
    let at = with_data();
    let refused = |arguments: &str| at.refused(&format!("train {arguments}"));
    assert!(refused("disk.toml --data nosuch -o m").contains("nosuch"));
    assert!(refused("disk.toml -o m").contains("--data"));
    assert!(refused("disk.toml --data data --stream gaussian -o m").contains("cannot be used with"));
    assert!(refused("disk.toml --data data --epochs 0 -o m").contains("--epochs"));
    assert!(refused("disk.toml --data data --rate 0 -o m").contains("--rate"));
    at.write("file", "");
    assert!(refused("disk.toml --data data -o file").contains("file"));
    at.write("other.toml", DISK.replace("0.1\n", "0.12\n"));
    assert!(refused("other.toml --data data -o m").contains("data"));
    at.write("few.toml", DISK);
    at.good("simulate few.toml --seed 1 --samples 100 -o few");
    assert!(refused("few.toml --data few -o m").contains("`dermis simulate --finish few`"));
    at.good("simulate --finish few");
    // A dataset smaller than a step is one step.
    at.good("train few.toml --data few --epochs 1 -o small");

    at.good("train disk.toml --data data --epochs 1 -o model");
    let checkpoint = std::fs::read(at.path("model/checkpoint.safetensors")).unwrap();
    // Other training options and another network do not resume from this checkpoint.
    assert!(refused("disk.toml --data data --epochs 2 --rate 0.01 -o model").contains("checkpoint"));
    assert!(refused("disk.toml --data data --epochs 1 --network spots -o model").contains("checkpoint"));
    assert!(refused("disk.toml --data data --epochs 2 --noise harsh -o model").contains("checkpoint"));
    // Samples of another skin on the same mesh.
    at.write("other.toml", DISK.replace("[protocol]", "[protocol]\namplitude_only = true"));
    let said = refused("other.toml --data data --epochs 1 -o other");
    assert!(said.contains("another [protocol]"), "{said}");
    assert!(std::fs::read(at.path("model/checkpoint.safetensors")).unwrap() == checkpoint);
}
