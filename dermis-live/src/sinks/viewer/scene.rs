//! The skin as drawn by the page.

use dermis::design::{ElectrodeShape, SkinDesign, TouchEffect};
use dermis::geom::vector::{Point3, node_normals};
use dermis::geom::{Chart, Surface};
use dermis::image::PixelSpace;
use dermis::mesh::Mesh;
use dermis::reconstruct::Quantity;
use dermis::skin::Skin;
use serde_json::{Value, json};
use std::collections::HashMap;

/// Grid steps of the drawn cylinder per pixel, along and around it.
const STEPS_PER_PIXEL: usize = 3;

/// Pixels and weights of a vertex.
type Weights = ([usize; 4], [f64; 4]);

/// A surface to draw, its vertices coloured by pixels.
#[derive(Debug, Default)]
struct Drawn {
    vertices_m: Vec<Point3>,
    normals: Vec<Point3>,
    triangles: Vec<[usize; 3]>,
    weights: Vec<Weights>,
}

/// The message `scene`.
pub(super) fn scene(skin: &Skin, quantity: Quantity, methods: &[String], emulated: bool) -> Value {
    let (design, pixels) = (skin.design(), skin.pixels());
    let drawn = drawn(design, skin.mesh(), pixels);
    let flat = |list: &[Point3]| -> Vec<f32> { list.iter().flatten().map(|&value| value as f32).collect() };
    let electrodes = (0..design.electrodes.len()).map(|index| {
        let (position_m, normal) = electrode(skin, index);
        json!({ "position_m": position_m, "normal": normal, "radius_m": radius_m(skin, index) })
    });
    json!({
        "type": "scene",
        "version": env!("CARGO_PKG_VERSION"),
        "design": design.name,
        "frame_id": design.frame_id(),
        "touch": match design.sheet.touch {
            TouchEffect::ConductanceRises => "conductance_rises",
            TouchEffect::ConductanceFalls => "conductance_falls",
        },
        "surface": pixels.surface,
        "skin": {
            "vertices_m": flat(&drawn.vertices_m),
            "normals": flat(&drawn.normals),
            "triangles": drawn.triangles.as_flattened(),
            "pixels": drawn.weights.iter().flat_map(|weights| weights.0).collect::<Vec<_>>(),
            "weights": drawn.weights.iter().flat_map(|weights| weights.1).map(|w| w as f32).collect::<Vec<_>>(),
        },
        "electrodes": electrodes.collect::<Vec<_>>(),
        "image": {
            "pixel_count": pixels.len(),
            "rows": pixels.grid.map(|grid| grid[0]),
            "columns": pixels.grid.map(|grid| grid[1]),
            "position_in_grid": pixels.grid.map(|_| &pixels.position_in_grid),
        },
        "unrolled": unrolled(skin),
        "methods": methods,
        "emulated": emulated,
        "quantity": match quantity {
            Quantity::Touch => "touch",
            Quantity::Change => "change",
            Quantity::Density => "density",
        },
    })
}

/// The position of a point on the flat layout, m; `None` on a body without one.
pub(super) fn flat_m(surface: &Surface, place: Point3) -> Option<[f64; 2]> {
    (*surface != Surface::Free).then(|| Chart::of(surface).unroll(place))
}

fn unrolled(skin: &Skin) -> Value {
    let surface = &skin.pixels().surface;
    let Some(chart) = skin.design().body.chart() else { return Value::Null };
    let wraps = chart.period_m().is_some();
    let labels = if wraps { ["round (mm)", "along z (mm)"] } else { ["x (mm)", "y (mm)"] };
    let places: Vec<_> =
        (0..skin.design().electrodes.len()).map(|index| flat_m(surface, electrode(skin, index).0)).collect();
    json!({ "size_m": chart.size_m(), "wraps": wraps, "labels": labels, "electrodes_m": places })
}

/// The position of an electrode, and the outward normal there.
fn electrode(skin: &Skin, index: usize) -> (Point3, Point3) {
    let centre = skin.design().electrodes[index].centre_m;
    let place = if centre.iter().all(|value| value.is_finite()) { centre } else { skin.mesh().electrode_centre(index) };
    (place, skin.pixels().normal(place))
}

fn radius_m(skin: &Skin, index: usize) -> f64 {
    match skin.design().electrodes[index].shape {
        ElectrodeShape::Disc { radius_m } => radius_m,
        ElectrodeShape::Arc { length_m } => 0.5 * length_m,
        ElectrodeShape::Point => 0.002,
        ElectrodeShape::Group => (skin.mesh().electrode_size(index) / std::f64::consts::PI).sqrt(),
    }
}

fn drawn(design: &SkinDesign, mesh: &Mesh, pixels: &PixelSpace) -> Drawn {
    match (design.body.surface(), pixels.grid) {
        (Surface::Cylinder { radius_m, length_m }, Some(grid)) => cylinder(radius_m, length_m, grid, pixels),
        _ => any_body(mesh, pixels),
    }
}

