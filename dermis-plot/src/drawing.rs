//! Conversion of a design, its mesh and computed fields to a scene.

use crate::colour::{BLACK, Colour, ELECTRODE, ESTIMATE, FALSE_POSITIVE, INK, SKIN, Scale, mix};
use crate::scene::{Dot, Key, LABEL_SIZE, Label, LabelPosition, Mark, Scene, Stroke, Tile, normal_of};
use dermis::contact::Contact;
use dermis::design::SkinDesign;
use dermis::geom::polygon::clip_half_plane;
use dermis::geom::vector::{add, dot, node_normals, normalize, scale, sub};
use dermis::geom::{Chart, Point2, Point3, Shape, Surface, TriangleTree};
use dermis::image::PixelSpace;
use dermis::mesh::{Cells, ElectrodePatch, Mesh};
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Largest angle of a flat tile on a round body; its centre is then 0.1 % of the radius below the surface.
const TILE_ANGLE_RAD: f64 = TAU / 72.0;

/// With more presses, marks are small and electrodes have no numbers.
pub(crate) const CROWDED: usize = 200;

/// Text size of the names of marks, pixels.
const NAME_SIZE: f64 = 13.0;

/// A skin to draw: its design and its mesh.
pub struct Drawing<'a> {
    pub(crate) design: &'a SkinDesign,
    mesh: &'a Mesh,
    /// The visible faces of the mesh: triangles with outward orientation, and the cell of each.
    faces: Vec<([usize; 3], usize)>,
    node_normals: Vec<Point3>,
    /// The faces of a body from a mesh file, for the ones nearest to marks.
    tree: OnceLock<TriangleTree>,
}

impl<'a> Drawing<'a> {
    /// The skin of a design on its mesh.
    pub fn new(design: &'a SkinDesign, mesh: &'a Mesh) -> Self {
        let faces = mesh.outer_faces();
        let node_normals = node_normals(&mesh.nodes, faces.iter().map(|(face, _)| *face));
        Drawing { design, mesh, faces, node_normals, tree: OnceLock::new() }
    }

    fn surface(&self) -> Surface {
        self.design.body.surface()
    }

    fn normal_at(&self, node: usize) -> Point3 {
        self.surface().normal(self.mesh.nodes[node]).unwrap_or(self.node_normals[node])
    }

    fn corners_of(&self, face: usize) -> [Point3; 3] {
        self.faces[face].0.map(|node| self.mesh.nodes[node])
    }

    /// A position on the skin and the outward normal there. Positions on a body from a mesh file are given without a normal,
    /// and may lie beside it: the nearest face has them.
    pub(crate) fn on_skin(&self, at: Point3, normal: Point3) -> (Point3, Point3) {
        if self.design.body.chart().is_some() {
            return (at, normal);
        }
        let all = || TriangleTree::new((0..self.faces.len()).map(|face| self.corners_of(face)));
        let nearest = self.tree.get_or_init(all).nearest(at);
        (nearest.point, normal_of(&self.corners_of(nearest.triangle)))
    }

    /// A line along the skin. On a body from a mesh file it follows the surface in pieces, which would hide a straight one.
    pub(crate) fn line(&self, ends: [Point3; 2], normal: Point3, colour: Colour, width: f64) -> Vec<Stroke> {
        const PIECES: usize = 12;
        if self.design.body.chart().is_some() {
            return vec![Stroke { ends, normal, colour, width }];
        }
        let along = |piece: usize| add(ends[0], scale(sub(ends[1], ends[0]), piece as f64 / PIECES as f64));
        let points: Vec<(Point3, Point3)> = (0..=PIECES).map(|piece| self.on_skin(along(piece), normal)).collect();
        let stroke =
            |pair: &[(Point3, Point3)]| Stroke { ends: [pair[0].0, pair[1].0], normal: pair[0].1, colour, width };
        points.windows(2).map(stroke).collect()
    }

    /// The mesh: its cells with their edges, and its electrodes.
    pub fn mesh(&self) -> Scene {
        let mut scene = Scene { tiles: self.cell_tiles(|_| SKIN, Some(mix(SKIN, INK, 0.55))), ..Scene::default() };
        self.add_electrodes(&mut scene, ElectrodeLook::Filled { numbered: true });
        scene
    }

    /// The body and its electrodes with their numbers.
    pub fn electrodes(&self) -> Scene {
        let mut scene = Scene { tiles: self.body_tiles(), ..Scene::default() };
        self.add_electrodes(&mut scene, ElectrodeLook::Filled { numbered: true });
        scene
    }

    /// A value for each pixel of a space, as colours, with the outlines of the electrodes.
    pub fn field(&self, space: &PixelSpace, values: &[f64], key: Key) -> Scene {
        let mut scene =
            Scene { tiles: self.pixel_tiles(space, values, &key.scale), key: Some(key), ..Scene::default() };
        self.add_electrodes(&mut scene, ElectrodeLook::Outlined { numbered: true });
        scene
    }

