//! The step of the first test: commands that work for the design, and readings to compare.

use super::html::{self, Section, rounded, table};
use super::steps::argument;
use crate::electrical::{self, Reading};
use crate::error::FabricateError;
use crate::model::Fabrication;
use dermis::text::escaped;

/// Channels of the first drive that the page shows.
const SHOWN: usize = 12;
const PORT: &str = "--source serial:/dev/ttyACM0";

pub(super) fn section(fabrication: &Fabrication) -> Result<Section, FabricateError> {
    let electrical = fabrication.electrical()?;
    let options = &fabrication.options;
    let label = |electrode: usize| fabrication.electrodes[electrode].label.clone();
    let first = electrical.readings[0].slot.drive;
    let row = |reading: &Reading| {
        let ([plus, minus], channel) = reading.slot.measure?;
        let ohm = reading.ohm.as_ref().filter(|_| reading.slot.drive == first)?;
        let [low, high] = ohm.limits();
        let [low, nominal, high] = [low, ohm.nominal, high].map(|value| rounded(value, 2));
        Some([channel.to_string(), format!("{} - {}", label(plus), label(minus)), low, nominal, high])
    };
    let rows = electrical.readings.iter().filter_map(row).take(SHOWN);
    let columns = ["Channel", "Between", "Least, ohm", "Expected", "Greatest"];
    let text = format!(
        include_str!("first_test.html"),
        sheet = 100.0 * options.sheet_spread,
        contact = 100.0 * options.contact_spread,
        reference = 100.0 * electrical::REFERENCE_TOLERANCE,
        source = label(first[0]),
        sink = label(first[1]),
        readings = table(columns, rows).to_html(),
        design = escaped(&argument(&fabrication.design)),
        port = PORT
    );
    Ok(html::section("7. First test", text, true))
}
