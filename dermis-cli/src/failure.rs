//! Errors of commands and their exit codes.

use crate::console::say;
use dermis::design::DesignError;
use dermis::text::{printable, printable_lines, shortened};
use miette::{Diagnostic, NamedSource, SourceSpan};
use std::fmt;
use std::ops::Range;
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The result of a command.
pub type Outcome<T = ()> = Result<T, Failure>;

/// Why a command did not finish.
#[derive(Debug)]
pub enum Failure {
    /// Invalid input, or a result that cannot be written: exit code 2.
    Given(miette::Report),
    /// An internal error: exit code 1.
    Ours(String),
}

impl Failure {
    /// An error of the user's input, and the fix.
    pub fn given(message: impl fmt::Display, fix: Option<&str>) -> Self {
        let fix = fix.map(str::to_string);
        Failure::Given(Excerpt::new(&message.to_string(), fix).into())
    }

    /// Prints the error and returns the exit code.
    pub fn report(self) -> u8 {
        match self {
            Failure::Given(report) => {
                say(format_args!("{report:?}"));
                2
            }
            Failure::Ours(message) => {
                let message = printable_lines(&message);
                say(format_args!(
                    "Error: {message}\nThis is an internal error of dermis: please report it with the command and its files."
                ));
                1
            }
        }
    }
}

/// Panics of all threads since they are counted.
static PANICS: AtomicUsize = AtomicUsize::new(0);

/// Counts panics of every thread from now on; returns their number so far.
pub fn watch_panics() -> usize {
    static WATCHED: Once = Once::new();
    WATCHED.call_once(|| {
        let report = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            PANICS.fetch_add(1, Ordering::Relaxed);
            report(panic);
        }));
    });
    panics()
}

/// The number of panics of all threads.
pub fn panics() -> usize {
    PANICS.load(Ordering::Relaxed)
}

/// The error of a panic, which has printed its own message.
pub fn panicked() -> Failure {
    Failure::Ours("unexpected state (see above)".into())
}

/// The error of a command, for programs that run it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct CommandError {
    /// What is wrong.
    pub message: String,
    /// The fix, if known.
    pub hint: Option<String>,
    /// The line in a file.
    pub line: Option<usize>,
    /// The exit code: 2 for invalid input, 1 for an internal error.
    pub code: u8,
}

impl CommandError {
    /// From arguments that are not understood.
    pub(crate) fn of_arguments(error: &clap::Error) -> Self {
        let text = error.to_string();
        let message = text.trim().trim_start_matches("error: ").to_string();
        CommandError { message, hint: None, line: None, code: 2 }
    }

    pub(crate) fn of_failure(failure: Failure) -> Self {
        match failure {
            Failure::Ours(message) => CommandError { message, hint: None, line: None, code: 1 },
            Failure::Given(report) => {
                let excerpt = report.downcast_ref::<Excerpt>();
                CommandError {
                    message: report.to_string(),
                    hint: report.help().map(|help| help.to_string()),
                    line: excerpt.and_then(|excerpt| excerpt.line),
                    code: 2,
                }
            }
        }
    }
}

/// A message with the excerpt of the file where the error is.
#[derive(Debug)]
struct Excerpt {
    message: String,
    fix: Option<String>,
    source: Option<NamedSource<String>>,
    span: Option<SourceSpan>,
    /// The line of the span, from 1.
    line: Option<usize>,
}

/// Longest message, and longest line of an excerpt, bytes: a file may be one line of many megabytes.
const LONGEST_MESSAGE: usize = 4000;
const LONGEST_LINE: usize = 400;

impl Excerpt {
    /// A message without an excerpt. Texts of files cannot control the terminal.
    fn new(message: &str, fix: Option<String>) -> Self {
        let clean = |text: &str| printable_lines(&shortened(text, LONGEST_MESSAGE)).into_owned();
        Excerpt { message: clean(message), fix: fix.map(|fix| clean(&fix)), source: None, span: None, line: None }
    }

    /// Adds the place in a file; without its text where the lines around it are too long to be shown.
    fn at(mut self, (name, text): (String, String), span: Option<Range<usize>>) -> Self {
        let name = printable(&name).into_owned();
        let before = &text.as_bytes()[..span.as_ref().map_or(0, |span| span.start.min(text.len()))];
        let line = before.iter().filter(|&&byte| byte == b'\n').count();
        self.line = span.is_some().then_some(line + 1);
        let mut around = text.lines().skip(line.saturating_sub(EXCERPT_LINES)).take(2 * EXCERPT_LINES + 1);
        if around.any(|line| line.len() > LONGEST_LINE) {
            self.message = format!("{name}, line {}: {}", line + 1, self.message);
            return self;
        }
        self.source = Some(NamedSource::new(name, printable_lines(&text).into_owned()).with_language("TOML"));
        self.span = span.map(first_line_of);
        self
    }
}

/// Lines before and after the wrong one that an excerpt shows, at most.
const EXCERPT_LINES: usize = 2;

impl fmt::Display for Excerpt {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.message)
    }
}

impl std::error::Error for Excerpt {}