    /// Adds marks of detected contacts to any scene; several contacts are numbered from 0 in order.
    pub fn add_contacts(&self, scene: &mut Scene, contacts: &[Contact]) {
        self.add_marks(scene, contacts, 7.0, Mark::Cross(BLACK), "detected contact");
        if contacts.len() > 1 {
            let label = |(number, contact): (usize, &Contact)| {
                let (at, normal) = self.on_skin(contact.position_m, contact.normal);
                let position = LabelPosition::Above { pixels: 8.0 };
                Label { at, normal, text: format!("#{number}"), reach_m: 0.0, position, size: NAME_SIZE }
            };
            scene.labels.extend(contacts.iter().enumerate().map(label));
        }
    }

    /// Adds marks of true touches to any scene.
    pub fn add_touches(&self, scene: &mut Scene, touches: &[Contact]) {
        self.add_marks(scene, touches, 3.4, Mark::OutlinedDisc(BLACK), "true position");
    }

    /// Adds named marks to any scene.
    pub fn add_named_marks(&self, scene: &mut Scene, marks: impl Iterator<Item = (Point3, String)>, meaning: &str) {
        let mark = Mark::Cross(BLACK);
        for (at, text) in marks {
            let (at, normal) = self.on_skin(at, self.surface().normal(at).unwrap_or([0.0, 0.0, 1.0]));
            scene.dots.push(Dot { at, normal, radius: 7.0, mark });
            scene.labels.push(Label {
                at,
                normal,
                text,
                reach_m: 0.0,
                position: LabelPosition::Inwards { pixels: 12.0 },
                size: NAME_SIZE,
            });
        }
        scene.legend.push((mark, meaning.to_string()));
    }

    /// True and estimated positions of touches, as in the paper's Fig. 7: true positions are black dots, estimates red
    /// circles, errors lines, electrodes yellow. `false_positives` are estimates without a touch.
    pub fn localisation(&self, touches: &[(Contact, Option<Contact>)], false_positives: &[Contact]) -> Scene {
        let mut scene = Scene { tiles: self.body_tiles(), ..Scene::default() };
        let crowded = touches.len() > CROWDED;
        self.add_electrodes(&mut scene, ElectrodeLook::Filled { numbered: !crowded });
        let radius = if crowded { 1.7 } else { 3.0 };
        for (truth, estimate) in touches {
            if let Some(estimate) = estimate {
                let colour = mix(ESTIMATE, [255, 255, 255], 0.35);
                scene.strokes.extend(self.line([truth.position_m, estimate.position_m], truth.normal, colour, 1.0));
            }
        }
        for (truth, estimate) in touches {
            scene.dots.push(self.dot(truth, radius, Mark::Disc(BLACK, false)));
            scene.dots.extend(estimate.iter().map(|estimate| self.dot(estimate, radius + 1.3, Mark::Ring(ESTIMATE))));
        }
        let mark = Mark::Diamond(FALSE_POSITIVE);
        scene.dots.extend(false_positives.iter().map(|found| self.dot(found, radius + 2.5, mark)));
        scene.legend.push((Mark::Disc(BLACK, false), "true position".to_string()));
        scene.legend.push((Mark::Ring(ESTIMATE), "estimate".to_string()));
        scene.legend.push((Mark::Line(mix(ESTIMATE, [255, 255, 255], 0.35)), "error".to_string()));
        if !false_positives.is_empty() {
            scene.legend.push((mark, "false positive (nothing touched there)".to_string()));
        }
        scene
    }

    /// The mark of a contact or a touch.
    pub(crate) fn dot(&self, place: &Contact, radius: f64, mark: Mark) -> Dot {
        let (at, normal) = self.on_skin(place.position_m, place.normal);
        Dot { at, normal, radius, mark }
    }

    fn add_marks(&self, scene: &mut Scene, places: &[Contact], radius: f64, mark: Mark, name: &str) {
        scene.dots.extend(places.iter().map(|place| self.dot(place, radius, mark)));
        if !places.is_empty() {
            scene.legend.push((mark, name.to_string()));
        }
    }

    fn cell_tiles(&self, colour: impl Fn(usize) -> Colour, edge: Option<Colour>) -> Vec<Tile> {
        let corners = |face: &[usize; 3]| face.map(|node| self.mesh.nodes[node]).to_vec();
        self.faces.iter().map(|(face, cell)| Tile { corners: corners(face), fill: colour(*cell), edge }).collect()
    }

