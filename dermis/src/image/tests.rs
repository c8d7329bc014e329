use crate::design::{Body, ImageLayout, MeshOptions, Sheet, SkinDesign, TouchEffect};
use crate::geom::vector::{Point3, distance, dot};
use crate::geom::{Surface, vector};
use crate::image::{Image, PixelSpace};
use crate::mesh::{Cells, ElectrodePatch, Mesh};
use crate::protocol::Protocol;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

fn design(body: Body, image: ImageLayout) -> SkinDesign {
    SkinDesign {
        name: "test".into(),
        body,
        sheet: Sheet {
            kind: crate::design::SheetKind::Surface,
            conductance: 1e-3,
            regions: Vec::new(),
            touch: TouchEffect::ConductanceRises,
        },
        electrodes: Vec::new(),
        protocol: Protocol::adjacent(4).unwrap(),
        image,
        mesh: MeshOptions { max_edge_m: 6e-3, electrode_edge_m: 1e-3, growth: 0.2, correct_arc_ends: true },
        fabrication: None,
    }
}

fn surface_mesh(nodes: Vec<Point3>, triangles: Vec<[usize; 3]>) -> Mesh {
    Mesh { nodes, cells: Cells::Triangles(triangles), electrodes: Vec::new(), regions: Vec::new() }
}

/// A lattice of `rows` x `columns` squares, each cut in two; `place` gives the node positions, `wraps` closes the
/// columns.
fn lattice(rows: usize, columns: usize, wraps: bool, place: impl Fn(f64, f64) -> Point3) -> Mesh {
    let stride = if wraps { columns } else { columns + 1 };
    let node = |row: usize, column: usize| row * stride + column % stride;
    let mut nodes = Vec::new();
    for row in 0..=rows {
        for column in 0..stride {
            nodes.push(place(row as f64 / rows as f64, column as f64 / columns as f64));
        }
    }
    let mut triangles = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let (a, b) = (node(row, column), node(row, column + 1));
            let (c, d) = (node(row + 1, column + 1), node(row + 1, column));
            triangles.push([a, b, c]);
            triangles.push([a, c, d]);
        }
    }
    surface_mesh(nodes, triangles)
}

/// A cylinder of the paper's size, with a sheared and rotated lattice so that no edge is on a pixel's edge or the seam.
fn cylinder() -> (Body, Mesh) {
    let mesh = lattice(23, 37, true, |along, round| {
        let theta = TAU * round + 0.05 + 0.6 * along;
        [0.05 * theta.cos(), 0.05 * theta.sin(), 0.3 * along]
    });
    (Body::Cylinder { length_m: 0.3, diameter_m: 0.1 }, mesh)
}

/// A disk of radius 1 of rings of triangles around its centre.
fn disk() -> (Body, Mesh) {
    let (rings, spokes) = (7, 29);
    let mut nodes = vec![[0.0; 3]];
    for ring in 1..=rings {
        let radius = ring as f64 / rings as f64;
        let angle = |spoke: usize| TAU * spoke as f64 / spokes as f64 + 0.1;
        nodes.extend((0..spokes).map(|spoke| [radius * angle(spoke).cos(), radius * angle(spoke).sin(), 0.0]));
    }
    let node = |ring: usize, spoke: usize| if ring == 0 { 0 } else { 1 + (ring - 1) * spokes + spoke % spokes };
    let mut triangles = Vec::new();
    for ring in 0..rings {
        for spoke in 0..spokes {
            triangles.push([node(ring, spoke), node(ring + 1, spoke), node(ring + 1, spoke + 1)]);
            if ring > 0 {
                triangles.push([node(ring, spoke), node(ring + 1, spoke + 1), node(ring, spoke + 1)]);
            }
        }
    }
    (Body::Disk { diameter_m: 2.0 }, surface_mesh(nodes, triangles))
}

fn mesh_area(mesh: &Mesh) -> f64 {
    (0..mesh.cell_count()).map(|cell| mesh.cell_measure(cell)).sum()
}

