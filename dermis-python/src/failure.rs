//! Errors of the engine as `dermis.DermisError`.

use dermis::design::DesignError;
use dermis_cli::CommandError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt;

/// The result of a call into the engine.
pub type Outcome<T> = Result<T, Failure>;

/// An error of the engine, or an exception of Python.
#[derive(Debug)]
pub enum Failure {
    /// Input that cannot be used.
    Given {
        /// What is wrong.
        message: String,
        /// The fix, if known.
        hint: Option<String>,
        /// The line in a file.
        line: Option<usize>,
    },
    /// An exception that Python has raised.
    Raised(PyErr),
    /// The work was cancelled.
    Cancelled,
}

impl Failure {
    /// An error without a place in a file.
    pub fn given(message: impl fmt::Display) -> Self {
        Failure::Given { message: message.to_string(), hint: None, line: None }
    }

    /// An error with the fix.
    pub fn with_hint(message: impl fmt::Display, hint: &str) -> Self {
        Failure::Given { message: message.to_string(), hint: Some(hint.into()), line: None }
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        let (message, hint, line) = match failure {
            Failure::Given { message, hint, line } => (message, hint, line),
            Failure::Raised(exception) => return exception,
            Failure::Cancelled => ("the work was cancelled".to_string(), None, None),
        };
        // Names of fields are between back quotes.
        let field = message.split('`').nth(1).filter(|_| line.is_some()).map(str::to_string);
        let raise = |py: Python<'_>| -> PyResult<PyErr> {
            let details = PyDict::new(py);
            details.set_item("hint", hint)?;
            details.set_item("line", line)?;
            details.set_item("field", field)?;
            let class = py.import("dermis._errors")?.getattr("DermisError")?;
            Ok(PyErr::from_value(class.call((message,), Some(&details))?))
        };
        Python::attach(|py| raise(py).unwrap_or_else(|exception| exception))
    }
}

impl From<PyErr> for Failure {
    fn from(exception: PyErr) -> Self {
        Failure::Raised(exception)
    }
}

impl From<DesignError> for Failure {
    fn from(error: DesignError) -> Self {
        let (hint, line) = (error.fix.clone(), error.line());
        // The fix is the hint.
        Failure::Given { message: DesignError { fix: None, ..error }.to_string(), hint, line }
    }
}

impl From<dermis_sim::Error> for Failure {
    fn from(error: dermis_sim::Error) -> Self {
        match error {
            dermis_sim::Error::Dermis(error) => error.into(),
            error => Failure::Given { message: error.to_string(), hint: error.fix(), line: None },
        }
    }
}

impl From<CommandError> for Failure {
    fn from(error: CommandError) -> Self {
        let CommandError { message, hint, line, .. } = error;
        Failure::Given { message, hint, line }
    }
}

dermis_cli::from_crates!(Failure, Failure::given);

/// Errors of one module, which say everything in their message.
macro_rules! from_message {
    ($($error:ty),*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Failure::given(error)
            }
        })*
    };
}
from_message!(
    dermis::forward::ForwardError,
    dermis::frame::TableError,
    dermis::mesh::MeshError,
    dermis::reconstruct::ReconstructError,
    dermis_sim::evaluate::EvaluateError,
    dermis_sim::touch::TouchError
);