    /// The bare body as a few tiles.
    pub(crate) fn body_tiles(&self) -> Vec<Tile> {
        let Some(chart) = self.design.body.chart() else { return self.cell_tiles(|_| SKIN, None) };
        let [low_m, high_m] = chart.bounds_m();
        let rows = if chart.period_m().is_some() { 12 } else { 1 };
        let row = |row| box_polygons(&chart, [low_m[0], high_m[0]], part(row, rows, low_m[1], high_m[1]));
        let tile = |corners| Tile { corners, fill: mix(SKIN, [255, 255, 255], 0.45), edge: None };
        (0..rows).flat_map(row).map(tile).collect()
    }

    fn pixel_tiles(&self, space: &PixelSpace, values: &[f64], scale: &Scale) -> Vec<Tile> {
        let (Some([rows, columns]), Some(chart)) = (space.grid, self.design.body.chart()) else {
            let cell_values = self.spread_over_cells(space, values);
            return self.cell_tiles(|cell| scale.colour(cell_values[cell]), None);
        };
        let [low_m, high_m] = chart.bounds_m();
        let mut tiles = Vec::new();
        for (&position, &value) in space.position_in_grid.iter().zip(values) {
            let fill = scale.colour(value);
            let across_m = part(position % columns, columns, low_m[0], high_m[0]);
            let along_m = part(position / columns, rows, low_m[1], high_m[1]);
            for corners in box_polygons(&chart, across_m, along_m) {
                tiles.push(Tile { corners, fill, edge: None });
            }
        }
        tiles
    }

    /// The value of each cell: that of its pixel, or the mean of the pixels that contain it.
    fn spread_over_cells(&self, space: &PixelSpace, values: &[f64]) -> Vec<f64> {
        let (mut sums, mut shares) = (vec![0.0; self.mesh.cell_count()], vec![0.0; self.mesh.cell_count()]);
        for (overlaps, &value) in space.overlaps.iter().zip(values) {
            for &(cell, share) in overlaps {
                sums[cell] += share * value;
                shares[cell] += share;
            }
        }
        // A cell outside all pixels is grey.
        sums.into_iter().zip(shares).map(|(sum, share)| if share > 0.0 { sum / share } else { f64::NAN }).collect()
    }

    pub(crate) fn add_electrodes(&self, scene: &mut Scene, look: ElectrodeLook) {
        for (number, patch) in self.mesh.electrodes.iter().enumerate() {
            self.add_electrode(scene, patch, look);
            let (ElectrodeLook::Filled { numbered } | ElectrodeLook::Outlined { numbered }) = look;
            if numbered {
                scene.labels.extend(self.electrode_label(patch, number));
            }
        }
        let on_edges = self.mesh.electrodes.iter().all(|patch| matches!(patch, ElectrodePatch::Edges(_)));
        let mark = match look {
            ElectrodeLook::Filled { .. } => Mark::Disc(ELECTRODE, true),
            ElectrodeLook::Outlined { .. } if on_edges => Mark::Line(INK),
            ElectrodeLook::Outlined { .. } => Mark::Ring(INK),
        };
        scene.legend.push((mark, "electrode".to_string()));
    }

    fn add_electrode(&self, scene: &mut Scene, patch: &ElectrodePatch, look: ElectrodeLook) {
        let filled = matches!(look, ElectrodeLook::Filled { .. });
        let faces = self.patch_faces(patch);
        if filled {
            let corners = |face: &[usize; 3]| face.map(|node| self.mesh.nodes[node]).to_vec();
            scene.patches.extend(faces.iter().map(|face| Tile { corners: corners(face), fill: ELECTRODE, edge: None }));
        }
        let mut stroke = |[a, b]: [usize; 2], colour, width| {
            let ends = [a, b].map(|node| self.mesh.nodes[node]);
            let normal = normalize(add(self.normal_at(a), self.normal_at(b)));
            scene.strokes.push(Stroke { ends, normal, colour, width });
        };
        for edge in outline(&faces) {
            stroke(edge, INK, 1.0);
        }
        match patch {
            ElectrodePatch::Edges(edges) => {
                edges.iter().for_each(|&edge| stroke(edge, INK, if filled { 7.0 } else { 5.0 }));
                if filled {
                    edges.iter().for_each(|&edge| stroke(edge, ELECTRODE, 5.0));
                }
            }
            ElectrodePatch::Node(node) => {
                let mark = if filled { Mark::Disc(ELECTRODE, true) } else { Mark::Ring(INK) };
                scene.dots.push(Dot { at: self.mesh.nodes[*node], normal: self.normal_at(*node), radius: 4.0, mark });
            }
            ElectrodePatch::Cells(_) | ElectrodePatch::Faces(_) => {}
        }
    }

    fn patch_faces(&self, patch: &ElectrodePatch) -> Vec<[usize; 3]> {
        match (patch, &self.mesh.cells) {
            (ElectrodePatch::Cells(cells), Cells::Triangles(triangles)) => {
                cells.iter().map(|&c| triangles[c]).collect()
            }
            (ElectrodePatch::Faces(faces), _) => faces.iter().map(|&face| self.outward(face)).collect(),
            _ => vec![],
        }
    }

