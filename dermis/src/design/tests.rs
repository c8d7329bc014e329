//! Valid designs, and the error messages of invalid ones.

use crate::design::{Body, ElectrodeShape, FabricationOptions, ImageLayout, SkinDesign, TouchEffect};
use crate::geom::vector::distance;
use crate::protocol::{Channel, Protocol};
use std::f64::consts::TAU;

const GOOD: &str = include_str!("../../designs/cylinder30.toml");

/// The error of the shipped cylinder with one piece of text replaced.
fn broken(from: &str, to: &str) -> String {
    assert!(GOOD.contains(from), "{from} is not in the design");
    let error = SkinDesign::parse(&GOOD.replacen(from, to, 1), "skin.toml").expect_err(to);
    let line = error.line().expect("an error of a file has a line");
    assert!((1..=GOOD.lines().count() + to.lines().count()).contains(&line));
    error.to_string()
}

/// The 1-based line of a text in the shipped cylinder.
fn line_of(text: &str) -> usize {
    1 + GOOD.lines().position(|line| line.contains(text)).unwrap()
}

#[test]
fn the_papers_skin_is_as_the_conventions_state() {
    let design = SkinDesign::shipped("cylinder30").unwrap();
    assert_eq!(design.body, Body::Cylinder { length_m: 0.3, diameter_m: 0.1 });
    assert_eq!(design.sheet.conductance, 1e-3);
    assert_eq!(design.sheet.touch, TouchEffect::ConductanceRises);
    assert_eq!(design.electrodes.len(), 30);
    for (index, electrode) in design.electrodes.iter().enumerate() {
        let (ring, k) = (index / 5, index % 5);
        let theta_rad = (k as f64 + 0.5 * (ring % 2) as f64) * TAU / 5.0;
        let place = [0.05 * theta_rad.cos(), 0.05 * theta_rad.sin(), 0.06 * ring as f64];
        assert!(distance(electrode.centre_m, place) < 1e-15);
        assert_eq!(electrode.shape, ElectrodeShape::Disc { radius_m: 0.004 });
        assert_eq!(electrode.contact_impedance, 2e-5);
    }
    assert_eq!(design.electrodes[29].centre_m[2], 0.3, "the upper ring lies exactly on the rim");
    assert_eq!(design.protocol, Protocol::adjacent(30).unwrap());
    assert_eq!(design.image, ImageLayout::Grid { rows: 30, columns: 30 });
}

#[test]
fn every_shipped_design_is_read_and_names_itself() {
    for name in SkinDesign::SHIPPED {
        let design = SkinDesign::load(name).unwrap();
        assert_eq!(design.name, name);
        design.check().unwrap();
    }
}

#[test]
fn the_tanks_measures_begin_at_the_drive() {
    let protocol = SkinDesign::shipped("tank16").unwrap().protocol;
    assert_eq!(protocol.channel_count(), 208);
    let mut channels = protocol.channels().iter();
    for d in 0..16 {
        for k in 2..=14 {
            let expected = Channel { drive: [d, (d + 1) % 16], measure: [(d + k) % 16, (d + k + 1) % 16] };
            assert_eq!(channels.next(), Some(&expected));
        }
    }
}

#[test]
fn the_real_skins_protocol_is_their_channel_table() {
    let root = std::env::var("DERMIS_DATA")
        .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data").to_string());
    let path = std::path::Path::new(&root).join("skins_real/channels.csv");
    if !path.exists() {
        eprintln!("skipped: no recordings at {root}");
        return;
    }
    let protocol = SkinDesign::shipped("skin16").unwrap().protocol;
    assert!(protocol.amplitude_only());
    let table = Protocol::load(&path, 16).unwrap().with_amplitude_only(true);
    assert_eq!(protocol, table);
}

#[test]
fn a_name_that_is_nearly_shipped_is_suggested() {
    let error = SkinDesign::load("cylinder3").unwrap_err().to_string();
    assert!(error.contains("did you mean `cylinder30`?"), "{error}");
    let error = SkinDesign::load("no/such/file.toml").unwrap_err().to_string();
    assert!(error.contains("cylinder30, skin16, tank16"), "{error}");
}

