//! The derivative of a frame with respect to the contact impedances, by the adjoint method.
//!
//! In the bilinear form of the complete electrode model (Somersalo, Cheney and Isaacson, 1992, DOI 10.1137/0152060, Eq.
//! 3.5) an electrode `l` has the term `1/z_l integral over E_l of (u - U_l)(v - V_l)`. With `u_d, U_d` the field of 1 A
//! through drive `d` and `u_m, U_m` that of 1 A through measure pair `m`, the voltage at `m` for `d` changes by
//! `1/z_l^2 integral over E_l of (u_d - U_d)(u_m - U_m)` per unit of `z_l`.

use super::assembly::patch_parts;
use super::displacement_jacobian::add_outer;
use super::{ForwardError, ForwardModel, Matrix};
use crate::fem::mass;
use crate::protocol::Channel;

impl ForwardModel {
    /// The derivative of the frame with respect to the contact impedance of each electrode, channels x electrodes, ohm
    /// per ohm m2 (on cells and faces) or per ohm m (on edges); zero for a point electrode. The [series
    /// resistances](Self::series_resistances) and the matrix of the correction at the ends of arcs are held constant.
    ///
    /// # Errors
    /// As [`solve`](Self::solve).
    pub fn contact_jacobian(&self, conductivity: &[f64]) -> Result<Matrix, ForwardError> {
        let (nodes, electrodes) = self.solver().fields(conductivity)?;
        let channels = self.protocol().channels();
        let mut jacobian = Matrix::zeros(channels.len(), electrodes.rows);
        for electrode in 0..electrodes.rows {
            let products = self.contact_products(electrode, &nodes, electrodes.row(electrode));
            let admittance_squared = self.contact_impedances()[electrode].powi(-2);
            for (channel, value) in channels.iter().enumerate() {
                // A point has no contact impedance: its products are zero, and its value is arbitrary.
                if self.mesh().electrode_size(electrode) > 0.0 {
                    *jacobian.at_mut(channel, electrode) =
                        admittance_squared * of_channel(&products, value) + self.of_constant(electrode, value);
                }
            }
        }
        Ok(jacobian)
    }

    /// The derivative of what the correction at the ends of arcs adds to a channel: `(d_l m_l - (M' d)_l (M' m)_l) / w_l` with the
    /// currents `d` and `m` of drive and measure pair, and the size `w_l`.
    fn of_constant(&self, electrode: usize, Channel { drive, measure }: &Channel) -> f64 {
        let Some(transform) = self.transform() else { return 0.0 };
        let own = |[plus, minus]: [usize; 2]| {
            f64::from(u8::from(plus == electrode)) - f64::from(u8::from(minus == electrode))
        };
        let of_mesh =
            |[plus, minus]: [usize; 2]| transform.matrix.at(plus, electrode) - transform.matrix.at(minus, electrode);
        (own(*drive) * own(*measure) - of_mesh(*drive) * of_mesh(*measure)) / transform.sizes[electrode]
    }

    /// The integrals over an electrode of the products of the drops `u - U` of all electrodes' fields.
    fn contact_products(&self, electrode: usize, nodes: &Matrix, own: &[f64]) -> Matrix {
        let count = own.len();
        let mut products = Matrix::zeros(count, count);
        for (corners, measure) in patch_parts(self.mesh(), &self.mesh().electrodes[electrode]) {
            add_drops(&corners, measure, nodes, own, &mut products);
        }
        products
    }
}

/// The value of a channel, of products of the fields of all electrodes.
pub(super) fn of_channel(
    products: &Matrix,
    &Channel { drive: [source, sink], measure: [plus, minus] }: &Channel,
) -> f64 {
    let at = |drive: usize| products.at(drive, plus) - products.at(drive, minus);
    at(source) - at(sink)
}

/// Adds the integrals over a simplex of an electrode of the products of the drops `u - U` of all electrodes' fields.
/// `own`: the electrode's potential in each field.
pub(super) fn add_drops(corners: &[usize], measure: f64, nodes: &Matrix, own: &[f64], products: &mut Matrix) {
    let drop = |&node: &usize| nodes.row(node).iter().zip(own).map(|(u, own)| u - own).collect();
    let drops: Vec<Vec<f64>> = corners.iter().map(drop).collect();
    for (i, a) in drops.iter().enumerate() {
        for (j, b) in drops.iter().enumerate() {
            add_outer(mass(corners.len(), measure, i, j), a, b, products);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::design::SkinDesign;
    use crate::forward::ForwardModel;
    use crate::mesh::Mesh;

    /// Arcs, and discs with their series resistances held constant.
    #[test]
    fn the_derivative_is_that_of_central_differences() {
        for (name, series) in [("tank16", false), ("cylinder30", true)] {
            let mut design = SkinDesign::shipped(name).unwrap();
            design.mesh = design.mesh.scaled(3.0);
            let mesh = Mesh::generate(&design).unwrap();
            let model = ForwardModel::new(&design, &mesh).unwrap();
            assert_eq!(model.series_resistances().iter().any(|&ohm| ohm != 0.0), series, "{name}");
            let jacobian = model.contact_jacobian(model.rest_conductivity()).unwrap();
            for electrode in [0, 7] {
                let frame = |factor: f64| {
                    let mut impedances = model.contact_impedances().to_vec();
                    impedances[electrode] *= factor;
                    let other = model.with_parameters(&mesh.nodes, &impedances, model.rest_conductivity()).unwrap();
                    other.solve(model.rest_conductivity()).unwrap()
                };
                let (step, impedance) = (1e-4, model.contact_impedances()[electrode]);
                let (below, above) = (frame(1.0 - step), frame(1.0 + step));
                let largest = (0..above.len()).map(|c| (above[c] - below[c]).abs()).fold(0.0, f64::max);
                // The voltages are rounded, as differences of larger transfer impedances.
                let rounding = 1e-11 * above.iter().map(|value| value.abs()).fold(0.0, f64::max);
                for channel in 0..above.len() {
                    let expected = (above[channel] - below[channel]) / (2.0 * step * impedance);
                    let off = (jacobian.at(channel, electrode) - expected).abs() * 2.0 * step * impedance;
                    assert!(
                        off < 1e-6 * largest + rounding,
                        "{name}, electrode {electrode}, channel {channel}: {off} of {largest}"
                    );
                }
            }
        }
    }
}
