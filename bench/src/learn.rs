//! Networks compared with other programs: outputs the times of training steps and of single frames, in turns with the
//! other program.

use crate::serve::answer;
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::frame::write_array;
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::reconstruct::Reconstruct;
use dermis_learn::{
    Augmentation, Model, Noise, Precision, TrainOptions, Trainer, Training, TrainingData, TrainingPreset,
};
use dermis_sim::dataset::Dataset;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Standard deviation of the noise, ohm; the time does not depend on it.
const NOISE_OHM: f32 = 0.01;
/// Number of steps on one batch whose losses must agree between the programs.
const COMPARED_STEPS: usize = 5;
/// Number of frames whose images must agree.
const COMPARED_FRAMES: usize = 64;
/// Epochs before frames are compared and timed, so that all weights differ from their initial values.
const EPOCHS: usize = 2;

/// The prepared shipped skin.
struct Skin {
    design: SkinDesign,
    forward: ForwardModel,
    pixels: Arc<PixelSpace>,
}

impl Skin {
    fn new() -> Result<Self, Box<dyn Error>> {
        let design = SkinDesign::load("cylinder30")?;
        let mesh = Mesh::generate(&design)?;
        let forward = ForwardModel::new(&design, &mesh)?;
        let pixels = Arc::new(PixelSpace::for_design(&design, &mesh)?);
        Ok(Skin { design, forward, pixels })
    }

    fn noise(&self) -> Vec<f32> {
        vec![NOISE_OHM; self.forward.protocol().channel_count()]
    }

    fn paper(&self) -> TrainingPreset {
        TrainingPreset::paper(self.forward.protocol(), &self.pixels, self.noise())
    }

    fn spots(&self) -> TrainingPreset {
        TrainingPreset::spots(&self.design, self.forward.protocol(), &self.pixels, self.noise())
    }

    /// The training of a preset on the dataset of a folder.
    fn training(&self, preset: TrainingPreset, folder: &Path) -> Result<Training, Box<dyn Error>> {
        let data = TrainingData::Files { training: vec![Dataset::open(folder)?], test: vec![] };
        Ok(Training::new(&self.design, &self.forward, Arc::clone(&self.pixels), preset, data)?)
    }
}

/// `training`: writes the data that another program needs to train the paper's network from the same start into the
/// folder: the first batch and our losses on it. Then answers `train N` with the times of N steps.
pub fn training(data: &Path, few: &Path, folder: &Path) -> Result<(), Box<dyn Error>> {
    let skin = Skin::new()?;
    write_start(&skin, few, folder)?;
    let training = skin.training(skin.paper(), data)?;
    let TrainingPreset { architecture, input, options, .. } = training.preset();
    answer(|words| match *words {
        ["train", count] => {
            let count: usize = count.parse()?;
            // The first step is not timed.
            let epoch_samples = Some((count + 1) * options.batch);
            let options = TrainOptions { epoch_samples, ..options.clone() };
            let mut trainer =
                Trainer::new(architecture, input.clone(), &options, training.training(), training.test())?;
            let mut ends = Vec::new();
            trainer.epoch(|_| ends.push(Instant::now()))?;
            Ok(ends.windows(2).map(|pair| (pair[1] - pair[0]).as_secs_f64()).collect())
        }
        _ => Err("unknown command".into()),
    })
}