#[test]
fn a_byte_order_mark_and_carriage_returns_do_no_harm() {
    let text = format!("\u{feff}{}", GOOD.replace('\n', "\r\n"));
    assert_eq!(SkinDesign::parse(&text, "skin.toml").unwrap().electrodes.len(), 30);
}

#[test]
fn keys_are_checked_and_suggested() {
    let line = line_of("length_m");
    let error = broken("length_m = 0.300", "lenght_m = 0.300");
    assert!(error.starts_with(&format!("skin.toml:{line}: unknown field `lenght_m`")), "{error}");
    assert!(error.contains("did you mean `length_m`?"), "{error}");
    let error = broken("length_m = 0.300", "length_mm = 300");
    assert!(error.contains("did you mean `length_m`? The unit is part of the name"), "{error}");
    let error = broken("diameter_m = 0.100\n", "\n");
    assert!(error.contains("missing field `diameter_m`"), "{error}");
    let error = broken("pattern = \"adjacent\"", "pattern = \"adjacend\"");
    assert!(error.contains("did you mean `adjacent`?"), "{error}");
    let error = broken("[body.cylinder]", "[body.cylindre]");
    assert!(error.contains("did you mean `cylinder`?"), "{error}");
}

#[test]
fn types_and_units_are_checked_with_their_line() {
    let line = line_of("length_m");
    let error = broken("length_m = 0.300", "length_m = \"300 mm\"");
    assert!(error.starts_with(&format!("skin.toml:{line}: invalid type: string \"300 mm\"")), "{error}");
    let error = broken("length_m = 0.300", "length_m = 300");
    assert!(error.contains("length_m is 300 m") && error.contains("for 300 mm write 0.3"), "{error}");
    let error = broken("diameter_m = 0.100", "diameter_m = -0.1");
    assert!(error.contains("diameter_m is -0.1: it must be positive"), "{error}");
    let error = broken("sheet_resistance_ohm = 1000.0", "sheet_resistance_ohm = nan");
    assert!(error.starts_with(&format!("skin.toml:{}: sheet_resistance_ohm", line_of("sheet_res"))), "{error}");
    let error = broken("rings = 6", "rings = 6.5");
    assert!(error.contains("invalid type: floating point `6.5`"), "{error}");
    assert!(broken("[sheet]", "[sheet").starts_with("skin.toml:"));
}

#[test]
fn electrodes_that_leave_the_body_or_overlap_are_named() {
    let error = broken("spacing_m = 0.060", "spacing_m = 0.061");
    assert!(error.contains("electrode 25 leaves the body: its centre is at z_m = 0.305"), "{error}");
    let error = broken("shape.disc.radius_m = 0.004", "shape.disc.radius_m = 0.032");
    assert!(error.contains("electrodes 0 and 1 overlap: their centres are 62.832 mm apart"), "{error}");
    let error = broken("shape.disc.radius_m = 0.004", "shape.disc.radius_m = 4.0");
    assert!(error.contains("electrode 0 is larger than the body: 8000 mm across"), "{error}");
    let error = broken("shape.disc.radius_m = 0.004", "shape.disc.radius_m = 0.0");
    assert!(error.contains("electrode 0 has radius_m = 0: it must be positive"), "{error}");
    let error = broken("shape.disc.radius_m = 0.004", "shape.arc.length_m = 0.004");
    assert!(error.contains("electrode 0 needs `contact_impedance_ohm_m`"), "{error}");
}

#[test]
fn counts_are_limited_on_both_sides() {
    assert!(broken("rings = 6\nper_ring = 5", "rings = 1\nper_ring = 3").contains("3 electrodes are too few"));
    let error = broken("per_ring = 5", "per_ring = 1000000000000");
    assert!(error.contains("are too many"), "{error}");
    assert!(broken("rows = 30", "rows = 0").contains("0 x 30 pixels"));
    assert!(broken("rows = 30", "rows = 900000000").contains("pixels"));
    assert!(broken("max_edge_m = 0.006", "max_edge_m = 6e-7").contains("longer than max_edge_m"));
    assert!(broken("electrode_edge_m = 0.0016", "electrode_edge_m = 2e-6").contains("cells"));
}

