//! Training as a whole: it learns, it is reproducible, and after an interruption it continues with the same result.

use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::reconstruct::Reconstruct;
use dermis_learn::{
    Epoch, Files, LearnError, Model, Part, Precision, Samples, SkinRecord, Streamed, TrainOptions, Trainer,
    TrainingPreset, TrainingRecord,
};
use dermis_sim::dataset::{Dataset, GaussianTouches, Generator, Recipe, Record, Run, Shard, Skins, Touch, finish};
use std::path::Path;
use std::sync::Arc;

struct Bench {
    design: SkinDesign,
    forward: ForwardModel,
    pixels: Arc<PixelSpace>,
    data: Arc<[Dataset]>,
}

/// 512 samples of a coarse skin of 8 electrodes.
fn bench(folder: &Path) -> Bench {
    let text = SkinDesign::text_of("cylinder30").unwrap();
    let text = text
        .replace("rings = 6", "rings = 3")
        .replace("per_ring = 5", "per_ring = 4")
        .replace("spacing_m = 0.060", "spacing_m = 0.150")
        .replace("rows = 30", "rows = 10")
        .replace("columns = 30", "columns = 12")
        .replace("max_edge_m = 0.006", "max_edge_m = 0.012");
    let design = SkinDesign::parse(&text, "small").unwrap();
    let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
    let touches = GaussianTouches { width_m: [0.012, 0.02], ..GaussianTouches::for_effect(design.sheet.touch) };
    let recipe = Recipe { seed: 5, samples: 512, touch: Touch::Gaussian(touches), skins: Skins::Even };
    let generator = Generator::new(&design, &forward, &recipe).unwrap();
    let record = Record::new(&generator, &design.name, &text);
    Run::new(&generator, &record, folder, Shard::WHOLE).unwrap().make(|_| Ok::<_, dermis_sim::Error>(())).unwrap();
    finish(folder, || ()).unwrap();
    let pixels = Arc::new(PixelSpace::for_design(&design, forward.mesh()).unwrap());
    Bench { design, forward, pixels, data: Arc::new([Dataset::open(folder).unwrap()]) }
}

impl Bench {
    fn methods(&self) -> [TrainingPreset; 2] {
        let noise_ohm = vec![1e-3; self.forward.protocol().channel_count()];
        let mut methods = [
            TrainingPreset::paper(self.forward.protocol(), &self.pixels, noise_ohm.clone()),
            TrainingPreset::spots(&self.design, self.forward.protocol(), &self.pixels, noise_ohm),
        ];
        for method in &mut methods {
            method.options = TrainOptions { batch: 60, epochs: 4, ..method.options.clone() };
        }
        methods
    }

    fn samples(&self, method: &TrainingPreset, part: Part) -> Samples {
        let files = Files::new(Arc::clone(&self.data), part, &self.forward).unwrap();
        Samples::new(files, &self.forward, &self.pixels, method).unwrap()
    }
}

fn losses(epochs: &[Epoch]) -> Vec<(f64, f64)> {
    epochs.iter().map(|epoch| (epoch.training_loss, epoch.test_loss)).collect()
}

#[test]
fn a_killed_training_goes_on_with_the_same_losses_and_the_model_is_what_was_trained() {
    let folder = tempfile::tempdir().unwrap();
    let bench = bench(&folder.path().join("data"));
    for method in bench.methods() {
        let (training, test) = (bench.samples(&method, Part::Training), bench.samples(&method, Part::Test));
        let new =
            || Trainer::new(&method.architecture, method.input.clone(), &method.options, &training, &test).unwrap();
        let mut whole = new();
        while !whole.is_done() {
            whole.epoch(|_| ()).unwrap();
        }
        let expected = losses(whole.epochs());
        assert!(expected[3].0 < 0.95 * expected[0].0, "it learns: {expected:?}");
        let checkpoint = folder.path().join(format!("{}.safetensors", method.name));
        let mut killed = new();
        for _ in 0..2 {
            killed.epoch(|_| ()).unwrap();
        }
        killed.save(&checkpoint).unwrap();
        // In the middle of the third epoch.
        let mut again = new();
        assert!(again.resume(&checkpoint).unwrap());
        while !again.is_done() {
            again.epoch(|_| ()).unwrap();
        }
        assert_eq!(losses(again.epochs()), expected);
        assert_eq!(again.network(), whole.network());

        let record = TrainingRecord {
            options: method.options.clone(),
            samples: training.source().len(),
            test_samples: test.source().len(),
            target_variance: test.target_variance(&test.source().order(0, 0)).unwrap(),
            epochs: whole.epochs().to_vec(),
        };
        let skin = SkinRecord::new("small", &bench.forward, &bench.pixels);
        let card = method.card(skin, whole.input(), &bench.data, record);
        let model = Model::new(card, whole.network(), Arc::clone(&bench.pixels));
        let place = folder.path().join(method.name);
        model.save(&place, Precision::Single).unwrap();
        let loaded = Model::load(&place, &bench.forward, Arc::clone(&bench.pixels)).unwrap();
        let difference: Vec<f64> = training.difference(3).unwrap().iter().map(|&value| f64::from(value)).collect();
        let frame = dermis::frame::Frame(difference);
        assert_eq!(loaded.reconstruct(&frame).unwrap().values, model.reconstruct(&frame).unwrap().values);
        assert_eq!(loaded.card(), model.card());
    }
}

