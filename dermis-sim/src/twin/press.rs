//! A press and its footprint: the pressure on the sheet below the foam.

use super::error::{check_between, check_positive};
use super::{Foam, TwinError};
use crate::elementary::{acos, atan2, cos, hypot, replace_in_lanes};
use crate::quadrature::gauss_legendre;
use dermis::design::Body;
use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::mesh::Mesh;
use pulp::{Simd, WithSimd};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Number of values of the profile's table; the pressure between them is interpolated with third order.
const PROFILE_STEPS: usize = 48;
/// The footprint extends this many foam thicknesses beyond the tip's contact. In a half space the pressure of a point
/// load still has 3 % of the force beyond this radius, but below a layer on a stiff ground it decreases exponentially.
const REACH_THICKNESSES: f64 = 3.0;
/// Steps of the integral over circles that are clipped by an edge of the body; their length as a function of the radius
/// has a square-root singularity at each edge, so the error decreases with the power 3/2 of this number.
const RIM_STEPS: usize = 600;
/// A press within this distance of the surface counts as on it, m: positions in files are rounded.
const OFF_SURFACE_M: f64 = 1e-3;

/// Ranges of forces and tips.
pub(crate) const FORCES_N: [f64; 2] = [1e-6, 1e4];
pub(crate) const TIP_RADII_M: [f64; 2] = [1e-5, 1.0];

/// A spherical tip pressed on the skin with a force.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Press {
    /// The intersection of the tip's axis with the skin, m.
    pub centre_m: Point3,
    /// Force on the skin along its inward normal, N.
    pub force_n: f64,
    /// Radius of the tip, m.
    pub tip_radius_m: f64,
}

impl Press {
    /// On a body known only by its mesh, a centre must be within a distance of a node.
    ///
    /// # Errors
    /// A force or radius that is not positive, a centre off the skin.
    pub(super) fn check(&self, body: &Body, mesh: &Mesh, near_m: f64) -> Result<(), TwinError> {
        if !matches!(body, Body::Mesh { .. }) {
            return self.check_on(body);
        }
        self.check_size()?;
        let off_m = mesh.nodes.iter().map(|&node| distance(node, self.centre_m)).fold(f64::INFINITY, f64::min);
        if off_m <= near_m {
            return Ok(());
        }
        let skin = format!("whose nearest node is {off_m:.4} m away");
        Err(TwinError::OffTheSkin { centre_m: self.centre_m, skin })
    }

    /// # Errors
    /// As [`check`](Self::check); a body without a chart.
    fn check_on(&self, body: &Body) -> Result<(), TwinError> {
        self.check_size()?;
        check_on_body(self.centre_m, body)
    }

    fn check_size(&self) -> Result<(), TwinError> {
        check_positive("force_n", self.force_n, "newtons, as the skin feels it")?;
        check_positive("tip_radius_m", self.tip_radius_m, "a 10 mm ball is 0.005")?;
        check_between("force_n", self.force_n, FORCES_N, "newtons, as the skin feels it")?;
        check_between("tip_radius_m", self.tip_radius_m, TIP_RADII_M, "a 10 mm ball is 0.005")
    }
}

/// The pressure of one press on the sheet, as a function of the distance along it.
///
/// The tip presses on the foam as on an elastic foundation (Johnson, Contact Mechanics, 1985, section 4.3, DOI
/// 10.1017/CBO9781139171731): with modulus `E` and thickness `h`,
///
/// `p(r) = (E/h) (delta - r^2 / (2R)) = 2F / (pi a^2) (1 - r^2 / a^2)`, `a^2 = 2 R delta`, `F = pi R E delta^2 / h`,
///
/// or on rubber as on an elastic half space (Hertz; Johnson, equations 4.22 to 4.24), `E` being Young's modulus over
/// `1 - nu^2`:
///
/// `p(r) = 3F / (2 pi a^2) sqrt(1 - r^2 / a^2)`, `a^2 = R delta`, `a^3 = 3 F R / (4 E)`.
///
/// Through the foam each point load spreads as in an elastic half space (Boussinesq; Johnson, equation 3.19; used for
/// tactile sensors by Fearing and Hollerbach, 1985, DOI 10.1177/027836498500400303),
///
/// `p(d) = 3 F h^3 / (2 pi (d^2 + h^2)^(5/2))`,
///
/// for any modulus and Poisson's ratio. Beyond `a + 3 h` the pressure is zero; the remaining pressure of the half space
/// there, and the part off the body, are distributed proportionally over the rest, so that the integral over the skin
/// equals the force.
#[derive(Debug, Clone)]
pub(crate) struct Footprint {
    centre_m: Point3,
    reach_m: f64,
    /// Pressures at equal steps from the centre to the outer radius, where it is zero, Pa; before them the second one (the
    /// profile is even), behind them a zero.
    profile_pa: [f64; PROFILE_STEPS + 3],
}

