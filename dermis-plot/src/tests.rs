use super::*;
use crate::colour::Scale;
use crate::scene::Tile;
use dermis::contact::Contact;
use dermis::design::Body;
use dermis::geom::vector::{dot, triangle_area};
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::mesh::import;
use std::f64::consts::PI;
use std::path::Path;

fn skin(name: &str) -> (SkinDesign, Mesh) {
    let design = SkinDesign::shipped(name).unwrap();
    let mesh = Mesh::generate(&design).unwrap();
    (design, mesh)
}

fn area(tile: &Tile) -> f64 {
    tile.corners[1..].windows(2).map(|pair| triangle_area([tile.corners[0], pair[0], pair[1]])).sum()
}

fn field(drawing: &Drawing<'_>, space: &PixelSpace) -> Scene {
    let values: Vec<f64> = (0..space.len()).map(|pixel| pixel as f64).collect();
    drawing.field(space, &values, Key { scale: Scale::sequential(values.iter().copied()), label: "value".into() })
}

#[test]
fn the_pixels_of_a_picture_cover_the_body_once() {
    for (name, exact) in [("tank16", PI * 0.1 * 0.1), ("cylinder30", PI * 0.1 * 0.3)] {
        let (design, mesh) = skin(name);
        let space = PixelSpace::for_design(&design, &mesh).unwrap();
        let covered: f64 = field(&Drawing::new(&design, &mesh), &space).tiles.iter().map(area).sum();
        // A polygon of 72 or 180 corners lacks at most (pi / 72)^2 2/3 of the area of a round body.
        assert!((covered / exact - 1.0).abs() < 2e-3, "{name}: {covered} of {exact}");
    }
}

#[test]
fn a_pixel_is_drawn_where_its_centre_is() {
    for name in ["tank16", "cylinder30"] {
        let (design, mesh) = skin(name);
        let space = PixelSpace::for_design(&design, &mesh).unwrap();
        let drawing = Drawing::new(&design, &mesh);
        let mut values = vec![0.0; space.len()];
        let marked = space.len() / 3;
        values[marked] = 1.0;
        let key = Key { scale: Scale::sequential([0.0, 1.0]), label: String::new() };
        let bright = key.scale.colour(1.0);
        let scene = drawing.field(&space, &values, key);
        let tiles: Vec<&Tile> = scene.tiles.iter().filter(|tile| tile.fill == bright).collect();
        let corners: Vec<_> = tiles.iter().flat_map(|tile| tile.corners.clone()).collect();
        let middle = dermis::geom::vector::centroid(&corners);
        let off = dermis::geom::vector::distance(middle, space.centres_m[marked]);
        assert!(off < 1e-3, "{name}: the pixel is drawn {off} m off");
    }
}

#[test]
fn every_electrode_has_its_number_and_the_seam_shows_both_sides() {
    let (design, mesh) = skin("cylinder30");
    let scene = Drawing::new(&design, &mesh).electrodes();
    assert_eq!(scene.labels.len(), 30);
    let svg = View::Unrolled.draw(&scene, &design).unwrap().to_svg();
    for number in 0..30 {
        assert!(svg.contains(&format!(">{number}</text>")), "electrode {number}");
    }
    for label in ["z (mm)", "arc length s = r \u{3b8} (mm)", "\u{3b8} (degrees)"] {
        assert!(svg.contains(label), "{label}");
    }
    let solid = View::Solid.draw(&scene, &design).unwrap().to_svg();
    assert!(solid.contains("50 mm") && solid.contains("seen from \u{3b8} = "));
}

#[test]
fn every_electrode_and_contact_is_seen_in_space_and_data_have_the_colours_of_the_key() {
    let (design, mesh) = skin("cylinder30");
    let space = PixelSpace::for_design(&design, &mesh).unwrap();
    let surface = design.body.surface();
    let drawing = Drawing::new(&design, &mesh);
    let values = vec![0.5; space.len()];
    let key = Key { scale: Scale::sequential([0.0, 1.0]), label: String::new() };
    let [r, g, b] = key.scale.colour(0.5);
    let mut scene = drawing.field(&space, &values, key);
    let contacts = [(0.075, 0.05), (0.215, 1.1), (0.105, 2.6), (0.225, 4.5)].map(|(z_m, theta_rad)| {
        let place = surface.at(z_m, theta_rad).unwrap();
        Contact::truth(place, surface.normal(place).unwrap(), 1.0)
    });
    drawing.add_contacts(&mut scene, &contacts);
    let cameras = Camera::for_scene(&scene);
    assert!((2..=3).contains(&cameras.len()), "{cameras:?}");
    let svg = View::From(cameras).draw(&scene, &design).unwrap().to_svg();
    for name in (0..30).map(|number| number.to_string()).chain((0..4).map(|number| format!("#{number}"))) {
        assert!(svg.contains(&format!(">{name}</text>")), "{name}");
    }
    // The tiles of a view are one element with one colour.
    let fill = format!("fill=\"#{r:02x}{g:02x}{b:02x}\"");
    assert!(svg.matches(&fill).count() >= 2, "no tile has the colour of its number");
}