/// The wall of a cylinder on a regular grid; the image between pixel centres is bilinear.
fn cylinder(radius_m: f64, length_m: f64, [rows, columns]: [usize; 2], pixels: &PixelSpace) -> Drawn {
    let pixel_at: HashMap<usize, usize> =
        pixels.position_in_grid.iter().enumerate().map(|(pixel, &position)| (position, pixel)).collect();
    let (along, round) = (rows * STEPS_PER_PIXEL, columns * STEPS_PER_PIXEL);
    let mut drawn = Drawn::default();
    for i in 0..=along {
        for j in 0..=round {
            let theta = std::f64::consts::TAU * j as f64 / round as f64;
            let (sin, cos) = theta.sin_cos();
            drawn.vertices_m.push([radius_m * cos, radius_m * sin, length_m * i as f64 / along as f64]);
            drawn.normals.push([cos, sin, 0.0]);
            let row = (i as f64 / STEPS_PER_PIXEL as f64 - 0.5).clamp(0.0, (rows - 1) as f64);
            let column = (j as f64 / STEPS_PER_PIXEL as f64 - 0.5).rem_euclid(columns as f64);
            let (low, left) = (row.floor() as usize, column.floor() as usize % columns);
            let (up, over) = (row - low as f64, column - column.floor());
            let corners = [(low, left), (low, left + 1), (low + 1, left), (low + 1, left + 1)];
            let shares = [(1.0 - up) * (1.0 - over), (1.0 - up) * over, up * (1.0 - over), up * over];
            let pixel = |(row, column): (usize, usize)| {
                pixel_at.get(&(row.min(rows - 1) * columns + column % columns)).copied().unwrap_or(0)
            };
            drawn.weights.push((corners.map(pixel), shares));
        }
    }
    for i in 0..along {
        for j in 0..round {
            let corner = |di: usize, dj: usize| (i + di) * (round + 1) + j + dj;
            drawn.triangles.push([corner(0, 0), corner(0, 1), corner(1, 1)]);
            drawn.triangles.push([corner(0, 0), corner(1, 1), corner(1, 0)]);
        }
    }
    drawn
}

/// Any body by its mesh; a vertex shows the four nearest pixels, weighted by distance.
fn any_body(mesh: &Mesh, pixels: &PixelSpace) -> Drawn {
    let mut index_of: HashMap<usize, usize> = HashMap::new();
    let mut drawn = Drawn::default();
    for (triangle, _) in mesh.outer_faces() {
        let corners = triangle.map(|node| {
            *index_of.entry(node).or_insert_with(|| {
                drawn.vertices_m.push(mesh.nodes[node]);
                drawn.vertices_m.len() - 1
            })
        });
        drawn.triangles.push(corners);
    }
    drawn.normals = node_normals(&drawn.vertices_m, drawn.triangles.iter().copied());
    drawn.weights = drawn.vertices_m.iter().map(|&vertex| nearest_pixels(vertex, pixels)).collect();
    drawn
}

fn nearest_pixels(vertex: Point3, pixels: &PixelSpace) -> Weights {
    let mut nearest = [(f64::INFINITY, 0); 4];
    for (pixel, &centre) in pixels.centres_m.iter().enumerate() {
        let away = dermis::geom::vector::distance(vertex, centre);
        let place = nearest.partition_point(|&(other, _)| other <= away);
        if place < 4 {
            nearest[place..].rotate_right(1);
            nearest[place] = (away, pixel);
        }
    }
    let least_m = 0.1 * pixels.half_pixel_m();
    let shares = nearest.map(|(away, _)| if away.is_finite() { (away + least_m).powi(-2) } else { 0.0 });
    let sum: f64 = shares.iter().sum();
    (nearest.map(|(_, pixel)| pixel), shares.map(|share| share / sum))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dermis::geom::vector::{cross, sub};
    use dermis::mesh::Mesh;

    #[test]
    fn every_vertex_shows_pixels_whose_weights_add_up_to_one() {
        for name in SkinDesign::SHIPPED {
            let mut design = SkinDesign::shipped(name).unwrap();
            design.mesh = design.mesh.scaled(2.0);
            let mesh = Mesh::generate(&design).unwrap();
            let pixels = PixelSpace::for_design(&design, &mesh).unwrap();
            let drawn = drawn(&design, &mesh, &pixels);
            for (vertex, (corners, shares)) in drawn.vertices_m.iter().zip(&drawn.weights) {
                assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-9);
                // The pixels of a vertex are near it.
                let far = corners.iter().zip(shares).filter(|(_, share)| **share > 0.1);
                for (&pixel, _) in far {
                    let away_m = pixels.surface.distance_m(*vertex, pixels.centres_m[pixel]);
                    assert!(away_m < 6.0 * pixels.half_pixel_m(), "{name}: {away_m} m");
                }
            }
            for triangle in &drawn.triangles {
                let [a, b, c] = triangle.map(|corner| drawn.vertices_m[corner]);
                let normal = cross(sub(b, a), sub(c, a));
                let outward = drawn.normals[triangle[0]];
                assert!(normal.iter().zip(&outward).map(|(n, o)| n * o).sum::<f64>() > 0.0, "{name}");
            }
        }
    }
}
