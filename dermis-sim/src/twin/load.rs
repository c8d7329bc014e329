//! The pressure of several presses together.

use super::press::Footprint;
use crate::elementary::Chart;
use dermis::geom::Point2;

/// The pressure of all presses together below the foam.
#[derive(Debug)]
pub(super) struct Load<'a> {
    chart: Chart,
    /// With their centres in the chart.
    footprints: Vec<(Point2, &'a Footprint)>,
    preload_pa: f64,
}

impl<'a> Load<'a> {
    /// Presses on a body, added to a pressure everywhere.
    pub(super) fn new(footprints: &'a [Footprint], chart: Chart, preload_pa: f64) -> Self {
        let footprints = footprints.iter().map(|footprint| (chart.unroll(footprint.centre_m()), footprint)).collect();
        Load { chart, footprints, preload_pa }
    }

    /// The centre of each press in the chart [around, along], and the distance beyond which its pressure is zero, m.
    pub(super) fn reaches_m(&self) -> impl Iterator<Item = (Point2, f64)> {
        self.footprints.iter().map(|(centre, footprint)| (*centre, footprint.reach_m()))
    }

    /// The presses that may reach a box of the chart.
    pub(super) fn near(&self, [low, high]: [Point2; 2]) -> Load<'a> {
        let half = [0.5 * (high[0] - low[0]), 0.5 * (high[1] - low[1])];
        let middle = [low[0] + half[0], low[1] + half[1]];
        let reaches = |(centre, footprint): &&(Point2, &Footprint)| {
            let step = self.chart.difference(*centre, middle);
            (0..2).all(|axis| step[axis].abs() < half[axis] + footprint.reach_m())
        };
        Load { footprints: self.footprints.iter().filter(reaches).copied().collect(), ..*self }
    }

    /// The pressure at a point of the chart, Pa.
    pub(super) fn pressure_pa(&self, point: Point2) -> f64 {
        let of_press = |(centre, footprint): &(Point2, &Footprint)| footprint.pressure_pa(self.away_m(*centre, point));
        self.preload_pa + self.footprints.iter().map(of_press).sum::<f64>()
    }

    /// The pressures at some points of the chart, Pa.
    pub(super) fn pressures_pa(&self, points: impl ExactSizeIterator<Item = Point2> + Clone) -> Vec<f64> {
        let mut sums = vec![0.0; points.len()];
        let mut own = Vec::new();
        for (centre, footprint) in &self.footprints {
            footprint.add_pressures(points.clone().map(|point| self.away_m(*centre, point)), &mut own, &mut sums);
        }
        sums.iter_mut().for_each(|sum| *sum += self.preload_pa);
        sums
    }

    /// The distance of two points of the chart along the surface, m.
    fn away_m(&self, from: Point2, to: Point2) -> f64 {
        let [round, along] = self.chart.difference(from, to);
        (round * round + along * along).sqrt()
    }
}