impl Footprint {
    /// The footprint of a press on a body under foam.
    ///
    /// # Errors
    /// A force or radius that is not positive, a centre off the skin, a tip whose indentation exceeds the foam
    /// thickness.
    pub(crate) fn new(press: &Press, foam: &Foam, body: &Body) -> Result<Self, TwinError> {
        let radius_m = contact_radius_m(press, foam, body)?;
        let reach_m = radius_m + REACH_THICKNESSES * foam.thickness_m;
        let spread = spread(press.force_n, radius_m, reach_m, foam);
        let mut profile_pa = [0.0; PROFILE_STEPS + 3];
        profile_pa[0] = spread[1];
        profile_pa[1..PROFILE_STEPS + 2].copy_from_slice(&spread);
        let mut footprint = Footprint { centre_m: press.centre_m, reach_m, profile_pa };
        let scale = press.force_n / footprint.integral(body);
        footprint.profile_pa.iter_mut().for_each(|pressure| *pressure *= scale);
        Ok(footprint)
    }

    /// The footprints of some presses.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(crate) fn of_all(presses: &[Press], foam: &Foam, body: &Body) -> Result<Vec<Self>, TwinError> {
        presses.iter().map(|press| Footprint::new(press, foam, body)).collect()
    }

    /// The [reach](Self::reach_m) of a press, without its footprint.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(crate) fn reach_of(press: &Press, foam: &Foam, body: &Body) -> Result<f64, TwinError> {
        Ok(contact_radius_m(press, foam, body)? + REACH_THICKNESSES * foam.thickness_m)
    }

    /// The centre of the press.
    pub(crate) fn centre_m(&self) -> Point3 {
        self.centre_m
    }

    /// Beyond this distance from the centre the pressure is zero, m.
    pub(crate) fn reach_m(&self) -> f64 {
        self.reach_m
    }

    /// The pressure at a distance from the centre along the surface, Pa.
    pub(crate) fn pressure_pa(&self, distance_m: f64) -> f64 {
        let [pressure] = self.pressures_pa(&[distance_m]);
        pressure
    }

    /// Adds the pressures at some distances from the centre along the surface, m, to sums, Pa. `own` is memory.
    pub(crate) fn add_pressures(&self, distances_m: impl Iterator<Item = f64>, own: &mut Vec<f64>, sums: &mut [f64]) {
        own.clear();
        own.extend(distances_m);
        self.replace_by_pressures(own);
        sums.iter_mut().zip(own).for_each(|(sum, pressure)| *sum += *pressure);
    }

    /// Replaces distances by pressures.
    fn replace_by_pressures(&self, values: &mut [f64]) {
        replace_in_lanes(values, |distances_m| self.pressures_pa(distances_m));
    }

    /// Pressures at some distances: Lagrange's cubic through the four nearest values of the profile.
    #[inline(always)]
    fn pressures_pa<const COUNT: usize>(&self, distances_m: &[f64; COUNT]) -> [f64; COUNT] {
        let places = distances_m.map(|distance_m| distance_m / self.reach_m * PROFILE_STEPS as f64);
        let steps = places.map(|place| (place as usize).min(PROFILE_STEPS - 1));
        let nearest = steps.map(|step| [0, 1, 2, 3].map(|k| self.profile_pa[step + k]));
        let mut pressures = [0.0; COUNT];
        for lane in 0..COUNT {
            let t = places[lane] - steps[lane] as f64;
            let (one, [a, b, c, d]) = (t + 1.0, nearest[lane]);
            let value = -t * (t - 1.0) * (t - 2.0) / 6.0 * a + one * (t - 1.0) * (t - 2.0) / 2.0 * b
                - one * t * (t - 2.0) / 2.0 * c
                + one * t * (t - 1.0) / 6.0 * d;
            pressures[lane] = if places[lane] < PROFILE_STEPS as f64 { value.max(0.0) } else { 0.0 };
        }
        pressures
    }

    /// The integral over the part of the surface on the body, N.
    fn integral(&self, body: &Body) -> f64 {
        let edges = Edge::of(body, self.centre_m);
        let nearest_m = edges.iter().map(Edge::distance_m).fold(f64::INFINITY, f64::min);
        let step = self.reach_m / RIM_STEPS as f64;
        let radius = |k: usize| (k as f64 + 0.5) * step;
        let mut pressures: Vec<f64> = (0..RIM_STEPS).map(radius).collect();
        self.replace_by_pressures(&mut pressures);
        let ring = |(k, pressure): (usize, f64)| {
            let radius = radius(k);
            let share = if radius <= nearest_m { 1.0 } else { share_inside(&edges, radius) };
            pressure * TAU * radius * share * step
        };
        pressures.into_iter().enumerate().map(ring).sum()
    }
}

