//! Output of commands: results, progress bars, status lines.

use crate::failure::{Failure, Outcome};
use crate::output::to_standard_output;
use clap::Args;
use dermis::finding::Finding;
use dermis::pipeline::Severity;
use dermis::text::{printable, printable_lines};
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::collections::BTreeSet;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Prints a result. A closed pipe (`dermis ... | head`) is not an error.
pub fn print(text: &str) -> Outcome {
    to_standard_output(|out| out.write_all(printable_lines(text).as_bytes()))
}

/// What a command prints beside its result; the same for every command.
#[derive(Debug, Clone, Copy, Args)]
pub struct Verbosity {
    /// Print warnings and errors alone beside the result: no progress, no notes.
    #[arg(short, long, global = true, display_order = 998)]
    quiet: bool,
    /// Print the time of each step.
    #[arg(short, long, global = true, display_order = 999, conflicts_with = "quiet")]
    verbose: bool,
}

static QUIET: AtomicBool = AtomicBool::new(false);
static VERBOSE: AtomicBool = AtomicBool::new(false);
/// The warnings of this run.
static WARNINGS: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

impl Verbosity {
    /// Begins a run with this verbosity.
    pub fn begin(self) {
        QUIET.store(self.quiet, Ordering::Relaxed);
        VERBOSE.store(self.verbose, Ordering::Relaxed);
        WARNINGS.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}

fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Where progress is drawn.
fn progress_target() -> ProgressDrawTarget {
    if is_quiet() { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() }
}

/// Prints a line to standard error. Who does not read it any more does not end the program.
pub fn say(line: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// Prints a warning to standard error, once in a run.
pub fn warn(text: &str) {
    if WARNINGS.lock().unwrap_or_else(PoisonError::into_inner).insert(text.into()) {
        say(format_args!("warning: {}", printable_lines(text)));
    }
}

/// Prints a finding as a warning.
pub fn warn_of(found: &Finding) {
    warn(&format!("{}: {} = {}; {}", found.title(), found.evidence, found.value_text(), found.fix));
}

/// Prints a note to standard error.
pub fn note(text: &str) {
    if !is_quiet() {
        say(printable_lines(text));
    }
}

/// A number that JSON has; its `null` for one that is not known.
pub fn known(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Prints a value as JSON.
pub fn print_json(value: &impl serde::Serialize) -> Outcome {
    let text = serde_json::to_string_pretty(value).map_err(|error| Failure::Ours(error.to_string()))?;
    print(&format!("{text}\n"))
}

/// A progress bar with the time left, shown after two seconds; where standard error is no terminal, a line for each tenth.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    begun: Instant,
    shown: AtomicBool,
    tenths: AtomicU64,
}

impl Progress {
    /// Time without a bar.
    const QUIET: Duration = Duration::from_secs(2);

    /// A bar over `count` steps.
    pub fn new(what: &str, count: usize) -> Self {
        let bar = ProgressBar::with_draw_target(Some(count as u64), ProgressDrawTarget::hidden());
        let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len}, {eta} left").expect("a valid template");
        bar.set_style(style);
        bar.set_message(what.to_string());
        Progress::of(bar, false)
    }

    /// A bar over `count` steps that also shows the rate.
    pub fn with_rate(what: &str, count: u64) -> Self {
        let progress = Progress::new(what, usize::try_from(count).unwrap_or(usize::MAX));
        let template = "{msg} {wide_bar} {pos}/{len}, {per_sec}, {eta} left";
        progress.bar.set_style(ProgressStyle::with_template(template).expect("a valid template"));
        progress
    }

    /// A spinner with the elapsed time, for work of unknown length.
    pub fn waiting(what: &str) -> Self {
        let bar = ProgressBar::with_draw_target(None, progress_target());
        bar.set_style(ProgressStyle::with_template("{msg} {spinner} {elapsed}").expect("a valid template"));
        bar.set_message(what.to_string());
        bar.enable_steady_tick(Duration::from_millis(200));
        Progress::of(bar, true)
    }

    fn of(bar: ProgressBar, is_shown: bool) -> Self {
        Progress { bar, begun: Instant::now(), shown: AtomicBool::new(is_shown), tenths: AtomicU64::new(0) }
    }

    /// Changes the message.
    pub fn show(&self, what: &str) {
        self.bar.set_message(what.to_string());
    }

    /// Advances by one step.
    pub fn step(&self) {
        self.steps(1);
    }

    /// Advances by some steps.
    pub fn steps(&self, count: u64) {
        if self.begun.elapsed() > Self::QUIET && !self.shown.swap(true, Ordering::Relaxed) {
            // Draws nothing where standard error is not a terminal.
            self.bar.set_draw_target(progress_target());
        }
        self.bar.inc(count);
        if self.shown.load(Ordering::Relaxed) && !is_quiet() && !std::io::stderr().is_terminal() {
            self.log();
        }
    }

    /// Prints a line if another tenth of the steps is done.
    fn log(&self) {
        let (done, count) = (self.bar.position(), self.bar.length().unwrap_or(0).max(1));
        let tenth = 10 * done / count;
        if done < count && tenth > self.tenths.fetch_max(tenth, Ordering::Relaxed) {
            let left = self.begun.elapsed().mul_f64((count - done) as f64 / done as f64);
            say(format_args!("{}: {done} of {count}, {} left", self.bar.message(), HumanDuration(left)));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
        if VERBOSE.load(Ordering::Relaxed) {
            say(format_args!("{}: {:.2} s", printable_lines(&self.bar.message()), self.begun.elapsed().as_secs_f64()));
        }
    }
}

/// Progress of the study of the paper, shown on this console.
#[derive(Debug, Clone, Copy)]
pub struct StudyProgress;

impl dermis_study::Progress for StudyProgress {
    fn begin(&self, what: &str, total: usize) -> Box<dyn dermis_study::Task + '_> {
        Box::new(Progress::new(what, total))
    }

    fn note(&self, line: &str) {
        note(line);
    }
}

impl dermis_study::Task for Progress {
    fn advance(&self, steps: usize) {
        self.steps(steps as u64);
    }
}

/// Calls a function on the first interrupt (Ctrl-C) or termination request; a second one exits immediately.
pub fn on_interrupt(mut then: impl FnMut() + Send + 'static) -> Outcome {
    let mut asked = false;
    let handler = move || {
        if asked {
            std::process::exit(130);
        }
        asked = true;
        then();
    };
    ctrlc::set_handler(handler).map_err(|error| Failure::Ours(format!("no handler of interrupts: {error}")))
}

/// Whether an interrupt or a termination request has come.
pub fn interrupted() -> Outcome<Arc<AtomicBool>> {
    let has_come = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&has_come);
    on_interrupt(move || flag.store(true, Ordering::Relaxed))?;
    Ok(has_come)
}

