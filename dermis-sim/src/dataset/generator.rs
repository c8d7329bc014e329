//! Generation of samples by index.

use crate::dataset::gaussian::{GaussianMaker, GaussianWorker};
use crate::dataset::places::Places;
use crate::dataset::pressed::{PressMaker, PressWorker};
use crate::dataset::recipe::{Recipe, Skins, Touch};
use crate::dataset::sample::{Sample, SampleTouch, TOUCH_COLUMNS};
use crate::dataset::skins::{SkinInstance, SkinMaker};
use crate::touch::GaussianTouch;
use crate::twin::Press;
use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::image::PixelSpace;
use dermis::linalg::{LANES, SimdLevel};
use rayon::prelude::*;
use std::ops::Range;

/// Number of samples generated together: two batches of the solver, and the samples of one skin if skins differ. The
/// samples of a unit depend only on their indices.
pub(super) const UNIT: usize = 2 * LANES;

/// Generates samples of one recipe on one design. Shared between threads, each with its own [`Worker`].
#[derive(Debug)]
pub struct Generator {
    recipe: Recipe,
    forward: ForwardModel,
    pixels: PixelSpace,
    skins: Option<SkinMaker>,
    kind: Kind,
    rest: Vec<f32>,
}

#[derive(Debug)]
enum Kind {
    Gaussian(Box<GaussianMaker>),
    Pressed(Box<PressMaker>),
}

/// Work memory of one thread.
#[derive(Debug)]
pub struct Worker<'a> {
    generator: &'a Generator,
    instance: Option<SkinInstance>,
    maker: SampleMaker<'a>,
}

#[derive(Debug)]
enum SampleMaker<'a> {
    Gaussian(Box<GaussianWorker<'a>>),
    Pressed(Box<PressWorker<'a>>),
}

/// The output memory of the samples of one unit, row by row.
#[derive(Debug)]
pub(super) struct Rows<'a> {
    /// One for each sample; empty if all samples are of one skin.
    pub rest: &'a mut [f32],
    pub frames: &'a mut [f32],
    pub images: &'a mut [f32],
    pub touches: &'a mut [f32],
}

impl Generator {
    /// The generator of a recipe on a design with a given forward model.
    ///
    /// # Errors
    /// A recipe from which no sample can be drawn; touches narrower than the mesh can resolve; electrodes that would
    /// fold the mesh; patches or presses that do not fit the body; a design whose image does not fit its body.
    pub fn new(design: &SkinDesign, forward: &ForwardModel, recipe: &Recipe) -> crate::Result<Self> {
        Self::at_level(design, forward, recipe, SimdLevel::best())
    }

    /// The same with a chosen instruction set.
    pub(super) fn at_level(
        design: &SkinDesign,
        forward: &ForwardModel,
        recipe: &Recipe,
        level: SimdLevel,
    ) -> crate::Result<Self> {
        recipe.check(design.sheet.touch)?;
        let skins = match &recipe.skins {
            Skins::Even => None,
            Skins::Random(spread) => Some(SkinMaker::new(design, forward, recipe.seed, spread)?),
        };
        let pixels = PixelSpace::for_design(design, forward.mesh())?;
        let places = Places::new(&design.body, forward.mesh());
        let kind = match &recipe.touch {
            Touch::Gaussian(touches) => Kind::Gaussian(Box::new(GaussianMaker::new(
                design,
                forward,
                &pixels,
                places,
                recipe.seed,
                touches,
                level,
            )?)),
            Touch::Patch(touches) => {
                Kind::Pressed(Box::new(PressMaker::new(design, forward, &pixels, places, recipe, touches)?))
            }
        };
        let mut generator =
            Generator { recipe: recipe.clone(), forward: forward.clone(), pixels, skins, kind, rest: Vec::new() };
        generator.rest = generator.untouched()?;
        Ok(generator)
    }

