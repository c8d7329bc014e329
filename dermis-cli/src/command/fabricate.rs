//! `dermis fabricate`: the files of a workshop.

use crate::console::{Progress, print, print_json};
use crate::failure::Outcome;
use clap::Args;
use dermis::design::SkinDesign;
use dermis_fabricate::{Fabrication, Manifest, PARTS, check_free, notes, write_folder};
use std::fmt::Write;
use std::path::PathBuf;

/// The arguments of `dermis fabricate`.
#[derive(Debug, Args)]
#[command(after_help = "Sizes are those of the design's table [fabrication]; docs/fabrication.md explains every file.")]
pub struct Arguments {
    /// Design: the path of a file, or a shipped name.
    design: String,
    /// Folder to write.
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Replace a folder that this command has written.
    #[arg(long)]
    force: bool,
    /// Print the manifest as JSON instead of a table.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Writes the folder.
    pub fn run(self) -> Outcome {
        check_free(&self.output, self.force)?;
        let fabrication = Fabrication::new(&SkinDesign::load_for_fabrication(&self.design)?)?;
        let mut files = Vec::new();
        {
            let progress = Progress::new("making the parts", PARTS.len());
            for (what, make) in PARTS {
                progress.show(&format!("making the {what}"));
                files.extend(make(&fabrication)?);
                progress.step();
            }
        }
        let manifest = Manifest::new(&fabrication.design, notes(&fabrication), &files);
        write_folder(&self.output, self.force, &manifest, &files)?;
        if self.json { print_json(&manifest) } else { print(&self.text(&manifest)) }
    }

    fn text(&self, manifest: &Manifest) -> String {
        let mut text = format!("wrote {} files to {}\n\n", manifest.files.len() + 1, self.output.display());
        let width = manifest.files.iter().map(|file| file.path.len()).max().unwrap_or(0);
        for file in &manifest.files {
            let _ = writeln!(text, "{:width$}  {}", file.path, file.purpose);
        }
        for note in &manifest.notes {
            let _ = write!(text, "\nnote: {note}");
        }
        if !manifest.notes.is_empty() {
            text.push('\n');
        }
        text
    }
}