    /// Orients a face outwards.
    fn outward(&self, [a, b, c]: [usize; 3]) -> [usize; 3] {
        let normal = normal_of(&[a, b, c].map(|node| self.mesh.nodes[node]));
        if dot(normal, self.node_normals[a]) < 0.0 { [a, c, b] } else { [a, b, c] }
    }

    fn electrode_label(&self, patch: &ElectrodePatch, number: usize) -> Option<Label> {
        let nodes: Vec<usize> = match patch {
            ElectrodePatch::Cells(cells) => {
                cells.iter().flat_map(|&cell| self.mesh.cells.corners(cell).to_vec()).collect()
            }
            ElectrodePatch::Edges(edges) => edges.iter().flatten().copied().collect(),
            ElectrodePatch::Faces(faces) => faces.iter().flatten().copied().collect(),
            ElectrodePatch::Node(node) => vec![*node],
        };
        let first = *nodes.first()?;
        let at = self.surface().weighted_mean(self.mesh.nodes[first], nodes.iter().map(|&n| (self.mesh.nodes[n], 1.0)));
        let mean_normal = nodes.iter().fold([0.0; 3], |sum, &node| add(sum, self.normal_at(node)));
        let reach = |&node: &usize| self.surface().distance_m(at, self.mesh.nodes[node]);
        let reach_m = nodes.iter().map(reach).fold(0.0, f64::max);
        let inwards = matches!(patch, ElectrodePatch::Edges(_));
        let position = if inwards { LabelPosition::Inwards { pixels: 8.0 } } else { LabelPosition::OnOrAbove };
        Some(Label {
            at,
            normal: normalize(mean_normal),
            text: number.to_string(),
            reach_m,
            position,
            size: LABEL_SIZE,
        })
    }
}

/// How electrodes are drawn, with or without their numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum ElectrodeLook {
    /// Filled in yellow.
    Filled { numbered: bool },
    /// An outline, so that the data below remain visible.
    Outlined { numbered: bool },
}

/// The ends of one of some equal parts of an interval.
fn part(index: usize, count: usize, low: f64, high: f64) -> [f64; 2] {
    [index, index + 1].map(|end| low + (high - low) * end as f64 / count as f64)
}

/// The part of a box of the chart on the body, as flat polygons.
fn box_polygons(chart: &Chart, [x0, x1]: [f64; 2], [y0, y1]: [f64; 2]) -> Vec<Vec<Point3>> {
    let flat = |corners: &[Point2]| corners.iter().map(|&corner| chart.roll(corner)).collect();
    match chart.shape() {
        Shape::Wall { radius_m, .. } => {
            // Rounding must not add a slice.
            let slices = ((x1 - x0) / (radius_m * TILE_ANGLE_RAD) - 1e-9).ceil().max(1.0) as usize;
            let slice = |index| {
                let [a, b] = part(index, slices, x0, x1);
                flat(&[[a, y0], [b, y0], [b, y1], [a, y1]])
            };
            (0..slices).map(slice).collect()
        }
        Shape::Disk { radius_m } => {
            let mut corners = vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
            let outline = round(radius_m);
            for (from, to) in outline.iter().zip(outline.iter().cycle().skip(1)) {
                let normal = [to[1] - from[1], from[0] - to[0]];
                corners = clip_half_plane(&corners, normal, normal[0] * from[0] + normal[1] * from[1]);
            }
            if corners.len() < 3 { vec![] } else { vec![flat(&corners)] }
        }
        _ => vec![flat(&[[x0, y0], [x1, y0], [x1, y1], [x0, y1]])],
    }
}

/// A circle around the origin as a polygon, counter-clockwise.
fn round(radius_m: f64) -> Vec<[f64; 2]> {
    const CORNERS: usize = 180;
    (0..CORNERS).map(|k| TAU * k as f64 / CORNERS as f64).map(|a| [radius_m * a.cos(), radius_m * a.sin()]).collect()
}

/// The edges that belong to one face only.
fn outline(faces: &[[usize; 3]]) -> Vec<[usize; 2]> {
    let mut count: HashMap<[usize; 2], usize> = HashMap::new();
    let edges = |&[a, b, c]: &[usize; 3]| [[a, b], [b, c], [c, a]];
    let key = |[a, b]: [usize; 2]| [a.min(b), a.max(b)];
    faces.iter().flat_map(edges).for_each(|edge| *count.entry(key(edge)).or_default() += 1);
    // In the order of the faces, so that the output is deterministic.
    faces.iter().flat_map(edges).filter(|&edge| count[&key(edge)] == 1).collect()
}
