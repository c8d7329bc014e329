//! The presses of experiments: positions and forces.

use crate::elementary::{ln, sin_cos, unrolled};
use crate::random::sample_rng;
use crate::twin::{Press, PressOptions};
use dermis::design::SkinDesign;
use dermis::geom::vector::{Point3, add, cross, dot, normalize, scale, sub};
use dermis::geom::{Surface, TriangleTree};
use dermis::image::PixelSpace;
use dermis::mesh::{Cells, Mesh};
use rand::{Rng, RngExt};
use std::f64::consts::TAU;

/// Each set of presses has its own random streams, from its number plus one times this on: the first ones are those of
/// the frames' noise.
const STREAMS_PER_SET: u64 = 1 << 32;
/// Maximum number of draws for a set of compatible positions.
pub(super) const MAX_DRAWS: usize = 10_000;

/// Step along a body known only by its mesh, m, and the least straight distance of two presses on it over their distance along
/// the surface.
const WALK_M: f64 = 1e-3;
const MIN_STRAIGHT: f64 = 0.8;

/// Presses of one kind, a list for each frame.
#[derive(Debug, Clone, PartialEq)]
pub struct PressSet {
    /// Name for folders and tables.
    pub name: &'static str,
    /// All presses of each frame.
    pub presses: Vec<Vec<Press>>,
    /// For two touches, the distance between them in each frame, m; empty for other sets.
    pub separations_m: Vec<f64>,
}

/// Draws the presses of experiments on one skin: forces are log-uniform and independent of the position; both depend
/// only on the seed and their number.
#[derive(Debug)]
pub struct Presses<'a> {
    pub(super) surface: Surface,
    pixels: &'a PixelSpace,
    /// The design's own surface, to draw positions from.
    mesh: &'a Mesh,
    areas_up_to: Vec<f64>,
    /// The triangles of a body known only by its mesh.
    tree: Option<TriangleTree>,
    design: &'a SkinDesign,
    options: PressOptions,
    seed: u64,
}

impl<'a> Presses<'a> {
    /// Presses on a design with a given mesh and pixels.
    pub fn new(
        design: &'a SkinDesign,
        mesh: &'a Mesh,
        pixels: &'a PixelSpace,
        options: PressOptions,
        seed: u64,
    ) -> Self {
        let mut sum = 0.0;
        let areas_up_to = (0..mesh.cell_count())
            .map(|cell| {
                sum += mesh.cell_measure(cell);
                sum
            })
            .collect();
        let tree = match (&mesh.cells, design.body.surface()) {
            (Cells::Triangles(triangles), Surface::Free) => {
                Some(TriangleTree::new(triangles.iter().map(|corners| corners.map(|node| mesh.nodes[node]))))
            }
            _ => None,
        };
        Presses { surface: design.body.surface(), pixels, mesh, areas_up_to, tree, design, options, seed }
    }

    /// One press at the centre of every `step`-th pixel; with 1 the paper's experiment, with 0 none.
    pub fn on_grid(&self, step: usize) -> PressSet {
        let press = |(number, &centre_m): (usize, &Point3)| vec![self.press(centre_m, &mut self.rng(0, number as u64))];
        let centres_m = self.pixels.centres_m.iter().enumerate();
        PressSet {
            name: "grid",
            presses: centres_m.step_by(step.max(1)).filter(|_| step > 0).map(press).collect(),
            separations_m: vec![],
        }
    }

    /// Single presses at random positions on the skin, rims and seam included.
    pub fn at_random(&self, count: usize) -> PressSet {
        let press = |number| {
            let mut rng = self.rng(1, number);
            vec![self.press(self.place(&mut rng), &mut rng)]
        };
        PressSet { name: "random", presses: (0..count as u64).map(press).collect(), separations_m: vec![] }
    }

    /// Two simultaneous presses, `count` pairs at each separation (m along the surface); pairs that do not fit on the
    /// skin are omitted.
    pub fn in_pairs(&self, separations_m: &[f64], count: usize) -> PressSet {
        let mut set = PressSet { name: "two", presses: vec![], separations_m: vec![] };
        for (step, &separation_m) in separations_m.iter().enumerate() {
            for number in 0..count {
                let mut rng = self.rng(2, (step * count + number) as u64);
                if let Some(pair) = self.pair(separation_m, &mut rng) {
                    set.presses.push(pair.map(|place| self.press(place, &mut rng)).to_vec());
                    set.separations_m.push(separation_m);
                }
            }
        }
        set
    }

    /// Several simultaneous presses with a minimum distance from each other; frames without enough space are omitted.
    pub fn apart(&self, touches: usize, least_m: f64, count: usize) -> PressSet {
        let frame = |number| {
            let mut rng = self.rng(3, number);
            let places = self.places_apart(touches, least_m, &mut rng)?;
            Some(places.into_iter().map(|place| self.press(place, &mut rng)).collect())
        };
        let name = if touches == 4 { "four" } else { "several" };
        PressSet { name, presses: (0..count as u64).filter_map(frame).collect(), separations_m: vec![] }
    }