#[test]
fn a_touch_on_the_seam_appears_on_both_edges() {
    let (design, mesh) = skin("cylinder30");
    let surface = design.body.surface();
    let at = |theta: f64| {
        let place = surface.at(0.1, theta).unwrap();
        Contact::truth(place, surface.normal(place).unwrap(), 1.0)
    };
    let drawing = Drawing::new(&design, &mesh);
    let lines = |truth: f64, estimate: f64| {
        let scene = drawing.localisation(&[(at(truth), Some(at(estimate)))], &[]);
        let bare = drawing.localisation(&[], &[]);
        let count = |scene: &Scene| {
            let svg = View::Unrolled.draw(scene, &design).unwrap().to_svg();
            svg.matches("stroke-linecap").count() as i64
        };
        count(&scene) - count(&bare)
    };
    assert_eq!(lines(1.0, 1.1), 1, "an error line in the middle is one line");
    assert_eq!(lines(6.25, 0.05), 2, "an error line over the seam is seen on both sides");
}

#[test]
fn a_volume_shows_its_outside_and_cannot_be_unrolled() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../data/bodies");
    let mesh = import::load(&folder.join("block_4.1_ascii.msh"), 1.0).unwrap();
    let mut design = SkinDesign::shipped("tank16").unwrap();
    design.body = Body::Mesh { file: "block.msh".into(), unit_m: 1.0 };
    let scene = Drawing::new(&design, &mesh).mesh();
    let centre = dermis::geom::vector::centroid(&mesh.nodes);
    for tile in &scene.tiles {
        let outwards = dermis::geom::vector::sub(dermis::geom::vector::centroid(&tile.corners), centre);
        assert!(dot(tile.normal(), outwards) > 0.0, "a face of the block looks inwards");
    }
    assert_eq!(View::Unrolled.draw(&scene, &design).unwrap_err(), PlotError::NoFlatLayout);
    let picture = View::Solid.draw(&scene, &design).unwrap();
    assert!(picture.width > 300.0 && picture.height > 200.0);
    // The block measures 40 x 20 x 10: it is seen along z, its larger side across.
    let flat = View::Flat.draw(&scene, &design).unwrap().to_svg();
    assert!(flat.contains(">x (mm)</text>") && flat.contains(">y (mm)</text>") && !flat.contains(">z (mm)</text>"));
}

#[test]
fn a_flat_body_from_a_file_is_drawn_from_above() {
    let (mut design, mut mesh) = skin("skin16");
    design.body = Body::Mesh { file: "flat.ply".into(), unit_m: 1.0 };
    let axes = |mesh: &Mesh| {
        let scene = Drawing::new(&design, mesh).electrodes();
        assert_eq!(View::of(&scene, &design), View::Unrolled);
        let svg = View::Unrolled.draw(&scene, &design).unwrap().to_svg();
        ["x", "y", "z"].map(|axis| svg.contains(&format!(">{axis} (mm)</text>")))
    };
    mesh.nodes.iter_mut().for_each(|node| node[2] = -0.05);
    assert_eq!(axes(&mesh), [true, true, false]);
    mesh.nodes.iter_mut().for_each(|node| node.rotate_right(1));
    assert_eq!(axes(&mesh), [false, true, true]);
    mesh.nodes[0][0] += 0.01;
    let scene = Drawing::new(&design, &mesh).electrodes();
    assert_eq!(View::of(&scene, &design), View::Solid);
    assert_eq!(View::Unrolled.draw(&scene, &design).unwrap_err(), PlotError::NoFlatLayout);
}