#[test]
fn contact_impedances_are_one_or_one_each() {
    let line = format!("contact_impedance_ohm_m2 = [{}]", vec!["1e-5"; 30].join(", "));
    let text = GOOD.replace("contact_impedance_ohm_m2 = 2e-5", &line);
    assert_eq!(SkinDesign::parse(&text, "skin.toml").unwrap().electrodes[29].contact_impedance, 1e-5);
    let error = broken("contact_impedance_ohm_m2 = 2e-5", "contact_impedance_ohm_m2 = [1e-5, 2e-5]");
    assert!(error.contains("has 2 values for 30 electrodes"), "{error}");
    let error = broken("contact_impedance_ohm_m2 = 2e-5", "contact_impedance_ohm_m2 = 0.0");
    assert!(error.contains("contact impedance of electrode 0 is 0"), "{error}");
    let error = broken("contact_impedance_ohm_m2 = 2e-5", "contact_impedance_ohm_m2 = \"2e-5\"");
    assert!(error.contains("expected a number, or a list"), "{error}");
}

#[test]
fn protocols_must_fit_the_electrodes() {
    let error = broken("pattern = \"adjacent\"", "pattern.skip = 29");
    assert!(error.contains("skip 29 pairs every electrode with itself"), "{error}");
    let error = broken("pattern = \"adjacent\"", "pattern.table = \"no_such_table.csv\"");
    assert!(error.contains("no_such_table.csv") && error.contains("cannot read"), "{error}");
}

const FLAT: &str = r#"
image = "cells"
[body.rectangle]
width_m = 0.2
height_m = 0.1
[sheet]
sheet_resistance_ohm = 500
touch = "conductance_falls"
[[sheet.regions]]
name = "stripe"
sheet_resistance_ohm = 2000
low_m = [0.05, 0.0]
high_m = [0.1, 0.1]
[electrodes]
shape = "point"
contact_impedance_ohm_m2 = 1e-5
[electrodes.layout]
positions = [
  { x_m = 0.0, y_m = 0.0 },
  { x_m = 0.2, y_m = 0.0 },
  { x_m = 0.2, y_m = 0.1 },
  { x_m = 0.1, y_m = 0.05, shape.disc.radius_m = 0.01 },
]
[protocol]
pattern = "adjacent"
"#;

#[test]
fn a_rectangle_with_a_list_of_electrodes_and_a_region() {
    let design = SkinDesign::parse(FLAT, "designs/flat.toml").unwrap();
    assert_eq!(design.name, "flat");
    assert_eq!(design.electrodes[3].centre_m, [0.1, 0.05, 0.0]);
    assert_eq!(design.electrodes[3].shape, ElectrodeShape::Disc { radius_m: 0.01 });
    assert_eq!(design.electrodes[0].shape, ElectrodeShape::Point);
    assert_eq!(design.sheet.regions[0].conductance, 1.0 / 2000.0);
    assert_eq!(design.image, ImageLayout::Cells);
    let error =
        |from: &str, to: &str| SkinDesign::parse(&FLAT.replace(from, to), "designs/flat.toml").unwrap_err().to_string();
    let off = error("x_m = 0.2, y_m = 0.1", "x_m = 0.3, y_m = 0.1");
    assert!(off.starts_with("designs/flat.toml:21: electrode 2 leaves the body"), "{off}");
    let partial = error("{ x_m = 0.2, y_m = 0.1 }", "{ x_m = 0.2 }");
    assert!(partial.contains("electrode 2: a place on a rectangle is `x_m` and `y_m`"), "{partial}");
    let coincide = error("x_m = 0.2, y_m = 0.0", "x_m = 0.0, y_m = 0.0");
    assert!(coincide.contains("electrodes 0 and 1 overlap"), "{coincide}");
    assert!(error("high_m = [0.1, 0.1]", "high_m = [0.1, -0.1]").contains("region `stripe`"));
    assert!(error("high_m = [0.1, 0.1]", "").contains("only one corner"));
    assert!(error("sheet_resistance_ohm = 2000", "conductivity_s_per_m = 1").contains("different quantities"));
}