/// Properties of every pixel space: the fractions of a cell sum to one, the areas to the mesh's area, a constant stays
/// one, neighbours are mutual and centres are on the surface.
fn assert_partition(space: &PixelSpace, mesh: &Mesh) {
    let mut sums = vec![0.0; mesh.cell_count()];
    for &(cell, fraction) in space.overlaps.iter().flatten() {
        assert!(fraction > 0.0 && fraction <= 1.0 + 1e-14, "cell {cell}: {fraction}");
        sums[cell] += fraction;
    }
    for (cell, sum) in sums.iter().enumerate() {
        assert!((sum - 1.0).abs() < 1e-13, "cell {cell}: fractions add up to {sum}");
    }
    let area: f64 = space.areas.iter().sum();
    assert!((area / mesh_area(mesh) - 1.0).abs() < 1e-12, "{area}");
    let constant = space.average_cells(mesh, &vec![0.7; mesh.cell_count()]);
    assert!(constant.iter().all(|value| (value - 0.7).abs() < 1e-13));
    for (pixel, neighbours) in space.neighbours.iter().enumerate() {
        assert!(neighbours.iter().all(|&other| other != pixel && space.neighbours[other].contains(&pixel)));
    }
    assert_eq!(space.normals.len(), space.len());
}

#[test]
fn the_cylinders_pixels_share_out_every_triangle_and_wrap_at_the_seam() {
    let (body, mesh) = cylinder();
    let space = PixelSpace::for_design(&design(body, ImageLayout::Grid { rows: 30, columns: 30 }), &mesh).unwrap();
    assert_partition(&space, &mesh);
    assert_eq!((space.len(), space.grid), (900, Some([30, 30])));
    // Pixel (i, j) is centred at z = (i + 0.5) 10 mm, theta = (j + 0.5) 12 degrees.
    let expected = space.surface.at(0.145, 29.5 * PI / 15.0).unwrap();
    assert!(distance(space.centres_m[14 * 30 + 29], expected) < 1e-15);
    assert!(dot(space.normals[0], space.centres_m[0]) > 0.0);
    // Equal pixels on a mesh of equal cells: equal areas up to the difference of chord and arc.
    let arc = 0.01 * 0.05 * PI / 15.0;
    assert!(space.areas.iter().all(|area| (area / arc - 1.0).abs() < 0.005));
    assert_eq!(space.neighbours[14 * 30], vec![13 * 30, 14 * 30 + 1, 14 * 30 + 29, 15 * 30]);
    assert_eq!(space.neighbours[0], vec![1, 29, 30]);
}

#[test]
fn a_step_in_z_is_halved_by_the_ring_of_pixels_that_straddles_it() {
    // A step halfway up, in the middle of a ring of pixels: every pixel of that ring gets one half.
    let mesh =
        lattice(2, 12, true, |along, round| [0.05 * (TAU * round).cos(), 0.05 * (TAU * round).sin(), 0.3 * along]);
    let body = Body::Cylinder { length_m: 0.3, diameter_m: 0.1 };
    let space = PixelSpace::for_design(&design(body, ImageLayout::Grid { rows: 5, columns: 7 }), &mesh).unwrap();
    let upper: Vec<f64> = (0..mesh.cell_count()).map(|cell| f64::from(mesh.cell_centre(cell)[2] > 0.15)).collect();
    let means = space.average_cells(&mesh, &upper);
    for (row, expected) in [0.0, 0.0, 0.5, 1.0, 1.0].into_iter().enumerate() {
        for value in &means[row * 7..(row + 1) * 7] {
            assert!((value - expected).abs() < 1e-12, "row {row}: {value}");
        }
    }
}

