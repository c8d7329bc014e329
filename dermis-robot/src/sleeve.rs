//! The body of a skin around a link: a surface at a distance from its mesh, and evenly spread electrodes.

use dermis::design::DesignError;
use dermis::geom::Point3;
use dermis::geom::vector::{add, bounding_box, cross, distance, dot, scale, sub, triangle_area};
use dermis::mesh::export::write_stl;
use std::f64::consts::TAU;

/// Rows and columns of the surface in the distance between two electrodes: finer than a contact.
const ROWS_PER_SPACING: f64 = 5.0;
/// Largest link, m; the longest of industrial robots have 2 m.
const MAX_LINK_M: f64 = 5.0;
/// Shortest skin, smallest radius and narrowest slit, m: what can be printed and wired.
const MIN_LENGTH_M: f64 = 0.01;
const MIN_RADIUS_M: f64 = 0.005;
const MIN_SLIT_M: f64 = 0.002;
/// Steps of Lloyd's iteration.
const STEPS: usize = 60;
/// The part of the rays that may miss the link: more is a hole.
const MISSED: f64 = 0.25;

/// How a skin lies around a link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SleeveOptions {
    /// The axis that it surrounds, of the link's frame: 0 to 2. By default the longest one.
    pub axis: Option<usize>,
    /// From where to where along the axis, m. By default the middle four fifths of the link.
    pub along_m: Option<[f64; 2]>,
    /// From which angle about the axis to which, rad; a full turn is closed.
    pub around_rad: [f64; 2],
    /// Distance between the link and the skin, m.
    pub offset_m: f64,
    /// Number of electrodes.
    pub electrodes: usize,
}

impl Default for SleeveOptions {
    /// A closed sleeve of 30 electrodes, 8 mm from the link: a printed wall of 5 mm and some clearance.
    fn default() -> Self {
        SleeveOptions { axis: None, along_m: None, around_rad: [0.0, TAU], offset_m: 0.008, electrodes: 30 }
    }
}

/// The body of a skin around a link, in the link's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Sleeve {
    /// The triangles of its surface, with their corners to the left seen from outside, m.
    pub triangles: Vec<[Point3; 3]>,
    /// The electrodes on it, in bands along the axis, m.
    pub electrodes_m: Vec<Point3>,
    /// Mean distance of each electrode to the nearest other one, m.
    pub spacing_m: f64,
    /// Smallest and largest distance between the surface and the link along its rays, m.
    pub clearance_m: [f64; 2],
}

