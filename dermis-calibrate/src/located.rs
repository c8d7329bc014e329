//! A located press.

use dermis::geom::Point3;
use dermis::geom::vector::{cross, dot, normalize, sub};

/// Share of the regions that contain the true position.
pub(crate) const REGION_SHARE: f64 = 0.95;
/// Standard deviation below which a posterior is not resolved, m.
const SMALLEST_SD_M: f64 = 1e-5;

/// The posterior of a press's position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Located {
    /// Mean position, m.
    pub position_m: Point3,
    /// Covariance of the position, m2.
    pub covariance_m2: [[f64; 3]; 3],
    /// Probability of a position within 20 mm of the mean.
    pub confidence: f64,
    /// Outward or inward unit normal of the skin there.
    pub normal: Point3,
    /// Mean square of the whitened residuals in their standard deviations at the most likely position: about 1 for a
    /// press like the labelled ones.
    pub misfit: f64,
    /// The factor of its change of the frame over that of a labelled press.
    pub(crate) amplitude: f64,
}

impl Located {
    /// Whether the region of 95 % of the posterior, an ellipse about the mean, contains a position.
    pub fn region_contains(&self, position_m: Point3) -> bool {
        self.squared_distance(position_m) <= limit(REGION_SHARE)
    }

    /// The squared distance of a position in units of the covariance, along the surface.
    pub(crate) fn squared_distance(&self, position_m: Point3) -> f64 {
        let error = sub(position_m, self.position_m);
        let tangents = tangents(self.normal);
        let covariance = |i: usize, j: usize| {
            let times = |k: usize| dot(self.covariance_m2[k], tangents[j]);
            (0..3).map(|k| tangents[i][k] * times(k)).sum::<f64>() + if i == j { SMALLEST_SD_M.powi(2) } else { 0.0 }
        };
        let [a, b, c] = [covariance(0, 0), covariance(0, 1), covariance(1, 1)];
        let [x, y] = tangents.map(|tangent| dot(error, tangent));
        (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)
    }

    /// Standard deviation per axis of the surface, m.
    pub fn sd_m(&self) -> f64 {
        (0.5 * (0..3).map(|axis| self.covariance_m2[axis][axis]).sum::<f64>()).sqrt()
    }
}

/// Two unit vectors along the surface.
pub(crate) fn tangents(normal: Point3) -> [Point3; 2] {
    let axis = if normal[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let first = normalize(cross(axis, normal));
    [first, cross(normal, first)]
}

/// The squared distance in standard deviations within which two normal variables lie with a probability.
pub(crate) fn limit(share: f64) -> f64 {
    -2.0 * (1.0 - share).ln()
}