impl Diagnostic for Excerpt {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.fix.as_ref().map(|fix| Box::new(fix) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        self.source.as_ref().map(|source| source as &dyn miette::SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = miette::LabeledSpan> + '_>> {
        let span = self.span?;
        Some(Box::new(std::iter::once(miette::LabeledSpan::new_with_span(Some("here".into()), span))))
    }
}

impl From<DesignError> for Failure {
    fn from(error: DesignError) -> Self {
        let DesignError { message, fix, source_text, span } = error;
        let excerpt = Excerpt::new(&message, fix);
        Failure::Given(match source_text {
            Some(source) => excerpt.at(source, span).into(),
            None => excerpt.into(),
        })
    }
}

impl From<dermis_calibrate::CalibrateError> for Failure {
    fn from(error: dermis_calibrate::CalibrateError) -> Self {
        Failure::given(&error, error.fix())
    }
}

impl From<dermis_study::Error> for Failure {
    fn from(error: dermis_study::Error) -> Self {
        use dermis_study::Error;
        match error {
            Error::Dermis(error) => (*error).into(),
            Error::Sim(error) => (*error).into(),
            Error::Learn(error) => (*error).into(),
            Error::Plot(_) | Error::Internal(_) => Failure::Ours(error.to_string()),
            error => {
                let fix = error.fix();
                Failure::given(error, fix)
            }
        }
    }
}

impl From<dermis_fabricate::FabricateError> for Failure {
    fn from(error: dermis_fabricate::FabricateError) -> Self {
        use dermis_fabricate::FabricateError;
        match error {
            FabricateError::Design(error) => error.into(),
            FabricateError::Mesh(error) => error.into(),
            FabricateError::Dermis(error) => error.into(),
            FabricateError::Internal(message) => Failure::Ours(message),
            error => Failure::given(&error, error.fix()),
        }
    }
}

/// Marks only the beginning of a long table.
fn first_line_of(span: std::ops::Range<usize>) -> SourceSpan {
    const MAX: usize = 80;
    (span.start, span.len().min(MAX)).into()
}

impl From<dermis_plot::PlotError> for Failure {
    fn from(error: dermis_plot::PlotError) -> Self {
        match error {
            dermis_plot::PlotError::NoFlatLayout => Failure::given(error, Some("ask for the view in space: --view 3d")),
            error => Failure::Ours(error.to_string()),
        }
    }
}

impl From<dermis_sim::Error> for Failure {
    fn from(error: dermis_sim::Error) -> Self {
        match error {
            dermis_sim::Error::Dermis(error) => error.into(),
            error => Failure::given(&error, error.fix().as_deref()),
        }
    }
}

/// Makes a type of failures from errors that may be those of a crate below, which are reported as such; any other becomes a failure
/// by `$given`.
#[macro_export]
macro_rules! from_crates {
    ($failure:ty, $given:expr) => {
        $crate::from_crates! { $failure, $given;
            dermis::Error { Design(error) => error }
            dermis::method::MethodError { Dermis(error) => error }
            dermis::pipeline::PipelineError { Dermis(error) => *error, Method(error) => *error }
            dermis_learn::LearnError { Dermis(error) => error, Sim(error) => *error }
            dermis_live::LiveError { Dermis(error) => error, Method(error) => *error, Pipeline(error) => *error }
            dermis_emulate::EmulateError { Dermis(error) => error, Sim(error) => *error, Live(error) => *error }
        }
    };
    ($failure:ty, $given:expr; $($error:ty { $($variant:ident($inner:ident) => $of_below:expr),* })*) => {
        $(impl From<$error> for $failure {
            fn from(error: $error) -> Self {
                type Of = $error;
                match error {
                    $(Of::$variant($inner) => $of_below.into(),)*
                    error => ($given)(error),
                }
            }
        })*
    };
}
from_crates!(Failure, |error| Failure::given(error, None));

/// Errors of one module, by the error of its crate.
macro_rules! from_modules {
    ($($of_crate:ty: $($error:ty),*;)*) => {
        $($(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                <$of_crate>::from(error).into()
            }
        })*)*
    };
}
from_modules!(
    dermis::Error:
        dermis::fit::FitError,
        dermis::frame::TableError,
        dermis::mesh::MeshError,
        dermis::forward::ForwardError,
        dermis::reconstruct::ReconstructError;
    dermis_sim::Error:
        dermis_sim::touch::TouchError,
        dermis_sim::dataset::DatasetError,
        dermis_sim::evaluate::EvaluateError;
);

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::design::SkinDesign;

    #[test]
    fn texts_of_files_do_not_control_the_terminal_and_have_a_limit() {
        let handler = miette::GraphicalReportHandler::new_themed(miette::GraphicalTheme::unicode_nocolor());
        let shown = |text: &str| {
            let Err(error) = SkinDesign::parse(text, "my\u{1b}[2J.toml") else { panic!("it is no design") };
            let Failure::Given(report) = error.into() else { panic!("it is a mistake of the file") };
            let mut text = String::new();
            handler.render_report(&mut text, report.as_ref()).unwrap();
            text
        };
        let raw = shown("name = \"a\"\n\u{1b}]0;title\u{7}\n");
        assert!(raw.contains("title") && !raw.contains(['\u{1b}', '\u{7}']), "{raw}");
        let named = shown(&SkinDesign::shipped_text("skin16").unwrap().replacen("skin16\"", "a\\u001b[2Jb\"", 1));
        assert!(named.contains("`name`") && !named.contains('\u{1b}'), "{named}");
        for long in [format!("{} = 1\n", "x".repeat(1_000_000)), format!("name = [\"{}\"]\n", "y".repeat(1_000_000))] {
            let told = shown(&long);
            assert!(told.len() < 10_000 && told.contains("line 1"), "{} bytes", told.len());
        }
    }

    #[test]
    fn a_panic_of_any_thread_is_noted() {
        let before = super::watch_panics();
        assert!(std::thread::spawn(|| panic!("a test of panics")).join().is_err());
        assert_eq!(super::watch_panics(), before + 1);
    }
}
