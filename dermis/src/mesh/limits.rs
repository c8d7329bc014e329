//! The positions at which a skin can be touched.

use crate::geom::vector::{Point3, centroid, distance};
use crate::geom::{PlaceLimits, Surface};
use crate::mesh::{Cells, Mesh};

impl Mesh {
    /// The centre of an electrode: the mean of its nodes, m.
    ///
    /// # Panics
    /// If the electrode does not exist.
    pub fn electrode_centre(&self, electrode: usize) -> Point3 {
        let nodes = self.electrode_nodes(electrode);
        centroid(&nodes.iter().map(|&node| self.nodes[node]).collect::<Vec<_>>())
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
