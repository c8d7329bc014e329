//! Samples of Gaussian touches: drawn, rasterised on the cells, solved eight at a time.

use crate::dataset::generator::{Rows, write_row, write_touches};
use crate::dataset::places::Places;
use crate::dataset::raster::CellRaster;
use crate::dataset::recipe::GaussianTouches;
use crate::dataset::sample::{SampleTouch, TouchKind, single};
use crate::dataset::skins::{SkinInstance, SkinMaker};
use crate::dataset::target::Target;
use crate::random::{log_uniform, sample_rng, uniform};
use crate::touch::GaussianTouch;
use dermis::design::SkinDesign;
use dermis::forward::{BatchSolver, ForwardError, ForwardModel};
use dermis::image::PixelSpace;
use dermis::linalg::{LANES, SimdLevel};
use rand::RngExt;

/// Generates samples of Gaussian touches.
#[derive(Debug)]
pub(super) struct GaussianMaker {
    seed: u64,
    level: SimdLevel,
    options: GaussianTouches,
    sign: f64,
    places: Places,
    raster: CellRaster,
    target: Target,
    pixel_count: usize,
    /// Of the cells of the design's mesh, m2 (m3 in a volume).
    measures: Vec<f64>,
}

/// Work memory of one thread.
#[derive(Debug)]
pub(super) struct GaussianWorker<'a> {
    maker: &'a GaussianMaker,
    solver: BatchSolver,
    conductivity: Vec<[f64; LANES]>,
    frames: Vec<[f64; LANES]>,
    image: Vec<f64>,
    touches: Vec<Vec<GaussianTouch>>,
    /// The integral of each touch's relative change of conductance, m2.
    strengths: Vec<Vec<f64>>,
    moving: Option<Moving>,
}

/// The raster on a skin whose mesh is adapted to its electrode positions.
#[derive(Debug)]
struct Moving {
    raster: CellRaster,
    is_movable: Vec<bool>,
    /// The skin of the raster.
    skin: Option<u64>,
}

impl GaussianMaker {
    pub(super) fn new(
        design: &SkinDesign,
        forward: &ForwardModel,
        pixels: &PixelSpace,
        places: Places,
        seed: u64,
        options: &GaussianTouches,
        level: SimdLevel,
    ) -> crate::Result<Self> {
        Ok(GaussianMaker {
            seed,
            level,
            options: options.clone(),
            sign: design.sheet.touch.sign(),
            places,
            raster: CellRaster::at_level(design.body.surface(), forward.mesh(), options.width_m[0], level)?,
            target: Target::new(design, forward.mesh(), pixels),
            pixel_count: pixels.len(),
            measures: (0..forward.mesh().cell_count()).map(|cell| forward.mesh().cell_measure(cell)).collect(),
        })
    }

    pub(super) fn worker(&self, forward: &ForwardModel, skins: Option<&SkinMaker>) -> GaussianWorker<'_> {
        let moving = skins.filter(|skins| !skins.movable_cells().is_empty()).map(|skins| {
            let mut is_movable = vec![false; forward.mesh().cell_count()];
            skins.movable_cells().iter().for_each(|&cell| is_movable[cell] = true);
            Moving { raster: self.raster.clone(), is_movable, skin: None }
        });
        GaussianWorker {
            maker: self,
            solver: forward.batch_solver_at(self.level),
            conductivity: vec![[0.0; LANES]; forward.mesh().cell_count()],
            frames: vec![[0.0; LANES]; forward.protocol().channel_count()],
            image: vec![0.0; self.pixel_count],
            touches: vec![Vec::new(); LANES],
            strengths: vec![Vec::new(); LANES],
            moving,
        }
    }

    /// The untouched frame of the design, by the same solver as all others.
    pub(super) fn untouched(&self, forward: &ForwardModel) -> Result<Vec<f64>, ForwardError> {
        let mut worker = self.worker(forward, None);
        worker.rest_everywhere();
        worker.solver.solve_into(&worker.conductivity, &mut worker.frames)?;
        Ok(worker.frames.iter().map(|lanes| lanes[0]).collect())
    }

    /// The touches of a sample.
    pub(super) fn draw(&self, index: u64, touches: &mut Vec<GaussianTouch>) {
        let mut rng = sample_rng(self.seed, index);
        let count = rng.random_range(1..=self.options.most as u32);
        touches.clear();
        for _ in 0..count {
            let centre_m = self.places.draw(&mut rng);
            let width_m = uniform(&mut rng, self.options.width_m);
            touches.push(GaussianTouch { centre_m, amplitude: log_uniform(&mut rng, self.options.amplitude), width_m });
        }
    }
}

