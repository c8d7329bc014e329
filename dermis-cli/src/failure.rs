//! Errors of commands and their exit codes.

use dermis::design::DesignError;
use miette::{Diagnostic, NamedSource, SourceSpan};
use std::fmt;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

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
        Failure::Given(Excerpt { message: message.to_string(), fix, source: None, span: None }.into())
    }

    /// Prints the error and returns the exit code.
    pub fn report(self) -> ExitCode {
        match self {
            Failure::Given(report) => {
                eprintln!("{report:?}");
                ExitCode::from(2)
            }
            Failure::Ours(message) => {
                eprintln!(
                    "Error: {message}\nThis is an internal error of dermis: please report it with the command and its files."
                );
                ExitCode::from(1)
            }
        }
    }
}

/// Whether any thread has panicked.
static PANICKED: AtomicBool = AtomicBool::new(false);

/// Notes panics of every thread from now on.
pub fn watch_panics() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        PANICKED.store(true, Ordering::Relaxed);
        report(panic);
    }));
}

/// Whether any thread has panicked.
pub fn has_panicked() -> bool {
    PANICKED.load(Ordering::Relaxed)
}

/// Reports a panic, after its own message.
pub fn report_panic() -> ExitCode {
    Failure::Ours("unexpected state (see above)".into()).report()
}

/// A message with the excerpt of the file where the error is.
#[derive(Debug)]
struct Excerpt {
    message: String,
    fix: Option<String>,
    source: Option<NamedSource<String>>,
    span: Option<SourceSpan>,
}

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
        let source = source_text.map(|(name, text)| NamedSource::new(name, text).with_language("TOML"));
        Failure::Given(Excerpt { message, fix, source, span: span.map(first_line_of) }.into())
    }
}

impl From<dermis::method::MethodError> for Failure {
    fn from(error: dermis::method::MethodError) -> Self {
        match error {
            dermis::method::MethodError::Dermis(error) => error.into(),
            error => Failure::given(error, None),
        }
    }
}

impl From<dermis_learn::LearnError> for Failure {
    fn from(error: dermis_learn::LearnError) -> Self {
        match error {
            dermis_learn::LearnError::Dermis(error) => error.into(),
            dermis_learn::LearnError::Sim(error) => (*error).into(),
            error => Failure::given(error, None),
        }
    }
}

impl From<dermis_live::LiveError> for Failure {
    fn from(error: dermis_live::LiveError) -> Self {
        match error {
            dermis_live::LiveError::Dermis(error) => error.into(),
            dermis_live::LiveError::Sim(error) => (*error).into(),
            dermis_live::LiveError::Method(error) => (*error).into(),
            dermis_live::LiveError::Pipeline(error) => match *error {
                dermis::pipeline::PipelineError::Method(error) => (*error).into(),
                dermis::pipeline::PipelineError::Dermis(error) => (*error).into(),
                error => Failure::given(error, None),
            },
            error => Failure::given(error, None),
        }
    }
}

impl From<dermis_study::Error> for Failure {
    fn from(error: dermis_study::Error) -> Self {
        use dermis_study::Error;
        match error {
            Error::Dermis(error) => error.into(),
            Error::Sim(error) => error.into(),
            Error::Learn(error) => (*error).into(),
            Error::Plot(_) | Error::Internal(_) => Failure::Ours(error.to_string()),
            error => {
                let fix = error.fix();
                Failure::given(error, fix)
            }
        }
    }
}

/// Marks only the beginning of a long table.
fn first_line_of(span: std::ops::Range<usize>) -> SourceSpan {
    const MOST: usize = 80;
    (span.start, span.len().min(MOST)).into()
}

impl From<dermis::Error> for Failure {
    fn from(error: dermis::Error) -> Self {
        match error {
            dermis::Error::Design(error) => error.into(),
            error => Failure::given(error, None),
        }
    }
}

impl From<dermis_sim::Error> for Failure {
    fn from(error: dermis_sim::Error) -> Self {
        match error {
            dermis_sim::Error::Dermis(error) => error.into(),
            error => Failure::given(error, None),
        }
    }
}

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
    #[test]
    fn a_panic_of_any_thread_is_noted() {
        super::watch_panics();
        assert!(!super::has_panicked());
        assert!(std::thread::spawn(|| panic!("a test of panics")).join().is_err());
        assert!(super::has_panicked());
    }
}