impl Sleeve {
    /// A sleeve around the triangles of a link. Rays come from outside, across the axis, and see the outermost surface alone:
    /// shells inside, and how they meet, do not matter.
    ///
    /// # Errors
    /// A part of the link that is not there or has holes; too many electrodes for it.
    pub fn around(link: &[[Point3; 3]], options: &SleeveOptions) -> Result<Self, DesignError> {
        let wrong = |message: String, fix: &str| DesignError::new(message, Some(fix.into()));
        let [low, high] = bounding_box(link.iter().flatten().copied());
        let far_m = low.into_iter().chain(high).fold(0.0, |far: f64, part| far.max(part.abs()));
        if !(0.01..=MAX_LINK_M).contains(&distance(low, high)) || far_m > MAX_LINK_M {
            let message =
                format!("the link is {:.4} m large, and reaches {far_m:.3} m from its frame", distance(low, high));
            let fix = "meshes are read in metres: one in millimetres has scale=\"0.001 0.001 0.001\" in the URDF";
            return Err(wrong(message, fix));
        }
        let longest = || (0..3).max_by(|a, b| (high[*a] - low[*a]).total_cmp(&(high[*b] - low[*b]))).unwrap_or(2);
        let axis = options.axis.unwrap_or_else(longest);
        let length_m = high[axis] - low[axis];
        let along = options.along_m.unwrap_or([low[axis] + 0.1 * length_m, high[axis] - 0.1 * length_m]);
        if along[1] - along[0] < MIN_LENGTH_M {
            return Err(wrong(
                format!("the skin is {:.1} mm long", 1e3 * (along[1] - along[0])),
                "at least 10 mm, with --along",
            ));
        }
        if !(along[0] >= low[axis] && along[1] <= high[axis]) {
            let message = format!(
                "the skin from {:.3} to {:.3} m is not on the link, which is from {:.3} to {:.3} m along {}",
                along[0],
                along[1],
                low[axis],
                high[axis],
                ["x", "y", "z"][axis]
            );
            return Err(wrong(message, "give another part of it with --along"));
        }
        let [from, to] = options.around_rad;
        let turn = to - from;
        if !(0.1..=TAU + 1e-9).contains(&turn) {
            return Err(wrong(format!("the skin goes round by {:.0} degrees", turn.to_degrees()), "from 6 to 360"));
        }
        let rays = Rays { link, axis, reach_m: distance(low, high) };
        // A coarse look, for the size of the surface.
        let coarse = rays.cast(along, [from, turn], [13, 24])?;
        let mean_m = coarse.radii_m.iter().sum::<f64>() / coarse.radii_m.len() as f64 + options.offset_m;
        if mean_m < MIN_RADIUS_M {
            return Err(wrong(
                format!("the link has a radius of {:.1} mm there", 1e3 * mean_m),
                "give another part of it",
            ));
        }
        let slit_m = (TAU - turn) * mean_m;
        if slit_m > 1e-6 && slit_m < MIN_SLIT_M {
            let message = format!("the slit is {:.1} mm wide", 1e3 * slit_m);
            return Err(wrong(message, "at least 2 mm, with --around; or a closed sleeve without it"));
        }
        let area_m2 = (along[1] - along[0]) * turn * mean_m;
        let spacing_m = (area_m2 / options.electrodes as f64).sqrt();
        if spacing_m < 0.006 {
            let message = format!("{} electrodes are {:.1} mm apart on this link", options.electrodes, 1e3 * spacing_m);
            return Err(wrong(message, "fewer, with --electrodes"));
        }
        let step_m = spacing_m / ROWS_PER_SPACING;
        let rows = 1 + ((along[1] - along[0]) / step_m).round().max(4.0) as usize;
        let columns = (turn * mean_m / step_m).round().max(6.0) as usize;
        let grid = rays.cast(along, [from, turn], [rows, columns])?.smoothed(options.offset_m);
        let clearance_m = grid.clearance_m;
        if clearance_m[0] < 0.25 * options.offset_m {
            let message =
                format!("the skin comes within {:.1} mm of the link, which has steps there", 1e3 * clearance_m[0]);
            return Err(wrong(message, "a larger --offset, or another part of the link with --along"));
        }
        let triangles = grid.triangles();
        let electrodes_m = spread(&triangles, options.electrodes, axis, spacing_m);
        let nearest = |place: &Point3| {
            let others = electrodes_m.iter().filter(|other| *other != place);
            others.map(|other| distance(*place, *other)).fold(f64::INFINITY, f64::min)
        };
        let spacing_m = electrodes_m.iter().map(nearest).sum::<f64>() / electrodes_m.len() as f64;
        Ok(Sleeve { triangles, electrodes_m, spacing_m, clearance_m })
    }

    /// The surface as a binary STL file in millimetres.
    pub fn stl(&self) -> Vec<u8> {
        let millimetres = self.triangles.iter().map(|triangle| triangle.map(|corner| scale(corner, 1e3)));
        let mut bytes = Vec::new();
        write_stl(&millimetres.collect::<Vec<_>>(), "dermis, in mm", &mut bytes).expect("memory takes any bytes");
        bytes
    }
}

/// Rays onto a link.
struct Rays<'a> {
    link: &'a [[Point3; 3]],
    axis: usize,
    reach_m: f64,
}

/// Distances from a line along the link, by row along it and column around it.
struct Grid {
    axis: usize,
    along: [f64; 2],
    /// First angle, and angle from the first to the last column, or once around.
    around: [f64; 2],
    shape: [usize; 2],
    /// A point of the line at each row.
    centres: Vec<Point3>,
    radii_m: Vec<f64>,
    clearance_m: [f64; 2],
}

