//! Sources of samples: the files of datasets, or a generator.

use crate::LearnError;
use dermis::forward::ForwardModel;
use dermis_sim::dataset::{Dataset, Generator, Sample};
use dermis_sim::random::sample_rng;
use rand::seq::SliceRandom;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::{Arc, RwLock};

/// The random stream for the order of samples of the first epoch; the other epochs use the following ones.
const ORDER_STREAM: u64 = 1 << 63;
/// Number of samples of a stream that are generated together.
const TOGETHER: usize = 4096;

/// Samples by number. An epoch is an order of numbers; samples are prepared together before they are read.
pub trait Source: Send + Sync + std::fmt::Debug {
    /// Number of samples of an epoch.
    fn len(&self) -> usize;

    /// Whether there are no samples.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The samples of an epoch in the order of a seed.
    fn order(&self, seed: u64, epoch: u64) -> Vec<usize>;

    /// Prepares samples, so that they can be read.
    ///
    /// # Errors
    /// Samples that cannot be generated.
    fn prepare(&self, _numbers: &[usize]) -> Result<(), LearnError> {
        Ok(())
    }

    /// A sample; its image only if requested.
    ///
    /// # Errors
    /// A file that cannot be read; a value that is not finite.
    fn read(&self, number: usize, with_image: bool) -> Result<Sample, LearnError>;
}

impl<S: Source + ?Sized> Source for Box<S> {
    fn len(&self) -> usize {
        (**self).len()
    }

    fn order(&self, seed: u64, epoch: u64) -> Vec<usize> {
        (**self).order(seed, epoch)
    }

    fn prepare(&self, numbers: &[usize]) -> Result<(), LearnError> {
        (**self).prepare(numbers)
    }

    fn read(&self, number: usize, with_image: bool) -> Result<Sample, LearnError> {
        (**self).read(number, with_image)
    }
}

/// Samples that are adjacent in a file stay near one another in an epoch, so that a disk reads them together if a
/// dataset is larger than the memory: runs of this length are shuffled...
const RUN: usize = 64;
/// ... and then all samples within groups of this size, a hundred skins or more in every step.
const MIXED: usize = 32_768;

/// The samples of each dataset to use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// All.
    All,
    /// All except the last thirtieth.
    Training,
    /// The last thirtieth.
    Test,
}

/// The samples of some datasets.
#[derive(Debug)]
pub struct Files {
    datasets: Arc<[Dataset]>,
    /// Dataset and sample of each number.
    places: Vec<(usize, u64)>,
    channels: usize,
    pixels: usize,
}

impl Files {
    /// The samples of some datasets of the design with this forward model.
    ///
    /// # Errors
    /// A dataset of another design or mesh, or with too few samples to hold any out.
    pub fn new(datasets: Arc<[Dataset]>, part: Part, forward: &ForwardModel) -> Result<Self, LearnError> {
        let mut places = Vec::new();
        let mut pixels = 0;
        for (index, dataset) in datasets.iter().enumerate() {
            let wrong = |message: String| LearnError::Data { folder: dataset.folder().to_path_buf(), message };
            let record = &dataset.manifest().record;
            if record.mesh.hash != forward.mesh().hash() {
                let message = format!("made on the mesh {}, not on this design's: simulate it anew", record.mesh.hash);
                return Err(wrong(message));
            }
            let count = dataset.len();
            let held_out = (count / 30).max(1);
            if count < 2 {
                return Err(wrong("a single sample: none is left to test by".into()));
            }
            let numbers = match part {
                Part::All => 0..count,
                Part::Training => 0..count - held_out,
                Part::Test => count - held_out..count,
            };
            places.extend(numbers.map(|sample| (index, sample)));
            pixels = dataset.pixel_count();
        }
        Ok(Files { datasets, places, channels: forward.protocol().channel_count(), pixels })
    }
}

impl Source for Files {
    fn len(&self) -> usize {
        self.places.len()
    }

    fn order(&self, seed: u64, epoch: u64) -> Vec<usize> {
        let mut rng = sample_rng(seed, ORDER_STREAM + epoch);
        let mut runs: Vec<usize> = (0..self.len()).step_by(RUN).collect();
        runs.shuffle(&mut rng);
        let mut order: Vec<usize> = runs.into_iter().flat_map(|start| start..(start + RUN).min(self.len())).collect();
        order.chunks_mut(MIXED).for_each(|mixed| mixed.shuffle(&mut rng));
        order
    }

