//! The pressure of several presses together.

use super::press::{Footprint, Press};
use super::{Foam, TwinError};
use crate::elementary::hypot;
use crate::unrolled::Unrolled;
use dermis::design::Body;
use dermis::geom::Point2;

/// The pressure of all presses together below the foam.
#[derive(Debug)]
pub(super) struct Load {
    surface: Unrolled,
    footprints: Vec<(Point2, Footprint)>,
    preload_pa: f64,
}

impl Load {
    /// Presses on a body, added to a pressure everywhere.
    ///
    /// # Errors
    /// As [`Footprint::new`].
    pub(super) fn new(presses: &[Press], foam: &Foam, body: &Body, preload_pa: f64) -> Result<Self, TwinError> {
        let surface = Unrolled::of(&body.surface());
        let footprint = |press: &Press| Ok((surface.chart(press.centre_m), Footprint::new(press, foam, body)?));
        let footprints = presses.iter().map(footprint).collect::<Result<_, TwinError>>()?;
        Ok(Load { surface, footprints, preload_pa })
    }

    /// The centre of each press in the chart [around, along], and the distance beyond which its pressure is zero, m.
    pub(super) fn reaches_m(&self) -> impl Iterator<Item = (Point2, f64)> {
        self.footprints.iter().map(|(centre, footprint)| (*centre, footprint.reach_m()))
    }

    /// The pressure at a point of the chart, Pa.
    pub(super) fn pressure_pa(&self, point: Point2) -> f64 {
        let of_press = |(centre, footprint): &(Point2, Footprint)| {
            let [round, along] = self.surface.chart_step(*centre, point);
            footprint.pressure_pa(hypot(round, along))
        };
        self.preload_pa + self.footprints.iter().map(of_press).sum::<f64>()
    }
}
