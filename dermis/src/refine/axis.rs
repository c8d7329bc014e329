//! One axis of a grid of places, and interpolation between them.

/// One axis of the grid, in the chart of the surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    pub low_m: f64,
    pub step_m: f64,
    pub count: usize,
    pub is_closed: bool,
}

/// Interpolation at a place: the first of four grid points, with their weights for the value and two derivatives.
pub(super) struct Stencil {
    pub first: i64,
    pub weights: [[f64; 4]; 3],
}

impl Axis {
    pub(super) fn closed(low_m: f64, period_m: f64, step_m: f64) -> Self {
        let count = (period_m / step_m).ceil().max(4.0);
        Axis { low_m, step_m: period_m / count, count: count as usize, is_closed: true }
    }

    pub(super) fn open(low_m: f64, high_m: f64, step_m: f64) -> Self {
        let steps = ((high_m - low_m) / step_m).ceil().max(3.0);
        Axis { low_m, step_m: (high_m - low_m) / steps, count: steps as usize + 1, is_closed: false }
    }

    pub(super) fn at(&self, index: usize) -> f64 {
        self.low_m + index as f64 * self.step_m
    }

    pub(super) fn index(&self, index: i64) -> usize {
        index.rem_euclid(self.count as i64) as usize
    }

    /// Lagrange's cubic through the four nearest grid points; at an edge through the last four.
    pub(super) fn stencil(&self, place_m: f64) -> Stencil {
        let place = (place_m - self.low_m) / self.step_m;
        let mut middle = place.floor() as i64;
        if !self.is_closed {
            middle = middle.clamp(1, self.count as i64 - 3);
        }
        let (t, h) = (place - middle as f64, self.step_m);
        let value = [
            -t * (t - 1.0) * (t - 2.0) / 6.0,
            (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
            -(t + 1.0) * t * (t - 2.0) / 2.0,
            (t + 1.0) * t * (t - 1.0) / 6.0,
        ];
        let first = [
            -(3.0 * t * t - 6.0 * t + 2.0) / 6.0,
            (3.0 * t * t - 4.0 * t - 1.0) / 2.0,
            -(3.0 * t * t - 2.0 * t - 2.0) / 2.0,
            (3.0 * t * t - 1.0) / 6.0,
        ];
        let second = [1.0 - t, 3.0 * t - 2.0, 1.0 - 3.0 * t, t];
        let weights = [value, first.map(|weight| weight / h), second.map(|weight| weight / (h * h))];
        Stencil { first: middle - 1, weights }
    }
}
