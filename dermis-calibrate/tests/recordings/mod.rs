//! Sound recordings: simulated presses with noise.

use dermis::frame::Frame;
use dermis::geom::Point3;
use dermis::skin::Skin;
use dermis_calibrate::LabelFrame;
use dermis_calibrate::checks::{Checked, Recording, check_recording};
use dermis_sim::noise::Noise;
use dermis_sim::random::{log_uniform, sample_rng, uniform};
use dermis_sim::touch::{GaussianTouch, touched_conductivity};
use rand::Rng;
use rayon::prelude::*;

/// A recording that is sound.
#[derive(Clone)]
pub struct Sound {
    pub name: &'static str,
    pub skin: Skin,
    pub frames: Vec<Frame>,
    /// Raw untouched frames; empty for a recording of differences.
    pub untouched: Vec<Frame>,
    /// Channels before this one are not judged.
    pub first: usize,
}

impl Sound {
    pub fn check(&self) -> Checked {
        let recording = Recording {
            frames: &self.frames,
            untouched: &self.untouched,
            positions_m: None,
            label_frame: LabelFrame::Skin,
        };
        check_recording(&self.skin, &recording).unwrap()
    }

    pub fn channels(&self) -> usize {
        self.frames[0].len()
    }

    /// The drives with judged channels, as ranges of channels.
    pub fn drives(&self) -> Vec<Vec<usize>> {
        let (drives, of_channel) = self.skin.design().protocol.drives();
        let group =
            |drive: usize| (self.first..self.channels()).filter(|&c| of_channel[c] == drive).collect::<Vec<_>>();
        (0..drives.len()).map(group).filter(|group| !group.is_empty()).collect()
    }

    pub fn change(&mut self, change: impl Fn(usize, &mut Frame)) {
        self.frames.iter_mut().chain(&mut self.untouched).enumerate().for_each(|(row, frame)| change(row, frame));
    }
}

/// A disk with 12 electrodes; drives d to d + 4, so that the values have both signs.
pub const DISK12: &str = r#"
name = "disk12"
[body.disk]
diameter_m = 0.08
[sheet]
sheet_resistance_ohm = 1000.0
touch = "conductance_rises"
[electrodes]
shape.arc.length_m = 0.006
contact_impedance_ohm_m = 0.002
layout.rim.count = 12
[protocol]
pattern.skip = 3
[image.grid]
rows = 24
columns = 24
[mesh]
max_edge_m = 0.005
electrode_edge_m = 0.0015
"#;

/// A cylinder with 12 electrodes in three rings.
pub const CYLINDER: &str = r#"
name = "cylinder12"
[body.cylinder]
length_m = 0.12
diameter_m = 0.06
[sheet]
sheet_resistance_ohm = 1000.0
touch = "conductance_rises"
[electrodes]
shape.disc.radius_m = 0.004
contact_impedance_ohm_m2 = 2e-5
[electrodes.layout.rings]
rings = 3
per_ring = 4
spacing_m = 0.05
first_z_m = 0.01
[protocol]
pattern = "adjacent"
[image.grid]
rows = 16
columns = 16
[mesh]
max_edge_m = 0.006
electrode_edge_m = 0.002
"#;

/// A rectangle with its electrodes on one line, in its middle.
pub const STRIP: &str = r#"
name = "strip"
[body.rectangle]
width_m = 0.10
height_m = 0.06
[sheet]
sheet_resistance_ohm = 1000.0
touch = "conductance_rises"
[electrodes]
shape.disc.radius_m = 0.003
contact_impedance_ohm_m2 = 2e-5
layout.positions = [
    { x_m = 0.01, y_m = 0.03 }, { x_m = 0.026, y_m = 0.03 }, { x_m = 0.042, y_m = 0.03 },
    { x_m = 0.058, y_m = 0.03 }, { x_m = 0.074, y_m = 0.03 }, { x_m = 0.09, y_m = 0.03 },
]
[protocol]
pattern = "adjacent_undriven"
[image.grid]
rows = 20
columns = 20
[mesh]
max_edge_m = 0.005
electrode_edge_m = 0.0015
"#;

/// Single presses of random place, strength and size on a skin with a slightly uneven coat, with white noise, and 50
/// untouched frames.
pub fn simulated(name: &'static str, skin: &Skin, seed: u64, presses: usize, snr_db: f64, difference: bool) -> Sound {
    let (design, mesh, pixels) = (skin.design(), skin.mesh(), skin.pixels());
    let surface = design.body.surface();
    let rest = skin.forward().rest_conductivity();
    let mut rng = sample_rng(seed, 0);
    let area_m = pixels.areas.iter().sum::<f64>().sqrt();
    let mut bump = || GaussianTouch {
        centre_m: place(skin, &mut rng),
        amplitude: uniform(&mut rng, [0.0, 0.3]),
        width_m: 0.3 * area_m,
    };
    let bumps: Vec<GaussianTouch> = (0..3).map(|_| bump()).collect();
    let coat = touched_conductivity(mesh, &surface, design.sheet.touch, rest, &bumps).unwrap();
    let clean = Frame(skin.forward().solve(&coat).unwrap().0);
    let noise = Noise::at_snr_db(snr_db, &clean, &design.protocol, 1000.0).unwrap();
    let drive_of = design.protocol.drives().1;
    let press = |row: usize| {
        let mut rng = sample_rng(seed, 1 + row as u64);
        let centre_m = place(skin, &mut rng);
        let (amplitude, width_m) = (log_uniform(&mut rng, [0.2, 2.0]), area_m * uniform(&mut rng, [0.05, 0.1]));
        let touch = GaussianTouch { centre_m, amplitude, width_m };
        let touched = touched_conductivity(mesh, &surface, design.sheet.touch, &coat, &[touch]).unwrap();
        noise.apply(&skin.forward().solve(&touched).unwrap(), &drive_of, &mut rng)
    };
    let mut frames: Vec<Frame> = (0..presses).into_par_iter().map(press).collect();
    let mut rng = sample_rng(seed, 1_000_000);
    let mut untouched: Vec<Frame> = (0..50).map(|_| noise.apply(&clean, &drive_of, &mut rng)).collect();
    if difference {
        let baseline = dermis::frame::mean(&untouched).unwrap();
        frames = frames.iter().map(|frame| frame - &baseline).collect();
        untouched = Vec::new();
    }
    Sound { name, skin: skin.clone(), frames, untouched, first: 0 }
}

/// The positions of the presses of [`simulated`].
pub fn press_positions(sound: &Sound, seed: u64) -> Vec<Point3> {
    (0..sound.frames.len()).map(|row| place(&sound.skin, &mut sample_rng(seed, 1 + row as u64))).collect()
}

/// A random place on a skin.
pub fn place(skin: &Skin, rng: &mut impl Rng) -> Point3 {
    skin.pixels().centres_m[uniform(rng, [0.0, skin.pixels().len() as f64]) as usize]
}