impl Rays<'_> {
    fn cast(&self, along: [f64; 2], around: [f64; 2], shape: [usize; 2]) -> Result<Grid, DesignError> {
        let [rows, columns] = shape;
        let mut grid = Grid {
            axis: self.axis,
            along,
            around,
            shape,
            centres: Vec::with_capacity(rows),
            radii_m: Vec::with_capacity(rows * columns),
            clearance_m: [0.0; 2],
        };
        for row in 0..rows {
            grid.centres.push(self.centre(grid.place(row)));
        }
        grid.smooth_centres();
        let mut missed = 0;
        for row in 0..rows {
            let near = self.near(grid.place(row));
            for column in 0..columns {
                let radius_m = self.radius(&near, grid.centres[row], grid.direction(column));
                missed += usize::from(radius_m.is_nan());
                grid.radii_m.push(radius_m);
            }
        }
        if missed as f64 > MISSED * (rows * columns) as f64 {
            let part = 100.0 * missed as f64 / (rows * columns) as f64;
            let message = format!("{part:.0} % of the link is open there");
            return Err(DesignError::new(message, Some("give another part of it with --along or --around".into())));
        }
        grid.fill();
        Ok(grid)
    }

    /// The triangles that reach a plane across the axis.
    fn near(&self, place: f64) -> Vec<[Point3; 3]> {
        let spans = |triangle: &&[Point3; 3]| {
            let of = triangle.map(|corner| corner[self.axis]);
            of.iter().any(|value| *value <= place) && of.iter().any(|value| *value >= place)
        };
        self.link.iter().filter(spans).copied().collect()
    }

    /// The middle of the link's outline in a plane across the axis.
    fn centre(&self, place: f64) -> Point3 {
        let edges = self.near(place).into_iter().flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]]);
        let crossings = edges.filter_map(|[a, b]| {
            let part = (place - a[self.axis]) / (b[self.axis] - a[self.axis]);
            (0.0..=1.0).contains(&part).then(|| add(a, scale(sub(b, a), part)))
        });
        let [low, high] = bounding_box(crossings);
        let mut centre = scale(add(low, high), 0.5);
        centre[self.axis] = place;
        centre
    }

    /// The distance of the outermost surface from the centre in a direction; `NaN` if there is none.
    fn radius(&self, near: &[[Point3; 3]], centre: Point3, direction: Point3) -> f64 {
        let from = add(centre, scale(direction, self.reach_m));
        let hit = |triangle: &[Point3; 3]| hit(from, scale(direction, -1.0), triangle);
        let first = near.iter().filter_map(hit).fold(f64::INFINITY, f64::min);
        if first < self.reach_m { self.reach_m - first } else { f64::NAN }
    }
}

/// How far along a ray a triangle is hit (Moller, Trumbore 1997, DOI 10.1080/10867651.1997.10487468).
fn hit(from: Point3, direction: Point3, [a, b, c]: &[Point3; 3]) -> Option<f64> {
    let (first, second) = (sub(*b, *a), sub(*c, *a));
    let across = cross(direction, second);
    let determinant = dot(first, across);
    let offset = sub(from, *a);
    let u = dot(offset, across) / determinant;
    let turned = cross(offset, first);
    let v = dot(direction, turned) / determinant;
    let t = dot(second, turned) / determinant;
    // An edge that two triangles share is hit on both.
    let margin = 1e-9;
    (u >= -margin && v >= -margin && u + v <= 1.0 + margin && t > 0.0).then_some(t)
}

impl Grid {
    fn is_closed(&self) -> bool {
        self.around[1] > TAU - 1e-6
    }

    fn place(&self, row: usize) -> f64 {
        self.along[0] + (self.along[1] - self.along[0]) * row as f64 / (self.shape[0] - 1) as f64
    }

