//! From a design to a better one, with its files.

use super::judge::{judge, with_noise_of};
use super::options::Start;
use super::pattern::MIN_SLOTS;
use super::places::Places;
use super::state::{FoundLayout, State};
use super::text::design_text;
use super::{Judgement, Layouts, OptimiseError, OptimiseOptions, Optimiser, centres_m, finite, select_readings};
use crate::twin::TwinOptions;
use dermis::design::SkinDesign;
use dermis::files::sha256;
use dermis::frame::write_whole;
use dermis::geom::Point3;
use dermis::protocol::Protocol;
use dermis::text::hexadecimal;
use rayon::prelude::*;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Steps of the progress for each number of readings.
const STEPS_PER_PATTERN: usize = 100;

/// What is searched for, and how long.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchOptions {
    /// Rules of the places, press, objective, moves and seed.
    pub optimise: OptimiseOptions,
    /// Number of electrodes; that of the given design without it.
    pub electrodes: Option<usize>,
    /// More numbers of electrodes, for the curve.
    pub counts: Vec<usize>,
    /// Whether the electrodes are kept, and readings alone are chosen.
    pub keep_electrodes: bool,
    /// Numbers of readings of a frame, those of the currents included. The new design has the first.
    pub slots: Vec<usize>,
    /// Number of starts for each number of electrodes; the first begins at the given layout.
    pub starts: usize,
    /// Rounds in which a start is improved by its exact bounds.
    pub rounds: usize,
    /// File of the starts that are done (JSON): written after each, continued if it exists.
    pub state: Option<PathBuf>,
}

impl Default for SearchOptions {
    /// As many electrodes as the given design has, all readings, two starts and four rounds.
    fn default() -> Self {
        SearchOptions {
            optimise: OptimiseOptions::default(),
            electrodes: None,
            counts: Vec::new(),
            keep_electrodes: false,
            slots: Vec::new(),
            starts: 2,
            rounds: 4,
            state: None,
        }
    }
}

/// A design with its exact bounds.
#[derive(Debug, Clone, Serialize)]
pub struct JudgedDesign {
    /// Its name.
    #[serde(rename = "design")]
    pub name: String,
    /// Number of electrodes.
    pub electrodes: usize,
    /// Number of values of a frame.
    #[serde(skip)]
    pub values: usize,
    /// Its bounds.
    #[serde(flatten)]
    pub judgement: Judgement,
}

impl JudgedDesign {
    fn new(design: &SkinDesign, judgement: Judgement) -> Self {
        let (electrodes, values) = (design.electrodes.len(), design.protocol.channel_count());
        JudgedDesign { name: design.name.clone(), electrodes, values, judgement }
    }
}

/// A point of a curve: the bounds for a number of electrodes or of readings; none where a place has none.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CurvePoint {
    /// Number of electrodes, or of readings with those of the currents.
    pub count: usize,
    /// Frames that the instrument reads in a second, Hz; for readings alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// The largest bound, m.
    pub worst_m: Option<f64>,
    /// The mean bound, m.
    pub mean_m: Option<f64>,
}

/// A better design, beside the given one.
#[derive(Debug, Clone, Serialize)]
pub struct Optimised {
    /// The given design.
    pub given: JudgedDesign,
    /// The new design, under the noise of all readings.
    pub optimised: JudgedDesign,
    /// Whether a search has ended at the given places.
    pub given_kept: bool,
    /// The best layout for each number of electrodes, in ascending order.
    pub electrodes: Vec<CurvePoint>,
    /// The readings that are worth most, for each number of them.
    pub readings: Vec<CurvePoint>,
}

impl SearchOptions {
    /// Number of calls of `step` of [`optimise`] for a design.
    pub fn steps(&self, given: &SkinDesign) -> usize {
        let layouts =
            if self.keep_electrodes { 0 } else { self.all_counts(given).len() * self.starts * (1 + self.rounds) };
        layouts + STEPS_PER_PATTERN * self.slots.len()
    }

    fn all_counts(&self, given: &SkinDesign) -> Vec<usize> {
        let mut counts = self.counts.clone();
        counts.push(self.electrodes.unwrap_or(given.electrodes.len()));
        counts.sort_unstable();
        counts.dedup();
        counts
    }
}

