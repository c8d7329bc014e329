//! The text of a design with other electrodes and another pattern.

use dermis::design::{DesignError, SkinDesign};
use dermis::geom::{Point3, Surface};
use std::fmt::Write;
use std::path::Path;

/// The text of a design file with electrodes at other places, all of the shape of the first, with the mean of the contact
/// impedances. Comments are lost.
///
/// `name` is the name of the new design; `table`, if there is one, the channel table of its pattern, relative to its
/// folder. The files that the text carries stay; without them the path of a mesh file is made absolute.
pub(super) fn design_text(
    text: &str,
    path: &str,
    name: &str,
    electrodes_m: &[Point3],
    table: Option<&str>,
) -> Result<String, DesignError> {
    let design = SkinDesign::parse(text, path)?;
    // A design that was read is TOML.
    let mut file: toml::Table = toml::from_str(text.trim_start_matches('\u{feff}')).unwrap_or_default();
    file.insert("name".into(), name.into());
    // They follow all other tables.
    let mut carried = file.remove("files");
    if carried.is_none()
        && let Some(mesh) =
            file.get_mut("body").and_then(|body| body.get_mut("mesh")).and_then(toml::Value::as_table_mut)
        && let Some(of_file) = mesh.get("path").and_then(toml::Value::as_str)
    {
        let beside = Path::new(path).parent().unwrap_or(Path::new("")).join(of_file);
        let whole = std::path::absolute(&beside).unwrap_or(beside);
        mesh.insert("path".into(), whole.to_string_lossy().into_owned().into());
    }
    if let (Some(table), Some(protocol)) = (table, file.get_mut("protocol").and_then(toml::Value::as_table_mut)) {
        // The new table lies beside the design.
        if let (Some(files), Some(old)) = (
            carried.as_mut().and_then(toml::Value::as_table_mut),
            protocol.get("pattern").and_then(|pattern| pattern.get("table")).and_then(toml::Value::as_str),
        ) {
            files.remove(old);
        }
        // The table says where the measures start and which way round they are.
        protocol.retain(|key, _| key == "amplitude_only");
        protocol.insert("pattern".into(), toml::Table::from_iter([("table".to_string(), table.into())]).into());
    }
    let old = file.remove("electrodes");
    let mut new = toml::Table::new();
    if let Some(shape) = old.as_ref().and_then(first_shape) {
        new.insert("shape".into(), shape);
    }
    for key in ["contact_impedance_ohm_m2", "contact_impedance_ohm_m"] {
        let mean = || {
            let sum: f64 = design.electrodes.iter().map(|one| one.contact_impedance).sum();
            toml::Value::from(sum / design.electrodes.len() as f64)
        };
        if let Some(value) = old.as_ref().and_then(|old| old.get(key)) {
            new.insert(key.into(), if value.is_array() { mean() } else { value.clone() });
        }
    }
    file.insert("electrodes".into(), new.into());
    let mut written = toml::to_string(&file).expect("a table of TOML is TOML");
    written += "\n[electrodes.layout]\npositions = [\n";
    for position in electrodes_m {
        let _ = writeln!(written, "    {},", place(design.body.surface(), *position));
    }
    written += "]\n";
    if let Some(files) = carried {
        let table = toml::Table::from_iter([("files".to_string(), files)]);
        written += &format!("\n{}", toml::to_string(&table).expect("a table of TOML is TOML"));
    }
    Ok(written)
}

/// The shape of the first electrode.
fn first_shape(electrodes: &toml::Value) -> Option<toml::Value> {
    let positions = electrodes.get("layout").and_then(|layout| layout.get("positions"));
    let own = positions.and_then(|list| list.get(0)).and_then(|first| first.get("shape"));
    own.or(electrodes.get("shape")).cloned()
}

/// A place as a design states it. Twelve digits keep the centre of an arc on the edge, and the mesh that of the place.
fn place(surface: Surface, position_m: Point3) -> String {
    let rounded = |value: f64| (1e12 * value).round() / 1e12 + 0.0;
    let [x, y, z] = position_m.map(rounded);
    match surface.theta_rad(position_m) {
        Some(theta_rad) => format!("{{ z_m = {z:?}, theta_rad = {:?} }}", rounded(theta_rad)),
        None if surface == Surface::Plane => format!("{{ x_m = {x:?}, y_m = {y:?} }}"),
        None => format!("{{ x_m = {x:?}, y_m = {y:?}, z_m = {z:?} }}"),
    }
}
