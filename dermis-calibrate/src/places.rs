//! Places to press, evenly spread over a skin.

use dermis::geom::Point3;
use dermis::geom::vector::distance;
use dermis::image::PixelSpace;
use dermis::mesh::{Cells, Mesh};
use dermis::skin::Skin;
use std::collections::HashMap;

/// Places to press one after the other.
///
/// ```
/// use dermis::skin::Skin;
/// use dermis_calibrate::Places;
///
/// let skin = Skin::load("skin16")?;
/// let places = Places::spread(&skin, 50);
/// // A session that is cut short has pressed the whole skin, too.
/// assert_eq!(places.positions_m[..20], Places::spread(&skin, 20).positions_m);
/// assert_eq!(places.coverage(&skin, &places.positions_m), 1.0);
/// assert!(places.coverage(&skin, &places.positions_m[..20]) < 1.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Places {
    /// The places in their order, m.
    pub positions_m: Vec<Point3>,
    /// A point of the skin is covered by a press within this distance, m: the largest distance of a point from the
    /// nearest of as many evenly spread places.
    pub reach_m: f64,
}

impl Places {
    /// Evenly spread places: each is the centre of the pixel farthest from those before it and from the edge of the
    /// skin, whose distance counts twice (Gonzalez 1985, DOI 10.1016/0304-3975(85)90224-5). At most one for each pixel.
    pub fn spread(skin: &Skin, count: usize) -> Self {
        let pixels = skin.pixels();
        let edge = edge_nodes(skin.mesh());
        let from_edge = |centre: &Point3| {
            let nearest = edge.iter().map(|node| distance(*node, *centre)).fold(f64::INFINITY, f64::min);
            2.0 * nearest
        };
        let mut room_m: Vec<f64> = pixels.centres_m.iter().map(from_edge).collect();
        let mut nearest_m = vec![f64::INFINITY; pixels.len()];
        let mut positions_m = Vec::new();
        for _ in 0..count.min(pixels.len()) {
            let farthest = (0..pixels.len()).reduce(|a, b| if room_m[b] > room_m[a] { b } else { a });
            let place = pixels.centres_m[farthest.expect("a skin has pixels")];
            positions_m.push(place);
            for (pixel, centre) in pixels.centres_m.iter().enumerate() {
                let away_m = pixels.surface.distance_m(*centre, place);
                nearest_m[pixel] = nearest_m[pixel].min(away_m);
                room_m[pixel] = room_m[pixel].min(away_m);
            }
        }
        Places { positions_m, reach_m: nearest_m.into_iter().fold(0.0, f64::max) }
    }

    /// Chosen places.
    pub fn given(skin: &Skin, positions_m: Vec<Point3>) -> Self {
        let reach_m = Self::spread(skin, positions_m.len().max(1)).reach_m;
        Places { positions_m, reach_m }
    }

    /// The part of the skin's area that some presses cover.
    pub fn coverage(&self, skin: &Skin, presses_m: &[Point3]) -> f64 {
        let PixelSpace { surface, centres_m, areas, .. } = &**skin.pixels();
        let near = |centre: &Point3| presses_m.iter().any(|press| surface.distance_m(*centre, *press) <= self.reach_m);
        let covered: f64 = centres_m.iter().zip(areas).filter(|(centre, _)| near(centre)).map(|(_, area)| area).sum();
        // The sum of nothing is -0.
        (0.0 + covered) / areas.iter().sum::<f64>()
    }
}

/// The nodes at the edge of a surface: those of edges that belong to one triangle. None in a volume.
fn edge_nodes(mesh: &Mesh) -> Vec<Point3> {
    let Cells::Triangles(triangles) = &mesh.cells else { return Vec::new() };
    let mut count: HashMap<[usize; 2], usize> = HashMap::new();
    for &[a, b, c] in triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            *count.entry([from.min(to), from.max(to)]).or_default() += 1;
        }
    }
    let mut nodes: Vec<usize> = count.into_iter().filter(|(_, count)| *count == 1).flat_map(|(edge, _)| edge).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes.into_iter().map(|node| mesh.nodes[node]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_keep_apart_from_each_other_and_from_the_edge() {
        for (name, sides) in [("skin16", 1.0), ("cylinder30", 1.0)] {
            let skin = Skin::load(name).unwrap();
            let (pixels, count) = (skin.pixels(), 40);
            let places = Places::spread(&skin, count);
            // Disks round evenly spread places overlap little: their area is near that of the skin.
            let mut least_m = f64::INFINITY;
            for (index, a) in places.positions_m.iter().enumerate() {
                for b in &places.positions_m[..index] {
                    least_m = least_m.min(pixels.surface.distance_m(*a, *b));
                }
            }
            let spacing_m = (sides * pixels.areas.iter().sum::<f64>() / count as f64).sqrt();
            assert!(least_m > 0.6 * spacing_m, "{name}: {least_m} of {spacing_m} m apart");
            assert!(places.reach_m < 1.2 * spacing_m, "{name}: {} of {spacing_m} m", places.reach_m);
            let edge = edge_nodes(skin.mesh());
            let nearest =
                |place: &Point3| edge.iter().map(|node| distance(*node, *place)).fold(f64::INFINITY, f64::min);
            assert!(places.positions_m.iter().all(|place| nearest(place) > 0.25 * spacing_m), "{name}");
        }
    }
}
