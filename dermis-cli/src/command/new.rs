//! `dermis new`: a commented design file to start from.

use crate::console::print;
use crate::failure::{Failure, Outcome};
use clap::{Args, ValueEnum};
use dermis::frame::write_whole;
use std::path::PathBuf;

/// The arguments of `dermis new`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The body that wears the skin.
    body: BodyKind,
    /// The file to write; `<body>.toml` without it.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Replace a file that is there already.
    #[arg(long)]
    force: bool,
}

/// A body to start from.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum BodyKind {
    Cylinder,
    Disk,
    Rectangle,
}

impl BodyKind {
    fn template(self) -> (&'static str, &'static str) {
        match self {
            BodyKind::Cylinder => ("cylinder", include_str!("new/cylinder.toml")),
            BodyKind::Disk => ("disk", include_str!("new/disk.toml")),
            BodyKind::Rectangle => ("rectangle", include_str!("new/rectangle.toml")),
        }
    }
}

impl Arguments {
    /// Writes the file.
    pub fn run(self) -> Outcome {
        let (name, text) = self.body.template();
        let path = self.output.unwrap_or_else(|| format!("{name}.toml").into());
        if !self.force && path.is_file() {
            let message = format!("{} is there already", path.display());
            return Err(Failure::given(message, Some("choose another file with -o, or replace it with --force")));
        }
        write_whole(&path, |writer| writer.write_all(text.as_bytes()))?;
        print(&format!("wrote {0}\nnext: dermis mesh {0} -o skin.vtu\n", path.display()))
    }
}