    /// Presses at some random positions on the skin, each with every force (N), one after the other.
    pub(crate) fn at_fixed_places(&self, places: usize, forces_n: &[f64]) -> PressSet {
        let at_place = |number| {
            let centre_m = self.place(&mut self.rng(4, number));
            let press =
                move |&force_n: &f64| vec![Press { centre_m, force_n, tip_radius_m: self.options.tip_radius_m }];
            forces_n.iter().map(press)
        };
        PressSet { name: "fixed", presses: (0..places as u64).flat_map(at_place).collect(), separations_m: vec![] }
    }

    pub(super) fn rng(&self, set: u64, number: u64) -> impl Rng {
        sample_rng(self.seed, (set + 1) * STREAMS_PER_SET + number)
    }

    fn press(&self, centre_m: Point3, rng: &mut impl Rng) -> Press {
        let force_n = self.options.force_n(rng.random());
        Press { centre_m, force_n, tip_radius_m: self.options.tip_radius_m }
    }

    /// A position, uniform by area.
    pub(super) fn place(&self, rng: &mut impl Rng) -> Point3 {
        if let Surface::Cylinder { radius_m, length_m } = self.surface {
            let (z_m, theta) = (rng.random::<f64>() * length_m, rng.random::<f64>() * TAU);
            let (sine, cosine) = sin_cos(theta);
            return [radius_m * cosine, radius_m * sine, z_m];
        }
        let whole = self.areas_up_to.last().copied().expect("a mesh has cells");
        let at = rng.random::<f64>() * whole;
        let cell = self.areas_up_to.partition_point(|&area| area <= at).min(self.areas_up_to.len() - 1);
        // Exponential deviates over their sum are uniform in a simplex (Devroye, Non-Uniform Random Variate Generation,
        // 1986, XI.2).
        let corners = self.mesh.cells.corners(cell);
        let weights: Vec<f64> = corners.iter().map(|_| -ln(1.0 - rng.random::<f64>())).collect();
        let sum: f64 = weights.iter().sum();
        let add_corner =
            |point, (&node, weight): (&usize, &f64)| add(point, scale(self.mesh.nodes[node], weight / sum));
        corners.iter().zip(&weights).fold([0.0; 3], add_corner)
    }

    fn pair(&self, separation_m: f64, rng: &mut impl Rng) -> Option<[Point3; 2]> {
        (0..MAX_DRAWS).find_map(|_| {
            let first = self.place(rng);
            let second = self.walk(first, rng.random::<f64>() * TAU, separation_m)?;
            let reached_m = self.surface.distance_m(first, second);
            // A body known only by its mesh has straight distances.
            let least_m = if self.tree.is_some() { MIN_STRAIGHT } else { 1.0 - 1e-6 } * separation_m;
            (reached_m >= least_m).then_some([first, second])
        })
    }

    /// The place that is reached from another one straight along the surface, in a direction of the tangent plane; `None` off
    /// the skin. On a body known only by its mesh by steps that are projected onto it.
    pub(super) fn walk(&self, from: Point3, angle_rad: f64, distance_m: f64) -> Option<Point3> {
        let (sine, cosine) = sin_cos(angle_rad);
        let Some(tree) = &self.tree else {
            let place = unrolled(&self.surface).walk(from, [distance_m * cosine, distance_m * sine]);
            return self.design.body.holds(place).then_some(place);
        };
        let normal = |place| {
            let corners = self.mesh.cells.corners(tree.nearest(place).triangle);
            let [a, b, c] = [0, 1, 2].map(|corner| self.mesh.nodes[corners[corner]]);
            normalize(cross(sub(b, a), sub(c, a)))
        };
        let mut place = from;
        let mut up = normal(place);
        // Any axis of the tangent plane: the angle is random.
        let least = (0..3).min_by(|&a, &b| up[a].abs().total_cmp(&up[b].abs())).expect("three axes");
        let mut axis = [0.0; 3];
        axis[least] = 1.0;
        let first = normalize(cross(up, axis));
        let mut ahead = add(scale(first, cosine), scale(cross(up, first), sine));
        let steps = (distance_m / WALK_M).ceil().max(1.0);
        for _ in 0..steps as usize {
            let reached = add(place, scale(ahead, distance_m / steps));
            let nearest = tree.nearest(reached);
            // Beyond a rim nothing is near.
            if nearest.distance_m > 0.5 * WALK_M {
                return None;
            }
            place = nearest.point;
            up = normal(place);
            ahead = normalize(sub(ahead, scale(up, dot(ahead, up))));
        }
        Some(place)
    }

    fn places_apart(&self, touches: usize, least_m: f64, rng: &mut impl Rng) -> Option<Vec<Point3>> {
        (0..MAX_DRAWS).find_map(|_| {
            let places: Vec<Point3> = (0..touches).map(|_| self.place(rng)).collect();
            let is_apart =
                |(i, a): (usize, &Point3)| places[..i].iter().all(|b| self.surface.distance_m(*a, *b) >= least_m);
            places.iter().enumerate().all(is_apart).then_some(places)
        })
    }
}
