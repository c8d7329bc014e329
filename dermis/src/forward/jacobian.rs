//! The derivative of a frame with respect to the conductivity, by the adjoint method.
//!
//! With `u_d` the field of 1 A through drive `d` and `u_m` that of 1 A through measure pair `m`, the voltage at `m` for
//! `d` changes by `-integral of grad u_d . grad u_m` per unit of conductivity, over the region that changes
//! (Geselowitz, 1971, DOI 10.1109/TBME.1971.4502787).

use super::{ForwardError, ForwardModel};
use crate::fem::Gradients;
use crate::image::PixelSpace;
use crate::linalg::Matrix;
use crate::mesh::Mesh;
use crate::protocol::Protocol;
use pulp::{Simd, WithSimd};

/// Number of cells or pixels whose derivatives are computed before they are written together: the writes have a stride
/// of one frame, so this fills whole cache lines (64 bytes hold 8 values).
const BLOCK: usize = 8;

impl ForwardModel {
    /// The derivative of the frame with respect to the conductivity of each cell, channels x cells, ohm per S (ohm per
    /// S/m in volumes).
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    pub fn jacobian(&self, conductivity: &[f64]) -> Result<Matrix, ForwardError> {
        let cells: Vec<Vec<(usize, f64)>> = (0..self.mesh().cell_count()).map(|cell| vec![(cell, 1.0)]).collect();
        self.derivative_by(&cells, conductivity)
    }

    /// The derivative of the frame with respect to the conductivity of each pixel, channels x pixels: the sum of the
    /// cells' derivatives, weighted by the fraction of each cell in the pixel; ohm per S.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    pub fn pixel_jacobian(&self, conductivity: &[f64], pixels: &PixelSpace) -> Result<Matrix, ForwardError> {
        self.derivative_by(&pixels.overlaps, conductivity)
    }

    /// The derivative with respect to the conductivity of regions, each a list of cells with the fraction of each that
    /// changes.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    pub(crate) fn derivative_by(
        &self,
        parts: &[Vec<(usize, f64)>],
        conductivity: &[f64],
    ) -> Result<Matrix, ForwardError> {
        let fields = Fields::new(self.mesh(), &self.potentials(conductivity)?);
        let mut jacobian = Matrix::zeros(self.protocol().channel_count(), parts.len());
        let jacobian_values = &mut jacobian;
        pulp::Arch::new().dispatch(Fill {
            fields: &fields,
            parts,
            protocol: self.protocol(),
            jacobian: jacobian_values,
        });
        Ok(jacobian)
    }
}

/// Electrodes are processed in groups of this size, the lanes of the widest vectors.
const LANES: usize = 8;

/// The gradient of every electrode's field on every cell.
struct Fields {
    /// Number of electrodes, rounded up to whole lanes (padded with zero fields).
    stride: usize,
    dimension: usize,
    /// Per cell, per dimension, per electrode.
    values: Vec<f64>,
    measures: Vec<f64>,
}

impl Fields {
    fn new(mesh: &Mesh, potentials: &Matrix) -> Self {
        let stride = potentials.columns.next_multiple_of(LANES);
        let dimension = mesh.cells.corners(0).len() - 1;
        let mut values = vec![0.0; mesh.cell_count() * dimension * stride];
        let mut measures = Vec::with_capacity(mesh.cell_count());
        for (cell, field) in values.chunks_exact_mut(dimension * stride).enumerate() {
            let gradients = Gradients::new(mesh, cell);
            let local = in_local_axes(&gradients);
            measures.push(gradients.measure);
            for (axis, row) in field.chunks_exact_mut(stride).enumerate() {
                for (&node, gradient) in mesh.cells.corners(cell).iter().zip(&local) {
                    for (value, potential) in row.iter_mut().zip(potentials.row(node)) {
                        *value += gradient[axis] * potential;
                    }
                }
            }
        }
        Fields { stride, dimension, values, measures }
    }

    #[inline(always)]
    fn of_cell(&self, cell: usize) -> &[f64] {
        let size = self.dimension * self.stride;
        &self.values[cell * size..(cell + 1) * size]
    }
}

/// The gradients in axes of the cell: a triangle needs only two.
fn in_local_axes(gradients: &Gradients) -> [[f64; 3]; 4] {
    use crate::geom::vector::{dot, normalize, scale, sub};
    if gradients.corner_count == 4 {
        return gradients.of_corner;
    }
    let [a, b, _, _] = gradients.of_corner;
    let first = normalize(a);
    let second = normalize(sub(b, scale(first, dot(b, first))));
    gradients.of_corner.map(|gradient| [dot(gradient, first), dot(gradient, second), 0.0])
}

struct Fill<'a> {
    fields: &'a Fields,
    parts: &'a [Vec<(usize, f64)>],
    protocol: &'a Protocol,
    jacobian: &'a mut Matrix,
}

impl WithSimd for Fill<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        fill(self.fields, self.parts, self.protocol, self.jacobian);
    }
}

#[inline(always)]
fn fill(fields: &Fields, parts: &[Vec<(usize, f64)>], protocol: &Protocol, jacobian: &mut Matrix) {
    let count = fields.stride;
    let mut products = vec![0.0; BLOCK * count * count];
    for (block, parts) in parts.chunks(BLOCK).enumerate() {
        for (part, product) in parts.iter().zip(products.chunks_exact_mut(count * count)) {
            accumulate(fields, part, product);
        }
        for (channel, row) in protocol.channels().iter().zip(jacobian.values.chunks_exact_mut(jacobian.columns)) {
            let ([source, sink], [plus, minus]) = (channel.drive, channel.measure);
            let target = &mut row[block * BLOCK..block * BLOCK + parts.len()];
            for (value, product) in target.iter_mut().zip(products.chunks_exact(count * count)) {
                let (from, to) = (&product[source * count..][..count], &product[sink * count..][..count]);
                *value = (to[plus] - to[minus]) - (from[plus] - from[minus]);
            }
        }
    }
}

/// The integral of the products of all electrodes' fields over a region.
#[inline(always)]
fn accumulate(fields: &Fields, part: &[(usize, f64)], product: &mut [f64]) {
    let count = fields.stride;
    product.fill(0.0);
    for &(cell, fraction) in part {
        let weight = fraction * fields.measures[cell];
        let field = fields.of_cell(cell);
        for (k, row) in product.chunks_exact_mut(count).enumerate() {
            for axis in field.chunks_exact(count) {
                let factor = weight * axis[k];
                for (values, others) in row.as_chunks_mut::<LANES>().0.iter_mut().zip(axis.as_chunks::<LANES>().0) {
                    for lane in 0..LANES {
                        values[lane] += factor * others[lane];
                    }
                }
            }
        }
    }
}