#[test]
fn the_disks_pixels_end_at_its_rim() {
    let (body, mesh) = disk();
    let space = PixelSpace::for_design(&design(body, ImageLayout::Grid { rows: 16, columns: 16 }), &mesh).unwrap();
    assert_partition(&space, &mesh);
    assert!(space.len() < 256, "the corners of the box lie outside");
    assert!(space.centres_m.iter().all(|c| c[0].hypot(c[1]) < 1.0 && c[2] == 0.0));
    let image = Image { values: vec![1.0; space.len()], space: Arc::new(space.clone()) };
    let picture = image.to_grid();
    assert!(picture[0].is_nan() && picture[255].is_nan() && picture[8 * 16 + 8] == 1.0);
    assert_eq!(picture.iter().filter(|value| !value.is_nan()).count(), space.len());
    // A centre is the centroid of the part inside: their mean weighted by area is the centre of the disk.
    for axis in 0..2 {
        let moment: f64 = space.centres_m.iter().zip(&space.areas).map(|(c, area)| c[axis] * area).sum();
        assert!(moment.abs() < 1e-12, "{moment}");
    }
}

#[test]
fn a_square_of_two_triangles_is_cut_into_known_pieces() {
    let mesh = lattice(1, 1, false, |up, right| [right, up, 0.0]);
    let body = Body::Rectangle { width_m: 1.0, height_m: 1.0 };
    let space = PixelSpace::for_design(&design(body, ImageLayout::Grid { rows: 2, columns: 2 }), &mesh).unwrap();
    assert_partition(&space, &mesh);
    // The diagonal halves pixels (0, 0) and (1, 1); (0, 1) belongs to the lower triangle, (1, 0) to the upper.
    let expected = [vec![(0, 0.25), (1, 0.25)], vec![(0, 0.5)], vec![(1, 0.5)], vec![(0, 0.25), (1, 0.25)]];
    for (overlaps, expected) in space.overlaps.iter().zip(&expected) {
        assert_eq!(overlaps.len(), expected.len());
        for (got, want) in overlaps.iter().zip(expected) {
            assert!(got.0 == want.0 && (got.1 - want.1).abs() < 1e-15, "{got:?} for {want:?}");
        }
    }
    assert!(distance(space.centres_m[1], [0.75, 0.25, 0.0]) < 1e-15);
}

#[test]
fn every_cell_is_a_pixel_of_a_mesh_body() {
    let (_, mesh) = cylinder();
    let space = PixelSpace::cells(&mesh, Surface::Free);
    assert_partition(&space, &mesh);
    assert_eq!(space.len(), mesh.cell_count());
    // Normals come from the triangles and point outwards; inner cells have three neighbours.
    assert!(space.centres_m.iter().zip(&space.normals).all(|(c, n)| dot([c[0], c[1], 0.0], *n) > 0.99 * 0.0497));
    assert!(space.neighbours.iter().all(|list| list.len() == 2 || list.len() == 3));
    let body = Body::Mesh { file: "skin.msh".into(), unit_m: 1.0 };
    let picture = design(body, ImageLayout::Grid { rows: 4, columns: 4 });
    assert!(PixelSpace::for_design(&picture, &mesh).is_err());
}

#[test]
fn patches_are_connected_alike_and_a_sixth_of_the_spacing_wide() {
    let (_, mut mesh) = cylinder();
    let cells = PixelSpace::cells(&mesh, Surface::Free);
    // A sixth of the spacing of eight electrodes is more than a cell.
    mesh.electrodes = (0..8).map(ElectrodePatch::Node).collect();
    let body = Body::Mesh { file: "skin.msh".into(), unit_m: 1.0 };
    let space = PixelSpace::for_design(&design(body, ImageLayout::Patches), &mesh).unwrap();
    assert_partition(&space, &mesh);
    let wanted = 36 * mesh.electrodes.len();
    assert!((wanted * 4 / 5..wanted * 5 / 4).contains(&space.len()), "{} pixels, not about {wanted}", space.len());
    let mean = space.areas.iter().sum::<f64>() / space.len() as f64;
    assert!(space.areas.iter().all(|area| (0.2..2.5).contains(&(area / mean))));
    for (pixel, around) in space.neighbours.iter().enumerate() {
        assert!((2..=10).contains(&around.len()), "pixel {pixel} has the neighbours {around:?}");
        assert!(around.iter().all(|&other| space.neighbours[other].contains(&pixel)));
        // Its centre is one of its cells, and its normal that of the wall.
        assert!(space.overlaps[pixel].iter().any(|&(cell, _)| cells.centres_m[cell] == space.centres_m[pixel]));
        let [x, y, _] = space.centres_m[pixel];
        assert!(dot(vector::normalize([x, y, 0.0]), space.normals[pixel]) > 0.98);
    }
    // With 30 electrodes the cells are hardly finer than that.
    mesh.electrodes = (0..30).map(ElectrodePatch::Node).collect();
    assert_eq!(super::patches::pixels(&mesh, Surface::Free).len(), mesh.cell_count());
}

