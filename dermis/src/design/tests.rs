//! Valid designs, and the error messages of invalid ones.

use crate::design::resolve::parse_for_fabrication;
use crate::design::{Body, ElectrodeShape, FabricationOptions, ImageLayout, SkinDesign, TouchEffect};
use crate::geom::vector::distance;
use crate::protocol::{Channel, Driven, Protocol};
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
    let line = line_of("shape.disc.radius_m");
    let expected = format!("skin.toml:{line}: electrode 0 has radius_m = 0: it must be positive");
    assert!(error.starts_with(&expected), "{error}");
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
    let long = error("low_m = [0.05, 0.0]", "low_m = [0.05, 0.0, 0.0]");
    assert!(long.starts_with("designs/flat.toml:") && long.contains("the list has 3 values, not 2"), "{long}");
    let numbered = error("pattern = \"adjacent\"", "pattern.channels = [[0, 0, 1, 2, 3], [1, 1, 2, 3, 0]]");
    assert!(numbered.contains("the list has 5 values, not 4"), "{numbered}");
}

#[test]
fn angles_are_at_most_a_turn() {
    let [disk, tube] = ["[body.disk]\ndiameter_m = 0.1", "[body.cylinder]\nlength_m = 0.3\ndiameter_m = 0.1"];
    let error = |body: &str, layout: &str| {
        let text = format!(
            "{body}\n[sheet]\nsheet_resistance_ohm = 500\ntouch = \"conductance_falls\"\n[electrodes]\nshape = \"point\"\n\
             contact_impedance_ohm_m2 = 1e-5\n{layout}\n[protocol]\npattern = \"adjacent\"\n"
        );
        SkinDesign::parse(&text, "angles.toml").err().map(|error| error.to_string()).unwrap_or_default()
    };
    let rings = "layout.rings = { rings = 3, per_ring = 4, spacing_m = 0.1, ";
    for (body, layout, word) in [
        (disk, "layout.rim = { count = 8, first_theta_rad = 90.0 }".to_string(), "write 1.5708"),
        (disk, "layout.rim = { count = 8, first_theta_rad = nan }".to_string(), "first_theta_rad"),
        (tube, format!("{rings}first_theta_rad = 30.0 }}"), "write 0.5236"),
        (tube, format!("{rings}stagger = 18.0 }}"), "between -1 and 1"),
        (disk, "layout.positions = [{ theta_rad = 0.0 }, { theta_rad = 22.5 }, { theta_rad = 45.0 }, { theta_rad = 90.0 }]".into(), "electrode 1"),
    ] {
        let error = error(body, &layout);
        assert!(error.contains(word) && error.starts_with("angles.toml:"), "{layout}: {error}");
    }
    assert_eq!(error(disk, "layout.rim = { count = 8, first_theta_rad = -6.2831853 }"), "");
}

