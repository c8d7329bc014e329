//! `dermis bound`: how well any method can do on a skin, before it is built.

use crate::console::{Progress, print, print_json};
use crate::failure::{Failure, Outcome};
use crate::picture::{picture, save};
use crate::range::{count, number};
use crate::skin;
use crate::twin::TwinArguments;
use clap::Args;
use dermis::estimate::drift::DriftSpread;
use dermis::frame::write_whole;
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_plot::chart::Cumulative;
use dermis_plot::report::Table;
use dermis_plot::{Key, Picture, Scale, skin_map};
use dermis_sim::bound::{BoundMap, BoundOptions, MapOptions, PlaceBounds, Spread, map_bounds};
use std::path::PathBuf;

/// The arguments of `dermis bound`.
#[derive(Debug, Args)]
#[command(after_help = "The bounds hold for unbiased methods on the skin as designed: even coat, electrodes in their \
    places. Force, tip radius and the phase of the patches are unknown. docs/bounds.md has the formulas.")]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    #[command(flatten)]
    twin: TwinArguments,
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
    /// Tell two presses from one object of any length and direction, not only from one press by a ball.
    #[arg(long)]
    any_form: bool,
    /// Leave out the values that use an electrode, as if it were disconnected. May be given more than once.
    #[arg(long, value_name = "N", value_parser = count(0..=1023usize))]
    without_electrode: Vec<usize>,
    /// Compute the separation of two presses at every N-th place; 0: nowhere.
    #[arg(long, value_name = "N", default_value_t = 29, value_parser = count(0..=1_000_000usize))]
    separation_step: usize,
    /// Write the bounds of every place (CSV).
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write a map of the position's standard deviation (SVG, PNG).
    #[arg(long, value_name = "FILE", value_parser = picture())]
    map: Option<PathBuf>,
    /// Write a map of the smallest force (SVG, PNG).
    #[arg(long, value_name = "FILE", value_parser = picture())]
    force_map: Option<PathBuf>,
    /// Write a map of the distance at which two presses are told from one (SVG, PNG).
    #[arg(long, value_name = "FILE", value_parser = picture())]
    separation_map: Option<PathBuf>,
    /// Write the share of the places at which two presses are told from one against their distance (SVG, PNG).
    #[arg(long, value_name = "FILE", value_parser = picture())]
    separation_curve: Option<PathBuf>,
    /// Print JSON (SI units) instead of a table.
    #[arg(long)]
    json: bool,
}

/// A value of a place, and the statistics of such values.
type OfPlace = fn(&PlaceBounds) -> Option<f64>;
type OfMap = fn(&BoundMap) -> Option<Spread>;

impl Arguments {
    /// Computes the bounds at every pixel.
    pub fn run(self) -> Outcome {
        self.check()?;
        let skin = skin::load(&self.design)?;
        let twin = self.twin.load()?;
        let progress = Progress::new("bounds", skin.pixels().len());
        let found = map_bounds(&skin, &twin, &self.options(), || progress.step())?;
        drop(progress);
        let [one, mean] = &found.bounds;
        if self.json {
            print_json(&serde_json::json!(found))?;
            return self.write_files(&skin, one);
        }
        print(&format!(
            "{}, presses of {} N with a tip of {} mm, noise of `{}`{}, {}\n\n{}",
            found.design,
            self.force,
            1e3 * self.tip_radius,
            found.twin,
            self.disconnected(),
            counted(one.places.len(), "place"),
            table(one, mean).to_text()
        ))?;
        self.write_files(&skin, one)
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

    fn options(&self) -> MapOptions {
        let drift = self.coat_drift.zip(self.contact_drift).map(|(sheet, contact)| DriftSpread {
            sheet,
            contact,
            ..DriftSpread::default()
        });
        MapOptions {
            bound: BoundOptions {
                force_n: self.force,
                tip_radius_m: self.tip_radius,
                drift,
                known_patches: self.known_patches,
                known_form: !self.any_form,
                ..BoundOptions::default()
            },
            without_electrodes: self.without_electrode.clone(),
            separation_step: self.separation_step,
        }
    }

    fn write_files(&self, skin: &Skin, bounds: &BoundMap) -> Outcome {
        if let Some(path) = &self.output {
            write_whole(path, |out| bounds.write_csv(out))?;
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
            let key = Key { scale: Scale::sequential(values.iter().copied()), label: label.into() };
            save(&skin_map(skin, &values, key, title, self.conditions())?, path)?;
        }
        match &self.separation_curve {
            Some(path) => save(&self.curve(&bounds.places), path),
            None => Ok(()),
        }
    }

    /// The share of the places at which two presses are told from one, against their distance.
    fn curve(&self, places: &[PlaceBounds]) -> Picture {
        let values: Vec<f64> = places.iter().filter_map(|place| place.separation_m.map(|value| 1e3 * value)).collect();
        Cumulative {
            title: "Bound of the separation",
            subtitle: &self.conditions(),
            below: "distance of two presses that are told from one in 90 % of frames (mm)",
            left: "fraction of the places",
            values: &values,
            total: places.len().div_ceil(self.separation_step),
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
        format!("presses of {} N, noise of `{}`, one frame{}", self.force, self.twin.name, self.disconnected())
    }
}

fn table(one: &BoundMap, mean: &BoundMap) -> Table {
    let columns = ["bound", "frames", "mean", "median", "95th percentile", "largest", "places"];
    let mut table = Table::new(&columns);
    let quantities: [(&str, f64, OfMap); 4] = [
        ("position, standard deviation (mm)", 1e3, |map| map.sd_m),
        ("force, standard deviation (N)", 1.0, |map| map.force_sd_n),
        ("smallest force, 90 % found (N)", 1.0, |map| map.smallest_force_n),
        ("two presses told from one, 90 % (mm)", 1e3, |map| map.separation_m),
    ];
    for (name, unit, spread) in quantities {
        for map in [one, mean] {
            let Some(Spread { mean, median, p95, largest, places }) = spread(map) else { continue };
            let [mean, median, p95, largest] = [mean, median, p95, largest].map(|value| format!("{:.3}", unit * value));
            table.row([name.into(), map.frames.to_string(), mean, median, p95, largest, places.to_string()]);
        }
    }
    table
}
