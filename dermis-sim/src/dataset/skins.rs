//! Random skins of one design: one for every sixteen samples.

use crate::dataset::DatasetError;
use crate::dataset::generator::UNIT;
use crate::dataset::recipe::SkinSpread;
use crate::elementary::{Chart, cos, hypot, unrolled};
use crate::random::{log_normal, sample_rng};
use crate::twin::FieldPlaces;
use dermis::design::{Body, ElectrodeShape, SkinDesign};
use dermis::forward::{ForwardError, ForwardModel, Solver};
use dermis::geom::Point3;
use dermis::geom::vector::{cross, dot, sub};
use dermis::mesh::{Cells, Mesh};
use rand::RngExt;
use std::f64::consts::PI;

/// The random streams from here on are for skins, those below for samples.
const SKIN_STREAMS: u64 = 1 << 63;

/// The mesh around an electrode moves with it; the displacement then decreases to zero at this many radii of the
/// electrode, or halfway to the next electrode.
const FOLLOWING_RADII: f64 = 5.0;
/// Maximum displacement in units of its root mean square; larger ones occur once in 10 million and are limited.
const FARTHEST: f64 = 4.0;
/// Maximum compression of the mesh next to an electrode: the slope of a displacement.
const STEEPEST: f64 = 0.7;

/// Generates the skins of a recipe.
#[derive(Debug)]
pub(super) struct SkinMaker {
    seed: u64,
    spread: SkinSpread,
    design: SkinDesign,
    base: ForwardModel,
    /// The coating's random field at the cells' centres; none if the coating is uniform.
    coat: Option<FieldPlaces>,
    /// For each electrode the nodes that move with it, and their weights.
    followers: Vec<Vec<(usize, f64)>>,
    /// Cells with a node that moves with an electrode.
    movable: Vec<usize>,
}

/// One skin.
#[derive(Debug)]
pub(super) struct Skin {
    pub forward: ForwardModel,
    /// The displacement of each node, in the coordinates in which distances along the surface are straight-line
    /// distances, m.
    pub shifts_m: Vec<[f64; 2]>,
    /// Random numbers for all other differences.
    pub seed: u64,
}

impl SkinMaker {
    pub(super) fn new(
        design: &SkinDesign,
        forward: &ForwardModel,
        seed: u64,
        spread: &SkinSpread,
    ) -> crate::Result<Self> {
        spread.coat.check()?;
        spread.electrodes.check()?;
        let mesh = forward.mesh();
        let centres: Vec<Point3> = (0..mesh.cell_count()).map(|cell| mesh.cell_centre(cell)).collect();
        let places = || FieldPlaces::new(design.body.surface(), mesh, spread.coat.correlation_m, &centres);
        let coat = match spread.coat.rms > 0.0 {
            true => Some(places().ok_or_else(|| DatasetError::OutOfRange {
                what: "the correlation length of the coat in m",
                value: spread.coat.correlation_m,
                must: "not far shorter than the cells of a mesh".into(),
            })?),
            false => None,
        };
        let moves = spread.electrodes.displacement_rms_m > 0.0;
        let followers = if moves { followers(design, mesh, spread.electrodes.displacement_rms_m)? } else { Vec::new() };
        let mut follows = vec![false; mesh.node_count()];
        followers.iter().flatten().for_each(|&(node, _)| follows[node] = true);
        let movable = (0..mesh.cell_count()).filter(|&cell| mesh.cells.corners(cell).iter().any(|&n| follows[n]));
        Ok(SkinMaker {
            seed,
            spread: spread.clone(),
            design: design.clone(),
            base: forward.clone(),
            coat,
            movable: movable.collect(),
            followers,
        })
    }

    /// Cells whose nodes move on some skins.
    pub(super) fn movable_cells(&self) -> &[usize] {
        &self.movable
    }

