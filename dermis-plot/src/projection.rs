//! Parallel projection of a scene, and visibility of its parts.

use crate::camera::Camera;
use crate::colour::{BLACK, Colour, SKIN, mix};
use crate::scene::Tile;
use crate::svg::Place;
use dermis::geom::Point3;
use dermis::geom::vector::{add, bounding_box, centroid, dot, normalize, scale};
use std::collections::HashMap;

/// Largest extent of the body in a picture, pixels.
pub(crate) const PLOT_SIZE: f64 = 540.0;
/// Margin around the body, pixels.
pub(crate) const MARGIN: f64 = 24.0;

/// A projected tile.
pub(crate) struct Seen {
    /// Its corners, pixels.
    pub places: Vec<Place>,
    /// Its shaded colour.
    pub fill: Colour,
    /// The shaded colour of its outline.
    pub edge: Option<Colour>,
    depth: f64,
    /// Bounding box, pixels.
    low: Place,
    high: Place,
    /// Depth as a plane over the picture: `depth = plane[0] + plane[1] x + plane[2] y`; `None` if seen edge-on.
    plane: Option<[f64; 3]>,
}

/// Shading of colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Light {
    /// From the upper left: shows the shape.
    Shaded,
    /// Uniform: colours match the colour bar.
    Even,
}

/// A parallel projection of a body.
pub(crate) struct Projection {
    /// Right, up, and towards the viewer.
    pub axes: [Point3; 3],
    /// Pixels per m.
    pub pixels_per_m: f64,
    low: Place,
    high: Place,
}

/// The ends of an edge, and the numbers of its front-facing and back-facing tiles.
type Edge = ([Point3; 2], [usize; 2]);

impl Projection {
    /// The projection in which the body fills the plot.
    pub(crate) fn new(camera: &Camera, tiles: &[Tile]) -> Self {
        let axes = camera.axes();
        let corners = tiles.iter().flat_map(|tile| &tile.corners);
        let [low, high] = bounding_box(corners.map(|&corner| [0, 1].map(|axis| dot(axes[axis], corner))));
        let extent = (high[0] - low[0]).max(high[1] - low[1]);
        Projection { axes, low, high, pixels_per_m: if extent > 0.0 { PLOT_SIZE / extent } else { 1.0 } }
    }

    /// Width of the picture, pixels.
    pub(crate) fn width(&self) -> f64 {
        (self.high[0] - self.low[0]) * self.pixels_per_m + 2.0 * MARGIN
    }

    /// Height of the picture, pixels.
    pub(crate) fn height(&self) -> f64 {
        (self.high[1] - self.low[1]) * self.pixels_per_m + 2.0 * MARGIN
    }

    /// The projection of a point.
    pub(crate) fn place(&self, point: Point3) -> Place {
        let right = dot(self.axes[0], point) - self.low[0];
        let up = self.high[1] - dot(self.axes[1], point);
        [MARGIN + right * self.pixels_per_m, MARGIN + up * self.pixels_per_m]
    }

    fn depth(&self, point: Point3) -> f64 {
        dot(self.axes[2], point)
    }

    /// The cosine of the angle between a unit normal and the direction to the viewer.
    pub(crate) fn facing(&self, normal: Point3) -> f64 {
        dot(self.axes[2], normal)
    }

    fn lit(&self, fill: Colour, normal: Point3, light: Light) -> Colour {
        let facing = self.facing(normal);
        // The inside of an open body has no data and is darker.
        let (fill, normal) = if facing < 0.0 { (mix(SKIN, BLACK, 0.35), scale(normal, -1.0)) } else { (fill, normal) };
        if light == Light::Even && facing >= 0.0 {
            return fill;
        }
        let source = normalize(add(add(self.axes[2], scale(self.axes[1], 0.6)), scale(self.axes[0], -0.5)));
        mix(fill, BLACK, 0.28 * (1.0 - dot(source, normal).max(0.0)))
    }

    /// The tiles from back to front.
    pub(crate) fn see_all(&self, tiles: &[Tile], light: Light) -> Vec<Seen> {
        let mut seen: Vec<Seen> = tiles.iter().map(|tile| self.see(tile, light)).collect();
        seen.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        seen
    }

    /// Projects a tile.
    pub(crate) fn see(&self, tile: &Tile, light: Light) -> Seen {
        let places: Vec<Place> = tile.corners.iter().map(|&corner| self.place(corner)).collect();
        let normal = tile.normal();
        let [low, high] = bounding_box(places.iter().copied());
        Seen {
            depth: self.depth(centroid(&tile.corners)),
            fill: self.lit(tile.fill, normal, light),
            edge: tile.edge.map(|edge| self.lit(edge, normal, light)),
            plane: self.depth_plane(tile, normal, places[0]),
            places,
            low,
            high,
        }
    }

