//! `dermis forward`: conductivities, or touches, to frames.

use crate::console::Progress;
use crate::failure::{Failure, Outcome};
use crate::output::{Output, json_line, to_standard_output};
use crate::range::number;
use crate::skin;
use clap::Args;
use dermis::contact::Contact;
use dermis::frame::{Frame, Truth, read_table};
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_sim::touch::{GaussianTouch, touched_conductivity};
use serde::Serialize;
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// Maximum number of values of the frames from a file of touches.
const MAX_VALUES: f64 = 32e6;

/// The arguments of `dermis forward`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Conductivity of every cell in mesh order, one map per row (S on surfaces, S/m in volumes) [default: the
    /// untouched skin]
    #[arg(long, value_name = "FILE")]
    conductivity: Option<PathBuf>,
    /// Touches to simulate, one per row, with the columns of --truth of `evaluate`. Each is the same Gaussian change of
    /// conductance, whatever its force; `dermis experiment` presses by forces.
    #[arg(long, value_name = "FILE", conflicts_with = "conductivity")]
    touches: Option<PathBuf>,
    /// Relative change of conductance at the centre of a simulated touch: 1 doubles it.
    #[arg(long, value_name = "NUMBER", default_value_t = 0.5, requires = "touches", value_parser = number(1e-9..=1e6))]
    touch_amplitude: f64,
    /// Standard deviation of a simulated touch along the surface, m.
    #[arg(long, value_name = "M", default_value_t = 0.008, requires = "touches", value_parser = number(1e-5..=100.0))]
    touch_width_m: f64,
    /// Frames to write, one per row: CSV, NPY or NPZ; ohm. `-` prints CSV.
    #[arg(short, long, value_name = "FILE", required_unless_present = "json")]
    output: Option<Output>,
    /// Print a line of JSON per frame.
    #[arg(long, conflicts_with = "output")]
    json: bool,
}

/// A frame as a line of JSON.
#[derive(Serialize)]
struct FrameValues<'a> {
    frame: usize,
    values_ohm: &'a [f64],
}

impl Arguments {
    /// Solves the forward problem for every map.
    pub fn run(self) -> Outcome {
        self.output.iter().try_for_each(|output| output.check_array("frames"))?;
        let skin = skin::load(&self.design)?;
        skin::warn_if_ambiguous(&skin)?;
        let frames = match &self.touches {
            Some(path) => {
                let touches = self.read_touches(&skin, path)?;
                // A map is made when its frame is solved: all of them would fill the memory.
                solved(&skin, &touches, |touches| Ok(Cow::Owned(self.touched(&skin, touches)?)))?
            }
            None => {
                let maps = skin::conductivities(&skin, self.conductivity.as_deref())?;
                solved(&skin, &maps, |map| Ok(Cow::Borrowed(map)))?
            }
        };
        let channels = skin.design().protocol.channel_count();
        let Some(output) = self.output else {
            return to_standard_output(|out| {
                let mut lines = frames.iter().enumerate();
                lines.try_for_each(|(frame, values)| json_line(out, &FrameValues { frame, values_ohm: values }))
            });
        };
        let values: Vec<f64> = frames.iter().flat_map(|frame| frame.iter().copied()).collect();
        output.write_array("frames", &[frames.len(), channels], &values)?;
        output.say(&format!("{} of {channels} values", counted(frames.len(), "frame")))
    }

    /// The touches of each frame in a file; frames without a touch are untouched.
    fn read_touches(&self, skin: &Skin, path: &Path) -> Outcome<Vec<Vec<Contact>>> {
        let table = read_table(path, "truth")?;
        let frame_column = table.header.iter().flatten().position(|name| name == "frame");
        let column = frame_column.ok_or_else(|| {
            Failure::given(
                format!("{} has no column `frame`", path.display()),
                Some("name the columns in the first row, as for `dermis evaluate`"),
            )
        })?;
        let last = table.rows.iter().filter_map(|row| row.get(column)).fold(0.0, |last: f64, &frame| last.max(frame));
        let most = (MAX_VALUES / skin.design().protocol.channel_count() as f64).floor();
        if last >= most {
            let message = format!("{} names frame {last}: at most {most} of this skin are simulated", path.display());
            return Err(Failure::given(message, Some("number the frames from 0")));
        }
        let Truth::OnSkin(frames) = skin::read_truth(skin, path, last as usize + 1)? else {
            return Err(Failure::given(format!("{} has no header", path.display()), Some("name the columns")));
        };
        Ok(frames)
    }

    /// The conductivity during some touches.
    fn touched(&self, skin: &Skin, touches: &[Contact]) -> Outcome<Vec<f64>> {
        let (amplitude, width_m) = (self.touch_amplitude, self.touch_width_m);
        let gaussian = |touch: &Contact| GaussianTouch { centre_m: touch.position_m, amplitude, width_m };
        let touches: Vec<GaussianTouch> = touches.iter().map(gaussian).collect();
        let (surface, rest) = (skin.design().body.surface(), skin.forward().rest_conductivity());
        Ok(touched_conductivity(skin.mesh(), &surface, skin.design().sheet.touch, rest, &touches)?)
    }
}

/// The frame of each item, of which `map` gives the conductivity.
fn solved<'a, T: Sync>(
    skin: &Skin,
    items: &'a [T],
    map: impl Fn(&'a T) -> Outcome<Cow<'a, [f64]>> + Sync,
) -> Outcome<Vec<Frame>> {
    let progress = Progress::new("solving", items.len());
    skin.forward().solve_many(items.len(), |item| map(&items[item]), |done| progress.steps(done as u64))
}