    /// The skin of the samples from `16 index` on. It depends only on the seed and the index.
    pub(super) fn make(&self, index: u64) -> crate::Result<Skin> {
        let seed: u64 = sample_rng(self.seed, SKIN_STREAMS + index).random();
        let drawn = self.spread.electrodes.draw(&self.design, seed)?;
        let (nodes, shifts_m) = self.moved(&drawn);
        self.check_folds(&nodes)?;
        let impedances = drawn.contact_impedances();
        let mut rest = self.base.rest_conductivity().to_vec();
        if let Some(coat) = &self.coat {
            let field = coat.draw(&mut sample_rng(seed, SKIN_STREAMS));
            for (value, unit) in rest.iter_mut().zip(field) {
                *value *= log_normal(self.spread.coat.rms, unit);
            }
        }
        Ok(Skin { forward: self.base.with_parameters(&nodes, &impedances, &rest)?, shifts_m, seed })
    }

    /// The node positions of a skin.
    fn moved(&self, drawn: &SkinDesign) -> (Vec<Point3>, Vec<[f64; 2]>) {
        let mesh = self.base.mesh();
        let chart = unrolled(&self.design.body.surface());
        let farthest_m = FARTHEST * self.spread.electrodes.displacement_rms_m;
        let mut shifts = vec![[0.0; 2]; mesh.node_count()];
        let pairs = self.design.electrodes.iter().zip(&drawn.electrodes).zip(&self.followers);
        for ((from, to), followers) in pairs {
            let step = chart.difference(chart.unroll(from.centre_m), chart.unroll(to.centre_m));
            let cut = (farthest_m / hypot(step[0], step[1])).min(1.0);
            for &(node, share) in followers {
                shifts[node][0] += share * cut * step[0];
                shifts[node][1] += share * cut * step[1];
            }
        }
        let mut nodes = mesh.nodes.clone();
        for (node, shift) in nodes.iter_mut().zip(&mut shifts) {
            if *shift != [0.0; 2] {
                *node = stay_on(&self.design.body, chart, *node, shift);
            }
        }
        (nodes, shifts)
    }

    fn check_folds(&self, nodes: &[Point3]) -> Result<(), DatasetError> {
        let Cells::Triangles(triangles) = &self.base.mesh().cells else { return Ok(()) };
        let normal = |nodes: &[Point3], [a, b, c]: [usize; 3]| cross(sub(nodes[b], nodes[a]), sub(nodes[c], nodes[a]));
        let folds = |&&cell: &&usize| {
            let before = normal(&self.base.mesh().nodes, triangles[cell]);
            // A triangle that keeps less than a twentieth of its area gives no reliable solution.
            dot(normal(nodes, triangles[cell]), before) < 0.05 * dot(before, before)
        };
        match self.movable.iter().find(folds) {
            None => Ok(()),
            Some(_) => Err(too_far(self.spread.electrodes.displacement_rms_m)),
        }
    }
}

fn too_far(rms_m: f64) -> DatasetError {
    DatasetError::OutOfRange {
        what: "the displacement of electrodes in m",
        value: rms_m,
        must: "smaller: the mesh between them would fold".into(),
    }
}

/// Moves a node by a shift in the chart, without the components that would leave the edges of the body.
fn stay_on(body: &Body, chart: Chart, node: Point3, shift: &mut [f64; 2]) -> Point3 {
    let [x, y, z] = node;
    match *body {
        Body::Cylinder { length_m, .. } if z == 0.0 || z == length_m => shift[1] = 0.0,
        Body::Rectangle { width_m, height_m } => {
            if x == 0.0 || x == width_m {
                shift[0] = 0.0;
            }
            if y == 0.0 || y == height_m {
                shift[1] = 0.0;
            }
        }
        Body::Disk { diameter_m } if (hypot(x, y) - 0.5 * diameter_m).abs() <= 1e-9 * diameter_m => {
            // Along the rim: the component across it is removed.
            let across = (x * shift[0] + y * shift[1]) / (x * x + y * y);
            let along = [shift[0] - across * x, shift[1] - across * y];
            let moved = [x + along[0], y + along[1]];
            let back = hypot(x, y) / hypot(moved[0], moved[1]);
            *shift = [back * moved[0] - x, back * moved[1] - y];
        }
        _ => {}
    }
    chart.walk(node, *shift)
}

