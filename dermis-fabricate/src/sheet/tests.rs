use super::*;
use dermis::design::SkinDesign;
use std::f64::consts::PI;

fn fabrication(name: &str) -> Fabrication {
    Fabrication::new(&SkinDesign::shipped(name).unwrap()).unwrap()
}

fn layer<'a>(sheets: &'a [Sheet], sheet: &str, layer: &str) -> &'a [Outline] {
    let sheet = sheets.iter().find(|one| one.name == sheet).unwrap();
    &sheet.layers.iter().find(|one| one.name == layer).unwrap().outlines
}

#[test]
fn the_papers_patterns_have_their_counts_and_areas() {
    let made = fabrication("cylinder30");
    let (around, kerf) = (PI * 0.1, made.options.kerf_m);
    let sheets = patterns::sheets(&made);
    let patches = layer(&sheets, "patches", "PATCHES");
    assert_eq!(patches.len(), 30 * 31);
    let one = (0.009 + kerf) * (around / 31.0 - 0.001 + kerf);
    assert!(patches.iter().all(|patch| (patch.area_m2() / one - 1.0).abs() < 1e-12));
    let [foam] = layer(&sheets, "foam", "FOAM") else { panic!("one piece of foam") };
    assert!((foam.area_m2() / ((around + kerf) * (0.3 + kerf)) - 1.0).abs() < 1e-12);
    // Half discs on the rims, ten of them; the seam lies between electrodes.
    let pads = layer(&sheets, "coat-mask", "PADS");
    assert_eq!(pads.len(), 30);
    let circles = pads.iter().filter(|pad| matches!(pad, Outline::Circle { .. })).count();
    assert_eq!(circles, 20);
    assert_eq!(layer(&sheets, "drill-template", "DRILL").len(), 30);
}

#[test]
fn a_disk_is_covered_by_patches_cut_at_its_rim() {
    let made = fabrication("skin16");
    let options = made.options;
    let whole: f64 = made.patches.iter().map(|patch| patch.outline.area_m2()).sum();
    // Without gaps they fill the disk.
    let text = SkinDesign::shipped_text("skin16").unwrap();
    let text = text.replace("patch_gap_m = 0.001", "patch_gap_m = 0.0\nkerf_m = 0.0");
    let filled = Fabrication::new(&SkinDesign::parse(&text, "filled").unwrap()).unwrap();
    let area: f64 = filled.patches.iter().map(|patch| patch.outline.area_m2()).sum();
    assert!((area / (PI * 0.04f64.powi(2)) - 1.0).abs() < 1e-4, "{area}");
    assert!(whole < area * (1.0 - options.patch_gap_m / 0.008));
    assert!(made.patches.iter().all(|patch| patch.outline.area_m2() > 0.0));
}

/// On every sheet of the shipped designs: labels inside what they name a part of, and channels apart from one another.
#[test]
fn labels_are_inside_and_channels_do_not_overlap() {
    for name in ["cylinder30", "skin16"] {
        let made = fabrication(name);
        let sheets = patterns::sheets(&made);
        for (sheet, edge) in [("drill-template", "TEMPLATE"), ("coat-mask", "COAT")] {
            let [outline] = layer(&sheets, sheet, edge) else { panic!("one edge") };
            let parts = layer(&sheets, sheet, if edge == "COAT" { "PADS" } else { "DRILL" });
            let labels = &sheets.iter().find(|one| one.name == sheet).unwrap().labels;
            let named: Vec<_> = labels.iter().filter(|label| label.text.starts_with('E')).collect();
            assert_eq!(named.len(), made.electrodes.len(), "{name} {sheet}");
            for label in named {
                let [[x0, y0], [x1, y1]] = label.bounds_m(1.0);
                assert!(
                    [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].iter().all(|&corner| outline.contains(corner)),
                    "{label:?}"
                );
                let meets = |part: &&Outline| {
                    let [low, high] = part.bounds_m();
                    low[0] < x1 && x0 < high[0] && low[1] < y1 && y0 < high[1]
                };
                assert!(parts.iter().find(meets).is_none(), "{name} {sheet} {label:?}");
            }
        }
        let channels = layer(&sheets, "drill-template", "CHANNELS");
        let mut sides: Vec<[f64; 2]> =
            channels.iter().map(|one| [one.bounds_m()[0][0], one.bounds_m()[1][0]]).collect();
        sides.sort_by(|a, b| a[0].total_cmp(&b[0]));
        assert!(sides.len() > 3 && sides.windows(2).all(|pair| pair[0][1] <= pair[1][0]), "{name}: {sides:?}");
    }
    let notes = crate::notes(&fabrication("skin16"));
    assert!(notes.iter().any(|note| note.starts_with("the channels of E00, E01, E15 overlap")), "{notes:?}");
    assert!(!crate::notes(&fabrication("cylinder30")).iter().any(|note| note.contains("overlap")));
}