/// The radius of the contact between tip and foam of a press that is possible, m.
fn contact_radius_m(press: &Press, foam: &Foam, body: &Body) -> Result<f64, TwinError> {
    press.check_on(body)?;
    let depth_m = foam.depth_m(press);
    if depth_m >= foam.thickness_m {
        return Err(TwinError::FoamCrushed {
            force_n: press.force_n,
            tip_radius_m: press.tip_radius_m,
            depth_mm: depth_m * 1e3,
            thickness_mm: foam.thickness_m * 1e3,
        });
    }
    Ok(foam.contact_radius_m(press))
}

/// The pressure below the foam at equal steps, minus its value at the outer radius, so that it ends without a jump.
fn spread(force_n: f64, radius_m: f64, reach_m: f64, foam: &Foam) -> Vec<f64> {
    let h = foam.thickness_m;
    let panels = 2 + (2.0 * radius_m / h).ceil() as usize;
    let angles = 8 * (1 + (radius_m / h).ceil() as usize);
    let cosines: Vec<f64> = (0..angles).map(|k| cos(PI * (k as f64 + 0.5) / angles as f64)).collect();
    // Rings of the tip's pressure, as forces.
    let width = radius_m / panels as f64;
    let gauss = gauss_legendre(foam.indentation.points_per_panel());
    let rings: Vec<(f64, f64)> = (0..panels)
        .flat_map(|panel| {
            gauss.iter().map(move |(t, weight)| ((panel as f64 + 0.5 * (1.0 + t)) * width, 0.5 * weight * width))
        })
        .map(|(s, weight)| foam.indentation.ring(force_n, radius_m, s, weight))
        .collect();
    let radii: Vec<f64> = (0..=PROFILE_STEPS).map(|k| reach_m * k as f64 / PROFILE_STEPS as f64).collect();
    let mut profile = vec![0.0; radii.len()];
    let kernel = Spread { cosines: &cosines, rings: &rings, radii: &radii, h, profile: &mut profile };
    pulp::Arch::new().dispatch(kernel);
    let end = profile[PROFILE_STEPS];
    profile.into_iter().map(|pressure| (pressure - end).max(0.0)).collect()
}

/// The pressure of rings of force at depth `h`, at some radii: the mean over the angles of Boussinesq's pressure of a unit
/// load, `3 h^3 / (2 pi (d^2 + h^2)^(5/2))`.
struct Spread<'a> {
    /// Of the angles, in a multiple of eight.
    cosines: &'a [f64],
    /// Radius and force.
    rings: &'a [(f64, f64)],
    radii: &'a [f64],
    h: f64,
    profile: &'a mut [f64],
}

impl WithSimd for Spread<'_> {
    type Output = ();

    /// Compiled once per instruction set, with the same bits: no operation is fused, and the sums have eight parts
    /// everywhere.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Spread { cosines, rings, radii, h, profile } = self;
        let scale = 3.0 * h * h * h / TAU;
        for (pressure, &r) in profile.iter_mut().zip(radii) {
            for &(s, force) in rings {
                let (near, twice) = (r * r + s * s + h * h, 2.0 * r * s);
                let mut sums = [0.0; 8];
                for cosines in cosines.as_chunks::<8>().0 {
                    for (sum, cosine) in sums.iter_mut().zip(cosines) {
                        let q = near - twice * cosine;
                        *sum += 1.0 / (q * q * q.sqrt());
                    }
                }
                *pressure += force * scale * sums.iter().sum::<f64>() / cosines.len() as f64;
            }
        }
    }
}

/// One edge of a body relative to a point inside.
enum Edge {
    /// A straight edge at this distance in this direction.
    Straight { distance_m: f64, angle_rad: f64 },
    /// The rim of a disk, with its centre at this distance in the direction opposite to the angle.
    Round { radius_m: f64, off_centre_m: f64, angle_rad: f64 },
}

