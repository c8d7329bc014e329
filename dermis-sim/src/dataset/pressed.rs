//! Samples of presses on fabric patches: drawn, solved by a low-rank update.

use crate::dataset::generator::{Rows, UNIT, write_row, write_touches};
use crate::dataset::places::Places;
use crate::dataset::press_target::PressTarget;
use crate::dataset::recipe::{MAX_TOUCHES, PatchTouches, Recipe, SkinSpread, Skins};
use crate::dataset::sample::{SampleTouch, TouchKind, single};
use crate::dataset::skins::SkinInstance;
use crate::elementary::{sin_cos, unrolled};
use crate::random::{log_uniform, sample_rng, uniform};
use crate::twin::{Footprint, PatchOptions, PatchedSkin, Press, TwinError};
use dermis::design::{Body, SkinDesign};
use dermis::forward::{ForwardModel, OnceMemory};
use dermis::geom::Point3;
use dermis::image::PixelSpace;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;

/// Generates samples of presses.
#[derive(Debug)]
pub(super) struct PressMaker {
    seed: u64,
    options: PatchTouches,
    body: Body,
    places: Places,
    target: PressTarget,
    pixel_count: usize,
    channel_count: usize,
    skins: OnSkins,
}

/// The skins of the samples.
#[derive(Debug)]
enum OnSkins {
    One(Box<PatchedSkin>),
    Many(SkinSpread),
}

/// Work memory of one thread.
#[derive(Debug)]
pub(super) struct PressWorker<'a> {
    maker: &'a PressMaker,
    frame: Vec<f64>,
    image: Vec<f64>,
    memory: OnceMemory,
}

impl PressMaker {
    pub(super) fn new(
        design: &SkinDesign,
        forward: &ForwardModel,
        pixels: &PixelSpace,
        places: Places,
        recipe: &Recipe,
        options: &PatchTouches,
    ) -> crate::Result<Self> {
        let skins = match &recipe.skins {
            Skins::Even => OnSkins::One(Box::new(PatchedSkin::new(
                &options.patches,
                &design.body,
                forward,
                forward.rest_conductivity(),
            )?)),
            Skins::Random(spread) => OnSkins::Many(spread.clone()),
        };
        // The strongest press that can be drawn, so that too thin foam is refused before any sample is generated.
        let hardest = Press {
            centre_m: places.draw(&mut sample_rng(recipe.seed, 0)),
            force_n: options.force_n[1],
            tip_radius_m: options.tip_radius_m[0],
        };
        Footprint::new(&hardest, &options.patches.foam, &design.body)?;
        Ok(PressMaker {
            seed: recipe.seed,
            options: options.clone(),
            body: design.body.clone(),
            places,
            target: PressTarget::new(design, forward.mesh(), pixels, &options.patches)?,
            pixel_count: pixels.len(),
            channel_count: forward.protocol().channel_count(),
            skins,
        })
    }

    pub(super) fn worker(&self) -> PressWorker<'_> {
        PressWorker {
            maker: self,
            frame: vec![0.0; self.channel_count],
            image: vec![0.0; self.pixel_count],
            memory: OnceMemory::default(),
        }
    }

    /// The untouched frame of the design with its patches.
    pub(super) fn untouched(&self, forward: &ForwardModel) -> crate::Result<Vec<f64>> {
        let mut frame = vec![0.0; self.channel_count];
        match &self.skins {
            OnSkins::One(skin) => skin.network(&[])?.frame_into(forward.protocol(), &mut frame),
            OnSkins::Many(_) => forward.solver().solve_into(forward.rest_conductivity(), &mut frame)?,
        }
        Ok(frame)
    }

    /// The presses of a sample.
    pub(super) fn draw(&self, index: u64) -> Vec<Press> {
        let mut rng = sample_rng(self.seed, index);
        let count = rng.random_range(1..=self.options.most as u32);
        let mut presses: Vec<Press> = Vec::with_capacity(count as usize);
        for _ in 0..count {
            presses.push(Press {
                centre_m: self.place(presses.last(), &mut rng),
                tip_radius_m: uniform(&mut rng, self.options.tip_radius_m),
                force_n: log_uniform(&mut rng, self.options.force_n),
            });
        }
        presses
    }

    fn footprints(&self, presses: &[Press]) -> Result<Vec<Footprint>, TwinError> {
        Footprint::of_all(presses, &self.options.patches.foam, &self.body)
    }

    /// The position of a press next to another.
    fn place(&self, before: Option<&Press>, rng: &mut ChaCha8Rng) -> Point3 {
        if let (Some(together), Some(before)) = (&self.options.together, before)
            && rng.random::<f64>() < together.share
        {
            let (distance_m, way_rad) = (uniform(rng, together.distance_m), uniform(rng, [0.0, 2.0 * PI]));
            let (sine, cosine) = sin_cos(way_rad);
            let beside = unrolled(&self.body.surface()).walk(before.centre_m, [distance_m * cosine, distance_m * sine]);
            if self.body.holds(beside) {
                return beside;
            }
        }
        self.places.draw(rng)
    }

    /// The patches of a skin drawn from a seed.
    fn patches(&self, spread: &SkinSpread, skin_seed: u64) -> PatchOptions {
        let mut rng = sample_rng(skin_seed, PATCH_STREAM);
        let mut count = |[fewest, most]: [usize; 2]| fewest + rng.random_range(0..=(most - fewest) as u32) as usize;
        let (rows, columns) = (count(spread.patch_rows), count(spread.patch_columns));
        let [round_m, along_m] = self.body.chart().map_or([0.0; 2], |chart| chart.size_m());
        let offset_m = [along_m / rows as f64, round_m / columns as f64].map(|pitch| pitch * rng.random::<f64>());
        PatchOptions { rows, columns, offset_m, pitch_m: None, ..self.options.patches.clone() }
    }
}

