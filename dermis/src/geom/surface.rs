//! The surface of a body: distances along it, normals, means.

use super::chart::{Chart, System, on_wall, wrapped};
use crate::geom::vector::{Point3, add, distance, dot, normalize, scale, sub};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// The surface on which contacts are located.
///
/// A cylinder has its axis along z from 0 to `length_m`; a flat skin is in the plane z = 0 with the normal +z; on any
/// other body (`Free`) distances are straight-line distances in space.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Surface {
    /// A cylinder's curved wall.
    Cylinder {
        /// Radius, m.
        radius_m: f64,
        /// Length along z, m.
        length_m: f64,
    },
    /// The plane z = 0.
    Plane,
    /// Any other shape, known only by its mesh.
    Free,
}

/// An angle reduced to `[0, 2 pi)`.
pub fn wrap_angle(angle_rad: f64) -> f64 {
    wrapped(angle_rad, 0.0, TAU)
}

/// The difference of two angles, reduced to `[-pi, pi)`.
pub fn angle_difference(a_rad: f64, b_rad: f64) -> f64 {
    wrapped(a_rad - b_rad, -PI, TAU)
}

impl Surface {
    /// The angle around the cylinder's axis in `[0, 2 pi)`, from +x towards +y; `None` for other surfaces.
    pub fn theta_rad(&self, position_m: Point3) -> Option<f64> {
        match self {
            Surface::Cylinder { .. } => Some(wrap_angle(position_m[1].atan2(position_m[0]))),
            _ => None,
        }
    }

    /// The point of a cylinder at `(z, theta)`; `None` for other surfaces.
    pub fn at(&self, z_m: f64, theta_rad: f64) -> Option<Point3> {
        match *self {
            Surface::Cylinder { radius_m, .. } => Some(on_wall::<System>(radius_m, theta_rad, z_m)),
            _ => None,
        }
    }

    /// The distance along the surface, on a cylinder the shorter way around; straight through space if the surface is
    /// `Free`.
    pub fn distance_m(&self, a: Point3, b: Point3) -> f64 {
        match *self {
            Surface::Cylinder { .. } => {
                let [du, dv] = self.chart(a, b);
                du.hypot(dv)
            }
            Surface::Plane | Surface::Free => distance(a, b),
        }
    }

    /// The position of `point` relative to `origin`, in metres along the surface: (around, along z) on a cylinder, (x,
    /// y) on a plane. On a `Free` surface the first two components of the difference.
    pub fn chart(&self, origin: Point3, point: Point3) -> [f64; 2] {
        match *self {
            Surface::Cylinder { radius_m, .. } => {
                let sine = origin[0] * point[1] - origin[1] * point[0];
                let cosine = origin[0] * point[0] + origin[1] * point[1];
                [radius_m * sine.atan2(cosine), point[2] - origin[2]]
            }
            Surface::Plane | Surface::Free => [point[0] - origin[0], point[1] - origin[1]],
        }
    }

    /// The weighted mean position of some points near `origin`, on the surface: the circular mean on a cylinder if all
    /// points are within half a turn of `origin`.
    pub fn weighted_mean(&self, origin: Point3, points: impl Iterator<Item = (Point3, f64)>) -> Point3 {
        let mut weight_sum = 0.0;
        match *self {
            Surface::Cylinder { .. } => {
                let mut mean = [0.0; 2];
                for (point, weight) in points {
                    let [round, along] = self.chart(origin, point);
                    mean[0] += weight * round;
                    mean[1] += weight * along;
                    weight_sum += weight;
                }
                self.walk(origin, [mean[0] / weight_sum, mean[1] / weight_sum])
            }
            Surface::Plane | Surface::Free => {
                let mut mean = [0.0; 3];
                for (point, weight) in points {
                    mean = add(mean, scale(sub(point, origin), weight));
                    weight_sum += weight;
                }
                add(origin, scale(mean, 1.0 / weight_sum))
            }
        }
    }

    /// The point reached from `origin` by a [`chart`](Self::chart) vector.
    pub fn walk(&self, origin: Point3, step_m: [f64; 2]) -> Point3 {
        Chart::of(self).walk(origin, step_m)
    }

    /// The step from one position to another: along the surface as by [`chart`](Self::chart), or through space if it is `Free`.
    pub(crate) fn step(&self, from: Point3, to: Point3) -> Point3 {
        match self {
            Surface::Free => sub(to, from),
            _ => {
                let [u, v] = self.chart(from, to);
                [u, v, 0.0]
            }
        }
    }

    /// The outward unit normal; `None` if the surface is known only by its mesh.
    pub fn normal(&self, position_m: Point3) -> Option<Point3> {
        match self {
            Surface::Cylinder { .. } => Some(normalize([position_m[0], position_m[1], 0.0])),
            Surface::Plane => Some([0.0, 0.0, 1.0]),
            Surface::Free => None,
        }
    }
}

/// The point of a triangle nearest to `point` (Ericson, Real-Time Collision Detection, 2005, section 5.1.5).
pub(crate) fn nearest_on_triangle(point: Point3, corners: [Point3; 3]) -> Point3 {
    let [a, b, c] = corners;
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(point, a));
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = sub(point, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return add(a, scale(ab, d1 / (d1 - d3)));
    }
    let cp = sub(point, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return add(a, scale(ac, d2 / (d2 - d6)));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return add(b, scale(sub(c, b), t));
    }
    let denominator = 1.0 / (va + vb + vc);
    add(a, add(scale(ab, vb * denominator), scale(ac, vc * denominator)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_and_means_go_the_short_way_round_the_seam() {
        let body = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
        let a = body.at(0.1, 0.1).unwrap();
        let b = body.at(0.1, TAU - 0.1).unwrap();
        assert!((body.distance_m(a, b) - 0.01).abs() < 1e-15);
        let mean = body.weighted_mean(a, [(a, 1.0), (b, 1.0)].into_iter());
        assert!(distance(mean, [0.05, 0.0, 0.1]) < 1e-15);
    }

    #[test]
    fn the_nearest_point_of_a_triangle_is_inside_on_an_edge_or_a_corner() {
        let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert!(distance(nearest_on_triangle([0.2, 0.2, 5.0], triangle), [0.2, 0.2, 0.0]) < 1e-15);
        assert!(distance(nearest_on_triangle([0.5, -1.0, 0.0], triangle), [0.5, 0.0, 0.0]) < 1e-15);
        assert!(distance(nearest_on_triangle([2.0, -1.0, 0.0], triangle), [1.0, 0.0, 0.0]) < 1e-15);
    }
}
