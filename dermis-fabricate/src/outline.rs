//! Closed outlines of flat parts, and the paths that cut them.

use dermis::geom::vector::bounding_box;
use dermis::geom::{Chart, Point2, Shape, polygon};
use std::f64::consts::{PI, TAU};

/// A closed outline. Lengths in m.
#[derive(Debug, Clone, PartialEq)]
pub enum Outline {
    /// Corners in counter-clockwise order; the last is joined to the first.
    Polygon(Vec<Point2>),
    /// A circle.
    Circle {
        /// Its centre.
        centre_m: Point2,
        /// Its radius.
        radius_m: f64,
    },
}

/// Largest distance between an arc and the chords that stand for it, m: a hundredth of a kerf.
const CHORD_ERROR_M: f64 = 2e-6;

/// Chords of a full circle, a multiple of four.
pub(crate) fn chords(radius_m: f64, error_m: f64) -> usize {
    let half_angle = (1.0 - (error_m / radius_m).min(0.5)).acos();
    4 * (PI / half_angle / 4.0).ceil().max(3.0) as usize
}

impl Outline {
    /// A rectangle with sides along the axes.
    pub(crate) fn rectangle([x0, y0]: Point2, [x1, y1]: Point2) -> Self {
        Outline::Polygon(vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    }

    /// The edge of a body in its chart.
    pub(crate) fn of_chart(chart: &Chart) -> Self {
        match chart.shape() {
            Shape::Disk { radius_m } => Outline::Circle { centre_m: [0.0; 2], radius_m },
            _ => {
                let [low_m, high_m] = chart.bounds_m();
                Outline::rectangle(low_m, high_m)
            }
        }
    }

    /// Corners of the outline; a circle is given by chords.
    pub(crate) fn corners(&self) -> Vec<Point2> {
        match self {
            Outline::Polygon(corners) => corners.clone(),
            &Outline::Circle { centre_m: [x, y], radius_m } => {
                let count = chords(radius_m, CHORD_ERROR_M);
                let corner = |k: usize| {
                    let angle = TAU * k as f64 / count as f64;
                    [x + radius_m * angle.cos(), y + radius_m * angle.sin()]
                };
                (0..count).map(corner).collect()
            }
        }
    }

    /// Enclosed area, m2.
    pub(crate) fn area_m2(&self) -> f64 {
        match self {
            Outline::Polygon(corners) => polygon::signed_area(corners),
            Outline::Circle { radius_m, .. } => PI * radius_m * radius_m,
        }
    }

    /// Lower and upper corner of the box around it.
    pub(crate) fn bounds_m(&self) -> [Point2; 2] {
        match self {
            &Outline::Circle { centre_m: [x, y], radius_m: r } => [[x - r, y - r], [x + r, y + r]],
            Outline::Polygon(corners) => bounding_box(corners.iter().copied()),
        }
    }

    /// The same outline elsewhere.
    pub(crate) fn moved(&self, [dx, dy]: Point2) -> Self {
        match self {
            Outline::Polygon(corners) => Outline::Polygon(corners.iter().map(|[x, y]| [x + dx, y + dy]).collect()),
            &Outline::Circle { centre_m: [x, y], radius_m } => Outline::Circle { centre_m: [x + dx, y + dy], radius_m },
        }
    }

    /// The outline whose sides are farther out by a distance (farther in, where it is negative): a cut along it, twice
    /// that distance wide, leaves this outline. Exact for convex outlines. A side that is shorter than the rounding of
    /// its corners is left out.
    pub(crate) fn grown(&self, by_m: f64) -> Self {
        match self {
            &Outline::Circle { centre_m, radius_m } => Outline::Circle { centre_m, radius_m: radius_m + by_m },
            Outline::Polygon(corners) => Outline::Polygon(grown_polygon(corners, by_m)),
        }
    }

    /// The part of the outline inside another one that is convex; `None` if nothing is left.
    pub(crate) fn clipped(&self, to: &Outline) -> Option<Outline> {
        if let (Outline::Circle { centre_m, radius_m }, true) = (self, self.inside(to)) {
            return Some(Outline::Circle { centre_m: *centre_m, radius_m: *radius_m });
        }
        let mut corners = self.corners();
        let limit = to.corners();
        for (from, to) in limit.iter().zip(limit.iter().cycle().skip(1)) {
            let normal = [to[1] - from[1], from[0] - to[0]];
            corners = polygon::clip_half_plane(&corners, normal, normal[0] * from[0] + normal[1] * from[1]);
        }
        corners.dedup_by(|a, b| (a[0] - b[0]).hypot(a[1] - b[1]) < ROUNDING_M);
        let kept = Outline::Polygon(corners);
        (kept.area_m2() > ROUNDING_M * ROUNDING_M).then_some(kept)
    }

    /// Whether a point is inside this convex outline.
    pub(crate) fn contains(&self, centre_m: Point2) -> bool {
        Outline::Circle { centre_m, radius_m: 0.0 }.inside(self)
    }

    /// Whether a circle is inside a convex outline.
    fn inside(&self, to: &Outline) -> bool {
        let &Outline::Circle { centre_m, radius_m } = self else { return false };
        match to {
            &Outline::Circle { centre_m: [x, y], radius_m: most_m } => {
                (centre_m[0] - x).hypot(centre_m[1] - y) + radius_m <= most_m
            }
            Outline::Polygon(limit) => limit.iter().zip(limit.iter().cycle().skip(1)).all(|(from, to)| {
                let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
                let left = dx * (centre_m[1] - from[1]) - dy * (centre_m[0] - from[0]);
                left >= radius_m * dx.hypot(dy)
            }),
        }
    }
}

/// Corners closer than this are one, m.
const ROUNDING_M: f64 = 1e-9;

/// Moves every side outwards and intersects neighbours.
fn grown_polygon(corners: &[Point2], by_m: f64) -> Vec<Point2> {
    let count = corners.len();
    let side = |k: usize| {
        let (from, to) = (corners[k % count], corners[(k + 1) % count]);
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        [(to[0] - from[0]) / length, (to[1] - from[1]) / length]
    };
    let corner = |k: usize| {
        let ([ax, ay], [bx, by]) = (side(k + count - 1), side(k));
        // Outward normals (ay, -ax) and (by, -bx): the corner moves by m with m . n = by_m for both.
        let cosine = ax * bx + ay * by;
        let reach = by_m / (1.0 + cosine);
        let [x, y] = corners[k];
        [x + reach * (ay + by), y - reach * (ax + bx)]
    };
    (0..count).map(corner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Area and perimeter of a convex body grown by `d` with sharp corners: `A + P d + d^2 sum tan(turn / 2)`.
    #[test]
    fn a_grown_polygon_has_its_sides_at_the_distance() {
        let corners = vec![[0.0, 0.0], [0.03, 0.0], [0.035, 0.02], [0.01, 0.03]];
        let outline = Outline::Polygon(corners.clone());
        for by_m in [1e-4, 3e-3, -1e-3] {
            let Outline::Polygon(grown) = outline.grown(by_m) else { panic!("a polygon") };
            for k in 0..4 {
                let (a, b) = (corners[k], corners[(k + 1) % 4]);
                let length = (b[0] - a[0]).hypot(b[1] - a[1]);
                for p in [grown[k], grown[(k + 1) % 4]] {
                    let outside = ((b[1] - a[1]) * (p[0] - a[0]) - (b[0] - a[0]) * (p[1] - a[1])) / length;
                    assert!((outside - by_m).abs() < 1e-15, "{outside}");
                }
            }
        }
    }

    #[test]
    fn a_disc_on_an_edge_is_cut_in_half() {
        let sheet = Outline::rectangle([0.0, 0.0], [0.1, 0.05]);
        let disc = |x: f64| Outline::Circle { centre_m: [x, 0.02], radius_m: 0.004 };
        let half = disc(0.0).clipped(&sheet).unwrap().area_m2();
        // Chords leave out two thirds of their distance from the arc, times its length.
        assert!((half - 0.5 * PI * 1.6e-5).abs() < CHORD_ERROR_M * PI * 0.004, "{half}");
        assert_eq!(disc(0.05).clipped(&sheet), Some(disc(0.05)));
        assert_eq!(disc(-0.01).clipped(&sheet), None);
    }
}
