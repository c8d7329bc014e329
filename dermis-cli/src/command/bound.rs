//! `dermis bound`: how well any method can do on a skin, before it is built.

use crate::console::{Progress, print, print_json};
use crate::failure::{Failure, Outcome};
use crate::range::{count, number};
use crate::skin;
use clap::Args;
use dermis::design::SkinDesign;
use dermis::estimate::drift::DriftSpread;
use dermis::frame::write_whole;
use dermis::image::PixelSpace;
use dermis::skin::Skin;
use dermis::stats::{mean, quantile, sorted};
use dermis::text::counted;
use dermis_plot::chart::Cumulative;
use dermis_plot::report::Table;
use dermis_plot::{Drawing, Key, Picture, Scale, View};
use dermis_sim::bound::{BoundOptions, Bounds};
use dermis_sim::twin::TwinOptions;
use rayon::prelude::*;
use serde::Serialize;
use std::io::Write;
use std::path::PathBuf;

/// Time over which frames are averaged in the second column, s.
const LONG_S: f64 = 0.1;

/// The arguments of `dermis bound`.
#[derive(Debug, Args)]
#[command(after_help = "The bounds hold for unbiased methods on the skin as designed: even coat, electrodes in their \
    places. Force, tip radius and the phase of the patches are unknown. docs/bounds.md has the formulas.")]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Digital twin whose presses, noise and drift are assumed: the path of a file, or a shipped name.
    #[arg(long, value_name = "TWIN", default_value = "lab")]
    twin: String,
    /// Signal-to-noise ratio of a reading, instead of that of the twin, dB.
    #[arg(long, value_name = "DB", value_parser = number(-20.0..=200.0))]
    noise: Option<f64>,
    /// Force of the presses, N.
    #[arg(long, value_name = "N", default_value_t = 2.0, value_parser = number(1e-3..=1e3))]
    force: f64,
    /// Radius of the tip, m.
    #[arg(long, value_name = "M", default_value_t = 0.005, value_parser = number(1e-4..=0.1))]
    tip_radius: f64,
    /// Standard deviation of the relative drift of the coat's conductance since the untouched frame, instead of that of
    /// the twin.
    #[arg(long, value_name = "SHARE", value_parser = number(0.0..=1.0), requires = "contact_drift")]
    coat_drift: Option<f64>,
    /// Standard deviation of the relative drift of each contact's resistance.
    #[arg(long, value_name = "SHARE", value_parser = number(0.0..=10.0), requires = "coat_drift")]
    contact_drift: Option<f64>,
    /// Take it as known where the patches lie on the coat.
    #[arg(long)]
    known_patches: bool,
    /// Leave out the values that use an electrode, as if it were disconnected. May be given more than once.
    #[arg(long, value_name = "N", value_parser = count(0..=1023usize))]
    without_electrode: Vec<usize>,
    /// Compute the separation of two presses at every N-th place; 0: nowhere.
    #[arg(long, value_name = "N", default_value_t = 13, value_parser = count(0..=1_000_000usize))]
    separation_step: usize,
    /// Write the bounds of every place (CSV).
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write a map of the position's standard deviation (SVG).
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
    /// Write a map of the smallest force (SVG).
    #[arg(long, value_name = "FILE")]
    force_map: Option<PathBuf>,
    /// Write a map of the distance at which two presses are told from one (SVG).
    #[arg(long, value_name = "FILE")]
    separation_map: Option<PathBuf>,
    /// Write the share of the places at which two presses are told from one against their distance (SVG).
    #[arg(long, value_name = "FILE")]
    separation_curve: Option<PathBuf>,
    /// Print JSON (SI units) instead of a table.
    #[arg(long)]
    json: bool,
}

/// The bounds at a place; none where the skin allows none.
#[derive(Debug, Clone, Copy, Serialize)]
struct Place {
    position_m: [f64; 3],
    sd_m: Option<f64>,
    force_sd_n: Option<f64>,
    smallest_force_n: Option<f64>,
    separation_m: Option<f64>,
}

/// The bounds of all places for some number of frames.
#[derive(Debug, Serialize)]
struct Summary {
    frames: usize,
    sd_m: Option<Spread>,
    force_sd_n: Option<Spread>,
    smallest_force_n: Option<Spread>,
    separation_m: Option<Spread>,
    places: Vec<Place>,
}

/// A value of a place, and the statistics of such values.
type OfPlace = fn(&Place) -> Option<f64>;
type OfSummary = fn(&Summary) -> Option<Spread>;

/// Statistics over places.
#[derive(Debug, Clone, Copy, Serialize)]
struct Spread {
    mean: f64,
    median: f64,
    p95: f64,
    largest: f64,
    /// Number of places with a value.
    places: usize,
}

