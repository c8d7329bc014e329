//! `dermis fit`: a design fitted to frames of the untouched skin.

use crate::channels::LeaveOutArguments;
use crate::console::{Progress, print, print_json, warn};
use crate::failure::Outcome;
use crate::format::FormatArguments;
use crate::frames::{CURRENTS_HELP, warn_if_unlike};
use crate::skin;
use crate::used::Used;
use clap::{Args, ValueEnum};
use dermis::design::{SheetKind, SkinDesign};
use dermis::finding::Finding;
use dermis::fit::{Contacts, Determination, Fit, FitOptions, FittedQuantity, Misfit, Offset, Quantity, fit};
use dermis::frame::{ReadOptions, mean, write_whole};
use dermis::plausibility::Plausibility;
use dermis_plot::report::Table;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// A resistance that changes by more is likely in another unit.
const UNLIKELY_FACTOR: f64 = 30.0;

/// The arguments of `dermis fit`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Frames of the untouched skin, one per row (CSV, NPY or NPZ; ohm, or see --unit). From 2 of them on, the noise is measured from
    /// their scatter.
    #[arg(long, value_name = "FILE")]
    frames: PathBuf,
    #[arg(long, value_name = "FILE", help = CURRENTS_HELP)]
    currents: Option<PathBuf>,
    #[command(flatten)]
    format: FormatArguments,
    #[command(flatten)]
    leave_out: LeaveOutArguments,
    /// Contact impedances to fit.
    #[arg(long, value_enum, default_value_t = ContactsChoice::Common)]
    contacts: ContactsChoice,
    /// Write the constant part of each channel that the model does not explain (CSV: channel, offset_ohm, sd_ohm).
    #[arg(long, value_name = "FILE")]
    offsets: Option<PathBuf>,
    /// Design to write: the given file with the fitted values.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Print JSON (SI units) instead of a table.
    #[arg(long)]
    json: bool,
}

/// Contact impedances to fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ContactsChoice {
    /// One factor for all electrodes.
    Common,
    /// Each electrode's own.
    Each,
    /// None: the design's are kept.
    Keep,
}

impl From<ContactsChoice> for Contacts {
    fn from(choice: ContactsChoice) -> Self {
        match choice {
            ContactsChoice::Common => Contacts::Common,
            ContactsChoice::Each => Contacts::Each,
            ContactsChoice::Keep => Contacts::Kept,
        }
    }
}

/// The fit as JSON.
#[derive(Serialize)]
struct FitJson<'a> {
    skin: &'a str,
    frames: usize,
    quantities: &'a [FittedQuantity],
    /// Of the channels that read a voltage at a driven electrode.
    driven: Option<Misfit>,
    others: Option<Misfit>,
}

impl Arguments {
    /// Fits the design and writes it.
    pub fn run(self) -> Outcome {
        let text = SkinDesign::with_files(&SkinDesign::text_of(&self.design)?, &self.design)?;
        let skin = skin::load(&self.design)?;
        let design = skin.design();
        let left_out = self.leave_out.of(&design.protocol)?;
        let options = ReadOptions { left_out: &left_out, keep_incomplete: true, untouched: true, part: None };
        let frames = self.format.read_divided(&self.frames, &design.protocol, &options, self.currents.as_deref())?;
        let frames = Used::of(&self.frames, &frames)?.select(&frames);
        let check = Plausibility::new(&design.protocol, skin.untouched()?, &left_out);
        warn_if_unlike(&check, &frames);
        if let Some(Finding { evidence, fix, .. }) = mean(&frames).and_then(|mean| check.of_baseline(&mean)) {
            warn(&format!("{}: {evidence}; {fix}", self.frames.display()));
        }
        let options = FitOptions { contacts: self.contacts.into(), left_out };
        let progress = Progress::waiting("fitting the design");
        let fit = fit(design, skin.mesh(), &frames, &options)?;
        drop(progress);
        self.write_design(&fit, &text)?;
        if let Some(path) = &self.offsets {
            write_offsets(path, &fit.offsets)?;
        }
        warn_of_unit(&fit);
        if self.json {
            let Fit { quantities, driven, others, frames, .. } = &fit;
            let (driven, others, frames) = (*driven, *others, *frames);
            return print_json(&FitJson { skin: &design.name, frames, quantities, driven, others });
        }
        let (frames, channels) = (fit.frames, fit.offsets.len());
        print(&format!(
            "{}, untouched frames: {frames}, channels: {channels}\n\n{}\n{}\nwritten to {}\n",
            design.name,
            values(&fit, design).to_text(),
            misfits(&fit).to_text(),
            self.output.display()
        ))
    }

