//! The findings on a built skin as a page with pictures.

use crate::failure::Outcome;
use dermis::image::PixelSpace;
use dermis::skin::Skin;
use dermis::text::counted;
use dermis_calibrate::build::{BuildCheck, Fault};
use dermis_plot::report::{Report, Table};
use dermis_plot::{Drawing, Key, Picture, Scale, View};

/// Parts of the cells that are below and above the range of the colours of the coat.
const QUANTILES: [f64; 2] = [0.005, 0.995];
/// The colour of a contact reaches this far, in distances to the next electrode.
const CONTACT_SHARE: f64 = 0.25;

/// The page of a checked skin.
pub fn page(skin: &Skin, check: &BuildCheck, source: &str) -> Outcome<Report> {
    let name = &skin.design().name;
    let faults = check.findings.iter().filter(|finding| finding.is_fault()).count();
    let lead = match faults {
        0 => format!("{name} is sound: it is what the design says, within workmanship."),
        _ => format!("{name} is not as designed: {}.", counted(faults, "fault")),
    };
    let mut report = Report::new(&format!("Check of the built skin {name}"), &lead);
    report.findings(&check.findings);
    report.heading("Measured");
    report.table(&figures(check));
    if !check.conductance.is_empty() {
        report.heading("Coat and contacts");
        report.pictures(&[coat(skin, check)?, contacts(skin, check)?]);
        report.table(&contact_table(check));
    }
    report.heading("Sign-off");
    report.table(&sign_off(skin, check, source, faults == 0));
    Ok(report)
}

fn figures(check: &BuildCheck) -> Table {
    let mut table = Table::new(&["figure", "value"]);
    table.pair("resistances over those of the design", format!("{:.3}", check.resistance_factor));
    table.pair("unevenness of the coat (rms)", format!("{:.1} %", 100.0 * check.unevenness));
    table.pair("left of the frame, over noise and workmanship", format!("{:.2}", check.misfit));
    table.pair("the same without faults", format!("{:.2}", check.sound_misfit));
    table.pair("noise without a driven electrode, ohm", format!("{:.4}", check.noise_ohm[0]));
    table.pair("noise at driven electrodes, ohm", format!("{:.4}", check.noise_ohm[1]));
    table.pair("frames", check.frames);
    table
}

fn coat(skin: &Skin, check: &BuildCheck) -> Outcome<(Picture, String)> {
    let space = PixelSpace::cells(skin.mesh(), skin.design().body.surface());
    let scale = Scale::between_quantiles(check.conductance.iter().copied(), QUANTILES);
    let drawing = Drawing::new(skin.design(), skin.mesh());
    let mut scene = drawing.field(&space, &check.conductance, Key { scale, label: "conductance over its mean".into() });
    let marks: Vec<_> = check.faults.iter().flat_map(|fault| marks(skin, fault)).collect();
    if !marks.is_empty() {
        drawing.add_named_marks(&mut scene, marks.into_iter(), "fault");
    }
    let caption = "Conductance of the untouched coat, as far as the frame determines it; a cut has none.";
    draw(skin, &scene.titled("Coat", ""), caption)
}

/// The places of a fault on the skin.
fn marks(skin: &Skin, fault: &Fault) -> Vec<([f64; 3], String)> {
    let at = |electrode: usize| skin.design().electrodes[electrode].centre_m;
    let named = |electrodes: &[usize], name: &str| electrodes.iter().map(|&one| (at(one), name.to_string())).collect();
    match *fault {
        Fault::OpenElectrode { electrode } => named(&[electrode], "open"),
        Fault::PoorContact { electrode, .. } => named(&[electrode], "poor contact"),
        Fault::Short { electrodes, .. } => named(&electrodes, "short"),
        Fault::ExchangedWires { electrodes } => named(&electrodes, "exchanged"),
        Fault::Reference { drive, .. } => named(&skin.design().protocol.drives().0[drive], "reference"),
        Fault::Cut(cut) => vec![(cut.centre_m, "cut".into())],
    }
}

fn contacts(skin: &Skin, check: &BuildCheck) -> Outcome<(Picture, String)> {
    let surface = skin.design().body.surface();
    let centres: Vec<[f64; 3]> = skin.design().electrodes.iter().map(|electrode| electrode.centre_m).collect();
    let nearest = |point: [f64; 3], but: Option<usize>| {
        let others = centres.iter().enumerate().filter(|(index, _)| Some(*index) != but);
        let distances = others.map(|(index, &centre)| (index, surface.distance_m(centre, point)));
        distances.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, f64::INFINITY))
    };
    let spacing_m =
        (0..centres.len()).map(|index| nearest(centres[index], Some(index)).1).fold(f64::INFINITY, f64::min);
    let ratio = |electrode: usize| {
        check.contacts[electrode].contact_impedance / skin.design().electrodes[electrode].contact_impedance
    };
    let value = |cell: usize| match nearest(skin.mesh().cell_centre(cell), None) {
        (electrode, distance_m) if distance_m <= CONTACT_SHARE * spacing_m => ratio(electrode).log10(),
        _ => f64::NAN,
    };
    let values: Vec<f64> = (0..skin.mesh().cell_count()).map(value).collect();
    let space = PixelSpace::cells(skin.mesh(), surface);
    let key = Key {
        scale: Scale::diverging(values.iter().copied()),
        label: "log10 of contact impedance over the design's".into(),
    };
    let scene = Drawing::new(skin.design(), skin.mesh()).field(&space, &values, key);
    draw(
        skin,
        &scene.titled("Contacts", ""),
        "Contact impedance of each electrode; its colour is that of a disc around it.",
    )
}

fn draw(skin: &Skin, scene: &dermis_plot::Scene, caption: &str) -> Outcome<(Picture, String)> {
    let picture = View::of(scene, skin.design()).draw(scene, skin.design());
    Ok((picture?, caption.into()))
}

fn contact_table(check: &BuildCheck) -> Table {
    let mut table = Table::new(&["electrode", "contact impedance, ohm m2 (arcs: ohm m)", "displacement, mm", "state"]);
    for (electrode, contact) in check.contacts.iter().enumerate() {
        let [u, v] = contact.displacement_m.map(|by_m| 1e3 * by_m);
        let state = match (contact.is_faulty, contact.is_determined) {
            (true, _) => "faulty",
            (false, true) => "sound",
            (false, false) => "sound; impedance not determined",
        };
        let values = [format!("{:.2e}", contact.contact_impedance), format!("{u:.2}, {v:.2}")];
        let [impedance, displacement] = values;
        table.row([electrode.to_string(), impedance, displacement, state.into()]);
    }
    table
}

fn sign_off(skin: &Skin, check: &BuildCheck, source: &str, sound: bool) -> Table {
    let mut table = Table::new(&["entry", "value"]);
    table.pair("result", if sound { "sound" } else { "not as designed" });
    table.pair("design", &skin.design().name);
    table.pair("SHA-256 of its protocol", skin.design().protocol.sha256());
    table.pair("source", source);
    table.pair("frames", check.frames);
    ["checked by", "date", "signature"].into_iter().for_each(|entry| table.pair(entry, ""));
    table
}