impl Spread {
    fn of(places: &[Place], value: impl Fn(&Place) -> Option<f64>) -> Option<Self> {
        let values = sorted(places.iter().filter_map(value));
        let largest = *values.last()?;
        Some(Spread {
            mean: mean(&values),
            median: quantile(&values, 0.5),
            p95: quantile(&values, 0.95),
            largest,
            places: values.len(),
        })
    }
}

impl Arguments {
    /// Computes the bounds at every pixel.
    pub fn run(self) -> Outcome {
        self.check()?;
        let skin = skin::load(&self.design)?;
        let mut twin = TwinOptions::load(&self.twin)?;
        twin.electronics.snr_db = self.noise.or(twin.electronics.snr_db);
        let long = ((LONG_S * twin.electronics.frame_rate_hz).round() as usize).max(1);
        let waiting = Progress::waiting("preparing");
        let design = self.read_design(skin.design())?;
        let bounds = Bounds::new(&design, &twin, &self.options())?;
        drop(waiting);
        let one = self.summary(&skin, &bounds, 1)?;
        if one.sd_m.is_none() {
            let values = counted(design.protocol.channel_count(), "value");
            return Err(Failure::given(
                format!("the frame does not tell the place of a press anywhere on the skin: it has {values}"),
                Some("read more values: a press has four unknowns, two of its place, its force and its tip"),
            ));
        }
        let mean = self.summary(&skin, &bounds.averaged(long)?, long)?;
        self.write_files(&skin, &one)?;
        if self.json {
            let (design, twin) = (&skin.design().name, &twin.name);
            return print_json(&serde_json::json!({
                "design": design,
                "twin": twin,
                "without_electrodes": self.without_electrode,
                "bounds": [one, mean],
            }));
        }
        print(&format!(
            "{}, presses of {} N with a tip of {} mm, noise of `{}`{}, {}\n\n{}",
            skin.design().name,
            self.force,
            1e3 * self.tip_radius,
            twin.name,
            self.disconnected(),
            counted(one.places.len(), "place"),
            table(&one, &mean).to_text()
        ))
    }

    fn check(&self) -> Outcome {
        let pictures = [("--separation-map", &self.separation_map), ("--separation-curve", &self.separation_curve)];
        match pictures.into_iter().find(|(_, path)| path.is_some() && self.separation_step == 0) {
            Some((option, _)) => {
                Err(Failure::given(format!("{option} needs distances"), Some("leave out --separation-step 0")))
            }
            None => Ok(()),
        }
    }

    /// The design with the values that are read.
    fn read_design(&self, design: &SkinDesign) -> Outcome<SkinDesign> {
        let (count, mut design) = (design.electrodes.len(), design.clone());
        if let Some(electrode) = self.without_electrode.iter().find(|electrode| **electrode >= count) {
            let fix = format!("the electrodes of {} are 0 to {}", design.name, count - 1);
            return Err(Failure::given(format!("there is no electrode {electrode}"), Some(&fix)));
        }
        design.protocol = (design.protocol.without_electrodes(&self.without_electrode))
            .map_err(|_| Failure::given("no value is left", Some("leave out fewer electrodes")))?;
        Ok(design)
    }

    fn options(&self) -> BoundOptions {
        let drift = self.coat_drift.zip(self.contact_drift).map(|(sheet, contact)| DriftSpread {
            sheet,
            contact,
            ..DriftSpread::default()
        });
        BoundOptions {
            force_n: self.force,
            tip_radius_m: self.tip_radius,
            frames: 1,
            drift,
            known_patches: self.known_patches,
        }
    }

    /// The bounds at every pixel, for the mean of some frames.
    fn summary(&self, skin: &Skin, bounds: &Bounds, frames: usize) -> Outcome<Summary> {
        let pixels = skin.pixels();
        let progress = Progress::new(&format!("bounds of {}", counted(frames, "frame")), pixels.len());
        let at = |pixel: usize| {
            let place = self.place(bounds, pixels, pixel);
            progress.step();
            place
        };
        let places: Vec<Place> = (0..pixels.len()).into_par_iter().map(at).collect::<dermis_sim::Result<_>>()?;
        Ok(Summary {
            frames,
            sd_m: Spread::of(&places, |place| place.sd_m),
            force_sd_n: Spread::of(&places, |place| place.force_sd_n),
            smallest_force_n: Spread::of(&places, |place| place.smallest_force_n),
            separation_m: Spread::of(&places, |place| place.separation_m),
            places,
        })
    }

    fn place(&self, bounds: &Bounds, pixels: &PixelSpace, pixel: usize) -> dermis_sim::Result<Place> {
        let (position_m, normal) = (pixels.centres_m[pixel], pixels.normals[pixel]);
        let position = bounds.position(position_m, normal)?;
        let is_separated = bounds.has_chart() && self.separation_step > 0 && pixel.is_multiple_of(self.separation_step);
        let separation_m = if is_separated { bounds.worst_separation_m(position_m)? } else { None };
        Ok(Place {
            position_m,
            sd_m: position.map(|bound| bound.sd_m),
            force_sd_n: position.map(|bound| bound.force_sd_n),
            smallest_force_n: bounds.smallest_force_n(position_m, pixels.len())?,
            separation_m,
        })
    }