impl Edge {
    fn of(body: &Body, [x, y, z]: Point3) -> Vec<Edge> {
        let straight = |distance_m: f64, angle_rad: f64| Edge::Straight { distance_m, angle_rad };
        match *body {
            Body::Cylinder { length_m, .. } => vec![straight(z, -PI / 2.0), straight(length_m - z, PI / 2.0)],
            Body::Rectangle { width_m, height_m } => vec![
                straight(x, PI),
                straight(width_m - x, 0.0),
                straight(y, -PI / 2.0),
                straight(height_m - y, PI / 2.0),
            ],
            Body::Disk { diameter_m } => {
                vec![Edge::Round { radius_m: diameter_m / 2.0, off_centre_m: hypot(x, y), angle_rad: atan2(y, x) }]
            }
            Body::Mesh { .. } => Vec::new(),
        }
    }

    /// Its distance from the point, m.
    fn distance_m(&self) -> f64 {
        match *self {
            Edge::Straight { distance_m, .. } => distance_m,
            Edge::Round { radius_m, off_centre_m, .. } => radius_m - off_centre_m,
        }
    }

    /// The arc of a circle around the point that is beyond the edge: its middle and half its angle.
    fn arc_beyond(&self, circle_m: f64) -> (f64, f64) {
        match *self {
            Edge::Straight { distance_m, angle_rad } => (angle_rad, acos((distance_m / circle_m).clamp(-1.0, 1.0))),
            Edge::Round { radius_m, off_centre_m, angle_rad } => {
                let excess = radius_m * radius_m - off_centre_m * off_centre_m - circle_m * circle_m;
                let across = 2.0 * off_centre_m * circle_m;
                // At the disk's own centre the whole circle is either inside or outside.
                let cosine = if across > 0.0 { excess / across } else { excess.signum() };
                (angle_rad, acos(cosine.clamp(-1.0, 1.0)))
            }
        }
    }
}

/// The fraction of a circle that is inside all edges.
fn share_inside(edges: &[Edge], circle_m: f64) -> f64 {
    let mut arcs: Vec<[f64; 2]> = Vec::new();
    for (middle, half) in edges.iter().map(|edge| edge.arc_beyond(circle_m)).filter(|(_, half)| *half > 0.0) {
        // Split where the angle jumps, so that arcs are intervals of [0, 2 pi].
        let start = (middle - half).rem_euclid(TAU);
        let end = start + 2.0 * half;
        arcs.push([start, end.min(TAU)]);
        if end > TAU {
            arcs.push([0.0, end - TAU]);
        }
    }
    arcs.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let (mut covered, mut reached) = (0.0, 0.0f64);
    for [start, end] in arcs {
        covered += (end - start.max(reached)).max(0.0);
        reached = reached.max(end);
    }
    1.0 - covered / TAU
}

fn check_on_body(centre_m: Point3, body: &Body) -> Result<(), TwinError> {
    let [x, y, z] = centre_m;
    let within = |value: f64, size: f64| (-OFF_SURFACE_M..=size + OFF_SURFACE_M).contains(&value);
    let (on_skin, skin) = match *body {
        Body::Cylinder { length_m, diameter_m } => (
            (hypot(x, y) - diameter_m / 2.0).abs() <= OFF_SURFACE_M && within(z, length_m),
            format!("a cylinder of radius {} m and z from 0 to {length_m} m", diameter_m / 2.0),
        ),
        Body::Rectangle { width_m, height_m } => (
            within(x, width_m) && within(y, height_m) && z.abs() <= OFF_SURFACE_M,
            format!("a rectangle from (0, 0) to ({width_m}, {height_m}) m"),
        ),
        Body::Disk { diameter_m } => (
            distance(centre_m, [0.0; 3]) <= diameter_m / 2.0 + OFF_SURFACE_M && z.abs() <= OFF_SURFACE_M,
            format!("a disk of radius {} m", diameter_m / 2.0),
        ),
        Body::Mesh { .. } => return Err(TwinError::NoChart),
    };
    if on_skin { Ok(()) } else { Err(TwinError::OffTheSkin { centre_m, skin }) }
}

#[cfg(test)]
mod tests {
    use super::super::Indentation;
    use super::*;

    /// Boussinesq's pressure of a unit load at depth `h`, as a function of the squared distance.
    fn kernel(distance_squared: f64, h: f64) -> f64 {
        let q = distance_squared + h * h;
        3.0 * h * h * h / (TAU * q * q * q.sqrt())
    }