    /// The direction of a column, across the axis.
    fn direction(&self, column: usize) -> Point3 {
        let count = if self.is_closed() { self.shape[1] } else { self.shape[1] - 1 };
        let (sin, cos) = (self.around[0] + self.around[1] * column as f64 / count as f64).sin_cos();
        let mut direction = [0.0; 3];
        direction[(self.axis + 1) % 3] = cos;
        direction[(self.axis + 2) % 3] = sin;
        direction
    }

    /// The means of neighbours: a line that bends as the link does, and does not jump at its steps.
    fn smooth_centres(&mut self) {
        let rows = self.centres.len();
        // Between two shells there is no outline: the middle of the nearest one.
        let known: Vec<usize> =
            (0..rows).filter(|&row| self.centres[row].iter().all(|part| part.is_finite())).collect();
        for row in 0..rows {
            if let Some(nearest) = known.iter().min_by_key(|known| known.abs_diff(row)) {
                let place = self.place(row);
                self.centres[row] = self.centres[*nearest];
                self.centres[row][self.axis] = place;
            }
        }
        for _ in 0..2 * rows {
            let before = self.centres.clone();
            for row in 0..rows {
                let [a, b] = [before[row.saturating_sub(1)], before[(row + 1).min(rows - 1)]];
                let mean = scale(add(add(a, b), scale(before[row], 2.0)), 0.25);
                for axis in (0..3).filter(|axis| *axis != self.axis) {
                    self.centres[row][axis] = mean[axis];
                }
            }
        }
    }

    /// The neighbours of a place of the grid, itself included.
    fn around(&self, index: usize) -> impl Iterator<Item = usize> {
        let [rows, columns] = self.shape;
        let (row, column) = (index / columns, index % columns);
        let is_closed = self.is_closed();
        (row.saturating_sub(1)..=(row + 1).min(rows - 1)).flat_map(move |row| {
            [columns - 1, 0, 1].into_iter().filter_map(move |step| {
                let sum = column + step;
                // The first step is one back, around the closed sleeve.
                let inside = is_closed || (sum >= columns) == (step == columns - 1);
                inside.then_some(row * columns + sum % columns)
            })
        })
    }

    /// Fills gaps from their neighbours.
    fn fill(&mut self) {
        while self.radii_m.iter().any(|radius| radius.is_nan()) {
            let before = self.radii_m.clone();
            for index in (0..before.len()).filter(|&index| before[index].is_nan()) {
                let known: Vec<f64> =
                    self.around(index).map(|near| before[near]).filter(|near| !near.is_nan()).collect();
                if !known.is_empty() {
                    self.radii_m[index] = known.iter().sum::<f64>() / known.len() as f64;
                }
            }
        }
    }

    /// The surface at a distance: the largest of the neighbours, so that steps stay inside, then their means.
    fn smoothed(mut self, offset_m: f64) -> Self {
        let link = self.radii_m.clone();
        let each = |grid: &Grid, of: &dyn Fn(&[f64]) -> f64| -> Vec<f64> {
            let near = |index: usize| grid.around(index).map(|near| grid.radii_m[near]).collect::<Vec<_>>();
            (0..grid.radii_m.len()).map(|index| of(&near(index))).collect()
        };
        self.radii_m = each(&self, &|near| near.iter().copied().fold(0.0, f64::max));
        for _ in 0..3 {
            self.radii_m = each(&self, &|near| near.iter().sum::<f64>() / near.len() as f64);
        }
        self.radii_m.iter_mut().for_each(|radius| *radius += offset_m);
        let apart = self.radii_m.iter().zip(&link).map(|(skin, link)| skin - link);
        self.clearance_m = [apart.clone().fold(f64::INFINITY, f64::min), apart.fold(0.0, f64::max)];
        self
    }