    fn read(&self, number: usize, with_image: bool) -> Result<Sample, LearnError> {
        let Some(&(dataset, index)) = self.places.get(number) else {
            let must = "below the number of samples";
            return Err(LearnError::OutOfRange { what: "the index of a sample", value: number as f64, must });
        };
        let dataset = &self.datasets[dataset];
        let (mut rest, mut frame) = (vec![0.0; self.channels], vec![0.0; self.channels]);
        dataset.rest_into(index, &mut rest)?;
        dataset.frame_into(index, &mut frame)?;
        let mut image = vec![0.0; if with_image { self.pixels } else { 0 }];
        if with_image {
            dataset.image_into(index, &mut image)?;
        }
        if !rest.iter().chain(&frame).chain(&image).all(|value| value.is_finite()) {
            return Err(LearnError::NotFinite { folder: dataset.folder().to_path_buf(), sample: index });
        }
        Ok(Sample { index, frame, rest, image, touches: dataset.touches(index)? })
    }
}

/// Samples generated on demand; every epoch has new samples.
#[derive(Debug)]
pub struct Streamed {
    generator: Generator,
    per_epoch: usize,
    /// Blocks of samples that are ready, by the number of each block.
    ready: RwLock<BTreeMap<usize, Vec<Sample>>>,
}

impl Streamed {
    /// A generator with a number of samples per epoch.
    pub fn new(generator: Generator, per_epoch: usize) -> Self {
        Streamed { generator, per_epoch, ready: RwLock::new(BTreeMap::new()) }
    }

    fn make(&self, block: usize) -> Result<Vec<Sample>, LearnError> {
        /// Number of samples generated by one thread at a time: starting a stream has a cost.
        const PIECE: usize = 512;
        let first = block * TOGETHER;
        let pieces = (0..TOGETHER / PIECE).into_par_iter().map(|piece| {
            let from = (first + piece * PIECE) as u64;
            self.generator.stream(from).take(PIECE).collect::<dermis_sim::Result<Vec<Sample>>>()
        });
        Ok(pieces.collect::<dermis_sim::Result<Vec<_>>>()?.into_iter().flatten().collect())
    }
}

impl Source for Streamed {
    fn len(&self) -> usize {
        self.per_epoch
    }

    fn order(&self, _seed: u64, epoch: u64) -> Vec<usize> {
        let first = epoch as usize * self.per_epoch;
        (first..first + self.per_epoch).collect()
    }

    fn prepare(&self, numbers: &[usize]) -> Result<(), LearnError> {
        let mut ready = self.ready.write().expect("no thread panics while it holds the lock");
        let mut blocks: Vec<usize> = numbers.iter().map(|number| number / TOGETHER).collect();
        blocks.sort_unstable();
        blocks.dedup();
        ready.retain(|block, _| blocks.contains(block));
        for block in blocks {
            if let std::collections::btree_map::Entry::Vacant(place) = ready.entry(block) {
                place.insert(self.make(block)?);
            }
        }
        Ok(())
    }

    fn read(&self, number: usize, _with_image: bool) -> Result<Sample, LearnError> {
        let ready = self.ready.read().expect("no thread panics while it holds the lock");
        let block = ready.get(&(number / TOGETHER)).expect("samples are asked for before they are read");
        Ok(block[number % TOGETHER].clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::design::{SkinDesign, TouchEffect};
    use dermis::mesh::Mesh;
    use dermis_sim::dataset::{GaussianTouches, Recipe, Record, Run, Shard, Skins, Touch, finish};

    #[test]
    fn every_epoch_has_every_sample_once_in_an_order_of_its_own() {
        let text = SkinDesign::text_of("tank16").unwrap();
        let design = SkinDesign::parse(&text, "tank").unwrap();
        let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        let touch = Touch::Gaussian(GaussianTouches::for_effect(TouchEffect::ConductanceRises));
        let recipe = Recipe { seed: 5, samples: 300, touch, skins: Skins::Even };
        let generator = Generator::new(&design, &forward, &recipe).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let record = Record::new(&generator, &design.name, &text);
        Run::new(&generator, &record, folder.path(), Shard::WHOLE)
            .unwrap()
            .make(|_| Ok::<_, dermis_sim::Error>(()))
            .unwrap();
        finish(folder.path(), || ()).unwrap();
        let data = Arc::new([Dataset::open(folder.path()).unwrap()]);
        let files = Files::new(data, Part::All, &forward).unwrap();
        let [first, second] = [1, 2].map(|epoch| files.order(9, epoch));
        assert_ne!(first, second);
        assert_eq!(first, files.order(9, 1));
        for mut order in [first, second] {
            // Neighbours in a file are not neighbours in an epoch.
            let near = order.windows(2).filter(|pair| pair[0].abs_diff(pair[1]) == 1).count();
            assert!(near < 20, "{near} of 299");
            order.sort_unstable();
            assert!(order.into_iter().eq(0..300));
        }
    }
}