    const FOAM: Foam = Foam { thickness_m: 0.003, modulus_pa: 2e5, indentation: Indentation::Foundation };
    const RUBBER: Foam = Foam { thickness_m: 0.002, modulus_pa: 1e6, indentation: Indentation::HalfSpace };
    const SHEET: Body = Body::Rectangle { width_m: 0.2, height_m: 0.1 };

    fn press(x: f64, y: f64) -> Press {
        Press { centre_m: [x, y, 0.0], force_n: 2.0, tip_radius_m: 0.005 }
    }

    /// The integral of the footprint over the part of a body by the midpoint rule on a grid of 0.1 mm, N.
    fn force_on(body: &Body, press: &Press, foam: &Foam) -> f64 {
        let footprint = Footprint::new(press, foam, body).unwrap();
        let step = 1e-4;
        let steps = (footprint.reach_m() / step).ceil() as i64;
        let inside = |x: f64, y: f64| match *body {
            Body::Disk { diameter_m } => x.hypot(y) < diameter_m / 2.0,
            Body::Rectangle { width_m, height_m } => (0.0..width_m).contains(&x) && (0.0..height_m).contains(&y),
            Body::Cylinder { length_m, .. } => (0.0..length_m).contains(&y),
            Body::Mesh { .. } => false,
        };
        // On the cylinder x is around it, and y along.
        let [x0, y0] = match body {
            Body::Cylinder { .. } => [0.0, press.centre_m[2]],
            _ => [press.centre_m[0], press.centre_m[1]],
        };
        let mut force = 0.0;
        for i in -steps..steps {
            for j in -steps..steps {
                let (dx, dy) = ((i as f64 + 0.5) * step, (j as f64 + 0.5) * step);
                if inside(x0 + dx, y0 + dy) {
                    force += footprint.pressure_pa(dx.hypot(dy)) * step * step;
                }
            }
        }
        force
    }

    /// Conservation: the total pressure on the sheet equals the force, for any position of the tip.
    #[test]
    fn the_pressure_integrates_to_the_force() {
        let cylinder = Body::Cylinder { length_m: 0.3, diameter_m: 0.1 };
        let on_wall = |z: f64| Press { centre_m: [0.0, -0.05, z], force_n: 2.0, tip_radius_m: 0.005 };
        let cases = [
            ("the middle", SHEET, press(0.1, 0.05), 1e-4),
            ("an edge", SHEET, press(0.1, 0.003), 1e-3),
            ("a corner", SHEET, press(0.001, 0.1), 1e-3),
            ("a disk's rim", Body::Disk { diameter_m: 0.08 }, press(-0.03, 0.024), 1e-3),
            ("a cylinder's rim", cylinder.clone(), on_wall(0.298), 1e-3),
            ("a cylinder's wall", cylinder, on_wall(0.15), 1e-4),
        ];
        for (place, body, press, tolerance) in cases {
            for foam in [FOAM, RUBBER] {
                let error = force_on(&body, &press, &foam) / press.force_n - 1.0;
                println!("force on the sheet at {place}: relative error {error:.1e}");
                assert!(error.abs() < tolerance, "{place}: {error}");
            }
        }
    }

    /// The table and its interpolation compared with the same integral by a fine midpoint rule.
    #[test]
    fn the_profile_is_the_convolution_of_tip_and_foam() {
        let press = press(0.1, 0.05);
        let (a, h) = (FOAM.contact_radius_m(&press), FOAM.thickness_m);
        let footprint = Footprint::new(&press, &FOAM, &SHEET).unwrap();
        let exact = |r: f64| {
            let (n, m) = (400, 200);
            let mut sum = 0.0;
            for i in 0..n {
                let s = (i as f64 + 0.5) * a / n as f64;
                let force = 4.0 * press.force_n * s / (a * a) * (1.0 - s * s / (a * a)) * a / n as f64;
                for j in 0..m {
                    let angle = PI * (j as f64 + 0.5) / m as f64;
                    sum += force / m as f64 * kernel(r * r + s * s - 2.0 * r * s * angle.cos(), h);
                }
            }
            sum
        };
        let end = exact(footprint.reach_m());
        let scale = footprint.pressure_pa(0.0) / (exact(0.0) - end);
        println!(
            "contact radius {:.2} mm, reach {:.1} mm, peak {:.1} kPa; cutting the tail raises the rest by {:.1} %",
            a * 1e3,
            footprint.reach_m() * 1e3,
            footprint.pressure_pa(0.0) / 1e3,
            (scale - 1.0) * 100.0
        );
        assert!((1.0..1.1).contains(&scale));
        for r in [0.00031, 0.0017, 0.0033, 0.00512, 0.0091] {
            let error = (footprint.pressure_pa(r) - scale * (exact(r) - end)) / footprint.pressure_pa(0.0);
            assert!(error.abs() < 1e-5, "at {r} m: {error}");
        }
    }