    /// Work memory; each thread needs its own.
    pub fn worker(&self) -> Worker<'_> {
        let maker = match &self.kind {
            Kind::Gaussian(maker) => SampleMaker::Gaussian(Box::new(maker.worker(&self.forward, self.skins.as_ref()))),
            Kind::Pressed(maker) => SampleMaker::Pressed(Box::new(maker.worker())),
        };
        Worker { generator: self, instance: None, maker }
    }

    /// The recipe.
    pub fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    /// The forward model of the design.
    pub fn forward(&self) -> &ForwardModel {
        &self.forward
    }

    /// The pixels of the images.
    pub fn pixels(&self) -> &PixelSpace {
        &self.pixels
    }

    /// Values of a frame.
    pub fn channel_count(&self) -> usize {
        self.forward.protocol().channel_count()
    }

    /// Values of an image.
    pub fn pixel_count(&self) -> usize {
        self.pixels.len()
    }

    /// The untouched frame of the design, ohm.
    pub(super) fn rest(&self) -> &[f32] {
        &self.rest
    }

    /// Whether each sample has its own untouched frame.
    pub(super) fn has_own_rest(&self) -> bool {
        self.skins.is_some()
    }

    /// The samples from `first` on, without an end: the recipe's number of samples is not a limit here. Sample `i` is
    /// the same as in the files.
    pub fn stream(&self, first: u64) -> Stream<'_> {
        Stream { worker: self.worker(), next: first, ready: Vec::new().into_iter() }
    }

    /// The samples with these indices, computed in parallel. The recipe's number of samples is not a limit here.
    ///
    /// # Errors
    /// A forward problem without a solution.
    pub fn samples(&self, indices: Range<u64>) -> crate::Result<Vec<Sample>> {
        let unit = UNIT as u64;
        let units = (indices.start / unit..indices.end.div_ceil(unit)).into_par_iter();
        let made = units.map_init(|| self.worker(), |worker, number| worker.unit(number * unit));
        let samples = made.collect::<crate::Result<Vec<Vec<Sample>>>>()?.into_iter().flatten();
        Ok(samples.filter(|sample| indices.contains(&sample.index)).collect())
    }

    /// The Gaussian touches of a sample; none if touches are presses.
    pub fn touches(&self, index: u64) -> Vec<GaussianTouch> {
        let mut touches = Vec::new();
        if let Kind::Gaussian(maker) = &self.kind {
            maker.draw(index, &mut touches);
        }
        touches
    }

    /// The presses of a sample; none if touches are Gaussian.
    pub fn presses(&self, index: u64) -> Vec<Press> {
        match &self.kind {
            Kind::Gaussian(_) => Vec::new(),
            Kind::Pressed(maker) => maker.draw(index),
        }
    }

    fn untouched(&self) -> crate::Result<Vec<f32>> {
        let frame = match &self.kind {
            Kind::Gaussian(maker) => maker.untouched(&self.forward)?,
            Kind::Pressed(maker) => maker.untouched(&self.forward)?,
        };
        Ok(frame.into_iter().map(|value| value as f32).collect())
    }
}

impl Worker<'_> {
    /// The samples of the unit that starts at `first`, `count` of them.
    pub(super) fn make(&mut self, first: u64, count: usize, rows: &mut Rows<'_>) -> crate::Result<()> {
        debug_assert!(first.is_multiple_of(UNIT as u64) && count <= UNIT);
        if let Some(maker) = &self.generator.skins {
            match &mut self.instance {
                Some(instance) => instance.change(maker, first)?,
                None => self.instance = Some(SkinInstance::new(maker, first)?),
            }
        }
        match &mut self.maker {
            SampleMaker::Gaussian(worker) => worker.make(first, count, self.instance.as_mut(), rows)?,
            SampleMaker::Pressed(worker) => worker.make(first, count, self.instance.as_ref(), rows)?,
        }
        Ok(())
    }

    /// The samples of one unit.
    fn unit(&mut self, first: u64) -> crate::Result<Vec<Sample>> {
        let generator = self.generator;
        let (channels, pixels) = (generator.channel_count(), generator.pixel_count());
        let width = generator.recipe.most_touches() * TOUCH_COLUMNS;
        let mut rest = vec![0.0; if generator.has_own_rest() { UNIT * channels } else { 0 }];
        let (mut frames, mut images) = (vec![0.0; UNIT * channels], vec![0.0; UNIT * pixels]);
        let mut touches = vec![0.0; UNIT * width];
        let mut rows = Rows { rest: &mut rest, frames: &mut frames, images: &mut images, touches: &mut touches };
        self.make(first, UNIT, &mut rows)?;
        let is_press = generator.recipe.has_presses();
        let sample = |row: usize| Sample {
            index: first + row as u64,
            frame: frames[row * channels..][..channels].to_vec(),
            rest: rest.chunks_exact(channels).nth(row).unwrap_or(&generator.rest).to_vec(),
            image: images[row * pixels..][..pixels].to_vec(),
            touches: SampleTouch::from_rows(&touches[row * width..][..width], is_press),
        };
        Ok((0..UNIT).map(sample).collect())
    }
}

/// Writes a row of numbers in single precision.
pub(super) fn write_row(rows: &mut [f32], row: usize, values: impl ExactSizeIterator<Item = f64>) {
    let width = values.len();
    rows[row * width..][..width].iter_mut().zip(values).for_each(|(place, value)| *place = value as f32);
}

/// Writes the touches of a sample.
pub(super) fn write_touches(rows: &mut [f32], row: usize, most: usize, touches: impl Iterator<Item = SampleTouch>) {
    let values = &mut rows[row * most * TOUCH_COLUMNS..][..most * TOUCH_COLUMNS];
    values.fill(f32::NAN);
    values.chunks_exact_mut(TOUCH_COLUMNS).zip(touches).for_each(|(place, touch)| place.copy_from_slice(&touch.row()));
}

/// An endless sequence of samples without files; see [`Generator::stream`].
#[derive(Debug)]
pub struct Stream<'a> {
    worker: Worker<'a>,
    next: u64,
    ready: std::vec::IntoIter<Sample>,
}

impl Iterator for Stream<'_> {
    type Item = crate::Result<Sample>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ready.as_slice().is_empty() {
            let first = self.next / UNIT as u64 * UNIT as u64;
            match self.worker.unit(first) {
                Ok(samples) => self.ready = samples.into_iter(),
                Err(error) => return Some(Err(error)),
            }
            let skipped = (self.next - first) as usize;
            self.ready.by_ref().take(skipped).for_each(drop);
        }
        self.next += 1;
        self.ready.next().map(Ok)
    }
}