    fn depth_plane(&self, tile: &Tile, normal: Point3, first: Place) -> Option<[f64; 3]> {
        let facing = self.facing(normal);
        if facing.abs() < 1e-6 {
            return None;
        }
        // On the plane n . (x - x0) = 0 a step right by dx changes depth by -(n . right) dx / (n . towards).
        let dx = -dot(normal, self.axes[0]) / facing / self.pixels_per_m;
        let dy = dot(normal, self.axes[1]) / facing / self.pixels_per_m;
        Some([self.depth(tile.corners[0]) - dx * first[0] - dy * first[1], dx, dy])
    }

    /// Whether no part of the skin is between a point on it and the viewer.
    pub(crate) fn unobstructed(&self, point: Point3, skin: &[Seen]) -> bool {
        let place = self.place(point);
        // A point on a curved body is slightly off its flat tiles: tolerance of 0.5 % of the picture.
        let limit = self.depth(point) + 0.005 * PLOT_SIZE / self.pixels_per_m;
        !skin.iter().any(|tile| {
            let inside_box = (0..2).all(|axis| tile.low[axis] <= place[axis] && place[axis] <= tile.high[axis]);
            let nearer = tile.plane.is_some_and(|[d, dx, dy]| d + dx * place[0] + dy * place[1] > limit);
            inside_box && nearer && inside(&tile.places, place)
        })
    }

    /// The same for a point whose normal has at least a given cosine with the view.
    pub(crate) fn visible(&self, point: Point3, normal: Point3, least_facing: f64, skin: &[Seen]) -> bool {
        self.facing(normal) > least_facing && self.unobstructed(point, skin)
    }

    /// The outline of the body: edges of one tile only, and edges between a front-facing and a back-facing tile.
    pub(crate) fn outline(&self, tiles: &[Tile], skin: &[Seen]) -> Vec<[Place; 2]> {
        // Corners that differ only by rounding are merged.
        let grain_m = 1e-4 * PLOT_SIZE / self.pixels_per_m;
        let key = |corner: Point3| corner.map(|length_m| (length_m / grain_m).round() as i64);
        let mut edges: HashMap<[[i64; 3]; 2], Edge> = HashMap::new();
        let mut order = Vec::new();
        for tile in tiles {
            let side = usize::from(self.facing(tile.normal()) < 0.0);
            for (index, &from) in tile.corners.iter().enumerate() {
                let to = tile.corners[(index + 1) % tile.corners.len()];
                let mut ends = [key(from), key(to)];
                ends.sort_unstable();
                let edge = edges.entry(ends).or_insert_with(|| {
                    order.push(ends);
                    ([from, to], [0, 0])
                });
                edge.1[side] += 1;
            }
        }
        // In the order of the tiles, so that the output is deterministic.
        let edges =
            order.iter().map(|ends| &edges[ends]).filter(|(_, sides)| sides[0] + sides[1] == 1 || sides == &[1, 1]);
        let seen = edges.filter(|(ends, _)| self.unobstructed(centroid(ends), skin));
        seen.map(|(ends, _)| ends.map(|end| self.place(end))).collect()
    }
}

fn inside(polygon: &[Place], [x, y]: Place) -> bool {
    let mut odd = false;
    let mut previous = polygon[polygon.len() - 1];
    for &corner in polygon {
        if (corner[1] > y) != (previous[1] > y) {
            let crossing = corner[0] + (y - corner[1]) / (previous[1] - corner[1]) * (previous[0] - corner[0]);
            odd ^= x < crossing;
        }
        previous = corner;
    }
    odd
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(z: f64) -> Tile {
        let corners = vec![[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z]];
        Tile { corners, fill: SKIN, edge: None }
    }

    #[test]
    fn what_lies_behind_the_skin_or_faces_away_is_hidden() {
        let tiles = [square(0.0), square(1.0)];
        let camera = Camera { azimuth_rad: 0.3, elevation_rad: 1.5 };
        let view = Projection::new(&camera, &tiles);
        let skin = view.see_all(&tiles, Light::Shaded);
        let up = [0.0, 0.0, 1.0];
        assert!(view.visible([0.5, 0.5, 1.0], up, 0.0, &skin));
        assert!(!view.visible([0.5, 0.5, 0.0], up, 0.0, &skin), "the upper square covers it");
        assert!(!view.visible([0.5, 0.5, 1.0], [0.0, 0.0, -1.0], 0.0, &skin));
    }
}
