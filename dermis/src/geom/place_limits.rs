//! Checks that a position is on a body, and not given in another unit.

use super::surface::Surface;
use super::triangle_tree::TriangleTree;
use super::vector::{Point3, bounding_box, distance, norm};
use std::f64::consts::TAU;

/// The allowed positions of touches on a body: on it, or off it by less than a margin.
///
/// ```
/// use dermis::geom::{PlaceLimits, Surface};
///
/// // A flat skin of 80 x 80 mm, as two triangles; touches may lie up to 10 mm off it.
/// let corners = [[0.0, 0.0, 0.0], [0.08, 0.0, 0.0], [0.08, 0.08, 0.0], [0.0, 0.08, 0.0]];
/// let triangles = [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|corner: usize| corners[corner]));
/// let limits = PlaceLimits::of_surface(Surface::Plane, triangles, 0.01);
/// assert!(limits.check([0.085, 0.02, 0.0]).is_ok());
/// assert!(limits.check([40.0, 20.0, 0.0]).unwrap_err().contains("millimetres"));
/// ```
#[derive(Debug, Clone)]
pub struct PlaceLimits {
    /// The surface on which contacts are located.
    pub surface: Surface,
    margin_m: f64,
    low_m: Point3,
    high_m: Point3,
    /// The triangles of a surface; for a volume only its bounding box is known.
    tree: Option<TriangleTree>,
}

impl PlaceLimits {
    /// The limits of a body of triangles.
    ///
    /// # Panics
    /// If there is no triangle.
    pub fn of_surface(surface: Surface, triangles: impl IntoIterator<Item = [Point3; 3]>, margin_m: f64) -> Self {
        let triangles: Vec<[Point3; 3]> = triangles.into_iter().collect();
        let limits = Self::of_box(surface, triangles.iter().flatten().copied(), margin_m);
        PlaceLimits { tree: Some(TriangleTree::new(triangles)), ..limits }
    }

    /// The limits of a body that fills the bounding box of some points.
    pub fn of_box(surface: Surface, points: impl IntoIterator<Item = Point3>, margin_m: f64) -> Self {
        let [low_m, high_m] = bounding_box(points);
        PlaceLimits { surface, margin_m, low_m, high_m, tree: None }
    }

    /// The distance of a position from the body, m.
    pub fn distance_m(&self, place: Point3) -> f64 {
        match &self.tree {
            Some(tree) => tree.nearest(place).distance_m,
            None => norm([0, 1, 2].map(|axis| place[axis] - place[axis].clamp(self.low_m[axis], self.high_m[axis]))),
        }
    }

    /// Checks a position in metres.
    ///
    /// # Errors
    /// A position farther off the body than the margin: the problem, with the unit in which it is probably given.
    pub fn check(&self, place: Point3) -> Result<Point3, String> {
        let distance_m = self.distance_m(place);
        if distance_m <= self.margin_m {
            return Ok(place);
        }
        let fits = |factor: f64| self.distance_m(place.map(|value| factor * value)) <= self.margin_m;
        Err(self.explain(&format!("{place:?} m"), distance_m, fits))
    }

    /// Checks `(z, theta)` and returns the point of the cylinder; `None` if the surface is not a cylinder.
    ///
    /// # Errors
    /// As [`check`](Self::check); an angle of more than one turn, which is probably in degrees.
    pub(crate) fn check_on_cylinder(&self, z_m: f64, theta_rad: f64) -> Option<Result<Point3, String>> {
        let place = self.surface.at(z_m, theta_rad)?;
        if let Some(wrong) = beyond_a_turn("theta_rad", theta_rad) {
            return Some(Err(wrong));
        }
        let distance_m = self.distance_m(place);
        if distance_m <= self.margin_m {
            return Some(Ok(place));
        }
        let fits = |factor: f64| {
            let scaled = self.surface.at(factor * z_m, theta_rad);
            scaled.is_some_and(|place| self.distance_m(place) <= self.margin_m)
        };
        Some(Err(self.explain(&format!("z_m = {z_m}"), distance_m, fits)))
    }

    /// The error text for a position off the body; `fits` returns whether the position times a factor is on it.
    fn explain(&self, place: &str, distance_m: f64, fits: impl Fn(f64) -> bool) -> String {
        // A position just off the body is in metres: scaled down it is near the origin, which is often on the body.
        let is_far = distance_m > distance(self.low_m, self.high_m);
        let units: Vec<&str> = [("millimetres", 1e-3), ("centimetres", 1e-2)]
            .into_iter()
            .filter_map(|(name, factor)| (is_far && fits(factor)).then_some(name))
            .collect();
        let unit = match units.as_slice() {
            [] => String::new(),
            units => format!("; it seems to be in {}", units.join(" or ")),
        };
        let side = |axis: usize| format!("{:.4} to {:.4}", self.low_m[axis], self.high_m[axis]);
        format!(
            "the place {place} lies {distance_m:.4} m off the body, which reaches from {} m along x, {} m along y and {} m \
             along z: places are in metres{unit}",
            side(0),
            side(1),
            side(2)
        )
    }
}

/// What is wrong with an angle of more than one turn, which is probably in degrees, or one that is not finite.
pub fn beyond_a_turn(key: &str, angle_rad: f64) -> Option<String> {
    // Rounding may raise a full turn above its exact value.
    let is_within = angle_rad.abs() <= TAU * (1.0 + 1e-6);
    (!is_within).then(|| {
        format!(
            "{key} is {angle_rad}, more than one turn: angles are in radians; if it is in degrees, write {:.4}",
            angle_rad.to_radians()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_in_other_units_are_named_by_their_unit() {
        let surface = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
        let ring = |z: f64| (0..8).map(move |k| surface.at(z, f64::from(k) * TAU / 8.0).unwrap());
        let limits = PlaceLimits::of_box(surface, ring(0.0).chain(ring(0.3)), 0.05);
        let on = |z: f64, theta: f64| limits.check_on_cylinder(z, theta).unwrap();
        assert!(on(0.349, -TAU).is_ok() && on(-0.049, TAU).is_ok());
        assert!(on(150.0, 1.0).unwrap_err().ends_with("it seems to be in millimetres"));
        assert!(on(20.0, 1.0).unwrap_err().ends_with("in millimetres or centimetres"));
        assert!(on(0.36, 1.0).unwrap_err().ends_with("places are in metres"));
        assert!(on(0.1, 90.0).unwrap_err().contains("if it is in degrees, write 1.5708"));
        assert!(PlaceLimits::of_box(Surface::Plane, [[0.0; 3]], 0.0).check_on_cylinder(0.0, 0.0).is_none());
    }
}