/// The centres of a flat skin's electrodes, in mm rounded to a thousandth, or the error.
fn centres(body: &str, layout: &str) -> Result<Vec<[f64; 2]>, String> {
    let text = format!(
        "{body}\n[sheet]\nsheet_resistance_ohm = 500\ntouch = \"conductance_falls\"\n[electrodes]\nshape.arc.length_m = 0.004\n\
         contact_impedance_ohm_m = 0.01\n[electrodes.layout.rim]\n{layout}\n[protocol]\npattern = \"adjacent\"\n"
    );
    let design = SkinDesign::parse(&text, "flat.toml").map_err(|error| error.to_string())?;
    let rounded = |value: f64| (value * 1e6).round() / 1e3 + 0.0;
    Ok(design
        .electrodes
        .iter()
        .map(|electrode| [rounded(electrode.centre_m[0]), rounded(electrode.centre_m[1])])
        .collect())
}

#[test]
fn electrodes_on_the_rim_of_a_rectangle_are_where_a_drawing_has_them() {
    let sheet = "[body.rectangle]\nwidth_m = 0.06\nheight_m = 0.04";
    // Perimeter 200 mm, ten electrodes 20 mm apart, counter-clockwise from the origin.
    let ten = [
        [10.0, 0.0],
        [30.0, 0.0],
        [50.0, 0.0],
        [60.0, 10.0],
        [60.0, 30.0],
        [50.0, 40.0],
        [30.0, 40.0],
        [10.0, 40.0],
        [0.0, 30.0],
        [0.0, 10.0],
    ];
    assert_eq!(centres(sheet, "count = 10").unwrap(), ten);
    let clockwise: Vec<[f64; 2]> = ten.into_iter().rev().collect();
    assert_eq!(centres(sheet, "count = 10\ndirection = \"clockwise\"").unwrap(), clockwise);
    // From the upper right corner: first along the top, then down the left side.
    let turned: Vec<[f64; 2]> = ten.into_iter().cycle().skip(5).take(10).collect();
    assert_eq!(centres(sheet, "count = 10\nfirst_corner = \"upper_right\"").unwrap(), turned);
    let per_side =
        [[60.0, 30.0], [60.0, 10.0], [45.0, 0.0], [15.0, 0.0], [0.0, 10.0], [0.0, 30.0], [15.0, 40.0], [45.0, 40.0]];
    let down = "per_side = 2\nfirst_corner = \"upper_right\"\ndirection = \"clockwise\"";
    assert_eq!(centres(sheet, down).unwrap(), per_side);
    assert!(centres(sheet, "count = 10\nper_side = 2").unwrap_err().contains("either `count` or `per_side`"));
    assert!(centres(sheet, "").unwrap_err().contains("either `count` or `per_side`"));
    assert!(centres(sheet, "count = 8\nfirst_theta_rad = 1").unwrap_err().contains("write `first_corner = ...`"));
    assert!(centres(sheet, "per_side = 100000000000000000").unwrap_err().contains("too many"));
    assert!(centres(sheet, "count = 8\nfirst_corner = \"top\"").unwrap_err().contains("unknown variant `top`"));
}

#[test]
fn electrodes_on_the_rim_of_a_disk_run_either_way_from_a_given_angle() {
    let disk = "[body.disk]\ndiameter_m = 0.08";
    // Positions as on a clock: 12, 3, 6, 9.
    let clock = "count = 4\nfirst_theta_rad = 1.5707963267948966\ndirection = \"clockwise\"";
    assert_eq!(centres(disk, clock).unwrap(), [[0.0, 40.0], [40.0, 0.0], [0.0, -40.0], [-40.0, 0.0]]);
    assert_eq!(centres(disk, "count = 4").unwrap(), [[40.0, 0.0], [0.0, 40.0], [-40.0, 0.0], [0.0, -40.0]]);
    assert!(centres(disk, "per_side = 4").unwrap_err().contains("a disk have no `per_side`"));
    assert!(centres(disk, "count = 4\nfirst_corner = \"lower_left\"").unwrap_err().contains("write `first_theta_rad"));
    assert!(centres(disk, "first_theta_rad = 1").unwrap_err().contains("a rim needs `count`"));
    let cylinder = "[body.cylinder]\nlength_m = 0.3\ndiameter_m = 0.1";
    assert!(centres(cylinder, "count = 8").unwrap_err().contains("need a disk or a rectangle, not a cylinder"));
}

