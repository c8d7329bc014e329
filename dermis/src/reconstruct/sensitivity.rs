//! The sensitivity of a frame to each part of a skin.

use crate::image::PixelSpace;
use crate::reconstruct::Linearised;

impl Linearised {
    /// The change of the frame (its Euclidean norm over all channels, ohm) per relative change of conductance and area
    /// of each pixel, ohm/m2 (ohm/m3 in volumes):
    ///
    /// ```text
    /// s_p = |J e_p| / A_p
    /// ```
    ///
    /// Because of the division by the area it does not depend on the size of the pixels.
    ///
    /// # Panics
    /// If `pixels` are not those of the model.
    pub fn sensitivity(&self, pixels: &PixelSpace) -> Vec<f64> {
        assert_eq!(pixels.len(), self.pixel_count(), "the pixels of the model");
        let mut squares = vec![0.0; pixels.len()];
        for row in self.jacobian.values.chunks_exact(pixels.len().max(1)) {
            for (square, value) in squares.iter_mut().zip(row) {
                *square += value * value;
            }
        }
        squares.iter().zip(&pixels.areas).map(|(square, area)| square.sqrt() / area).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::SkinDesign;
    use crate::forward::ForwardModel;
    use crate::geom::Surface;
    use crate::mesh::{Cells, ElectrodePatch, Mesh};

    /// A strip of 2 x 1 squares with an electrode at each corner of its ends.
    fn strip(conductivity: f64) -> (Mesh, ForwardModel) {
        let protocol = SkinDesign::shipped("tank16").expect("shipped").protocol;
        let nodes = (0..2).flat_map(|j| (0..9).map(move |i| [i as f64 * 0.01, j as f64 * 0.01, 0.0])).collect();
        let cells = (0..8).flat_map(|i| [[i, i + 1, i + 10], [i, i + 10, i + 9]]).collect();
        let electrodes = (0..16).map(|k| ElectrodePatch::Node(if k < 8 { k } else { k + 1 })).collect();
        let mesh = Mesh { nodes, cells: Cells::Triangles(cells), electrodes, regions: vec![] };
        let rest = vec![conductivity; mesh.cell_count()];
        let forward = ForwardModel::from_parts(&mesh, &[1.0; 16], &protocol, &rest).expect("a valid model");
        (mesh, forward)
    }

    #[test]
    fn it_is_the_change_of_the_frame_that_a_small_touch_makes() {
        let (mesh, forward) = strip(2e-3);
        let space = PixelSpace::cells(&mesh, Surface::Plane);
        let sensitivity = Linearised::new(&forward, &space).unwrap().sensitivity(&space);
        let rest = forward.solve(forward.rest_conductivity()).unwrap();
        for cell in [0, 5, 11] {
            let step = 1e-6;
            let mut touched = forward.rest_conductivity().to_vec();
            touched[cell] *= 1.0 + step;
            let change = &forward.solve(&touched).unwrap() - &rest;
            let norm = change.iter().map(|v| v * v).sum::<f64>().sqrt() / step / mesh.cell_measure(cell);
            assert!((norm / sensitivity[cell] - 1.0).abs() < 1e-4, "{norm} {}", sensitivity[cell]);
        }
    }

    #[test]
    fn a_skin_of_twice_the_conductance_has_half_the_sensitivity() {
        let of = |conductivity| {
            let (mesh, forward) = strip(conductivity);
            let space = PixelSpace::cells(&mesh, Surface::Plane);
            Linearised::new(&forward, &space).unwrap().sensitivity(&space)
        };
        let (once, twice) = (of(1e-3), of(2e-3));
        assert!(once.iter().zip(&twice).all(|(a, b)| (a / b - 2.0).abs() < 1e-9));
    }
}