    /// Writes the design's file with the fitted values, and with the files that it names.
    fn write_design(&self, fit: &Fit, text: &str) -> Outcome {
        let new = fit.design.rewrite(text, &self.design)?;
        Ok(write_whole(&self.output, |out| out.write_all(new.as_bytes()))?)
    }
}

fn write_offsets(path: &Path, offsets: &[Offset]) -> Outcome {
    Ok(write_whole(path, |out| {
        writeln!(out, "channel,offset_ohm,sd_ohm")?;
        offsets.iter().try_for_each(|one| writeln!(out, "{},{:?},{:?}", one.channel, one.offset_ohm, one.sd_ohm))
    })?)
}

/// Warns of frames in another unit.
fn warn_of_unit(fit: &Fit) {
    let sheet = fit.quantities[0];
    let factor = sheet.value / sheet.initial;
    if !(1.0 / UNLIKELY_FACTOR..=UNLIKELY_FACTOR).contains(&factor) {
        warn(&format!("the resistance is {factor:.3e} times the design's: are the frames in ohm, volts per ampere?"));
    }
}

/// The fitted values.
fn values(fit: &Fit, design: &SkinDesign) -> Table {
    let mut table = Table::new(&["quantity", "design", "fitted", "deviation", "remark"]);
    for found in &fit.quantities {
        let FittedQuantity { initial, value, relative_sd, .. } = *found;
        let (name, initial, value) = match (found.quantity, design.sheet.kind) {
            (Quantity::Resistance, SheetKind::Surface) => ("sheet resistance, ohm".to_string(), initial, value),
            (Quantity::Resistance, SheetKind::Volume) => ("conductivity, S/m".to_string(), 1.0 / initial, 1.0 / value),
            (Quantity::CommonContact, _) => ("contact impedance".to_string(), initial, value),
            (Quantity::Contact(electrode), _) => (format!("contact impedance {electrode}"), initial, value),
        };
        let (deviation, remark) = match found.determination {
            Determination::Determined => (format!("{:.2} %", 100.0 * relative_sd), ""),
            Determination::Limit => ("-".to_string(), "only a limit: values beyond it fit as well"),
            Determination::Kept => ("-".to_string(), "not determined by the frames: kept"),
        };
        table.row([name, significant(initial), significant(value), deviation, remark.to_string()]);
    }
    table
}

/// What the fit leaves.
fn misfits(fit: &Fit) -> Table {
    let mut table = Table::new(&["values", "channels", "rms, ohm", "misfit, ohm", "noise, ohm"]);
    for (name, misfit) in [("at driven electrodes", fit.driven), ("others", fit.others)] {
        if let Some(Misfit { channels, rms_ohm, misfit_ohm, noise_ohm, .. }) = misfit {
            let [rms, misfit, noise] = [rms_ohm, misfit_ohm, noise_ohm].map(significant);
            table.row([name.to_string(), channels.to_string(), rms, misfit, noise]);
        }
    }
    table
}

/// A number to four digits.
fn significant(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    if rounded != 0.0 && !(1e-3..1e6).contains(&rounded.abs()) { format!("{rounded:e}") } else { rounded.to_string() }
}