#[test]
fn patches_do_not_reach_through_a_thin_body() {
    // Two plates 1 mm apart, joined nowhere.
    let side = 40;
    let node = |plate: usize, i: usize, j: usize| plate * (side + 1) * (side + 1) + i * (side + 1) + j;
    let at = |plate: usize, i: usize, j: usize| [i as f64, j as f64, plate as f64].map(|value| 1e-3 * value);
    let places = |plate: usize| (0..=side).flat_map(move |i| (0..=side).map(move |j| at(plate, i, j)));
    let squares = (0..2).flat_map(|plate| (0..side * side).map(move |square| (plate, square / side, square % side)));
    let triangles = squares.flat_map(|(plate, i, j)| {
        let [a, b, c, d] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(|[i, j]| node(plate, i, j));
        [[a, b, c], [a, c, d]]
    });
    let mesh = Mesh {
        nodes: (0..2).flat_map(places).collect(),
        cells: Cells::Triangles(triangles.collect()),
        electrodes: Vec::new(),
        regions: Vec::new(),
    };
    let space = super::patches::pixels(&mesh, Surface::Free);
    assert_partition(&space, &mesh);
    assert!(space.len() < mesh.cell_count() / 10);
    let plate = |cell: usize| cell / (2 * side * side);
    assert!(space.overlaps.iter().all(|cells| cells.iter().all(|(cell, _)| plate(*cell) == plate(cells[0].0))));
}

#[test]
fn tetrahedra_are_neighbours_across_faces_and_look_outwards() {
    // A cube around the origin cut into five tetrahedra: four corners and a middle one.
    let nodes: Vec<Point3> = (0..8).map(|i| [i & 1, (i >> 1) & 1, (i >> 2) & 1].map(|v| v as f64 - 0.5)).collect();
    let mut cells = vec![[0, 1, 2, 4], [3, 2, 1, 7], [5, 4, 7, 1], [6, 7, 4, 2], [1, 2, 4, 7]];
    for cell in &mut cells {
        if vector::tetrahedron_volume(cell.map(|node| nodes[node])) < 0.0 {
            cell.swap(0, 1);
        }
    }
    let mesh = Mesh { nodes, cells: Cells::Tetrahedra(cells), electrodes: Vec::new(), regions: Vec::new() };
    let space = PixelSpace::cells(&mesh, Surface::Free);
    assert_partition(&space, &mesh);
    assert_eq!(space.neighbours[4], vec![0, 1, 2, 3]);
    assert_eq!(space.neighbours[0], vec![4]);
    for corner in 0..4 {
        let outwards = vector::normalize(space.centres_m[corner]);
        assert!((dot(space.normals[corner], outwards) - 1.0).abs() < 1e-12);
    }
}

/// The paper's 30 x 30 pixels, for tests of the layers above.
pub(crate) fn cylinder_space() -> Arc<PixelSpace> {
    let (body, mesh) = cylinder();
    let layout = ImageLayout::Grid { rows: 30, columns: 30 };
    Arc::new(PixelSpace::for_design(&design(body, layout), &mesh).unwrap())
}

/// An image of Gaussian peaks: position, height and width.
pub(crate) fn bumps(space: &Arc<PixelSpace>, bumps: &[(Point3, f64, f64)]) -> Image {
    let value = |&at: &Point3| -> f64 {
        let bump = |&(centre, height, width): &(Point3, f64, f64)| {
            height * (-0.5 * (space.surface.distance_m(at, centre) / width).powi(2)).exp()
        };
        bumps.iter().map(bump).sum()
    };
    Image { values: space.centres_m.iter().map(value).collect(), space: Arc::clone(space) }
}
