//! Wrenches of contacts, with their covariance.

use crate::pose::Pose;
use dermis::contact::Contact;
use dermis::geom::Point3;
use dermis::geom::vector::{add, cross, scale};
use dermis::linalg::Matrix;
use serde::Serialize;

/// The wrench of contacts on a link: force and torque about the origin of the link's frame, in that frame.
///
/// A contact at `p` with the outward normal `n` and the normal force `f` presses with `-f n`. Its covariance is `A F A' + B P B'`:
/// `A = [I; [p]x]` and `F` that of the force, with the variance of `f` along the normal and, across it, that of a friction force that
/// is uniform in a disc of the radius `mu f`, `(mu f)^2 / 4` on each axis; `B = [0; -[-f n]x]` and `P` that of the position, in
/// the tangent plane. That of one contact has the rank 5: nothing turns about its normal.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Wrench {
    /// The name of the link.
    pub link: String,
    /// Force on the link, N.
    pub force_n: Point3,
    /// Torque about the origin of the link's frame, N m.
    pub torque_n_m: Point3,
    /// Covariance of force, then torque.
    pub covariance: [[f64; 6]; 6],
    /// Whether it is of all contacts: every skin of the link is known, and so is every force.
    pub complete: bool,
    /// The skins that are unknown or have contacts whose force is unknown or only a lower bound.
    pub missing: Vec<String>,
}

impl Wrench {
    /// No force.
    pub(crate) fn zero(link: &str) -> Self {
        let (force_n, torque_n_m, covariance) = ([0.0; 3], [0.0; 3], [[0.0; 6]; 6]);
        Wrench { link: link.into(), force_n, torque_n_m, covariance, complete: true, missing: Vec::new() }
    }

    /// Something of a skin is not known.
    pub(crate) fn lacks(&mut self, skin: &str) {
        self.complete = false;
        if !self.missing.iter().any(|missing| missing == skin) {
            self.missing.push(skin.into());
        }
    }

    /// Adds the wrench of another skin of the link.
    pub(crate) fn join(&mut self, other: Wrench) {
        self.force_n = add(self.force_n, other.force_n);
        self.torque_n_m = add(self.torque_n_m, other.torque_n_m);
        let sums = self.covariance.iter_mut().flatten().zip(other.covariance.into_iter().flatten());
        sums.for_each(|(sum, value)| *sum += value);
        other.missing.iter().for_each(|skin| self.lacks(skin));
    }

    /// Adds a contact of a skin whose frame has the pose `origin` in the link's; returns whether its force is known. A force that is
    /// a lower bound is added, and is not known.
    pub(crate) fn add(&mut self, contact: &Contact, origin: &Pose, friction: f64) -> bool {
        if !contact.force_n.is_finite() {
            return false;
        }
        let (point, normal) = (origin.point(contact.position_m), origin.vector(contact.normal));
        let force = scale(normal, -contact.force_n);
        self.force_n = add(self.force_n, force);
        self.torque_n_m = add(self.torque_n_m, cross(point, force));
        // That of a lower bound is as large as the force.
        let known = |value: f64, other: f64| if value.is_finite() { value } else { other };
        let along = known(contact.force_sd_n, contact.force_n.abs()).powi(2);
        let across = (friction * contact.force_n).powi(2) / 4.0;
        let position = known(contact.sd_m, 0.0).powi(2);
        for axis in 0..3 {
            let mut unit = [0.0; 3];
            unit[axis] = 1.0;
            // Columns of the roots of F and P: `n n'` is the part along the normal, `I - n n'` that across it.
            let tangent = add(unit, scale(normal, -normal[axis]));
            self.add_square(tangent, cross(point, tangent), across);
            self.add_square([0.0; 3], cross(tangent, force), position);
        }
        self.add_square(normal, cross(point, normal), along);
        contact.force_is_known()
    }

    /// Adds the variance times the square of a column.
    fn add_square(&mut self, force: Point3, torque: Point3, variance: f64) {
        let column: Vec<f64> = force.into_iter().chain(torque).collect();
        for (row, a) in self.covariance.iter_mut().zip(&column) {
            row.iter_mut().zip(&column).for_each(|(value, b)| *value += variance * a * b);
        }
    }