    fn write_files(&self, skin: &Skin, bounds: &Summary) -> Outcome {
        if let Some(path) = &self.output {
            write_whole(path, |out| write_places(out, &bounds.places))?;
        }
        let maps: [(&Option<PathBuf>, &str, &str, OfPlace); 3] = [
            (&self.map, "Bound of the position", "standard deviation of the position (mm)", |place| {
                place.sd_m.map(|sd_m| 1e3 * sd_m)
            }),
            (&self.force_map, "Bound of the smallest force", "smallest force found in 90 % of frames (N)", |place| {
                place.smallest_force_n
            }),
            (
                &self.separation_map,
                "Bound of the separation",
                "two presses told from one in 90 % of frames (mm)",
                |place| place.separation_m.map(|separation_m| 1e3 * separation_m),
            ),
        ];
        for (path, title, label, value) in maps {
            let Some(path) = path else { continue };
            let values: Vec<f64> = bounds.places.iter().map(|place| value(place).unwrap_or(f64::NAN)).collect();
            let picture = self.draw(skin, &values, title, label)?;
            write_whole(path, |out| out.write_all(picture.to_svg().as_bytes()))?;
        }
        if let Some(path) = &self.separation_curve {
            write_whole(path, |out| out.write_all(self.curve(&bounds.places).to_svg().as_bytes()))?;
        }
        Ok(())
    }

    /// The share of the places at which two presses are told from one, against their distance.
    fn curve(&self, places: &[Place]) -> Picture {
        let is_tried = |pixel: &usize| pixel.is_multiple_of(self.separation_step);
        let tried = (0..places.len()).filter(is_tried).count();
        let values: Vec<f64> = places.iter().filter_map(|place| place.separation_m.map(|value| 1e3 * value)).collect();
        Cumulative {
            title: "Bound of the separation",
            subtitle: &self.conditions(),
            below: "distance of two presses that are told from one in 90 % of frames (mm)",
            left: "fraction of the places",
            values: &values,
            total: tried,
            marks: Vec::new(),
        }
        .draw()
    }

    /// The disconnected electrodes, after a comma; empty without any.
    fn disconnected(&self) -> String {
        let numbers: Vec<String> = self.without_electrode.iter().map(usize::to_string).collect();
        if numbers.is_empty() { String::new() } else { format!(", without electrode {}", numbers.join(", ")) }
    }

    fn conditions(&self) -> String {
        format!("presses of {} N, noise of `{}`, one frame{}", self.force, self.twin, self.disconnected())
    }

    fn draw(&self, skin: &Skin, values: &[f64], title: &str, label: &str) -> Outcome<Picture> {
        let drawing = Drawing::new(skin.design(), skin.mesh());
        let key = Key { scale: Scale::sequential(values.iter().copied()), label: label.into() };
        let mut scene = drawing.field(skin.pixels(), values, key);
        scene.title = title.into();
        scene.subtitle = self.conditions();
        let drawn = View::of(skin.design()).draw(&scene, skin.design());
        drawn.map_err(|error| Failure::Ours(error.to_string()))
    }
}

fn table(one: &Summary, mean: &Summary) -> Table {
    let columns = ["bound", "frames", "mean", "median", "95th percentile", "largest", "places"];
    let mut table = Table::new(&columns);
    let quantities: [(&str, f64, OfSummary); 4] = [
        ("position, standard deviation (mm)", 1e3, |summary| summary.sd_m),
        ("force, standard deviation (N)", 1.0, |summary| summary.force_sd_n),
        ("smallest force, 90 % found (N)", 1.0, |summary| summary.smallest_force_n),
        ("two presses told from one, 90 % (mm)", 1e3, |summary| summary.separation_m),
    ];
    for (name, unit, spread) in quantities {
        for summary in [one, mean] {
            let Some(Spread { mean, median, p95, largest, places }) = spread(summary) else { continue };
            let [mean, median, p95, largest] = [mean, median, p95, largest].map(|value| format!("{:.3}", unit * value));
            table.row([name.into(), summary.frames.to_string(), mean, median, p95, largest, places.to_string()]);
        }
    }
    table
}

fn write_places(out: &mut dyn Write, places: &[Place]) -> std::io::Result<()> {
    writeln!(out, "x_m,y_m,z_m,sd_m,force_sd_n,smallest_force_n,separation_m")?;
    let text = |value: Option<f64>| value.map(|value| value.to_string()).unwrap_or_default();
    for Place { position_m: [x, y, z], sd_m, force_sd_n, smallest_force_n, separation_m } in places {
        let values = [sd_m, force_sd_n, smallest_force_n, separation_m].map(|value| text(*value));
        writeln!(out, "{x},{y},{z},{}", values.join(","))?;
    }
    Ok(())
}
