//! The text of a design file with other electrical values.

use crate::design::error::DesignError;
use crate::design::file::{At, DesignFile, ElectrodesTable, OneOrEach};
use crate::design::{ElectrodeShape, SkinDesign, resolve};
use std::ops::Range;

/// Numbers in a line of a list.
const PER_LINE: usize = 8;

/// A place in the text, and what to write there.
type Change = (Range<usize>, String);

pub(super) fn rewrite(design: &SkinDesign, text: &str, name: &str) -> Result<String, DesignError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let (file, old) = resolve::read(text, name)?;
    let counts = |design: &SkinDesign| (design.electrodes.len(), design.sheet.regions.len());
    if counts(&old) != counts(design) {
        let message = format!("{name} describes another skin: its electrodes or regions are not as many");
        return Err(DesignError::new(message, Some("give the file from which the design was made".into())));
    }
    let mut changes = sheet(design, &old, &file);
    let electrodes = &file.electrodes.value;
    let is_area = |electrode: usize| in_ohm_m2(design.electrodes[electrode].shape, electrodes);
    changes.extend(impedances(design, &old, electrodes.contact_impedance_ohm_m2.as_ref(), is_area));
    changes.extend(impedances(design, &old, electrodes.contact_impedance_ohm_m.as_ref(), |one| !is_area(one)));
    changes.sort_by_key(|(span, _)| std::cmp::Reverse(span.start));
    let mut text = text.to_string();
    changes.into_iter().for_each(|(span, new)| text.replace_range(span, &new));
    Ok(text)
}

/// The conductances of the sheet and of its regions.
fn sheet(design: &SkinDesign, old: &SkinDesign, file: &DesignFile) -> Vec<Change> {
    let change = |resistance: &Option<At<f64>>, conductivity: &Option<At<f64>>, [old, new]: [f64; 2]| {
        let resistance = resistance.as_ref().map(|at| (at.span.clone(), number(1.0 / new)));
        let change = resistance.or_else(|| conductivity.as_ref().map(|at| (at.span.clone(), number(new))));
        change.filter(|_| new != old)
    };
    let (sheet, before, after) = (&file.sheet.value, &old.sheet, &design.sheet);
    let conductance = [before.conductance, after.conductance];
    let whole = change(&sheet.sheet_resistance_ohm, &sheet.conductivity_s_per_m, conductance);
    let regions = sheet.regions.iter().zip(before.regions.iter().zip(&after.regions));
    let regions = regions.filter_map(|(At { value: file, .. }, (before, after))| {
        let conductance = [before.conductance, after.conductance];
        change(&file.sheet_resistance_ohm, &file.conductivity_s_per_m, conductance)
    });
    whole.into_iter().chain(regions).collect()
}

/// Whether an electrode's contact impedance is under the key for areas.
fn in_ohm_m2(shape: ElectrodeShape, table: &ElectrodesTable) -> bool {
    match shape {
        ElectrodeShape::Disc { .. } => true,
        ElectrodeShape::Arc { .. } | ElectrodeShape::Point => false,
        ElectrodeShape::Group => table.contact_impedance_ohm_m2.is_some(),
    }
}

/// The contact impedances under a key: one number where one is enough, else a list.
fn impedances(
    design: &SkinDesign,
    old: &SkinDesign,
    given: Option<&At<OneOrEach>>,
    belongs: impl Fn(usize) -> bool,
) -> Option<Change> {
    let given = given?;
    let own: Vec<usize> = (0..design.electrodes.len())
        .filter(|&one| belongs(one) && design.electrodes[one].shape != ElectrodeShape::Point)
        .collect();
    let impedance = |electrode: usize| design.electrodes[electrode].contact_impedance;
    let first = impedance(*own.first()?);
    if own.iter().all(|&one| impedance(one) == old.electrodes[one].contact_impedance) {
        return None;
    }
    let new = match &given.value {
        OneOrEach::One(_) if own.iter().all(|&one| impedance(one) == first) => number(first),
        before => {
            let kept = |electrode: usize| match before {
                OneOrEach::One(value) => *value,
                OneOrEach::Each(values) => values[electrode],
            };
            let value = |one: usize| if own.contains(&one) { impedance(one) } else { kept(one) };
            list(&(0..design.electrodes.len()).map(value).collect::<Vec<f64>>())
        }
    };
    Some((given.span.clone(), new))
}