/// The random stream of a skin for its patches.
const PATCH_STREAM: u64 = 1;

impl PressWorker<'_> {
    /// The samples of the unit that starts at `first`, `count` of them, on a skin instance if skins differ.
    pub(super) fn make(
        &mut self,
        first: u64,
        count: usize,
        instance: Option<&SkinInstance>,
        rows: &mut Rows<'_>,
    ) -> crate::Result<()> {
        let maker = self.maker;
        match (&maker.skins, instance) {
            (OnSkins::Many(spread), Some(instance)) => {
                let model = &instance.skin.forward;
                // All samples of the skin, even if fewer were requested: a sample's bits must not depend on their
                // number.
                let drawn: Vec<Vec<Press>> = (0..UNIT as u64).map(|row| maker.draw(first + row)).collect();
                let options = maker.patches(spread, instance.skin.seed);
                let coat = model.rest_conductivity();
                let skin = PatchedSkin::for_presses(&options, &maker.body, model, coat, &drawn.concat())?;
                let mut footprints = vec![Vec::new()];
                for presses in &drawn[..count] {
                    footprints.push(maker.footprints(presses)?);
                }
                let frames = skin.frames_under(&footprints, &mut self.memory)?;
                for row in 0..count {
                    write_row(rows.rest, row, frames[0].iter().copied());
                    self.frame.copy_from_slice(&frames[row + 1]);
                    self.write(row, &drawn[row], &footprints[row + 1], rows);
                }
            }
            (OnSkins::One(skin), _) => {
                let protocol = skin.conductors().model().protocol();
                for row in 0..count {
                    let presses = maker.draw(first + row as u64);
                    skin.network(&presses)?.frame_into(protocol, &mut self.frame);
                    self.write(row, &presses, &maker.footprints(&presses)?, rows);
                }
            }
            (OnSkins::Many(_), None) => unreachable!("random skins come with an instance"),
        }
        Ok(())
    }

    fn write(&mut self, row: usize, presses: &[Press], footprints: &[Footprint], rows: &mut Rows<'_>) {
        write_row(rows.frames, row, self.frame.iter().copied());
        let mut strengths = [0.0; MAX_TOUCHES];
        let strengths = &mut strengths[..presses.len()];
        self.maker.target.image_into(footprints, &mut self.image, strengths);
        write_row(rows.images, row, self.image.iter().copied());
        let touches = presses.iter().zip(strengths).map(|(press, strength)| SampleTouch {
            centre_m: single(press.centre_m),
            kind: TouchKind::Press { tip_radius_m: press.tip_radius_m as f32, force_n: press.force_n as f32 },
            strength_m2: *strength as f32,
        });
        write_touches(rows.touches, row, self.maker.options.most, touches);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Touch;
    use crate::dataset::skins::SkinMaker;
    use dermis::mesh::Mesh;
    use std::path::Path;

    /// Patches smaller than the cells of the mesh, and larger: the samples are those of a new factorisation for each,
    /// with an unknown more per touched patch.
    #[test]
    fn frames_are_those_of_a_new_factorisation_for_each_sample() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        let pixels = PixelSpace::for_design(&design, forward.mesh()).unwrap();
        for name in ["fine-soft", "coarse-firm-together"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../dermis-study/recipes/{name}.toml"));
            let recipe = Recipe::load(&path, 5, 64).unwrap();
            let (Touch::Patch(touches), Skins::Random(spread)) = (&recipe.touch, &recipe.skins) else {
                panic!("{name} has presses on random skins")
            };
            let places = Places::new(&design.body, forward.mesh());
            let maker = PressMaker::new(&design, &forward, &pixels, places, &recipe, touches).unwrap();
            let skins = SkinMaker::new(&design, &forward, recipe.seed, spread).unwrap();
            let mut worst = 0.0f64;
            for index in [0, 7, 40] {
                let made = skins.make(index / UNIT as u64).unwrap();
                let (model, presses) = (&made.forward, maker.draw(index));
                let coat = model.rest_conductivity();
                let options = maker.patches(spread, made.seed);
                let skin = PatchedSkin::for_presses(&options, &maker.body, model, coat, &presses).unwrap();
                let contacts = skin.contacts(&presses).unwrap();
                let moments = skin.conductors().moments();
                let direct = model.network_with_conductors(coat, moments, &contacts).unwrap().frame(model.protocol());
                let footprints = maker.footprints(&presses).unwrap();
                let mut memory = OnceMemory::default();
                let frame = &skin.frames_under(&[footprints.clone(), Vec::new(), footprints], &mut memory).unwrap()[2];
                let largest = direct.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
                let off = frame.iter().zip(direct.iter()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                worst = worst.max(off / largest);
            }
            println!("{name}: frames off by {worst:.1e} of their largest value");
            assert!(worst < 1e-10, "{name}: {worst}");
        }
    }
}
