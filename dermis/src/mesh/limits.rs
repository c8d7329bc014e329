//! The positions at which a skin can be touched.

use crate::geom::vector::{Point3, centroid, distance};
use crate::geom::{PlaceLimits, Surface};
use crate::mesh::{Cells, Mesh};
use std::collections::HashSet;

impl Mesh {
    /// The centre of an electrode: the mean of its nodes, m.
    ///
    /// # Panics
    /// If the electrode does not exist.
    pub fn electrode_centre(&self, electrode: usize) -> Point3 {
        let nodes = self.electrode_nodes(electrode);
        centroid(&nodes.iter().map(|&node| self.nodes[node]).collect::<Vec<_>>())
    }

    /// The sides of triangles on the edge of a mesh, each along its triangle, ascending; none of a closed surface or of
    /// tetrahedra.
    pub fn edge_sides(&self) -> Vec<[usize; 2]> {
        let Cells::Triangles(triangles) = &self.cells else { return Vec::new() };
        let sides: HashSet<[usize; 2]> = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        // Triangles have one orientation: another one has a side in reverse.
        let mut edge: Vec<[usize; 2]> = sides.iter().copied().filter(|&[a, b]| !sides.contains(&[b, a])).collect();
        edge.sort_unstable();
        edge
    }

    /// The largest distance from an electrode to its nearest neighbour, m.
    pub(crate) fn electrode_spacing_m(&self) -> f64 {
        let centres: Vec<Point3> =
            (0..self.electrodes.len()).map(|electrode| self.electrode_centre(electrode)).collect();
        let nearest = |own: usize| {
            let others = (0..centres.len()).filter(|&other| other != own);
            others.map(|other| distance(centres[own], centres[other])).fold(f64::INFINITY, f64::min)
        };
        (0..centres.len()).map(nearest).filter(|spacing_m| spacing_m.is_finite()).fold(0.0, f64::max)
    }

    /// The possible positions of touches on a body of this mesh: on it, or off it by less than the electrode spacing.
    pub fn place_limits(&self, surface: Surface) -> PlaceLimits {
        let margin_m = self.electrode_spacing_m();
        match &self.cells {
            Cells::Triangles(cells) => {
                PlaceLimits::of_surface(surface, cells.iter().map(|cell| cell.map(|node| self.nodes[node])), margin_m)
            }
            Cells::Tetrahedra(_) => PlaceLimits::of_box(surface, self.nodes.iter().copied(), margin_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::design::SkinDesign;
    use crate::mesh::Mesh;

    #[test]
    fn edges_are_those_of_the_body() {
        let mesh = Mesh::generate(&SkinDesign::shipped("cylinder30").unwrap()).unwrap();
        let length_m = |[a, b]: &[usize; 2]| crate::geom::vector::distance(mesh.nodes[*a], mesh.nodes[*b]);
        let edge_m: f64 = mesh.edge_sides().iter().map(length_m).sum();
        // Two rims of 100 mm, whose chords are a little shorter.
        assert!((edge_m / (2.0 * std::f64::consts::PI * 0.1) - 1.0).abs() < 2e-3, "{edge_m}");
    }

    #[test]
    fn touches_may_lie_off_the_skin_by_the_spacing_of_its_electrodes() {
        let design = SkinDesign::shipped("cylinder30").unwrap();
        let mesh = Mesh::generate(&design).unwrap();
        // The rings are 60 mm apart; neighbours on a ring and across rings are at least 58.8 mm apart (a chord of 72
        // degrees).
        let spacing_m = mesh.electrode_spacing_m();
        assert!((0.05..0.06).contains(&spacing_m), "{spacing_m}");
        let limits = mesh.place_limits(design.body.surface());
        assert!(limits.check([0.05 + 0.9 * spacing_m, 0.0, 0.1]).is_ok());
        assert!(limits.check([0.05 + 1.1 * spacing_m, 0.0, 0.1]).is_err());
        assert!(limits.check([50.0, 0.0, 100.0]).unwrap_err().ends_with("it seems to be in millimetres"));
    }
}