/// The nodes that move with each electrode: completely on it, then decreasing (a half cosine).
fn followers(design: &SkinDesign, mesh: &Mesh, rms_m: f64) -> Result<Vec<Vec<(usize, f64)>>, DatasetError> {
    let flat = matches!(mesh.cells, Cells::Triangles(_)) && !matches!(design.body, Body::Mesh { .. });
    if !flat || design.electrodes.iter().any(|electrode| electrode.shape == ElectrodeShape::Group) {
        return Err(DatasetError::OutOfRange {
            what: "the displacement of electrodes in m",
            value: rms_m,
            must: "0 on bodies from mesh files and in volumes, where electrodes cannot be moved".into(),
        });
    }
    let chart = unrolled(&design.body.surface());
    let distance_m = |a: Point3, b: Point3| chart.squared_distance_m2(a, b).sqrt();
    let centres: Vec<Point3> =
        design.electrodes.iter().map(|electrode| chart.unroll_in_space(electrode.centre_m)).collect();
    let places: Vec<Point3> = mesh.nodes.iter().map(|&node| chart.unroll_in_space(node)).collect();
    let mut all = Vec::with_capacity(centres.len());
    for (index, &centre) in centres.iter().enumerate() {
        let radius_m =
            (mesh.electrode_nodes(index).into_iter()).map(|node| distance_m(centre, places[node])).fold(0.0, f64::max);
        let others = centres.iter().enumerate().filter(|(other, _)| *other != index);
        let next_m = others.map(|(_, &other)| distance_m(centre, other)).fold(f64::INFINITY, f64::min);
        let around_m = radius_m.max(FARTHEST * rms_m);
        let reach_m = (radius_m + FOLLOWING_RADII * around_m).min(0.5 * next_m);
        // The maximum slope of a half cosine is pi / 2 over its length.
        if 0.5 * PI * FARTHEST * rms_m > STEEPEST * (reach_m - radius_m) {
            return Err(too_far(rms_m));
        }
        let share = |away_m: f64| match away_m <= radius_m * (1.0 + 1e-9) {
            true => 1.0,
            false => 0.5 + 0.5 * cos(PI * (away_m - radius_m) / (reach_m - radius_m)),
        };
        let near = places.iter().enumerate().map(|(node, &place)| (node, distance_m(centre, place)));
        all.push(near.filter(|&(_, away_m)| away_m < reach_m).map(|(node, away_m)| (node, share(away_m))).collect());
    }
    Ok(all)
}

/// The current skin of a thread.
#[derive(Debug)]
pub(super) struct SkinInstance {
    pub index: u64,
    pub skin: Skin,
    solver: Solver,
}

impl SkinInstance {
    /// The skin of a unit of samples.
    pub(super) fn new(maker: &SkinMaker, first_sample: u64) -> crate::Result<Self> {
        let index = first_sample / UNIT as u64;
        let skin = maker.make(index)?;
        Ok(SkinInstance { index, solver: skin.forward.solver(), skin })
    }

    /// Replaces the skin by the next one, in the same memory.
    pub(super) fn change(&mut self, maker: &SkinMaker, first_sample: u64) -> crate::Result<()> {
        let index = first_sample / UNIT as u64;
        if index != self.index {
            self.skin = maker.make(index)?;
            self.index = index;
            self.solver.set_model(&self.skin.forward);
        }
        Ok(())
    }

