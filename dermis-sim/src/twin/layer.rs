//! A continuous piezoresistive layer: a coating that conducts better where it is pressed.

use super::TwinError;
use super::error::{check_between, check_positive};
use super::load::Load;
use super::press::{Foam, Press};
use crate::quadrature::LocalFunction;
use crate::unrolled::Unrolled;
use dermis::design::Body;
use dermis::geom::Point3;
use dermis::geom::vector::{distance, longest_edge};
use dermis::mesh::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Longest edge of a triangle and of a tetrahedron over the foam's thickness, the scale of the pressure: with 1/2 the
/// mean over a triangle is correct to 1e-5 of the highest value.
const LONGEST_EDGE_THICKNESSES: [f64; 2] = [0.5, 0.25];

/// A coating without patches, whose own sheet conductance rises with the pressure below the foam.
///
/// `s(p) = s_rest (1 + r(p))` with `r(p) = r_max p / (p + p_half)`: proportional to a low pressure, as the number of
/// conducting paths through a filled polymer or a fabric of conductive fibres is, and bounded, since the paths are
/// finite in number. The form is the simplest with these two limits; an assumption without a source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayerOptions {
    /// `r_max`: relative rise of conductance that no pressure exceeds.
    pub greatest_rise: f64,
    /// `p_half`: pressure at which half of it is reached, Pa.
    pub half_pressure_pa: f64,
    /// The foam between a tip and the layer.
    pub foam: Foam,
}

impl LayerOptions {
    /// The relative rise of conductance at a pressure.
    pub fn rise(&self, pressure_pa: f64) -> f64 {
        self.greatest_rise * (pressure_pa / (pressure_pa + self.half_pressure_pa))
    }

    /// # Errors
    /// Invalid values.
    pub(super) fn check(&self) -> Result<(), TwinError> {
        check_positive("greatest_rise", self.greatest_rise, "1 doubles the conductance at most")?;
        check_between("greatest_rise", self.greatest_rise, [1e-6, 1e6], "1 doubles the conductance at most")?;
        check_positive("half_pressure_pa", self.half_pressure_pa, "10000 is the pressure of a finger")?;
        check_between("half_pressure_pa", self.half_pressure_pa, [1e-3, 1e12], "10000 is the pressure of a finger")?;
        self.foam.check()
    }

    /// The conductance of each cell during some presses, S: the mean of `s(p)` over the cell.
    ///
    /// # Errors
    /// Presses that are invalid for the body and the foam.
    pub(super) fn conductivity(
        &self,
        presses: &[Press],
        body: &Body,
        mesh: &Mesh,
        rest: &[f64],
    ) -> Result<Vec<f64>, TwinError> {
        let mut rises = vec![0.0; rest.len()];
        let (load, surface) = (Load::new(presses, &self.foam, body, 0.0)?, Unrolled::of(&body.surface()));
        let reaches: Vec<(Point3, f64)> =
            presses.iter().zip(load.reaches_m()).map(|(press, (_, reach_m))| (press.centre_m, reach_m)).collect();
        let rise = LocalFunction {
            // A distance in space is at most the distance along the surface.
            reaches: |corners: &[Point3]| {
                let size_m = longest_edge(corners);
                reaches.iter().any(|&(centre_m, reach_m)| distance(corners[0], centre_m) <= reach_m + size_m)
            },
            value: |point_m| self.rise(load.pressure_pa(surface.chart(point_m))),
            longest_edge_m: LONGEST_EDGE_THICKNESSES.map(|thicknesses| thicknesses * self.foam.thickness_m),
        };
        rise.add_cell_means(mesh, &mut rises);
        Ok(rest.iter().zip(rises).map(|(rest, rise)| rest * (1.0 + rise)).collect())
    }
}