/// Searches for a better design, and writes it to `output`, with the table of its pattern beside it. `design` is the path of
/// a design file or a shipped name; the new design has the name of its file. Starts run in parallel. A design that is better
/// than the given one is written as soon as it is found.
///
/// ```no_run
/// use dermis_sim::optimise::{SearchOptions, optimise};
/// use dermis_sim::twin::TwinOptions;
///
/// let twin = TwinOptions::shipped("lab").unwrap();
/// let options = SearchOptions { electrodes: Some(20), ..SearchOptions::default() };
/// let found = optimise("cylinder30", &twin, &options, "better20.toml".as_ref(), || ())?;
/// println!("{:.2} mm", 1e3 * found.optimised.judgement.worst_m);
/// # Ok::<(), dermis_sim::Error>(())
/// ```
///
/// # Errors
/// A design that cannot be read or whose electrodes cannot be moved; rules that leave too few places; a twin without noise;
/// more readings than the protocol has; a place that no reading locates; files that cannot be written; a state of another
/// search.
pub fn optimise(
    design: &str,
    twin: &TwinOptions,
    options: &SearchOptions,
    output: &Path,
    step: impl Fn() + Sync,
) -> crate::Result<Optimised> {
    // Refused before the search, which takes minutes.
    if let Some(&slots) = options.slots.iter().find(|slots| **slots < MIN_SLOTS) {
        return Err(OptimiseError::TooFewSlots { slots, least: MIN_SLOTS }.into());
    }
    let text = SkinDesign::with_files(&SkinDesign::text_of(design)?, design)?;
    let given = SkinDesign::parse(&text, design)?;
    if !options.keep_electrodes {
        let places = Places::new(&given, &options.optimise.rules)?;
        options.all_counts(&given).into_iter().try_for_each(|count| places.fitting(count).map(drop))?;
    }
    let run = Run { path: design, text: &text, given: &given, twin, options, output };
    let bound = &options.optimise.bound;
    let of_given = judge(&given, twin, bound)?;
    let found = if options.keep_electrodes { Vec::new() } else { run.search(&of_given, &step)? };
    let best = found.iter().find(|one| one.start.electrodes_m.len() == run.wanted());
    let electrodes_m = best.map_or_else(|| centres_m(&given), |one| one.start.electrodes_m.clone());
    let patterns = run.patterns(&electrodes_m, &step)?;
    let new = run.write(&electrodes_m, patterns.first())?;
    let of_new = match patterns.first() {
        Some(pattern) => pattern.judgement.clone(),
        None => judge(&new, twin, bound)?,
    };
    let layout = |found: &FoundLayout| CurvePoint {
        count: found.start.electrodes_m.len(),
        rate_hz: None,
        worst_m: found.worst_m,
        mean_m: found.mean_m,
    };
    Ok(Optimised {
        given_kept: found.iter().any(|found| found.start.electrodes_m == centres_m(&given)),
        electrodes: found.iter().map(layout).collect(),
        readings: patterns.iter().map(|pattern| pattern.point(twin)).collect(),
        given: JudgedDesign::new(&given, of_given),
        optimised: JudgedDesign::new(&new, of_new),
    })
}

/// Readings that were chosen.
struct Pattern {
    /// Values and currents.
    slots: usize,
    protocol: Protocol,
    judgement: Judgement,
}

impl Pattern {
    fn point(&self, twin: &TwinOptions) -> CurvePoint {
        CurvePoint {
            count: self.slots,
            rate_hz: Some(twin.electronics.slot_rate_hz / self.slots as f64),
            worst_m: finite(self.judgement.worst_m),
            mean_m: finite(self.judgement.mean_m),
        }
    }
}

/// What the steps of a search share.
struct Run<'a> {
    path: &'a str,
    text: &'a str,
    given: &'a SkinDesign,
    twin: &'a TwinOptions,
    options: &'a SearchOptions,
    output: &'a Path,
}

