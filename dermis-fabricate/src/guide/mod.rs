//! The builder's guide: the steps of the paper's section III.B with the numbers and the drawings of a design, as a page to
//! print.

mod html;
mod pictures;
mod steps;
mod wiring;

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::Fabrication;
use crate::sheet::escaped;

/// The guide.
///
/// # Errors
/// A base that cannot be made; a design without an electrical model.
pub fn files(fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    Ok(vec![OutputFile::new("guide.html", "steps of the builder, to read or print", page(fabrication)?)])
}

/// The page: one file without references to others.
fn page(fabrication: &Fabrication) -> Result<String, FabricateError> {
    let name = escaped(&fabrication.design.name);
    let parts = [
        steps::overview(fabrication)?,
        steps::parts(fabrication)?,
        steps::base(fabrication),
        steps::electrodes(fabrication),
        steps::coat(fabrication),
        steps::cover(fabrication),
        wiring::section(fabrication)?,
        steps::test(fabrication)?,
        steps::robot(fabrication),
    ];
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>Building {name}</title>\n\
         <style>\n{}</style>\n</head>\n<body>\n<h1>Building {name}</h1>\n{}</body>\n</html>\n",
        include_str!("style.css"),
        parts.concat()
    ))
}

#[cfg(test)]
mod tests;