impl GaussianWorker<'_> {
    /// The samples of the unit that starts at `first`, `count` of them, on a skin instance if skins differ.
    pub(super) fn make(
        &mut self,
        first: u64,
        count: usize,
        instance: Option<&mut SkinInstance>,
        rows: &mut Rows<'_>,
    ) -> Result<(), ForwardError> {
        if let Some(instance) = instance {
            self.use_instance(instance);
            let rest = instance.untouched()?;
            (0..count).for_each(|row| write_row(rows.rest, row, rest.iter().copied()));
        }
        for from in (0..count).step_by(LANES) {
            self.batch(first + from as u64, (count - from).min(LANES), from, rows)?;
        }
        Ok(())
    }

    fn use_instance(&mut self, instance: &SkinInstance) {
        self.solver.set_model(&instance.skin.forward);
        if let Some(moving) = &mut self.moving
            && moving.skin != Some(instance.index)
        {
            let mesh = instance.skin.forward.mesh();
            moving.raster.follow(&self.maker.raster, mesh, &moving.is_movable, &instance.skin.shifts_m);
            moving.skin = Some(instance.index);
        }
    }

    fn rest_everywhere(&mut self) {
        for (lanes, &rest) in self.conductivity.iter_mut().zip(self.solver.model().rest_conductivity()) {
            *lanes = [rest; LANES];
        }
    }

    /// Eight samples together, or the last few. The bits of a lane do not depend on the other lanes.
    fn batch(&mut self, first: u64, count: usize, row: usize, rows: &mut Rows<'_>) -> Result<(), ForwardError> {
        self.rest_everywhere();
        let maker = self.maker;
        let rest = self.solver.model().rest_conductivity();
        let raster = self.moving.as_ref().map_or(&maker.raster, |moving| &moving.raster);
        for lane in 0..count {
            maker.draw(first + lane as u64, &mut self.touches[lane]);
            self.strengths[lane].clear();
            for touch in &self.touches[lane] {
                let mut strength = 0.0;
                raster.for_each_mean(touch, |cell, mean| {
                    self.conductivity[cell][lane] += maker.sign * rest[cell] * mean;
                    strength += mean * maker.measures[cell];
                });
                self.strengths[lane].push(strength);
            }
        }
        self.solver.solve_into(&self.conductivity, &mut self.frames)?;
        let rest = self.solver.model().rest_conductivity();
        for lane in 0..count {
            write_row(rows.frames, row + lane, self.frames.iter().map(|lanes| lanes[lane]));
            let change = |cell: usize| maker.sign * (self.conductivity[cell][lane] / rest[cell] - 1.0);
            maker.target.image_into(&self.touches[lane], change, &mut self.image);
            write_row(rows.images, row + lane, self.image.iter().copied());
            let touches = self.touches[lane].iter().zip(&self.strengths[lane]).map(|(touch, &strength)| SampleTouch {
                centre_m: single(touch.centre_m),
                kind: TouchKind::Gaussian { width_m: touch.width_m as f32, amplitude: touch.amplitude as f32 },
                strength_m2: strength as f32,
            });
            write_touches(rows.touches, row + lane, maker.options.most, touches);
        }
        Ok(())
    }
}