#[test]
fn inputs_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let bench = bench(&folder.path().join("data"));
    let [method, _] = bench.methods();
    let (training, test) = (bench.samples(&method, Part::Training), bench.samples(&method, Part::Test));
    let new =
        |options: &TrainOptions| Trainer::new(&method.architecture, method.input.clone(), options, &training, &test);
    for (options, expected) in [
        (TrainOptions { rate: f32::NAN, ..method.options.clone() }, "the rate"),
        (TrainOptions { batch: 100_000, ..method.options.clone() }, "the samples of a step"),
        (TrainOptions { epochs: 0, ..method.options.clone() }, "the number of epochs"),
    ] {
        let message = new(&options).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    // A learning rate at which the loss diverges.
    let mut wild = new(&TrainOptions { rate: 1e30, ..method.options.clone() }).unwrap();
    let ends = (0..4).find_map(|_| wild.epoch(|_| ()).err());
    assert!(matches!(ends, Some(LearnError::Diverged { .. })), "{ends:?}");

    let checkpoint = folder.path().join("checkpoint.safetensors");
    new(&method.options).unwrap().save(&checkpoint).unwrap();
    let resume = |options: &TrainOptions| new(options).unwrap().resume(&checkpoint).unwrap_err().to_string();
    assert!(resume(&TrainOptions { seed: 9, ..method.options.clone() }).contains("other"));
    let bytes = std::fs::read(&checkpoint).unwrap();
    for length in [0, 7, 100, bytes.len() - 1] {
        std::fs::write(&checkpoint, &bytes[..length]).unwrap();
        assert!(resume(&method.options).contains("checkpoint.safetensors"));
    }

    let other = SkinDesign::shipped("cylinder30").unwrap();
    let forward = ForwardModel::new(&other, &Mesh::generate(&other).unwrap()).unwrap();
    let refused = Files::new(Arc::clone(&bench.data), Part::All, &forward);
    assert!(refused.unwrap_err().to_string().contains("simulate it anew"));
}

#[test]
fn a_stream_gives_the_samples_that_files_hold_and_new_ones_in_every_epoch() {
    let folder = tempfile::tempdir().unwrap();
    let bench = bench(folder.path());
    let [method, _] = bench.methods();
    let files = bench.samples(&method, Part::All);
    let recipe = bench.data[0].manifest().record.recipe.clone();
    let streamed = || Streamed::new(Generator::new(&bench.design, &bench.forward, &recipe).unwrap(), 300);
    let samples = |source: Streamed| Samples::new(source, &bench.forward, &bench.pixels, &method).unwrap();
    let (training, test) = (samples(streamed()), samples(streamed()));
    training.source().prepare(&[0, 17, 299]).unwrap();
    for number in [0, 17, 299] {
        assert_eq!(training.difference(number).unwrap(), files.difference(number).unwrap());
    }
    assert!(training.source().order(1, 1).iter().all(|number| (300..600).contains(number)));
    let mut trainer =
        Trainer::new(&method.architecture, method.input.clone(), &method.options, &training, &test).unwrap();
    let [first, last] = [0, 1].map(|_| trainer.epoch(|_| ()).unwrap());
    assert!(last.training_loss < first.training_loss);
}
