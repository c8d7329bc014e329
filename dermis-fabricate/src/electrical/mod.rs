//! Tables and a netlist for wiring and first tests: electrodes, multiplexers, scan table, expected readings, parts, SPICE.

mod model;
mod neighbours;
mod netlist;
mod parts;
mod range;
mod reader;
mod spread;
mod tables;

pub use model::{Electrical, Reading};
pub use neighbours::Neighbours;
pub(crate) use parts::Pin;
pub use parts::{Part, parts};
pub use range::Range;
pub(crate) use reader::USUAL_REFERENCE_OHM;
pub use reader::{REFERENCE_TOLERANCE, electronics};
pub use spread::{Loop, Sensitivities, Value};
pub(crate) use tables::amount;

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::Fabrication;

/// Tables of electrodes, wiring, scan order, expected readings of the untouched skin and parts, and a SPICE netlist that
/// gives the same readings.
///
/// # Errors
/// A design that cannot be meshed, solved or read; a base that cannot be made.
pub fn files(fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    let electrical = fabrication.electrical()?;
    let (design, places) = (&fabrication.design, &electrical.places);
    let header = design.protocol.scan_c_header(&design.name, design.sha256(), places);
    let parts = tables::parts(&parts(fabrication)?);
    Ok(vec![
        OutputFile::new(
            "tables/electrodes.csv",
            "place, normal and bore of each electrode",
            tables::electrodes(fabrication),
        ),
        OutputFile::new(
            "tables/wiring.csv",
            "multiplexer input of each electrode",
            tables::wiring(fabrication, places),
        ),
        OutputFile::new("tables/scan-table.csv", "order of the readings", design.protocol.scan_csv(places)),
        OutputFile::new("tables/scan_table.h", "order of the readings, for firmware in C", header),
        OutputFile::new(
            "tables/readings.csv",
            "expected readings, untouched, with limits",
            tables::readings(electrical),
        ),
        OutputFile::new(
            "tables/neighbours.csv",
            "resistances between neighbouring electrodes, with limits",
            tables::neighbours(fabrication, electrical),
        ),
        OutputFile::new("tables/parts.csv", "parts and materials", parts),
        OutputFile::new(
            "tables/skin.cir",
            "SPICE netlist that gives the readings",
            netlist::netlist(fabrication, electrical),
        ),
    ])
}
