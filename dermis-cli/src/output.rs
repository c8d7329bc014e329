//! Where the results of commands go: files, or standard output.

use crate::console::{note, print};
use crate::failure::{Failure, Outcome};
use dermis::files::ending;
use dermis::frame::{write_array, write_csv, write_whole};
use serde::Serialize;
use std::io::{BufWriter, Error, ErrorKind, IsTerminal, Write};
use std::path::{Path, PathBuf};

/// A file to write, or `-` for standard output.
#[derive(Debug, Clone)]
pub struct Output(PathBuf);

impl From<std::ffi::OsString> for Output {
    fn from(name: std::ffi::OsString) -> Self {
        Output(name.into())
    }
}

impl Output {
    /// Standard output.
    pub fn standard() -> Self {
        Output("-".into())
    }

    /// The file; `None` for standard output.
    pub fn file(&self) -> Option<&Path> {
        (self.0.as_os_str() != "-").then_some(self.0.as_path())
    }

    /// The ending of the file's name in small letters; that of standard output is `csv`.
    pub fn ending(&self) -> String {
        self.file().map_or_else(|| "csv".into(), ending)
    }

    /// Writes the file whole or not at all, or standard output.
    pub fn write(&self, fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Outcome {
        match self.file() {
            Some(file) => Ok(write_whole(file, fill)?),
            None => to_standard_output(fill),
        }
    }

    /// Refuses the ending of another kind of file than an array's: text of any ending is CSV.
    pub fn check_array(&self, what: &str) -> Outcome {
        const OTHER: [&str; 12] =
            ["json", "jsonl", "mcap", "mat", "h5", "hdf5", "parquet", "xlsx", "toml", "svg", "png", "html"];
        if OTHER.contains(&self.ending().as_str()) {
            return Err(self.unknown_ending(what, ".csv, .npy or .npz"));
        }
        Ok(())
    }

    /// Writes an array in row-major order in the format of the file's ending; CSV to standard output.
    pub fn write_array(&self, name: &str, shape: &[usize], values: &[f64]) -> Outcome {
        match self.file() {
            Some(file) => Ok(write_array(file, name, shape, values)?),
            None => to_standard_output(|out| write_csv(out, values, shape.iter().skip(1).product())),
        }
    }

    /// The error of an ending that the result of a command cannot be written as.
    pub fn unknown_ending(&self, what: &str, endings: &str) -> Failure {
        let message = format!("{}: {what} are written as {endings}", self.0.display());
        Failure::given(message, Some("choose one of these endings"))
    }

    /// Says what was written. Beside a result on standard output it is said on standard error, to people alone.
    pub fn say(&self, text: &str) -> Outcome {
        match self.file() {
            Some(file) => print(&format!("{}: {text}\n", file.display())),
            None if std::io::stderr().is_terminal() => {
                note(text);
                Ok(())
            }
            None => Ok(()),
        }
    }
}

/// Writes standard output. A closed pipe (`dermis ... | head`) ends the output without an error.
pub fn to_standard_output(fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Outcome {
    let mut out = BufWriter::new(std::io::stdout().lock());
    match fill(&mut out).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::given(format!("cannot write to standard output: {error}"), None))
        }
        _ => Ok(()),
    }
}

/// Writes a line of JSON.
pub fn json_line(out: &mut dyn Write, value: &impl Serialize) -> std::io::Result<()> {
    serde_json::to_writer(&mut *out, value).map_err(Error::from)?;
    out.write_all(b"\n")
}