    fn triangles(&self) -> Vec<[Point3; 3]> {
        let [rows, columns] = self.shape;
        let point = |row: usize, column: usize| {
            let column = column % columns;
            add(self.centres[row], scale(self.direction(column), self.radii_m[row * columns + column]))
        };
        let count = if self.is_closed() { columns } else { columns - 1 };
        let squares = (0..rows - 1).flat_map(|row| (0..count).map(move |column| (row, column)));
        let both = |(row, column): (usize, usize)| {
            let [a, b] = [point(row, column), point(row, column + 1)];
            let [c, d] = [point(row + 1, column), point(row + 1, column + 1)];
            // In turn, so that the surface looks the same in both directions.
            if (row + column) % 2 == 0 { [[a, b, d], [a, d, c]] } else { [[a, b, c], [b, d, c]] }
        };
        squares.flat_map(both).collect()
    }
}

/// Places spread evenly over triangles by Lloyd's iteration (Lloyd 1982, DOI 10.1109/TIT.1982.1056489), in bands along an axis.
fn spread(triangles: &[[Point3; 3]], count: usize, axis: usize, spacing_m: f64) -> Vec<Point3> {
    let samples: Vec<(Point3, f64)> = triangles.iter().flat_map(|triangle| quarters(*triangle)).collect();
    // Each one farthest from those before.
    let mut places = vec![samples[0].0];
    let mut away: Vec<f64> = samples.iter().map(|(sample, _)| distance(*sample, places[0])).collect();
    while places.len() < count {
        let farthest = (0..samples.len()).max_by(|a, b| away[*a].total_cmp(&away[*b])).unwrap_or(0);
        places.push(samples[farthest].0);
        let last = samples[farthest].0;
        away.iter_mut().zip(&samples).for_each(|(away, (sample, _))| *away = away.min(distance(*sample, last)));
    }
    let nearest_of = |place: Point3, places: &[Point3]| {
        (0..places.len())
            .min_by(|a, b| distance(place, places[*a]).total_cmp(&distance(place, places[*b])))
            .unwrap_or(0)
    };
    for _ in 0..STEPS {
        let mut sums = vec![([0.0; 3], 0.0); count];
        for (sample, area) in &samples {
            let (sum, weight) = &mut sums[nearest_of(*sample, &places)];
            (*sum, *weight) = (add(*sum, scale(*sample, *area)), *weight + area);
        }
        for (place, (sum, weight)) in places.iter_mut().zip(sums).filter(|(_, (_, weight))| *weight > 0.0) {
            *place = scale(sum, 1.0 / weight);
        }
    }
    // Means lie inside a curved surface.
    let points: Vec<Point3> = samples.iter().map(|(sample, _)| *sample).collect();
    places.iter_mut().for_each(|place| *place = points[nearest_of(*place, &points)]);
    let [low, high] = bounding_box(points.iter().copied());
    let bands = ((high[axis] - low[axis]) / spacing_m).round().max(1.0);
    let middle = scale(add(low, high), 0.5);
    let key = |place: &Point3| {
        let band = ((place[axis] - low[axis]) / (high[axis] - low[axis]) * bands).floor().min(bands - 1.0);
        let [u, v] = [1, 2].map(|step| place[(axis + step) % 3] - middle[(axis + step) % 3]);
        (band, v.atan2(u))
    };
    places.sort_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal));
    places
}