impl Run<'_> {
    /// The best layout for each number of electrodes, in ascending order.
    fn search(&self, of_given: &Judgement, step: &(impl Fn() + Sync)) -> crate::Result<Vec<FoundLayout>> {
        let SearchOptions { optimise: options, starts, rounds, state, .. } = self.options;
        let best = Mutex::new(if self.wanted() == self.given.electrodes.len() {
            of_given.of(options.objective)
        } else {
            f64::INFINITY
        });
        let counts = self.options.all_counts(self.given);
        let text = hexadecimal(&sha256(self.text.as_bytes()));
        let conditions = format!("design {text}\n{:?}\n{options:?}\n{rounds} rounds", self.twin);
        let state = Mutex::new(State::open(state.as_deref(), conditions)?);
        let kept = state.lock().unwrap_or_else(PoisonError::into_inner).best(self.wanted(), *starts, options.objective);
        if let Some(kept) = kept {
            let mut best = best.lock().unwrap_or_else(PoisonError::into_inner);
            *best = best.min(kept.objective_m(options.objective));
        }
        let locked = || state.lock().unwrap_or_else(PoisonError::into_inner);
        let optimiser = Optimiser::new(self.text, self.path, self.twin, options)?;
        // What does not fit is refused before any start.
        let layouts: Vec<Layouts<'_>> =
            counts.iter().map(|&count| optimiser.layouts(count)).collect::<crate::Result<_>>()?;
        let all: Vec<(usize, &Layouts<'_>, usize)> = (counts.iter().zip(&layouts))
            .flat_map(|(&count, layouts)| (0..*starts).map(move |index| (count, layouts, index)))
            .collect();
        all.into_par_iter().with_max_len(1).try_for_each(|(count, layouts, index)| -> crate::Result<()> {
            if locked().has(count, index) {
                (0..=*rounds).for_each(|_| step());
                return Ok(());
            }
            // A search that is stopped has written the best design so far.
            let keep = |start: &Start, judgement: &Judgement| {
                step();
                let mut best = best.lock().unwrap_or_else(PoisonError::into_inner);
                let is_wanted = count == self.wanted() && (best.is_finite() || count != self.given.electrodes.len());
                if is_wanted && judgement.of(options.objective) < *best {
                    *best = judgement.of(options.objective);
                    self.write(&start.electrodes_m, None)?;
                }
                Ok(())
            };
            let (start, judgement) = layouts.refine(layouts.start(index)?, *rounds, of_given, keep)?;
            locked().add(FoundLayout::new(start, &judgement))
        })?;
        Ok(counts.iter().filter_map(|&count| locked().best(count, *starts, options.objective)).collect())
    }

    /// Number of electrodes of the new design.
    fn wanted(&self) -> usize {
        self.options.electrodes.unwrap_or(self.given.electrodes.len())
    }

    /// The readings that are worth most, for each number of them.
    fn patterns(&self, electrodes_m: &[Point3], step: &(impl Fn() + Sync)) -> crate::Result<Vec<Pattern>> {
        if self.options.slots.is_empty() {
            return Ok(Vec::new());
        }
        let whole = SkinDesign::parse(&self.new_text(electrodes_m, None)?, self.path)?;
        let OptimiseOptions { bound, objective, .. } = &self.options.optimise;
        let pattern = |&slots: &usize| {
            let mut done = 0;
            let mut advance = |share: f64| {
                let now = (share * STEPS_PER_PATTERN as f64) as usize;
                (done..now).for_each(|_| step());
                done = done.max(now);
            };
            let channels = select_readings(&whole, self.twin, bound, *objective, slots, &mut advance)?;
            let protocol = Protocol::new(whole.electrodes.len(), channels)?;
            let design = SkinDesign { protocol: protocol.clone(), ..whole.clone() };
            let judgement = judge(&design, &with_noise_of(self.twin, &design, &whole)?, bound)?;
            advance(1.0);
            Ok(Pattern { slots, protocol, judgement })
        };
        self.options.slots.iter().map(pattern).collect()
    }

    /// Writes the new design, and the channel table of its pattern beside it.
    fn write(&self, electrodes_m: &[Point3], pattern: Option<&Pattern>) -> crate::Result<SkinDesign> {
        let table = format!("{}-pattern.csv", self.output.file_stem().unwrap_or_default().to_string_lossy());
        if let Some(Pattern { protocol, .. }) = pattern {
            let path = self.output.parent().unwrap_or(Path::new("")).join(&table);
            write_whole(&path, |out| out.write_all(protocol.to_csv().as_bytes()))?;
        }
        let text = self.new_text(electrodes_m, pattern.map(|_| &table[..]))?;
        write_whole(self.output, |out| out.write_all(text.as_bytes()))?;
        Ok(SkinDesign::parse(&text, &self.output.to_string_lossy())?)
    }

    /// The text of the new design.
    fn new_text(&self, electrodes_m: &[Point3], table: Option<&str>) -> crate::Result<String> {
        let name = self.output.file_stem().map_or("optimised".into(), |stem| stem.to_string_lossy());
        Ok(design_text(self.text, self.path, &name, electrodes_m, table)?)
    }
}
