//! From a number to a sample.

use crate::dataset::places::Places;
use crate::dataset::raster::CellRaster;
use crate::dataset::recipe::{GaussianTouches, Recipe, Touch};
use crate::dataset::target::Target;
use crate::design::SkinDesign;
use crate::forward::{BatchSolver, ForwardError, ForwardModel};
use crate::image::PixelSpace;
use crate::linalg::{LANES, Level};
use crate::touch::{GaussianTouch, sample_rng};
use rand::RngExt;

/// Samples that are made together: two batches of the solver. Which samples share a unit depends on their numbers alone.
pub(super) const UNIT: usize = 2 * LANES;

/// What a touch is told by in a dataset: its place (x, y, z), its width and its amplitude.
pub(super) const TOUCH_COLUMNS: [&str; 5] = ["x_m", "y_m", "z_m", "width_m", "amplitude"];

/// Makes samples of one recipe on one skin. Shared between threads, each of which has a [`Worker`].
#[derive(Debug)]
pub struct Generator {
    recipe: Recipe,
    forward: ForwardModel,
    sign: f64,
    places: Places,
    raster: CellRaster,
    target: Target,
    pixels: PixelSpace,
    rest: Vec<f32>,
}

/// One sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Its number.
    pub index: u64,
    /// The frame while the touches last, ohm.
    pub frame: Vec<f32>,
    /// The untouched frame of the same skin, ohm.
    pub rest: Vec<f32>,
    /// The relative change of conductance, a mean per pixel, positive for any touch.
    pub image: Vec<f32>,
    /// The touches: x, y, z (m, in the body's frame), width (m) and amplitude of each.
    pub touches: Vec<[f32; 5]>,
}

/// Memory of one thread that makes samples.
#[derive(Debug)]
pub struct Worker<'a> {
    generator: &'a Generator,
    solver: BatchSolver,
    conductivity: Vec<[f64; LANES]>,
    frames: Vec<[f64; LANES]>,
    image: Vec<f64>,
    touches: Vec<Vec<GaussianTouch>>,
}

/// Where the samples of one unit go, row by row.
#[derive(Debug)]
pub(super) struct Rows<'a> {
    pub frames: &'a mut [f32],
    pub images: &'a mut [f32],
    pub touches: &'a mut [f32],
}

impl Generator {
    /// The generator of a recipe on a skin whose forward model is given.
    ///
    /// # Errors
    /// A recipe that no sample can be drawn from; touches narrower than the mesh can carry; a design whose image does not
    /// fit its body.
    pub fn new(design: &SkinDesign, forward: &ForwardModel, recipe: &Recipe) -> crate::Result<Self> {
        Self::at_level(design, forward, recipe, Level::best())
    }

    fn at_level(design: &SkinDesign, forward: &ForwardModel, recipe: &Recipe, level: Level) -> crate::Result<Self> {
        recipe.check(design.sheet.touch)?;
        let (target, pixels) = Target::new(design, forward.mesh())?;
        let Touch::Gaussian(GaussianTouches { width_m, .. }) = &recipe.touch;
        let raster = CellRaster::at_level(design.body.surface(), forward.mesh(), width_m[0], level)?;
        let mut generator = Generator {
            recipe: recipe.clone(),
            forward: forward.clone(),
            sign: design.sheet.touch.sign(),
            places: Places::new(&design.body, forward.mesh()),
            raster,
            target,
            pixels,
            rest: Vec::new(),
        };
        generator.rest = generator.worker().untouched()?;
        Ok(generator)
    }

    /// Memory to make samples with; each thread has its own.
    pub fn worker(&self) -> Worker<'_> {
        Worker {
            generator: self,
            solver: self.forward.batch_solver(),
            conductivity: vec![[0.0; LANES]; self.forward.mesh().cell_count()],
            frames: vec![[0.0; LANES]; self.channel_count()],
            image: vec![0.0; self.pixel_count()],
            touches: vec![Vec::new(); LANES],
        }
    }

    /// What the samples are drawn from.
    pub fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    /// The forward model that solves them.
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

    /// The frame of the untouched skin, ohm.
    pub(super) fn rest(&self) -> &[f32] {
        &self.rest
    }

    /// The samples from `first` on, one after the other and without an end: the recipe's number of samples does not bind
    /// here. Sample `i` is the one that a file would hold.
    pub fn stream(&self, first: u64) -> Stream<'_> {
        Stream { worker: self.worker(), next: first, ready: Vec::new().into_iter() }
    }

    /// The touches of a sample.
    pub fn touches(&self, index: u64) -> Vec<GaussianTouch> {
        let mut touches = Vec::new();
        self.draw(index, &mut touches);
        touches
    }

    fn draw(&self, index: u64, touches: &mut Vec<GaussianTouch>) {
        let Touch::Gaussian(options) = &self.recipe.touch;
        let mut rng = sample_rng(self.recipe.seed, index);
        let count = rng.random_range(1..=options.most as u32);
        touches.clear();
        for _ in 0..count {
            let centre_m = self.places.draw(&mut rng);
            let [narrow, wide] = options.width_m;
            let width_m = narrow + (wide - narrow) * rng.random::<f64>();
            let [weak, strong] = options.amplitude;
            // `libm`, whose bits do not depend on the system.
            let amplitude = weak * libm::exp(libm::log(strong / weak) * rng.random::<f64>());
            touches.push(GaussianTouch { centre_m, amplitude, width_m });
        }
    }
}

