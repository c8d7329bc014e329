//! The builder's guide: the steps of the paper's section III.B with the numbers and the drawings of a design, as a page to
//! print.

mod coat;
mod cover;
mod first_test;
mod html;
mod pictures;
mod reader;
mod steps;
mod wiring;

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::Fabrication;
use dermis::text::escaped;
use dermis_plot::report::document;

/// The guide.
///
/// # Errors
/// A base that cannot be made; a design without an electrical model.
pub fn files(fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    Ok(vec![OutputFile::new("guide.html", "steps of the builder, to read or print", page(fabrication)?)])
}

/// The page: one file without references to others.
fn page(fabrication: &Fabrication) -> Result<String, FabricateError> {
    let title = format!("Building {}", fabrication.design.name);
    let sections = [
        steps::overview(fabrication)?,
        steps::parts(fabrication)?,
        steps::base(fabrication),
        steps::electrodes(fabrication),
        coat::section(fabrication)?,
        cover::section(fabrication),
        wiring::section(fabrication)?,
        reader::firmware(fabrication)?,
        first_test::section(fabrication)?,
        steps::robot(fabrication),
    ];
    let body = format!("<h1>{}</h1>\n{}", escaped(&title), html::sections(&sections));
    Ok(document(&title, include_str!("style.css"), &body))
}

#[cfg(test)]
mod tests;