fn list(values: &[f64]) -> String {
    let lines: Vec<String> = (values.chunks(PER_LINE))
        .map(|line| line.iter().map(|&value| number(value)).collect::<Vec<_>>().join(", "))
        .collect();
    if lines.len() == 1 { format!("[{}]", lines[0]) } else { format!("[\n    {},\n]", lines.join(",\n    ")) }
}

/// A number to seven digits, as TOML writes it.
fn number(value: f64) -> String {
    let rounded: f64 = format!("{value:.6e}").parse().expect("a number that was just written");
    format!("{rounded:?}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"# my skin
name = "skin"   # a name
[body.disk]
diameter_m = 0.1
[sheet]
sheet_resistance_ohm = 1e3   # ohm per square
touch = "conductance_rises"
[[sheet.regions]]
name = "patch"
sheet_resistance_ohm = 500
low_m = [-0.01, -0.01]
high_m = [0.01, 0.01]
[electrodes]
shape.arc.length_m = 0.005
contact_impedance_ohm_m = 0.01 # of arcs
layout.rim.count = 9
[protocol]
pattern = "adjacent"
"#;

    #[test]
    fn only_the_values_change() {
        let mut design = SkinDesign::parse(TEXT, "skin.toml").unwrap();
        assert_eq!(design.rewrite(TEXT, "skin.toml").unwrap(), TEXT);
        design.sheet.conductance = 1.0 / 1_234.567_89;
        design.electrodes.iter_mut().for_each(|electrode| electrode.contact_impedance = 2.5e-5);
        let text = design.rewrite(TEXT, "skin.toml").unwrap();
        let expected = TEXT.replace("= 1e3", "= 1234.568").replace("= 0.01 #", "= 2.5e-5 #");
        assert_eq!(text, expected);
        design.electrodes[4].contact_impedance = 0.02;
        let text = design.rewrite(&text, "skin.toml").unwrap();
        let list = "[\n    2.5e-5, 2.5e-5, 2.5e-5, 2.5e-5, 0.02, 2.5e-5, 2.5e-5, 2.5e-5,\n    2.5e-5,\n] # of arcs";
        assert!(text.contains(list), "{text}");
        let back = SkinDesign::parse(&text, "skin.toml").unwrap();
        assert_eq!(back.electrodes, design.electrodes);
        assert_eq!(design.rewrite(&text, "skin.toml").unwrap(), text);
        let other = TEXT.replace("count = 9", "count = 8");
        assert!(design.rewrite(&other, "o.toml").unwrap_err().to_string().contains("o.toml describes another skin"));
    }

    /// A key for each of two shapes: each holds the values of its own electrodes.
    #[test]
    fn shapes_of_both_kinds_keep_their_keys() {
        let places = "layout.positions = [{ x_m = 0.05, y_m = 0 }, { x_m = 0, y_m = 0.05 }, { x_m = -0.05, y_m = 0 }, \
             { x_m = 0, y_m = -0.05 }, { x_m = 0, y_m = 0, shape.disc.radius_m = 0.004 }]\ncontact_impedance_ohm_m2 = 1e-4";
        let text = TEXT.replace("layout.rim.count = 9", places);
        let mut design = SkinDesign::parse(&text, "skin.toml").unwrap();
        design.electrodes[4].contact_impedance = 3e-4;
        design.electrodes[1].contact_impedance = 0.03;
        let rewritten = design.rewrite(&text, "skin.toml").unwrap();
        assert!(rewritten.contains("contact_impedance_ohm_m2 = 0.0003\n"), "{rewritten}");
        assert!(
            rewritten.contains("contact_impedance_ohm_m = [0.01, 0.03, 0.01, 0.01, 0.01] # of arcs"),
            "{rewritten}"
        );
        assert_eq!(SkinDesign::parse(&rewritten, "skin.toml").unwrap().electrodes, design.electrodes);
    }
}