    /// Its untouched frame without patches, ohm.
    pub(super) fn untouched(&mut self) -> Result<Vec<f64>, ForwardError> {
        let mut rest = vec![0.0; self.skin.forward.protocol().channel_count()];
        self.solver.solve_into(self.skin.forward.rest_conductivity(), &mut rest)?;
        Ok(rest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::{CoatOptions, ElectrodeOptions};
    use dermis::geom::vector::distance;
    use dermis::stats::mean_and_sd;

    fn spread() -> SkinSpread {
        SkinSpread::usual()
    }

    fn base(name: &str) -> (SkinDesign, ForwardModel) {
        let design = SkinDesign::shipped(name).unwrap();
        let forward = ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap();
        (design, forward)
    }

    fn difference(a: &[f64], b: &[f64], keep: impl Fn(usize) -> bool) -> f64 {
        let (mut off, mut norm) = (0.0, 0.0);
        for (index, (a, b)) in a.iter().zip(b).enumerate().filter(|(index, _)| keep(*index)) {
            debug_assert!(keep(index));
            off += (a - b) * (a - b);
            norm += b * b;
        }
        (off / norm).sqrt()
    }

    #[test]
    fn a_skin_with_moved_nodes_has_the_frames_of_a_remeshed_skin() {
        let (design, forward) = base("cylinder30");
        let moved = SkinSpread {
            coat: CoatOptions { rms: 0.0, correlation_m: 0.04 },
            electrodes: ElectrodeOptions { displacement_rms_m: 1e-3, contact_impedance_rms: 0.3 },
            ..spread()
        };
        let maker = SkinMaker::new(&design, &forward, 9, &moved).unwrap();
        let untouched = forward.solve(forward.rest_conductivity()).unwrap();
        let channels = design.protocol.channels();
        let far = |index: usize| !channels[index].touches_driven();
        for index in 0..3 {
            let skin = maker.make(index).unwrap();
            let frame = skin.forward.solve(skin.forward.rest_conductivity()).unwrap();
            let drawn = moved.electrodes.draw(&design, skin.seed).unwrap();
            let anew = ForwardModel::new(&drawn, &Mesh::generate(&drawn).unwrap()).unwrap();
            let exact = anew.solve(anew.rest_conductivity()).unwrap();
            let (off, change) = (difference(&frame, &exact, far), difference(&exact, &untouched, far));
            println!("skin {index}: the frame changes by {change:.4}, off from a new mesh by {off:.4}");
            assert!(off < 0.15 * change && off < 5e-3, "{off} of {change}");
        }
    }

    #[test]
    fn coats_and_contacts_spread_as_stated() {
        let (design, forward) = base("tank16");
        let still = SkinSpread {
            electrodes: ElectrodeOptions { displacement_rms_m: 0.0, contact_impedance_rms: 0.3 },
            coat: CoatOptions { rms: 0.2, correlation_m: 0.04 },
            ..spread()
        };
        let maker = SkinMaker::new(&design, &forward, 3, &still).unwrap();
        let (mut factors, mut contacts) = (Vec::new(), Vec::new());
        for index in 0..400 {
            let skin = maker.make(index).unwrap();
            factors.push(skin.forward.rest_conductivity()[7] / forward.rest_conductivity()[7]);
            contacts.push(skin.forward.contact_impedances()[2] / forward.contact_impedances()[2]);
            assert!(skin.shifts_m.iter().all(|shift| *shift == [0.0; 2]));
        }
        for (values, rms) in [(factors, 0.2), (contacts, 0.3)] {
            let (mean, sd) = mean_and_sd(&values);
            println!("mean {mean:.3}, standard deviation {sd:.3} for {rms}");
            assert!((mean - 1.0).abs() < 0.06 && (sd / rms - 1.0).abs() < 0.15);
        }
    }

    #[test]
    fn nodes_stay_on_their_body() {
        let (design, forward) = base("cylinder30");
        let maker = SkinMaker::new(&design, &forward, 4, &spread()).unwrap();
        let skin = maker.make(5).unwrap();
        let moved = skin.shifts_m.iter().filter(|shift| **shift != [0.0; 2]).count();
        assert!(moved > 1000, "{moved} nodes moved");
        for (before, after) in forward.mesh().nodes.iter().zip(&skin.forward.mesh().nodes) {
            assert!((after[0].hypot(after[1]) - 0.05).abs() < 1e-12);
            assert!((0.0..=0.3).contains(&after[2]));
            assert!((before[2] == 0.0) == (after[2] == 0.0) && (before[2] == 0.3) == (after[2] == 0.3));
            assert!(distance(*before, *after) < 0.002 + 1e-9);
        }
    }

    #[test]
    fn electrodes_that_would_fold_the_mesh_are_refused() {
        let (design, forward) = base("cylinder30");
        let far = ElectrodeOptions { displacement_rms_m: 0.01, contact_impedance_rms: 0.3 };
        let error = SkinMaker::new(&design, &forward, 4, &SkinSpread { electrodes: far, ..spread() }).unwrap_err();
        assert!(error.to_string().contains("the mesh between them would fold"), "{error}");
    }
}