/// The centres and areas of the quarters of a triangle.
fn quarters([a, b, c]: [Point3; 3]) -> [(Point3, f64); 4] {
    let middle = |a: Point3, b: Point3| scale(add(a, b), 0.5);
    let [d, e, f] = [middle(a, b), middle(b, c), middle(c, a)];
    [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
        .map(|part @ [a, b, c]| (scale(add(add(a, b), c), 1.0 / 3.0), triangle_area(part)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cylinder along y with 40 sides, moved in x.
    fn cylinder(radius_m: f64, length_m: f64) -> Vec<[Point3; 3]> {
        let point = |k: usize, y: f64| {
            let (sin, cos) = (TAU * k as f64 / 40.0).sin_cos();
            [0.2 + radius_m * cos, y, radius_m * sin]
        };
        let side = |k: usize| {
            let [a, b, c, d] = [point(k, 0.0), point(k + 1, 0.0), point(k, length_m), point(k + 1, length_m)];
            [[a, b, c], [b, d, c]]
        };
        (0..40).flat_map(side).collect()
    }

    #[test]
    fn a_sleeve_around_a_cylinder_is_a_cylinder_at_its_distance() {
        // A tube inside does not matter.
        let link = [cylinder(0.04, 0.3), cylinder(0.02, 0.3)].concat();
        let options = SleeveOptions { along_m: Some([0.05, 0.25]), ..SleeveOptions::default() };
        let sleeve = Sleeve::around(&link, &options).unwrap();
        for [x, y, z] in sleeve.triangles.iter().flatten() {
            // The sides of a polygon of 40 corners are 0.12 mm inside its circle.
            assert!(
                ((x - 0.2).hypot(*z) - 0.048).abs() < 2e-4 && (0.05 - 1e-9..=0.25 + 1e-9).contains(y),
                "{x} {y} {z}"
            );
        }
        let area: f64 = sleeve.triangles.iter().map(|triangle| triangle_area(*triangle)).sum();
        assert!((area / (TAU * 0.048 * 0.2) - 1.0).abs() < 0.01, "{area}");
        let outward = sleeve.triangles.iter().all(|[a, b, c]| {
            let middle = scale(add(add(*a, *b), *c), 1.0 / 3.0);
            dot(cross(sub(*b, *a), sub(*c, *a)), [middle[0] - 0.2, 0.0, middle[2]]) > 0.0
        });
        assert!(outward);
        // Even: hexagons of this area have neighbours 1.07 times the root of their area apart.
        let ideal = (2.0 / 3.0_f64.sqrt() * area / 30.0).sqrt();
        assert_eq!(sleeve.electrodes_m.len(), 30);
        assert!((0.75..1.05).contains(&(sleeve.spacing_m / ideal)), "{} {ideal}", sleeve.spacing_m);
    }

    #[test]
    fn a_gap_between_two_shells_is_covered() {
        let far = cylinder(0.04, 0.1).into_iter().map(|triangle| triangle.map(|[x, y, z]| [x, y + 0.12, z]));
        let link: Vec<_> = cylinder(0.04, 0.1).into_iter().chain(far).collect();
        let sleeve = Sleeve::around(&link, &SleeveOptions::default()).unwrap();
        assert!(sleeve.triangles.iter().flatten().all(|[x, _, z]| ((x - 0.2).hypot(*z) - 0.048).abs() < 2e-4));
    }

    #[test]
    fn an_open_sleeve_leaves_its_slit_free() {
        let around_rad = [0.3, TAU - 0.3];
        let options = SleeveOptions { along_m: Some([0.05, 0.25]), around_rad, ..SleeveOptions::default() };
        let sleeve = Sleeve::around(&cylinder(0.04, 0.3), &options).unwrap();
        // Angles about y run from z to x.
        let angle = |[x, _, z]: &Point3| (x - 0.2).atan2(*z).rem_euclid(TAU);
        assert!(
            sleeve.triangles.iter().flatten().map(angle).all(|angle| (0.3 - 1e-6..=TAU - 0.3 + 1e-6).contains(&angle))
        );
    }

    #[test]
    fn a_part_that_is_not_there_is_named() {
        let refused = |options: SleeveOptions| Sleeve::around(&cylinder(0.04, 0.3), &options).unwrap_err().to_string();
        let options = SleeveOptions::default();
        assert!(
            refused(SleeveOptions { along_m: Some([0.2, 0.4]), ..options }).contains("from 0.000 to 0.300 m along y")
        );
        let half = &cylinder(0.04, 0.3)[..40];
        let open = Sleeve::around(half, &SleeveOptions { axis: Some(1), ..options }).unwrap_err().to_string();
        assert!(open.contains("of the link is open there"), "{open}");
        assert!(refused(SleeveOptions { electrodes: 20_000, ..options }).contains("mm apart on this link"));
        assert!(refused(SleeveOptions { around_rad: [1.0, 0.5], ..options }).contains("degrees"));
    }
}
