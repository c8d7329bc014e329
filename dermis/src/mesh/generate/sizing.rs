//! Target edge lengths as a function of position.

use super::CELLS_ACROSS;
use super::outline::Outline;
use crate::design::{MeshOptions, Region, RegionPlace};
use crate::geom::{Chart, Edge, Point2};
use crate::mesh::fit::boxes;

/// Mean edge length as a fraction of the longest allowed: a relaxed mesh has edges up to a fifth longer than the mean.
const MEAN_OF_LONGEST: f64 = 0.87;

/// How much shorter than elsewhere edges are in a narrow region, at most: a mesh of millions of cells is no answer to a region given
/// in another unit.
const MAX_REFINEMENT: f64 = 64.0;

/// Number of squares of the grid by which electrodes near a point are found.
const SQUARES: f64 = 4096.0;

/// `h(x) = min(h_max, h_electrode + growth * distance to the nearest electrode outline)`.
///
/// Around an electrode of radius `a` the field decreases like `1 / r`, its second derivative like `1 / r^2`; the energy
/// error of linear elements is uniform over the mesh if `h` is proportional to `r`, hence the linear growth.
#[derive(Debug)]
pub(super) struct Sizing {
    chart: Chart,
    features: Vec<Feature>,
    /// The relevant features, by square of a grid over the body.
    nearby: Vec<Vec<usize>>,
    columns: usize,
    rows: usize,
    at_electrode: f64,
    pub largest: f64,
    growth: f64,
}

#[derive(Debug, Clone, Copy)]
enum Feature {
    /// The outline of a disc and the length of its sides; for a small disc they are shorter than the target length.
    Circle {
        centre: Point2,
        radius: f64,
        side: f64,
    },
    Point {
        at: Point2,
    },
    /// The box of a region, and the length of edges in it.
    Box {
        low: Point2,
        high: Point2,
        side: f64,
    },
}

impl Sizing {
    pub(super) fn new(chart: &Chart, outlines: &[Outline], regions: &[Region], options: &MeshOptions) -> Self {
        let mut features = Vec::new();
        let edges = Edge::all(chart);
        for outline in outlines {
            match *outline {
                Outline::Disc { centre, radius, step, .. } => {
                    let side = (radius * step).min(options.electrode_edge_m);
                    features.push(Feature::Circle { centre, radius, side });
                }
                Outline::Arc { edge, from, to } => {
                    features.push(Feature::Point { at: edges[edge].point(from) });
                    features.push(Feature::Point { at: edges[edge].point(to) });
                }
                Outline::Point { at } => features.push(Feature::Point { at }),
            }
        }
        for region in regions {
            let RegionPlace::Box { low_m, high_m } = region.place else { continue };
            let [least, most] = chart.bounds_m();
            for [low, high] in boxes(chart, low_m, high_m) {
                // A box on a cylinder may pass its seam.
                let inside_m = |axis: usize| match chart.period_m() {
                    Some(_) if axis == 0 => high[0] - low[0],
                    _ => high[axis].min(most[axis]) - low[axis].max(least[axis]),
                };
                let across_m = inside_m(0).min(inside_m(1));
                let side = MEAN_OF_LONGEST * (across_m / CELLS_ACROSS).max(options.max_edge_m / MAX_REFINEMENT);
                if across_m > 0.0 {
                    features.push(Feature::Box { low, high, side });
                }
            }
        }
        let mut sizing = Sizing {
            chart: *chart,
            features,
            nearby: Vec::new(),
            columns: 0,
            rows: 0,
            at_electrode: options.electrode_edge_m,
            largest: MEAN_OF_LONGEST * options.max_edge_m,
            growth: options.growth,
        };
        sizing.sort_features();
        sizing
    }

    /// Lists for every square of a grid the features that can limit the edge length there; elsewhere edges have the
    /// maximum length.
    fn sort_features(&mut self) {
        let [low, high] = self.chart.bounds_m();
        let size = [high[0] - low[0], high[1] - low[1]];
        let side = (size[0] * size[1] / SQUARES).sqrt();
        (self.columns, self.rows) = ((size[0] / side).ceil() as usize, (size[1] / side).ceil() as usize);
        let half_diagonal = 0.5 * (size[0] / self.columns as f64).hypot(size[1] / self.rows as f64);
        let slack = self.growth * half_diagonal;
        for row in 0..self.rows {
            for column in 0..self.columns {
                let centre = [
                    low[0] + size[0] * (column as f64 + 0.5) / self.columns as f64,
                    low[1] + size[1] * (row as f64 + 0.5) / self.rows as f64,
                ];
                let near = |&feature: &usize| self.allowed(feature, centre) <= self.largest + slack;
                self.nearby.push((0..self.features.len()).filter(near).collect());
            }
        }
    }

    /// The edge length that a feature allows at a point.
    fn allowed(&self, feature: usize, point: Point2) -> f64 {
        match self.features[feature] {
            Feature::Circle { centre, radius, side } => {
                side + self.growth * (self.chart.distance_m(point, centre) - radius).abs()
            }
            Feature::Point { at } => self.at_electrode + self.growth * self.chart.distance_m(point, at),
            Feature::Box { low, high, side } => {
                let nearest = [0, 1].map(|axis| point[axis].clamp(low[axis], high[axis]));
                side + self.growth * (point[0] - nearest[0]).hypot(point[1] - nearest[1])
            }
        }
    }

    fn square(&self, point: Point2) -> usize {
        let [low, high] = self.chart.bounds_m();
        let index = |axis: usize, count: usize| {
            let share = (point[axis] - low[axis]) / (high[axis] - low[axis]);
            ((share * count as f64).max(0.0) as usize).min(count - 1)
        };
        index(1, self.rows) * self.columns + index(0, self.columns)
    }

    /// The target edge length at a point.
    pub(super) fn at(&self, point: Point2) -> f64 {
        let nearby = &self.nearby[self.square(self.chart.wrap(point))];
        nearby.iter().map(|&feature| self.allowed(feature, point)).fold(self.largest, f64::min)
    }

    /// Divides `from..to` of a curve into at least one part of the target length; returns the inner division points.
    pub(super) fn divide(&self, from: f64, to: f64, point: impl Fn(f64) -> Point2) -> Vec<f64> {
        let samples = (8.0 * (to - from) / self.at_electrode.min(to - from)).ceil() as usize;
        let place = |k: usize| from + (to - from) * k as f64 / samples as f64;
        let mut count = vec![0.0];
        for k in 0..samples {
            let middle = 0.5 * (place(k) + place(k + 1));
            count.push(count[k] + (place(k + 1) - place(k)) / self.at(point(middle)));
        }
        let total = count[samples];
        let nearest = total.round().max(1.0);
        // Rounding down must not make a part longer than the longest edge allowed.
        let parts = if total > nearest / MEAN_OF_LONGEST { nearest + 1.0 } else { nearest } as usize;
        (1..parts)
            .map(|part| {
                let wanted = total * part as f64 / parts as f64;
                let k = count.partition_point(|&reached| reached < wanted).clamp(1, samples);
                let t = (wanted - count[k - 1]) / (count[k] - count[k - 1]);
                place(k - 1) + t * (place(k) - place(k - 1))
            })
            .collect()
    }
}