#[test]
fn the_schema_knows_the_tables() {
    let schema = SkinDesign::json_schema();
    let properties = schema["properties"].as_object().unwrap();
    for table in ["name", "body", "sheet", "electrodes", "protocol", "image", "mesh", "fabrication"] {
        assert!(properties.contains_key(table), "{table}");
    }
    assert!(schema.to_string().contains("length_m"));
}

#[test]
fn what_no_workshop_can_make_is_named_with_its_line() {
    let line = line_of("wall_m");
    let error = broken("wall_m = 0.005", "wall_m = 0.0025");
    assert!(
        error.starts_with(&format!("skin.toml:{line}: the wall (2.5 mm) is thinner than a bore (3 mm)")),
        "{error}"
    );
    let error = broken("wall_m = 0.005", "wall_m = 5");
    assert!(error.contains("wall_m is 5 m") && error.contains("lengths are in metres"), "{error}");
    let error = broken("wall_m = 0.005", "wall_m = 0.0495");
    assert!(error.contains("a wall of 49.5 mm fills a cylinder of 100 mm diameter"), "{error}");
    // 62.8 mm apart on the surface, and 25.1 mm at the inner face of a wall of 30 mm: chords of 58.8 and 23.5 mm.
    let error = broken("wall_m = 0.005\nbore_m = 0.003", "wall_m = 0.030\nbore_m = 0.024");
    assert!(error.contains("meet: they overlap by 0.489 mm"), "{error}");
    let error = broken("channel_depth_m = 0.002", "channel_depth_m = 0.0045");
    assert!(error.contains("leave 0.5 mm of the wall"), "{error}");
    let error = broken("kerf_m = 0.0002", "kerf_m = 0.0002\nflange_m = 0.002");
    assert!(error.contains("too short for bores on the edge, which need 2.5 mm"), "{error}");
    assert!(broken("patch_gap_m = 0.001", "patch_gap_m = 0.01").contains("nothing is left of patches 10 mm apart"));
    assert!(broken("patch_pitch_m = 0.010", "patch_pitch_m = 0.31").contains("do not fit on a body of 300 mm"));
    assert!(broken("kerf_m = 0.0002", "kerf_m = 0.002").contains("wider than the gaps of 1 mm"));
    assert!(broken("kerf_m = 0.0002", "kerf_mm = 0.2").contains("did you mean `kerf_m`?"));
}

#[test]
fn bores_on_a_rim_move_inward_unless_there_is_a_flange() {
    let mut design = SkinDesign::shipped("cylinder30").unwrap();
    let heights = |design: &SkinDesign| -> Vec<f64> {
        let bores = design.bores().unwrap();
        [0, 5, 29].map(|electrode: usize| bores[electrode].0[2]).to_vec()
    };
    assert_eq!(heights(&design), [0.0025, 0.06, 0.3 - 0.0025]);
    let options = FabricationOptions { flange_m: 0.01, ..design.fabrication_options() };
    design.fabrication = Some(options);
    assert_eq!(heights(&design), [0.0, 0.06, 0.3]);
}

proptest::proptest! {
    /// Any file content gives a design or an error, never a panic.
    #[test]
    fn no_text_panics(at in 0..GOOD.len(), length in 0_usize..40, junk in "[-a-z0-9_=\\[\\]{}\".,#\n ]{0,12}") {
        let end = (at + length).min(GOOD.len());
        let text = format!("{}{junk}{}", &GOOD[..at], &GOOD[end..]);
        if let Err(error) = SkinDesign::parse(&text, "skin.toml") {
            let _ = error.to_string();
        }
    }
}

#[test]
fn the_hash_depends_on_the_skin_but_not_on_its_material() {
    let design = SkinDesign::shipped("cylinder30").unwrap();
    let mut other = design.clone();
    other.sheet.conductance *= 2.0;
    other.mesh = other.mesh.scaled(0.5);
    assert_eq!(design.sha256(), other.sha256());
    other.electrodes.swap(3, 4);
    assert_ne!(design.sha256(), other.sha256());
    assert_ne!(design.sha256(), SkinDesign::shipped("skin16").unwrap().sha256());
}