impl Worker<'_> {
    /// The samples of the unit that begins at `first`, as many as there are rows.
    pub(super) fn make(&mut self, first: u64, count: usize, rows: &mut Rows<'_>) -> Result<(), ForwardError> {
        debug_assert!(first.is_multiple_of(UNIT as u64) && count <= UNIT);
        for from in (0..count).step_by(LANES) {
            self.batch(first + from as u64, (count - from).min(LANES), from, rows)?;
        }
        Ok(())
    }

    /// Eight samples at once, or the last few. A lane's bits do not depend on its neighbours.
    fn batch(&mut self, first: u64, count: usize, row: usize, rows: &mut Rows<'_>) -> Result<(), ForwardError> {
        let generator = self.generator;
        let rest = generator.forward.rest_conductivity();
        for (lanes, &rest) in self.conductivity.iter_mut().zip(rest) {
            *lanes = [rest; LANES];
        }
        for lane in 0..count {
            generator.draw(first + lane as u64, &mut self.touches[lane]);
            for touch in &self.touches[lane] {
                generator.raster.for_each_mean(touch, |cell, mean| {
                    self.conductivity[cell][lane] += generator.sign * rest[cell] * mean;
                });
            }
        }
        self.solver.solve_into(&self.conductivity, &mut self.frames)?;
        for lane in 0..count {
            self.write(lane, row + lane, rows);
        }
        Ok(())
    }

    /// Writes one lane's frame, image and touches to their rows.
    fn write(&mut self, lane: usize, row: usize, rows: &mut Rows<'_>) {
        let generator = self.generator;
        let channels = self.frames.len();
        for (value, lanes) in rows.frames[row * channels..][..channels].iter_mut().zip(&self.frames) {
            *value = lanes[lane] as f32;
        }
        let rest = generator.forward.rest_conductivity();
        let change = |cell: usize, lane: usize| generator.sign * (self.conductivity[cell][lane] / rest[cell] - 1.0);
        generator.target.image_into(&self.touches[lane], lane, change, &mut self.image);
        let pixels = self.image.len();
        for (value, &mean) in rows.images[row * pixels..][..pixels].iter_mut().zip(&self.image) {
            *value = mean as f32;
        }
        let width = generator.recipe.most_touches() * TOUCH_COLUMNS.len();
        let truth = &mut rows.touches[row * width..][..width];
        truth.fill(f32::NAN);
        for (place, touch) in truth.chunks_exact_mut(TOUCH_COLUMNS.len()).zip(&self.touches[lane]) {
            let [x, y, z] = touch.centre_m;
            place.copy_from_slice(&[x, y, z, touch.width_m, touch.amplitude].map(|value| value as f32));
        }
    }

    fn untouched(&mut self) -> Result<Vec<f32>, ForwardError> {
        for (lanes, &rest) in self.conductivity.iter_mut().zip(self.generator.forward.rest_conductivity()) {
            *lanes = [rest; LANES];
        }
        self.solver.solve_into(&self.conductivity, &mut self.frames)?;
        Ok(self.frames.iter().map(|lanes| lanes[0] as f32).collect())
    }

    /// The samples of one unit.
    fn unit(&mut self, first: u64) -> Result<Vec<Sample>, ForwardError> {
        let generator = self.generator;
        let (channels, pixels) = (generator.channel_count(), generator.pixel_count());
        let width = generator.recipe.most_touches() * TOUCH_COLUMNS.len();
        let (mut frames, mut images) = (vec![0.0; UNIT * channels], vec![0.0; UNIT * pixels]);
        let mut touches = vec![0.0; UNIT * width];
        let mut rows = Rows { frames: &mut frames, images: &mut images, touches: &mut touches };
        self.make(first, UNIT, &mut rows)?;
        let truth = |row: usize| {
            let places = touches[row * width..][..width].chunks_exact(TOUCH_COLUMNS.len());
            let places = places.map(|place| <[f32; 5]>::try_from(place).expect("five columns"));
            places.filter(|place| !place[0].is_nan()).collect()
        };
        let sample = |row: usize| Sample {
            index: first + row as u64,
            frame: frames[row * channels..][..channels].to_vec(),
            rest: generator.rest.clone(),
            image: images[row * pixels..][..pixels].to_vec(),
            touches: truth(row),
        };
        Ok((0..UNIT).map(sample).collect())
    }
}

/// Samples without a disk and without an end; see [`Generator::stream`].
#[derive(Debug)]
pub struct Stream<'a> {
    worker: Worker<'a>,
    next: u64,
    ready: std::vec::IntoIter<Sample>,
}

impl Iterator for Stream<'_> {
    type Item = Result<Sample, ForwardError>;

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