    /// On the axis of Hertz's contact the half space has the pressure `3F / (2 pi a^2) / (1 + h^2 / a^2)` at the depth `h`
    /// (Johnson, equation 3.45); far away it is that of a point load.
    #[test]
    fn the_pressure_in_a_half_space_is_exact_on_the_axis() {
        for force_n in [0.01, 2.0, 5.0] {
            let press = Press { force_n, ..press(0.1, 0.05) };
            let (a, h) = (RUBBER.contact_radius_m(&press), RUBBER.thickness_m);
            // So far that the pressure there, which is subtracted, is zero.
            let reach_m = 48.0;
            let profile = spread(force_n, a, reach_m, &RUBBER);
            let exact = 3.0 * force_n / (TAU * a * a) / (1.0 + h * h / (a * a));
            let error = profile[0] / exact - 1.0;
            println!("{force_n} N: {exact:.4e} Pa below the tip, relative error {error:.1e}");
            assert!(error.abs() < 1e-5);
            let at_1_m = kernel(1.0, h) - kernel(reach_m * reach_m, h);
            assert!((profile[1] / (force_n * at_1_m) - 1.0).abs() < 1e-4);
        }
    }

    /// Hertz: `F = 4/3 E sqrt(R) delta^(3/2)`.
    #[test]
    fn depth_and_contact_follow_the_half_space() {
        let press = press(0.1, 0.05);
        let depth = RUBBER.depth_m(&press);
        let force = 4.0 / 3.0 * RUBBER.modulus_pa * press.tip_radius_m.sqrt() * depth.powf(1.5);
        assert!((force / press.force_n - 1.0).abs() < 1e-12);
        let eight_times = Press { force_n: 16.0, ..press };
        assert!((RUBBER.depth_m(&eight_times) / depth - 4.0).abs() < 1e-12);
        let crushed = Footprint::new(&eight_times, &RUBBER, &SHEET).unwrap_err();
        assert!(matches!(crushed, TwinError::FoamCrushed { .. }), "{crushed}");
    }

    /// The laws of the foundation: `F = pi R E delta^2 / h`, so the depth is proportional to the square root of the
    /// force.
    #[test]
    fn depth_and_contact_follow_the_foundation() {
        let press = press(0.1, 0.05);
        let depth = FOAM.depth_m(&press);
        let force = PI * press.tip_radius_m * FOAM.modulus_pa * depth * depth / FOAM.thickness_m;
        assert!((force / press.force_n - 1.0).abs() < 1e-12);
        let four_times = Press { force_n: 8.0, ..press };
        assert!((FOAM.depth_m(&four_times) / depth - 2.0).abs() < 1e-12);
        assert!((FOAM.contact_radius_m(&four_times) / FOAM.contact_radius_m(&press) - 2f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn presses_that_no_skin_can_feel_are_refused() {
        let refusal = |press: Press, body: &Body| Footprint::new(&press, &FOAM, body).unwrap_err();
        let good = press(0.1, 0.05);
        let no_force = refusal(Press { force_n: 0.0, ..good }, &SHEET);
        assert!(matches!(no_force, TwinError::OutOfRange { field: "force_n", .. }), "{no_force}");
        let no_tip = refusal(Press { tip_radius_m: f64::NAN, ..good }, &SHEET);
        assert!(matches!(no_tip, TwinError::OutOfRange { field: "tip_radius_m", .. }), "{no_tip}");
        let off = refusal(press(0.1, 0.12), &SHEET);
        assert!(off.to_string().contains("0.12"), "{off}");
        let nowhere = refusal(Press { centre_m: [0.1, f64::NAN, 0.0], ..good }, &SHEET);
        assert!(matches!(nowhere, TwinError::OffTheSkin { .. }), "{nowhere}");
        let crushed = refusal(Press { force_n: 20.0, ..good }, &SHEET);
        assert!(crushed.to_string().contains("4.37 mm") && crushed.to_string().contains("3 mm"), "{crushed}");
        let mesh = Body::Mesh { file: "arm.stl".into(), unit_m: 1.0 };
        assert_eq!(refusal(good, &mesh), TwinError::NoChart);
    }
}
