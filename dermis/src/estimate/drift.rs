//! Directions in which the untouched frame of a skin drifts.

use crate::forward::{ForwardError, ForwardModel, Matrix};
use crate::geom::Point3;
use crate::geom::vector::centroid;

/// How much a skin drifts between two frames: standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DriftSpread {
    /// Relative change of the conductance of the whole sheet.
    pub sheet: f64,
    /// Relative change of the conductance at the ends of the body's longest side, linear along each axis.
    pub gradient: f64,
    /// Relative change of each contact impedance.
    pub contact: f64,
    /// Least change of each contact resistance, ohm.
    pub contact_least_ohm: f64,
}

/// The changes of the frame of a model by one standard deviation of each drift, directions x channels, ohm: of the sheet as
/// a whole, along each axis, of each contact. Directions whose deviation is 0 are left out. An instrument that reports
/// amplitudes has those of amplitudes.
///
/// # Errors
/// A forward problem without a solution.
pub fn directions(model: &ForwardModel, spread: &DriftSpread) -> Result<Matrix, ForwardError> {
    let mut rows: Vec<Vec<f64>> = Vec::new();
    let of_sheet = of_sheet(model, spread);
    if !of_sheet.is_empty() {
        let changes = model.derivative_by(&of_sheet, model.rest_conductivity())?.transposed();
        rows.extend(changes.values.chunks_exact(changes.columns).map(<[f64]>::to_vec));
    }
    if spread.contact > 0.0 || spread.contact_least_ohm > 0.0 {
        rows.extend(of_contacts(model, spread)?);
    }
    let rest = model.solve(model.rest_conductivity())?;
    if model.protocol().amplitude_only() {
        for row in &mut rows {
            row.iter_mut().zip(rest.iter()).for_each(|(change, value)| *change *= value.signum());
        }
    }
    Ok(Matrix { rows: rows.len(), columns: rest.len(), values: rows.concat() })
}

/// The changes of the cells' conductivity, a list for each direction.
fn of_sheet(model: &ForwardModel, spread: &DriftSpread) -> Vec<Vec<(usize, f64)>> {
    let mesh = model.mesh();
    let centres_m: Vec<Point3> = (0..mesh.cell_count()).map(|cell| mesh.cell_centre(cell)).collect();
    let middle = centroid(&centres_m);
    let along = |axis: usize| centres_m.iter().map(move |centre| centre[axis]);
    let half_m =
        |axis: usize| 0.5 * (along(axis).fold(f64::NEG_INFINITY, f64::max) - along(axis).fold(f64::INFINITY, f64::min));
    let extent_m = (0..3).map(half_m).fold(f64::MIN_POSITIVE, f64::max);
    let whole = (spread.sheet > 0.0).then(|| vec![spread.sheet; centres_m.len()]);
    let linear = |axis: usize| along(axis).map(|at| spread.gradient * (at - middle[axis]) / extent_m).collect();
    // Across a flat body the gradient is zero.
    let axes = (0..3).filter(|_| spread.gradient > 0.0);
    let changes = |shares: Vec<f64>| {
        model.rest_conductivity().iter().zip(shares).map(|(rest, share)| rest * share).enumerate().collect()
    };
    whole.into_iter().chain(axes.map(linear)).map(changes).collect()
}

/// The changes by each contact.
fn of_contacts(model: &ForwardModel, spread: &DriftSpread) -> Result<Vec<Vec<f64>>, ForwardError> {
    let by_contact = model.contact_jacobian(model.rest_conductivity())?;
    let change = |(electrode, impedance): (usize, &f64)| {
        let least_ohm = (spread.contact_least_ohm - spread.contact * model.contact_resistance_ohm(electrode)).max(0.0);
        let gains = model.protocol().contact_gains(electrode).enumerate();
        gains
            .map(|(channel, gain)| spread.contact * impedance * by_contact.at(channel, electrode) + least_ohm * gain)
            .collect()
    };
    Ok(model.contact_impedances().iter().enumerate().map(change).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::SkinDesign;
    use crate::mesh::Mesh;

    const STEP: f64 = 1e-4;

    fn model(amplitude_only: bool) -> ForwardModel {
        let mut design = SkinDesign::shipped("tank16").unwrap();
        design.mesh = design.mesh.scaled(3.0);
        design.protocol = design.protocol.clone().with_amplitude_only(amplitude_only);
        ForwardModel::new(&design, &Mesh::generate(&design).unwrap()).unwrap()
    }

    /// Compared with frames of the drifted skin.
    #[test]
    fn directions_are_the_changes_of_the_frame() {
        let model = model(false);
        let (rest, nodes_m) = (model.rest_conductivity(), &model.mesh().nodes);
        let spread = DriftSpread { sheet: 0.03, contact: 0.2, ..DriftSpread::default() };
        let found = directions(&model, &spread).unwrap();
        assert_eq!(found.rows, 1 + 16);
        let frame = |contacts: &[f64], conductivity: &[f64]| {
            let model = model.with_parameters(nodes_m, contacts, conductivity).unwrap();
            model.solve(conductivity).unwrap()
        };
        let contacts = model.contact_impedances();
        let grown: Vec<f64> = rest.iter().map(|value| value * (1.0 + STEP * 0.03)).collect();
        let mut resistive = contacts.to_vec();
        resistive[5] *= 1.0 + STEP * 0.2;
        let before = frame(contacts, rest);
        for (row, after) in [(0, frame(contacts, &grown)), (1 + 5, frame(&resistive, rest))] {
            let size = before.iter().fold(0.0f64, |most, value| most.max(value.abs()));
            for (channel, direction) in found.row(row).iter().enumerate() {
                let change = (after[channel] - before[channel]) / STEP;
                assert!((change - direction).abs() < 1e-4 * size, "{row} {channel}: {change} {direction}");
            }
        }
    }

    #[test]
    fn a_flat_skin_has_no_gradient_across_it_and_amplitudes_have_no_signs() {
        let spread = DriftSpread { gradient: 0.03, contact_least_ohm: 0.5, ..DriftSpread::default() };
        let (signed, amplitudes) = (model(false), model(true));
        let [a, b] = [&signed, &amplitudes].map(|model| directions(model, &spread).unwrap());
        assert_eq!([a.rows, b.rows], [3 + 16; 2]);
        assert!(a.row(0).iter().any(|change| *change != 0.0) && a.row(2).iter().all(|change| *change == 0.0));
        let rest = signed.solve(signed.rest_conductivity()).unwrap();
        for (channel, value) in rest.iter().enumerate() {
            assert!((a.at(0, channel) * value.signum() - b.at(0, channel)).abs() < 1e-12, "{channel}");
        }
    }
}
