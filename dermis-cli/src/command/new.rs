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
    /// A body of any shape, from a file: a forearm, whose file is written beside.
    Mesh,
}

/// The body of the design that `dermis new mesh` writes.
const FOREARM: (&str, &[u8]) = ("forearm.stl", include_bytes!("../../../data/bodies/forearm.stl"));

impl BodyKind {
    fn template(self) -> (&'static str, &'static str) {
        match self {
            BodyKind::Cylinder => ("cylinder", include_str!("new/cylinder.toml")),
            BodyKind::Disk => ("disk", include_str!("new/disk.toml")),
            BodyKind::Rectangle => ("rectangle", include_str!("new/rectangle.toml")),
            BodyKind::Mesh => ("mesh", include_str!("new/mesh.toml")),
        }
    }
}

impl Arguments {
    /// Writes the file.
    pub fn run(self) -> Outcome {
        let (name, text) = self.body.template();
        let path = self.output.unwrap_or_else(|| format!("{name}.toml").into());
        let mut files = vec![(path.clone(), text.as_bytes())];
        if let BodyKind::Mesh = self.body {
            files.push((path.with_file_name(FOREARM.0), FOREARM.1));
        }
        if let Some((there, _)) = files.iter().find(|(path, _)| !self.force && path.is_file()) {
            let message = format!("{} is there already", there.display());
            return Err(Failure::given(message, Some("choose another place with -o, or replace it with --force")));
        }
        for (path, content) in files {
            write_whole(&path, |writer| writer.write_all(content))?;
        }
        print(&format!("wrote {0}\nnext: dermis mesh {0} -o skin.vtu\n", path.display()))
    }
}