/// The start of training without noise on a dataset of a single batch, the batch, and the losses of our first steps.
fn write_start(skin: &Skin, few: &Path, folder: &Path) -> Result<(), Box<dyn Error>> {
    let mut method = skin.paper();
    method.noise = Noise::white(vec![0.0; skin.forward.protocol().channel_count()]);
    let training = skin.training(method.clone(), few)?;
    let (batch, inputs, outputs) = (method.options.batch, method.architecture.inputs(), method.architecture.outputs());
    let count = training.training().source().len();
    if count != batch {
        return Err(format!("{count} samples to train on, but one batch is {batch}").into());
    }
    let mut trainer = training.trainer()?;
    // Targets are learned in units of their standard deviation; the other program gets the same values.
    let scale = trainer.target_scale();
    let (mut given, mut wanted) = (vec![0.0; batch * inputs], vec![0.0; batch * outputs]);
    for (index, (given, wanted)) in given.chunks_exact_mut(inputs).zip(wanted.chunks_exact_mut(outputs)).enumerate() {
        training.training().fill(index, Augmentation::Nothing, trainer.input(), given, wanted)?;
        wanted.iter_mut().for_each(|value| *value *= scale);
    }
    save(folder, "batch_inputs", &[batch, inputs], &given)?;
    save(folder, "batch_targets", &[batch, outputs], &wanted)?;
    save(folder, "noise_ohm", &[skin.forward.protocol().channel_count()], &skin.noise())?;
    // The network of the first step, whose outputs are the scaled targets.
    let start = trainer.network().scaled(scale);
    training.model(trainer.input(), start, &[])?.save(&folder.join("start"), Precision::Single)?;
    let losses = (0..COMPARED_STEPS).map(|_| Ok(trainer.epoch(|_| ())?.training_loss * f64::from(scale * scale)));
    let losses = losses.collect::<Result<Vec<f64>, Box<dyn Error>>>()?;
    write_array(&folder.join("losses.npy"), "losses", &[losses.len()], &losses)?;
    Ok(())
}

fn save(folder: &Path, name: &str, shape: &[usize], values: &[f32]) -> Result<(), Box<dyn Error>> {
    let values: Vec<f64> = values.iter().copied().map(f64::from).collect();
    Ok(write_array(&folder.join(format!("{name}.npy")), name, shape, &values)?)
}

/// `inference`: trains both networks for a short time and writes their folders, their ONNX files, differences and our
/// images of them. Then answers `infer NAME N` with the times of N frames, one by one.
pub fn inference(data: &Path, folder: &Path) -> Result<(), Box<dyn Error>> {
    let skin = Skin::new()?;
    let trainings = [skin.training(skin.paper(), data)?, skin.training(skin.spots(), data)?];
    let differences = (0..COMPARED_FRAMES).map(|index| trainings[0].test().difference(index));
    let differences = differences.collect::<Result<Vec<Vec<f32>>, _>>()?;
    save(folder, "differences", &[COMPARED_FRAMES, differences[0].len()], &differences.concat())?;
    let differences: Vec<Vec<f64>> =
        differences.into_iter().map(|frame| frame.into_iter().map(f64::from).collect()).collect();
    let models = trainings.iter().map(trained).collect::<Result<Vec<Model>, Box<dyn Error>>>()?;
    let mut image = vec![0.0; skin.pixels.len()];
    for model in &models {
        let name = &model.card().name;
        model.save(&folder.join(name), Precision::Single)?;
        std::fs::write(folder.join(format!("{name}.onnx")), model.to_onnx())?;
        let mut images = Vec::new();
        for difference in &differences {
            model.reconstruct_into(difference, &mut image)?;
            images.extend_from_slice(&image);
        }
        write_array(&folder.join(format!("{name}_images.npy")), "images", &[COMPARED_FRAMES, image.len()], &images)?;
    }
    answer(|words| match *words {
        ["infer", name, count] => {
            let model = models.iter().find(|model| model.card().name == name).ok_or("no such network")?;
            let mut times = Vec::new();
            for difference in differences.iter().cycle().take(count.parse()?) {
                let start = Instant::now();
                model.reconstruct_into(std::hint::black_box(difference), &mut image)?;
                times.push(start.elapsed().as_secs_f64());
                std::hint::black_box(&image);
            }
            Ok(times)
        }
        _ => Err("unknown command".into()),
    })
}

fn trained(training: &Training) -> Result<Model, Box<dyn Error>> {
    let mut trainer = training.trainer()?;
    for _ in 0..EPOCHS {
        trainer.epoch(|_| ())?;
    }
    Ok(training.model(trainer.input(), trainer.network(), trainer.epochs())?)
}