/// A message as a line, coloured on a terminal.
pub fn notice_line(level: Severity, text: &str) -> String {
    let text = printable(text);
    let colour = std::io::stderr().is_terminal();
    match (level, colour) {
        (Severity::Info, _) => text.into_owned(),
        (Severity::Warning, true) => format!("\u{1b}[33mwarning\u{1b}[0m: {text}"),
        (Severity::Error, true) => format!("\u{1b}[31merror\u{1b}[0m: {text}"),
        (Severity::Warning, false) => format!("warning: {text}"),
        (Severity::Error, false) => format!("error: {text}"),
    }
}

/// A status line on the terminal that is redrawn; nothing where standard error is not a terminal.
#[derive(Debug)]
pub struct StatusLine {
    bar: ProgressBar,
}

impl StatusLine {
    /// An empty line.
    pub fn new() -> Self {
        let bar = ProgressBar::with_draw_target(None, progress_target());
        bar.set_style(ProgressStyle::with_template("{msg}").expect("a valid template"));
        StatusLine { bar }
    }

    /// Draws the line.
    pub fn show(&self, text: &str) {
        self.bar.set_message(text.to_string());
        self.bar.tick();
    }

    /// Prints a message above it.
    pub fn notice(&self, level: Severity, text: &str) {
        if level != Severity::Info || !is_quiet() {
            self.print(&notice_line(level, text));
        }
    }

    /// Prints text above it.
    pub fn print(&self, text: &str) {
        if self.bar.is_hidden() { say(text) } else { self.bar.println(text) }
    }
}

impl Drop for StatusLine {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