#[test]
fn touches_and_errors_are_seen_on_a_body_from_a_file() {
    let (mut design, mesh) = skin("cylinder30");
    design.body = Body::Mesh { file: "tube.ply".into(), unit_m: 1.0 };
    let drawing = Drawing::new(&design, &mesh);
    // 1 mm below the surface, without a normal, and an estimate 30 mm away: the straight line between them is inside.
    let at = |theta: f64| [0.049 * theta.cos(), 0.049 * theta.sin(), 0.15];
    let contacts = [0.3, 0.9].map(|theta| Contact::truth(at(theta), [0.0; 3], 1.0));
    let scene = drawing.localisation(&[(contacts[0], Some(contacts[1]))], &[]);
    for (place, normal) in scene.dots.iter().map(|dot| (dot.at, dot.normal)) {
        assert!((place[0].hypot(place[1]) - 0.05).abs() < 3e-4, "{place:?}");
        assert!(dot([place[0], place[1], 0.0], normal) > 0.049, "{normal:?}");
    }
    let solid = |scene: &Scene| View::Solid.draw(scene, &design).unwrap().to_svg();
    let bare = Scene { strokes: Vec::new(), dots: Vec::new(), ..scene.clone() };
    assert!(scene.dots.len() == 2 && scene.strokes.len() > drawing.electrodes().strokes.len());
    assert!(solid(&scene).matches("<circle").count() > solid(&bare).matches("<circle").count());
    let mut image = drawing.electrodes();
    drawing.add_touches(&mut image, &contacts);
    assert!(image.dots.iter().all(|dot| dot.normal != [0.0; 3]));
}

#[test]
fn a_projected_body_has_no_holes() {
    // A box of two faces, above and below: seen along z both cover the same square.
    let corners = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]];
    let face = |z: f64, up: bool| {
        let mut corners: Vec<_> = corners.iter().map(|[x, y]| [*x, *y, z]).collect();
        if !up {
            corners.reverse();
        }
        Tile { corners, fill: [1, 2, 3], edge: None }
    };
    let scene = Scene { tiles: vec![face(0.01, true), face(0.0, false)], ..Scene::default() };
    let mut design = SkinDesign::shipped("tank16").unwrap();
    design.body = Body::Mesh { file: "box.stl".into(), unit_m: 1.0 };
    let svg = View::Flat.draw(&scene, &design).unwrap().to_svg();
    let path = svg.lines().find(|line| line.contains("#010203")).expect("the faces");
    let [one, other] = path.split("Z").take(2).map(area_of).collect::<Vec<_>>()[..] else { panic!("{path}") };
    assert!(one > 1e4 && other > 1e4, "{one} and {other}: opposite orientations leave a hole");
}

/// The area of a polygon of a path, with the sign of its orientation.
fn area_of(path: &str) -> f64 {
    let numbers = path.split(|c: char| !(c.is_ascii_digit() || c == '.')).filter_map(|text| text.parse::<f64>().ok());
    let numbers: Vec<f64> = numbers.collect();
    let places: Vec<[f64; 2]> = numbers.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
    (0..places.len())
        .map(|k| (places[k], places[(k + 1) % places.len()]))
        .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
        .sum::<f64>()
        / 2.0
}

#[test]
fn a_cumulative_curve_ends_at_the_fraction_that_was_found() {
    let chart = |values: &[f64], total: usize| {
        let marks = vec![(2.0, "median".to_string())];
        let chart = chart::Cumulative { title: "", subtitle: "", below: "error (mm)", left: "", values, total, marks };
        let svg = chart.draw().to_svg();
        let line = svg.lines().rfind(|line| line.contains("stroke-width=\"2\"")).expect("the curve").to_string();
        let path = line.split('"').nth(1).unwrap().to_string();
        path.rsplit(' ').next().unwrap().parse::<f64>().unwrap()
    };
    let (all, half) = (chart(&[1.0, 2.0, 3.0, 4.0], 4), chart(&[1.0, 2.0, 3.0, 4.0], 8));
    let none = chart(&[], 4);
    // 0 is below 1, and the half is in the middle.
    assert!(all < half && (half - 0.5 * (all + none)).abs() < 0.11, "{all}, {half}, {none}");
}

#[test]
fn missed_presses_are_crosses_and_found_ones_have_lines() {
    let (design, mesh) = skin("skin16");
    let at = |x: f64| Contact::truth([x, 0.0, 0.0], [0.0, 0.0, 1.0], 1.0);
    let found = PressError { truth: at(0.01), estimate: Some(([0.013, 0.0, 0.0], 0.003)) };
    let missed = PressError { truth: at(-0.02), estimate: None };
    let drawing = Drawing::new(&design, &mesh);
    let scene = drawing.errors(&[found, missed]);
    let bare = drawing.electrodes();
    assert_eq!(scene.strokes.len(), bare.strokes.iter().filter(|stroke| stroke.width < 7.0).count() + 1);
    assert!(scene.legend.iter().any(|(_, name)| name == "missed"));
    assert!(drawing.errors(&[found]).legend.iter().all(|(_, name)| name != "missed"));
    assert!(View::Flat.draw(&scene, &design).unwrap().to_svg().contains(">error (mm)</text>"));
}

#[test]
fn the_same_scene_gives_the_same_file() {
    let draw = || {
        let (design, mesh) = skin("skin16");
        let scene = Drawing::new(&design, &mesh).mesh();
        View::Solid.draw(&scene, &design).unwrap().to_svg()
    };
    assert_eq!(draw(), draw());
}
