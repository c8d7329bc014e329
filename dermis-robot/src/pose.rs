//! Poses of frames.

use dermis::geom::Point3;
use dermis::geom::vector::{add, dot, norm, sub};

/// A rotation matrix, row by row.
pub type Rotation = [[f64; 3]; 3];

/// The pose of a frame in another one: `p_other = rotation p + translation_m`.
///
/// ```
/// use dermis_robot::Pose;
///
/// let pose = Pose::from_xyz_rpy([1.0, 0.0, 0.0], [0.0, 0.0, std::f64::consts::FRAC_PI_2]);
/// let [x_m, y_m, _] = pose.point([1.0, 0.0, 0.0]);
/// assert!((x_m - 1.0).abs() < 1e-15 && (y_m - 1.0).abs() < 1e-15);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// The axes of the frame, as columns.
    pub rotation: Rotation,
    /// The origin of the frame, m.
    pub translation_m: Point3,
}

impl Pose {
    /// The same frame.
    pub const IDENTITY: Self =
        Pose { rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], translation_m: [0.0; 3] };

    /// From a translation, m, and the angles of URDF, rad: `Rz(yaw) Ry(pitch) Rx(roll)`.
    pub fn from_xyz_rpy(xyz_m: Point3, rpy_rad: Point3) -> Self {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let mut unit = [0.0; 3];
            unit[axis] = 1.0;
            Pose { rotation: rotation_about(unit, rpy_rad[axis]), translation_m: [0.0; 3] }
        });
        let rotation = z.after(&y.after(&x)).rotation;
        Pose { rotation, translation_m: xyz_m }
    }

    /// From a translation, m, and a quaternion `x, y, z, w`; `None` unless its length is 1, to `1e-3`.
    pub fn from_xyz_quaternion(xyz_m: Point3, quaternion: [f64; 4]) -> Option<Self> {
        let length = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
        // Four decimals, as people and messages write them.
        if (length - 1.0).abs() > 1e-3 || length.is_nan() {
            return None;
        }
        let [x, y, z, w] = quaternion.map(|part| part / length);
        let vector = [x, y, z];
        let angle = 2.0 * norm(vector).atan2(w);
        let axis = if norm(vector) > 0.0 { vector.map(|part| part / norm(vector)) } else { [0.0, 0.0, 1.0] };
        Some(Pose { rotation: rotation_about(axis, angle), translation_m: xyz_m })
    }

    /// The rotation as a unit quaternion `x, y, z, w` with `w >= 0`.
    pub fn quaternion(&self) -> [f64; 4] {
        let r = &self.rotation;
        // The column of `4 q q'` with the largest diagonal (Shepperd 1978, DOI 10.2514/3.55767b).
        let columns = [
            [1.0 + r[0][0] - r[1][1] - r[2][2], r[0][1] + r[1][0], r[0][2] + r[2][0], r[2][1] - r[1][2]],
            [r[0][1] + r[1][0], 1.0 - r[0][0] + r[1][1] - r[2][2], r[1][2] + r[2][1], r[0][2] - r[2][0]],
            [r[0][2] + r[2][0], r[1][2] + r[2][1], 1.0 - r[0][0] - r[1][1] + r[2][2], r[1][0] - r[0][1]],
            [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1], 1.0 + r[0][0] + r[1][1] + r[2][2]],
        ];
        let largest = (1..4).fold(0, |best, k| if columns[k][k] > columns[best][best] { k } else { best });
        let column = columns[largest];
        let length = column.iter().map(|part| part * part).sum::<f64>().sqrt();
        column.map(|part| part / if column[3] < 0.0 { -length } else { length })
    }

    /// A rotation about a unit axis, rad, then a translation, m.
    pub(crate) fn about(axis: Point3, angle_rad: f64, translation_m: Point3) -> Self {
        Pose { rotation: rotation_about(axis, angle_rad), translation_m }
    }

    /// The pose, in the outer frame, of a frame whose pose in this one is `inner`.
    #[must_use]
    pub fn after(&self, inner: &Pose) -> Self {
        let column = |k: usize| self.vector([inner.rotation[0][k], inner.rotation[1][k], inner.rotation[2][k]]);
        let [a, b, c] = [0, 1, 2].map(column);
        let rotation = [0, 1, 2].map(|row| [a[row], b[row], c[row]]);
        Pose { rotation, translation_m: self.point(inner.translation_m) }
    }

    /// The pose of the outer frame in this one.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = [0, 1, 2].map(|row| [0, 1, 2].map(|column| self.rotation[column][row]));
        let turned = Pose { rotation, translation_m: [0.0; 3] };
        Pose { rotation, translation_m: sub([0.0; 3], turned.vector(self.translation_m)) }
    }

    /// A point of this frame in the outer one, m.
    pub fn point(&self, point_m: Point3) -> Point3 {
        add(self.vector(point_m), self.translation_m)
    }

    /// A direction of this frame in the outer one.
    pub fn vector(&self, vector: Point3) -> Point3 {
        self.rotation.map(|row| dot(row, vector))
    }

    pub(crate) fn is_finite(&self) -> bool {
        self.rotation.iter().flatten().chain(&self.translation_m).all(|value| value.is_finite())
    }
}

/// The rotation about a unit axis (Rodrigues 1840).
fn rotation_about([x, y, z]: Point3, angle_rad: f64) -> Rotation {
    let (sin, cos) = angle_rad.sin_cos();
    let rest = 1.0 - cos;
    [
        [cos + x * x * rest, x * y * rest - z * sin, x * z * rest + y * sin],
        [y * x * rest + z * sin, cos + y * y * rest, y * z * rest - x * sin],
        [z * x * rest - y * sin, z * y * rest + x * sin, cos + z * z * rest],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_and_its_inverse_are_the_identity_and_quaternions_are_the_same_rotations() {
        let pose = Pose::from_xyz_rpy([0.1, -0.2, 0.3], [0.4, -0.5, 0.6]);
        let back = pose.inverse().after(&pose);
        let flat = |pose: Pose| pose.rotation.into_iter().flatten().chain(pose.translation_m).collect::<Vec<_>>();
        let is_near = |a: Pose, b: Pose| flat(a).iter().zip(flat(b)).all(|(a, b)| (a - b).abs() < 1e-15);
        assert!(is_near(back, Pose::IDENTITY));
        // Half angles of each turn, multiplied by hand.
        let [(sr, cr), (sp, cp), (sy, cy)] = [0.2_f64, -0.25, 0.3].map(f64::sin_cos);
        let quaternion = [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ];
        assert!(is_near(Pose::from_xyz_quaternion([0.1, -0.2, 0.3], quaternion).unwrap(), pose));
        let back = pose.quaternion();
        assert!(back.iter().zip(&quaternion).all(|(a, b)| (a - b).abs() < 1e-12), "{back:?}");
        for axis in 0..3 {
            let mut half_turn = [0.0; 4];
            half_turn[axis] = 1.0;
            let back = Pose::from_xyz_quaternion([0.0; 3], half_turn).unwrap().quaternion();
            assert!(back.iter().zip(&half_turn).all(|(a, b)| (a - b).abs() < 1e-12), "{back:?}");
        }
        assert_eq!(Pose::from_xyz_quaternion([0.0; 3], [0.0, 0.0, 0.0, 1.1]), None);
        assert_eq!(Pose::from_xyz_quaternion([0.0; 3], [f64::NAN, 0.0, 0.0, 1.0]), None);
    }
}