    /// The torques `J' w` of this wrench on joints, N m or N, with their variances: `jacobian` is that of the link's origin in
    /// the frame of the base, `pose` the link's in it.
    pub(crate) fn torques(&self, jacobian: &Matrix, pose: &Pose) -> Vec<(f64, f64)> {
        let torque = |joint: usize| {
            let column: Vec<f64> = (0..6).map(|row| jacobian.at(row, joint)).collect();
            let turned = pose.inverse();
            let in_link = |part: &[f64]| turned.vector([part[0], part[1], part[2]]);
            let arms: Vec<f64> = in_link(&column[..3]).into_iter().chain(in_link(&column[3..])).collect();
            let wrench: Vec<f64> = self.force_n.into_iter().chain(self.torque_n_m).collect();
            let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let variance = self.covariance.iter().zip(&arms).map(|(row, arm)| arm * product(row, &arms)).sum();
            (product(&arms, &wrench), variance)
        };
        (0..jacobian.columns).map(torque).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The covariance against that of many drawn contacts: forces and positions Gaussian, friction uniform in a disc.
    #[test]
    fn the_covariance_is_that_of_drawn_contacts() {
        let contact =
            Contact { force_sd_n: 0.6, sd_m: 0.002, ..Contact::truth([0.03, -0.01, 0.2], [0.6, 0.0, 0.8], 5.0) };
        let (mut wrench, friction) = (Wrench::zero("arm"), 0.5);
        assert!(wrench.add(&contact, &Pose::IDENTITY, friction));
        // A sequence of low discrepancy in six dimensions (Roberts 2018): its error falls faster than that of random numbers.
        let step = 1.146_727_f64;
        let uniform = |index: u32, axis: i32| (0.5 + f64::from(index) / step.powi(axis + 1)).fract();
        let normal_pair = |a: f64, b: f64| {
            let (radius, turn) = ((-2.0 * (1.0 - a).ln()).sqrt(), std::f64::consts::TAU * b);
            [radius * turn.cos(), radius * turn.sin()]
        };
        let (n, t, s) = (contact.normal, [0.8, 0.0, -0.6], [0.0, 1.0, 0.0]);
        let count = 200_000;
        let mut moments = [[0.0; 6]; 6];
        for index in 0..count {
            let u = |axis| uniform(index, axis);
            let [g, _] = normal_pair(u(0), u(1));
            let [x, y] = normal_pair(u(2), u(3)).map(|value| value * contact.sd_m);
            let radius = friction * contact.force_n * u(4).sqrt();
            let (sin, cos) = (std::f64::consts::TAU * u(5)).sin_cos();
            let force = [0, 1, 2]
                .map(|k| -(contact.force_n + contact.force_sd_n * g) * n[k] + radius * (cos * t[k] + sin * s[k]));
            // To first order, as the covariance is: the arm of the mean force.
            let mean = scale(n, -contact.force_n);
            let moved = add(scale(t, x), scale(s, y));
            let torque = add(cross(contact.position_m, force), cross(moved, mean));
            let off: Vec<f64> = force
                .into_iter()
                .chain(torque)
                .zip(wrench.force_n.into_iter().chain(wrench.torque_n_m))
                .map(|(drawn, mean)| drawn - mean)
                .collect();
            for (row, a) in moments.iter_mut().zip(&off) {
                row.iter_mut().zip(&off).for_each(|(sum, b)| *sum += a * b / f64::from(count));
            }
        }
        let scale_of = |k: usize| wrench.covariance[k][k].sqrt();
        let pairs = moments.iter().flatten().zip(wrench.covariance.iter().flatten());
        for (place, (drawn, stated)) in pairs.enumerate() {
            let error = (drawn - stated) / (scale_of(place / 6) * scale_of(place % 6));
            assert!(error.abs() < 0.01, "{place}: {error}");
        }
    }

    #[test]
    fn a_force_that_is_not_known_is_no_force() {
        let mut wrench = Wrench::zero("arm");
        assert!(!wrench.add(&Contact::truth([0.0; 3], [0.0, 0.0, 1.0], f64::NAN), &Pose::IDENTITY, 0.5));
        wrench.lacks("sleeve");
        wrench.lacks("sleeve");
        assert_eq!((wrench.force_n, wrench.complete, wrench.missing.len()), ([0.0; 3], false, 1));
        // A lower bound is a part of the force, and not all of it.
        assert!(!wrench.add(&Contact::truth([0.0; 3], [0.0, 0.0, 1.0], 7.5), &Pose::IDENTITY, 0.5));
        assert_eq!(wrench.force_n, [0.0, 0.0, -7.5]);
    }
}