/// The centres of a flat skin's electrodes, in mm rounded to a thousandth, or the error.
fn centres(body: &str, layout: &str) -> Result<Vec<[f64; 2]>, String> {
    // A polygon has no arcs.
    let shape = if body.contains("polygon") { "shape = \"point\"" } else { "shape.arc.length_m = 0.004" };
    let text = format!(
        "{body}\n[sheet]\nsheet_resistance_ohm = 500\ntouch = \"conductance_falls\"\n[electrodes]\n{shape}\n\
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
    assert!(
        centres(cylinder, "count = 8").unwrap_err().contains("need a disk, a rectangle or a polygon, not a cylinder")
    );
}

/// The centres, mm, of electrodes of a shape at positions, each with its number and its own keys.
fn placed(body: &str, shape: &str, positions: &[&str]) -> Result<Vec<[f64; 2]>, String> {
    let positions: Vec<String> = positions.iter().map(|keys| format!("{{ {keys} }}")).collect();
    let impedances = "contact_impedance_ohm_m = 0.01\ncontact_impedance_ohm_m2 = 1e-5";
    let text = format!(
        "{body}\n[sheet]\nsheet_resistance_ohm = 1000\ntouch = \"conductance_rises\"\n[electrodes]\nshape.{shape}\n\
         {impedances}\n[electrodes.layout]\npositions = [{}]\n[protocol]\npattern = \"adjacent\"",
        positions.join(", ")
    );
    let design = SkinDesign::parse(&text, "test.toml").map_err(|error| error.to_string())?;
    Ok(design.electrodes.iter().map(|one| [0, 1].map(|axis| 1000.0 * one.centre_m[axis])).collect())
}

#[test]
fn rounded_positions_on_an_edge_are_moved_to_it() {
    let disk = "[body.disk]\ndiameter_m = 0.08";
    let (arc, disc) = ("arc.length_m = 0.005", "disc.radius_m = 0.002");
    // 45 degrees on a radius of 40 mm is 28.284271 mm; rounded to 0.01 mm it is inside.
    let near =
        ["x_m = 0.02828, y_m = 0.02828", "x_m = -0.0404, y_m = 0", "x_m = 0, y_m = -0.04", "x_m = 0.0396, y_m = 0"];
    let found = placed(disk, arc, &near).unwrap();
    assert!(found.iter().all(|[x, y]| (x.hypot(*y) - 40.0).abs() < 1e-9), "{found:?}");
    assert!((found[0][0] - found[0][1]).abs() < 1e-9 && found[2] == [0.0, -40.0]);
    // A disc may lie inside, but not beyond the edge.
    let discs = ["x_m = 0.0401, y_m = 0", "x_m = 0.0399, y_m = -0.01", "x_m = 0, y_m = 0", "x_m = -0.03, y_m = 0"];
    let found = placed(disk, disc, &[discs[0], "x_m = 0.0398, y_m = -0.001", discs[2], discs[3]]);
    assert!(found.unwrap_err().contains("overlap"));
    let found = placed(disk, disc, &[discs[0], "x_m = 0, y_m = 0.0399", discs[2], discs[3]]).unwrap();
    assert_eq!(found[..2], [[40.0, 0.0], [0.0, 39.9]]);
    let far = |shape: &str, keys: &str| placed(disk, shape, &[near[0], near[1], near[2], keys]).unwrap_err();
    let error = far(arc, "x_m = 0.039, y_m = 0");
    assert!(error.contains("electrode 3 is an arc, but its centre is 1 mm from the edge"), "{error}");
    assert!(error.contains("move its centre there, or make the electrode a disc"), "{error}");
    assert!(far(arc, "x_m = 0.041, y_m = 0").contains("electrode 3 leaves the body"));
    assert!(far(disc, "x_m = 0.041, y_m = 0").contains("leaves the body"));
    let rectangle = "[body.rectangle]\nwidth_m = 0.1\nheight_m = 0.06";
    let sides =
        ["x_m = 0.02, y_m = 0.0001", "x_m = 0.1003, y_m = 0.03", "x_m = 0.05, y_m = 0.0602", "x_m = 0, y_m = 0.02"];
    let found = placed(rectangle, arc, &sides).unwrap();
    for ([x, y], expected) in found.iter().zip([[20.0, 0.0], [100.0, 30.0], [50.0, 60.0], [0.0, 20.0]]) {
        assert!((x - expected[0]).hypot(y - expected[1]) < 1e-9, "{x}, {y}");
    }
}

#[test]
fn positions_on_an_edge_are_given_by_angle_or_distance() {
    let (disk, arc) = ("[body.disk]\ndiameter_m = 0.08", "arc.length_m = 0.005");
    let angles = ["theta_rad = 0", "theta_rad = 1", "along_edge_m = 0.08", "theta_rad = -1"];
    let found = placed(disk, arc, &angles).unwrap();
    for (place, theta_rad) in found.iter().zip([0.0_f64, 1.0, 2.0, -1.0]) {
        assert!(distance([place[0], place[1], 0.0], [40.0 * theta_rad.cos(), 40.0 * theta_rad.sin(), 0.0]) < 1e-9);
    }
    let rectangle = "[body.rectangle]\nwidth_m = 0.1\nheight_m = 0.06";
    let along = ["along_edge_m = 0.01", "along_edge_m = 0.11", "along_edge_m = 0.2", "along_edge_m = 0.29"];
    let found = placed(rectangle, arc, &along).unwrap();
    for (place, expected) in found.iter().zip([[10.0, 0.0], [100.0, 10.0], [60.0, 60.0], [0.0, 30.0]]) {
        assert!((place[0] - expected[0]).hypot(place[1] - expected[1]) < 1e-9, "{place:?}");
    }
    let wrong = |body: &str, keys: &str| placed(body, arc, &[keys, along[1], along[2], along[0]]).unwrap_err();
    assert!(
        wrong(rectangle, "along_edge_m = 0.33")
            .contains("electrode 0: along_edge_m is 0.33: it must be between 0 and 0.32")
    );
    assert!(wrong(rectangle, "theta_rad = 1").contains("`x_m` and `y_m`, or on the edge `along_edge_m`"));
    assert!(wrong(disk, "theta_rad = 1, x_m = 0").contains("or on the edge `theta_rad` or `along_edge_m`"));
}

#[test]
fn a_polygon_has_electrodes_on_its_edge_and_inside() {
    // An L whose edge is 0.8 m long, from its first corner to the right.
    let polygon = "[body.polygon]\ncorners_m = [[0, 0], [0, 0.2], [0.1, 0.2], [0.1, 0.1], [0.2, 0.1], [0.2, 0]]";
    let disc = "disc.radius_m = 0.004";
    let places = ["along_edge_m = 0.05", "along_edge_m = 0.35", "along_edge_m = 0.7", "x_m = 0.05, y_m = 0.05"];
    let found = placed(polygon, disc, &places).unwrap();
    for (place, expected) in found.iter().zip([[50.0, 0.0], [150.0, 100.0], [0.0, 100.0], [50.0, 50.0]]) {
        assert!((place[0] - expected[0]).hypot(place[1] - expected[1]) < 1e-9, "{place:?}");
    }
    let wrong = |body: &str, shape: &str, keys: &str| {
        placed(body, shape, &[keys, places[1], places[2], places[3]]).unwrap_err()
    };
    let error = wrong(polygon, disc, "along_edge_m = 0.81");
    assert!(error.contains("electrode 0: along_edge_m is 0.81: it must be between 0 and 0.8"), "{error}");
    assert!(wrong(polygon, disc, "theta_rad = 0").contains("a place on a polygon is `x_m` and `y_m`, or on the edge"));
    assert!(wrong(polygon, "arc.length_m = 0.01", places[0]).contains("a mesh file or a polygon cannot hold"));
    let error = wrong(&polygon.replace("[0, 0.2], [0.1, 0.2]", "[0.1, 0.2], [0, 0.2]"), disc, places[0]);
    assert!(error.contains("test.toml:2: corners_m: the side between corners"), "{error}");
    let rim = |keys: &str| centres(polygon, keys);
    assert_eq!(rim("per_side = 1").unwrap().len(), 6);
    let [first, .., last] = rim("count = 8").unwrap()[..] else { panic!("8 electrodes") };
    assert!((first[0] - 50.0).abs() < 1e-9 && first[1] == 0.0 && last[0] == 0.0 && (last[1] - 50.0).abs() < 1e-9);
    assert!(rim("count = 8\nfirst_corner = \"lower_left\"").unwrap_err().contains("they begin at its first corner"));
}

/// The protocol of the tank with other keys of its pattern.
fn patterned(keys: &str) -> Result<Protocol, String> {
    let text = SkinDesign::shipped_text("tank16").unwrap();
    let (before, after) = text.split_once("[protocol]").unwrap();
    let rest = after.split_once("\n[").map_or("", |(_, rest)| rest);
    let text = format!("{before}[protocol]\n{keys}\n[{rest}");
    SkinDesign::parse(&text, "tank.toml").map(|design| design.protocol).map_err(|error| error.to_string())
}

#[test]
fn drives_and_measures_have_the_distances_of_the_design() {
    let protocol = patterned("pattern.distances = { drive = 5, measure = 3 }").unwrap();
    assert_eq!(protocol, Protocol::distances(16, [5, 3], Driven::LeftOut).unwrap());
    let protocol = patterned("pattern.distances = { drive = 1, with_driven = true }").unwrap();
    assert_eq!(protocol, Protocol::adjacent(16).unwrap());
    let error = patterned("pattern.distances = { drive = 32 }").unwrap_err();
    assert!(error.contains("tank.toml:") && error.contains("distance 32 pairs every electrode with itself"), "{error}");
    assert!(
        patterned("pattern.distances = { drive = 5, measures = 1 }").unwrap_err().contains("did you mean `measure`?")
    );
}

#[test]
fn channels_are_listed_in_the_design_and_may_count_from_one() {
    let expected = [Channel { drive: [0, 15], measure: [1, 2] }, Channel { drive: [3, 4], measure: [5, 6] }];
    let zero = patterned("pattern.channels = [[0, 15, 1, 2], [3, 4, 5, 6]]").unwrap();
    let one = patterned("first_electrode = 1\npattern.channels = [[1, 16, 2, 3], [4, 5, 6, 7]]").unwrap();
    assert!(zero.channels() == expected && one == zero);
    let error = patterned("pattern.channels = [[4, 5, 6, 7], [1, 16, 2, 3]]").unwrap_err();
    assert!(error.contains("channel 1 of `channels`, its row 2, names electrode 16"), "{error}");
    assert!(error.contains("write `first_electrode = 1` in [protocol]"), "{error}");
    assert!(patterned("pattern.channels = [[0, 0, 1, 2]]").unwrap_err().contains("drives electrode 0 against itself"));
    assert!(patterned("pattern.channels = [[0, 1, 2]]").is_err());
    let error = patterned("first_electrode = 1\npattern = \"adjacent\"").unwrap_err();
    assert!(error.contains("`first_electrode` belongs to a pattern with a `table` or `channels`"), "{error}");
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
    // Only fabrication refuses it.
    let unmakeable = |from: &str, to: &str| {
        let text = GOOD.replacen(from, to, 1);
        assert!(SkinDesign::parse(&text, "skin.toml").unwrap().check_fabrication().is_err(), "{to}");
        parse_for_fabrication(&text, "skin.toml").unwrap_err().to_string()
    };
    let line = line_of("wall_m");
    let error = unmakeable("wall_m = 0.005", "wall_m = 0.0025");
    assert!(
        error.starts_with(&format!("skin.toml:{line}: the wall (2.5 mm) is thinner than a bore (3 mm)")),
        "{error}"
    );
    let error = unmakeable("wall_m = 0.005", "wall_m = 5");
    assert!(error.contains("wall_m is 5 m") && error.contains("lengths are in metres"), "{error}");
    let error = unmakeable("wall_m = 0.005", "wall_m = 0.0495");
    assert!(error.contains("a wall of 49.5 mm fills a cylinder of 100 mm diameter"), "{error}");
    // 62.8 mm apart on the surface, and 25.1 mm at the inner face of a wall of 30 mm: chords of 58.8 and 23.5 mm.
    let error = unmakeable("wall_m = 0.005\nbore_m = 0.003", "wall_m = 0.030\nbore_m = 0.024");
    assert!(error.contains("meet: they overlap by 0.489 mm"), "{error}");
    let error = unmakeable("channel_depth_m = 0.002", "channel_depth_m = 0.0045");
    assert!(error.contains("leave 0.5 mm of the wall"), "{error}");
    let error = unmakeable("kerf_m = 0.0002", "kerf_m = 0.0002\nflange_m = 0.002");
    assert!(error.contains("too short for bores on the edge, which need 2.5 mm"), "{error}");
    assert!(unmakeable("patch_gap_m = 0.001", "patch_gap_m = 0.01").contains("nothing is left of patches 10 mm apart"));
    assert!(unmakeable("patch_pitch_m = 0.010", "patch_pitch_m = 0.31").contains("do not fit on a body of 300 mm"));
    assert!(unmakeable("kerf_m = 0.0002", "kerf_m = 0.002").contains("wider than the gaps of 1 mm"));
    assert!(broken("kerf_m = 0.0002", "kerf_mm = 0.2").contains("did you mean `kerf_m`?"));
    let error = broken("kerf_m = 0.0002", "kerf_m = 0.0002\nmultiplexers = 9999");
    assert!(error.contains("9999 multiplexers on a line"), "{error}");
    let mut flat = SkinDesign::shipped("skin16").unwrap();
    flat.fabrication = Some(FabricationOptions { overlap_m: 0.005, ..flat.fabrication_options() });
    let error = flat.check_fabrication().unwrap_err().to_string();
    assert!(error.contains("`overlap_m` is 0.005, but the patterns of this body have no seam"), "{error}");
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
