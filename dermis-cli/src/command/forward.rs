//! `dermis forward`: conductivities, or touches, to frames.

use crate::console::{Progress, print};
use crate::failure::{Failure, Outcome};
use crate::range::number;
use crate::skin;
use clap::Args;
use dermis::frame::{Frame, Truth, read_table, read_truth, write_frames};
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_sim::touch::{GaussianTouch, touched_conductivity};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Maximum number of frames from a file of touches.
const MOST_FRAMES: f64 = 1e6;

/// The arguments of `dermis forward`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Conductivity of every cell in mesh order, one map per row (S on surfaces, S/m in volumes) [default: the
    /// untouched skin]
    #[arg(long, value_name = "FILE")]
    conductivity: Option<PathBuf>,
    /// Touches to simulate, one per row, with the columns of --truth of `evaluate`. Each is a Gaussian change of
    /// conductance.
    #[arg(long, value_name = "FILE", conflicts_with = "conductivity")]
    touches: Option<PathBuf>,
    /// Relative change of conductance at the centre of a simulated touch: 1 doubles it.
    #[arg(long, value_name = "NUMBER", default_value_t = 0.5, requires = "touches", value_parser = number(1e-9..=1e6))]
    touch_amplitude: f64,
    /// Standard deviation of a simulated touch along the surface, m.
    #[arg(long, value_name = "M", default_value_t = 0.008, requires = "touches", value_parser = number(1e-5..=100.0))]
    touch_width_m: f64,
    /// Frames to write, one per row: CSV, NPY or NPZ; ohm.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

impl Arguments {
    /// Solves the forward problem for every map.
    pub fn run(self) -> Outcome {
        let skin = skin::load(&self.design)?;
        let maps = match &self.touches {
            Some(touches) => self.touched(&skin, touches)?,
            None => skin::conductivities(&skin, self.conductivity.as_deref())?,
        };
        let progress = Progress::new("solving", maps.len());
        let channels = skin.design().protocol.channel_count();
        let solve = |solver: &mut dermis::forward::Solver, map: &Vec<f64>| {
            let mut frame = Frame(vec![0.0; channels]);
            solver.solve_into(map, &mut frame)?;
            skin.design().protocol.drop_signs(&mut frame);
            progress.step();
            Ok::<Frame, dermis::forward::ForwardError>(frame)
        };
        let frames = maps.par_iter().map_init(|| skin.forward().solver(), solve).collect::<Result<Vec<_>, _>>()?;
        drop(progress);
        write_frames(&self.output, &frames)?;
        print(&format!("{}: {} of {channels} values\n", self.output.display(), counted(frames.len(), "frame")))
    }
    /// The conductivity of each frame in a file of touches; frames without a touch are untouched.
    fn touched(&self, skin: &Skin, path: &Path) -> Outcome<Vec<Vec<f64>>> {
        let table = read_table(path, "truth")?;
        let frame_column = table.header.iter().flatten().position(|name| name == "frame");
        let column = frame_column.ok_or_else(|| {
            Failure::given(
                format!("{} has no column `frame`", path.display()),
                Some("name the columns in the first row, as for `dermis evaluate`"),
            )
        })?;
        let last = table.rows.iter().filter_map(|row| row.get(column)).fold(0.0, |last: f64, &frame| last.max(frame));
        if last >= MOST_FRAMES {
            let message = format!("{} names frame {last}: at most {MOST_FRAMES} are simulated", path.display());
            return Err(Failure::given(message, None));
        }
        let (mesh, surface) = (skin.mesh(), skin.design().body.surface());
        let Truth::OnSkin(frames) = read_truth(path, &skin::place_limits(skin), last as usize + 1)? else {
            return Err(Failure::given(format!("{} has no header", path.display()), Some("name the columns")));
        };
        let gaussian =
            |centre_m| GaussianTouch { centre_m, amplitude: self.touch_amplitude, width_m: self.touch_width_m };
        let map = |touches: &Vec<dermis::contact::Contact>| {
            let touches: Vec<_> = touches.iter().map(|touch| gaussian(touch.position_m)).collect();
            let rest = skin.forward().rest_conductivity();
            Ok(touched_conductivity(mesh, &surface, skin.design().sheet.touch, rest, &touches)?)
        };
        frames.iter().map(map).collect()
    }
}
