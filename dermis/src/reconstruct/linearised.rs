//! The forward model linearised about the untouched skin: the basis of every linear method.

use crate::forward::{ForwardModel, Matrix};
use crate::frame::Frame;
use crate::image::PixelSpace;
use crate::reconstruct::ReconstructError;

/// The forward model linearised about the untouched skin.
///
/// A relative change `x` of the pixels' conductance changes the frame by `jacobian x` (ohm).
#[derive(Debug, Clone)]
pub struct Linearised {
    /// The derivative of the frame with respect to the relative change of each pixel's conductance, channels x pixels,
    /// ohm.
    pub jacobian: Matrix,
    /// The untouched frame, ohm.
    pub rest_frame: Vec<f64>,
    /// Conductance of each untouched pixel (mean over its cells weighted by their overlap).
    pub(crate) rest_conductivity: Vec<f64>,
}

impl Linearised {
    /// The linear model about the rest conductivity of a forward model, in pixels.
    ///
    /// # Errors
    /// A forward problem that cannot be solved, pixels with cells that are not in the mesh.
    pub fn new(forward: &ForwardModel, pixels: &PixelSpace) -> crate::Result<Self> {
        Self::about(forward, pixels, forward.solve(forward.rest_conductivity())?)
    }

    /// [`new`](Self::new) with the untouched frame, which is known.
    pub(crate) fn about(forward: &ForwardModel, pixels: &PixelSpace, untouched: Frame) -> crate::Result<Self> {
        let rest = forward.rest_conductivity();
        if let Some(cell) = pixels.overlaps.iter().flatten().map(|o| o.0).find(|&cell| cell >= rest.len()) {
            let message = format!("a pixel overlaps cell {cell}, but the mesh has {} cells", rest.len());
            return Err(ReconstructError::Parameter(message).into());
        }
        // J times sigma for each cell, before the cells are summed into pixels: a change relative to the cell's own
        // rest value.
        let mut relative = pixels.clone();
        for (cell, fraction) in relative.overlaps.iter_mut().flatten() {
            *fraction *= rest[*cell];
        }
        let mesh = forward.mesh();
        let rest_conductivity = pixels.overlaps.iter().map(|overlaps| {
            let weight = |&(cell, fraction): &(usize, f64)| fraction * mesh.cell_measure(cell);
            let total: f64 = overlaps.iter().map(weight).sum();
            overlaps.iter().map(|overlap| weight(overlap) * rest[overlap.0]).sum::<f64>() / total
        });
        let mut model = Linearised {
            rest_conductivity: rest_conductivity.collect(),
            jacobian: forward.pixel_jacobian(rest, &relative)?,
            rest_frame: untouched.0,
        };
        if forward.protocol().amplitude_only() {
            model.drop_signs();
        }
        Ok(model)
    }

    /// The model of an instrument that reports amplitudes: `d|V| = sign(V) dV` about the untouched frame.
    fn drop_signs(&mut self) {
        for (row, value) in self.jacobian.values.chunks_exact_mut(self.jacobian.columns).zip(&mut self.rest_frame) {
            if *value < 0.0 {
                row.iter_mut().for_each(|entry| *entry = -*entry);
                *value = -*value;
            }
        }
    }

    /// Number of values of a frame.
    pub fn channel_count(&self) -> usize {
        self.jacobian.rows
    }

    /// Number of pixels.
    pub fn pixel_count(&self) -> usize {
        self.jacobian.columns
    }

    /// Checks that the lists fit each other and all values are finite.
    pub(crate) fn validate(&self, pixels: &PixelSpace) -> Result<(), ReconstructError> {
        let Matrix { rows, columns, ref values } = self.jacobian;
        for (what, got, expected) in [
            ("the Jacobian", values.len(), rows * columns),
            ("the untouched frame", self.rest_frame.len(), rows),
            ("the rest conductivity", self.rest_conductivity.len(), columns),
            ("the list of pixels", pixels.len(), columns),
            ("the list of the pixels' neighbours", pixels.neighbours.len(), columns),
            ("the list of the pixels' areas", pixels.areas.len(), columns),
        ] {
            if got != expected {
                let message = format!("{what} has {got} values, but {expected} are needed");
                return Err(ReconstructError::Parameter(message));
            }
        }
        if rows == 0 || columns == 0 {
            return Err(ReconstructError::Parameter("a reconstruction needs a channel and a pixel at least".into()));
        }
        if let Some(at) = values.iter().position(|value| !value.is_finite()) {
            let (channel, pixel) = (at / columns, at % columns);
            let message = format!("the Jacobian is {} at channel {channel}, pixel {pixel}", values[at]);
            return Err(ReconstructError::Parameter(message));
        }
        if let Some(pixel) = self.rest_conductivity.iter().position(|&value| !(value.is_finite() && value > 0.0)) {
            let value = self.rest_conductivity[pixel];
            let message = format!("the rest conductivity of pixel {pixel} is {value}: it must be positive and finite");
            return Err(ReconstructError::Parameter(message));
        }
        Ok(())
    }
}
