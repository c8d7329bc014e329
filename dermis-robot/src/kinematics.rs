//! The tree of a robot's links and joints: poses of links, Jacobians of points.

use crate::pose::Pose;
use dermis::design::{DesignError, closest_name};
use dermis::geom::Point3;
use dermis::geom::vector::{cross, scale, sub};
use dermis::linalg::Matrix;
use std::f64::consts::TAU;

/// A revolute joint that turns farther than this in one direction is not of this world: limits of arms are of two turns at most.
const MAX_TURNS: f64 = 2.0;

/// How a joint moves its child link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum JointKind {
    /// Not at all.
    Fixed,
    /// It turns about its axis; `wraps` if without limits.
    Revolute {
        /// Whether a full turn is the same position.
        wraps: bool,
    },
    /// It slides along its axis.
    Prismatic,
}

/// A joint between two links.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Joint {
    pub(crate) name: String,
    pub(crate) kind: JointKind,
    pub(crate) parent: usize,
    pub(crate) child: usize,
    /// The joint's frame in the parent link's, at position 0.
    pub(crate) origin: Pose,
    /// Unit vector in the joint's frame.
    pub(crate) axis: Point3,
    /// The joint that it follows, with factor and offset.
    pub(crate) mimic: Option<(usize, f64, f64)>,
    /// Highest speed, rad/s or m/s.
    pub(crate) speed_limit: Option<f64>,
    /// Lowest and highest position, rad or m.
    pub(crate) limits: Option<[f64; 2]>,
}

/// The links and joints of a robot. A link without a parent is the root of a tree; a robot whose URDF has planar or floating
/// joints has several trees.
#[derive(Debug, Clone, PartialEq)]
pub struct Kinematics {
    pub(crate) name: String,
    pub(crate) links: Vec<String>,
    pub(crate) joints: Vec<Joint>,
    /// The joint above each link.
    above: Vec<Option<usize>>,
    /// The joints that have a position of their own.
    movable: Vec<usize>,
}

impl Kinematics {
    /// From its parts.
    ///
    /// # Errors
    /// A link with two parents, a cycle of links or of mimic joints: what is wrong, with the names.
    pub(crate) fn new(name: String, links: Vec<String>, joints: Vec<Joint>) -> Result<Self, String> {
        let mut above: Vec<Option<usize>> = vec![None; links.len()];
        for (index, joint) in joints.iter().enumerate() {
            if let Some(other) = above[joint.child].replace(index) {
                let (link, a, b) = (&links[joint.child], &joints[other].name, &joint.name);
                return Err(format!("the link `{link}` is the child of two joints, `{a}` and `{b}`"));
            }
        }
        // From any link the way up ends after as many joints as there are, or never.
        let up = |&link: &usize| above[link].map(|joint: usize| joints[joint].parent);
        let is_cyclic = |&link: &usize| std::iter::successors(Some(link), up).nth(joints.len() + 1).is_some();
        if let Some(link) = (0..links.len()).find(is_cyclic) {
            return Err(format!("the link `{}` is its own ancestor: the joints form a cycle", links[link]));
        }
        for joint in &joints {
            let follows = |joint: &Joint| joint.mimic.map(|(source, ..)| source);
            if follows(joint).is_some_and(|source| follows(&joints[source]).is_some() || !joints[source].moves()) {
                return Err(format!("the joint `{}` mimics a joint that is fixed or mimics another", joint.name));
            }
        }
        let has_own = |index: &usize| joints[*index].moves() && joints[*index].mimic.is_none();
        let movable = (0..joints.len()).filter(has_own).collect();
        Ok(Kinematics { name, links, joints, above, movable })
    }

    /// The names of the links.
    pub fn links(&self) -> &[String] {
        &self.links
    }

    /// The names of the joints that have a position, in the order of positions and of the columns of Jacobians. Fixed joints
    /// and those that mimic another have none.
    pub fn joint_names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.movable.iter().map(|&joint| self.joints[joint].name.as_str())
    }

    /// Joints whose limits cannot be right, in words: with them, positions in degrees are not noticed.
    pub fn doubtful_limits(&self) -> Vec<String> {
        let doubt = |joint: &Joint| {
            let (JointKind::Revolute { wraps: false }, name) = (joint.kind, &joint.name) else { return None };
            match joint.limits {
                None => Some(format!(
                    "the revolute joint `{name}` has no limits, so that positions in degrees are not noticed: write its <limit> with \
                     lower and upper, rad, or make it continuous"
                )),
                Some([lower, upper]) if lower.abs().max(upper.abs()) > MAX_TURNS * TAU => Some(format!(
                    "the limits of the revolute joint `{name}` are {lower} to {upper}: they are in rad, and seem to be in degrees"
                )),
                Some(_) => None,
            }
        };
        self.movable().filter_map(doubt).collect()
    }

    pub(crate) fn movable(&self) -> impl ExactSizeIterator<Item = &Joint> {
        self.movable.iter().map(|&joint| &self.joints[joint])
    }

    /// The origins of the joints that a link carries, in its frame, m.
    pub fn joint_origins(&self, link: usize) -> impl Iterator<Item = Point3> {
        let below = self.joints.iter().filter(move |joint| joint.parent == link);
        below.map(|joint| joint.origin.point([0.0; 3]))
    }

    /// The links with their depth in the tree and the joint above each, every link after its parent.
    pub fn tree(&self) -> Vec<(usize, &str, Option<&str>)> {
        let mut rows = Vec::new();
        let mut waiting: Vec<usize> = (0..self.links.len()).rev().filter(|&link| self.above[link].is_none()).collect();
        while let Some(link) = waiting.pop() {
            let above = self.above[link].map(|joint| self.joints[joint].name.as_str());
            let depth = self.chain(link).count();
            rows.push((depth, self.links[link].as_str(), above));
            let below = self.joints.iter().rev().filter(|joint| joint.parent == link);
            waiting.extend(below.map(|joint| joint.child));
        }
        rows
    }

    /// The index of a link.
    pub fn link(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|link| link == name)
    }

    /// The index of a link that a person named.
    ///
    /// # Errors
    /// A link that is not there, with the fix.
    pub(crate) fn named_link(&self, name: &str) -> Result<usize, DesignError> {
        self.link(name).ok_or_else(|| {
            let near = closest_name(name, self.links.iter().map(String::as_str));
            let fix =
                near.map_or("`dermis robot links FILE` lists them".into(), |near| format!("did you mean `{near}`?"));
            DesignError::new(format!("the robot has no link `{name}`"), Some(fix))
        })
    }

    /// The first link without a parent.
    pub(crate) fn root(&self) -> usize {
        self.above.iter().position(Option::is_none).unwrap_or(0)
    }

    /// The joints from a link up to its root.
    fn chain(&self, link: usize) -> impl Iterator<Item = usize> {
        let up = move |&joint: &usize| self.above[self.joints[joint].parent];
        std::iter::successors(self.above[link], up)
    }

    /// The root of the tree of a link.
    pub(crate) fn root_of(&self, link: usize) -> usize {
        self.chain(link).last().map_or(link, |joint| self.joints[joint].parent)
    }

    /// Whether two links belong to one tree.
    pub(crate) fn are_connected(&self, a: usize, b: usize) -> bool {
        self.root_of(a) == self.root_of(b)
    }

    /// The joints between two links and their last common ancestor, the lowest first: those above `base`, those above `link`.
    fn joints_between(&self, base: usize, link: usize) -> [Vec<usize>; 2] {
        let [of_base, of_link] = [base, link].map(|link| self.chain(link).collect::<Vec<_>>());
        let common = of_base.iter().rev().zip(of_link.iter().rev()).take_while(|(a, b)| a == b).count();
        [of_base, of_link].map(|chain| chain[..chain.len() - common].to_vec())
    }

    /// The joints whose positions the pose of a link in another one depends on, by their place in the positions.
    pub(crate) fn needed(&self, base: usize, link: usize) -> Vec<usize> {
        let joints = self.joints_between(base, link).into_iter().flatten();
        joints.filter(|&joint| self.joints[joint].moves()).map(|joint| self.source(joint).0).collect()
    }

    /// The place in the positions, the factor and the offset of a joint that moves.
    fn source(&self, joint: usize) -> (usize, f64, f64) {
        let (source, factor, offset) = self.joints[joint].mimic.unwrap_or((joint, 1.0, 0.0));
        let place = self.movable.iter().position(|&own| own == source).expect("a joint that moves has a position");
        (place, factor, offset)
    }

    /// The robot at positions of its joints, rad or m, in the order of [`joint_names`](Self::joint_names); `NaN` if unknown.
    ///
    /// # Panics
    /// If there are not as many positions as joints.
    pub fn posture(&self, positions: &[f64]) -> Posture<'_> {
        assert_eq!(positions.len(), self.movable.len(), "a position for each joint");
        let motion = |(index, joint): (usize, &Joint)| {
            let position = || {
                let (place, factor, offset) = self.source(index);
                factor * positions[place] + offset
            };
            joint.origin.after(&match joint.kind {
                JointKind::Fixed => Pose::IDENTITY,
                JointKind::Revolute { .. } => Pose::about(joint.axis, position(), [0.0; 3]),
                JointKind::Prismatic => Pose { translation_m: scale(joint.axis, position()), ..Pose::IDENTITY },
            })
        };
        Posture { kinematics: self, motions: self.joints.iter().enumerate().map(motion).collect() }
    }
}

impl Joint {
    fn moves(&self) -> bool {
        self.kind != JointKind::Fixed
    }
}

/// A robot at positions of its joints.
#[derive(Debug, Clone)]
pub struct Posture<'a> {
    kinematics: &'a Kinematics,
    /// The child of each joint in the frame of its parent.
    motions: Vec<Pose>,
}

impl Posture<'_> {
    /// The pose of a link in the frame of another one; `None` if it depends on a joint whose position is unknown, or if no
    /// joints connect the two.
    pub fn pose(&self, base: usize, link: usize) -> Option<Pose> {
        let [from_base, from_link] = self
            .kinematics
            .joints_between(base, link)
            .map(|joints| joints.iter().rev().fold(Pose::IDENTITY, |pose, &joint| pose.after(&self.motions[joint])));
        let pose = from_base.inverse().after(&from_link);
        Some(pose).filter(|pose| self.kinematics.are_connected(base, link) && pose.is_finite())
    }

    /// The Jacobian of a point of a link (m, in the link's frame): 6 x joints; the velocity of the point in the base's
    /// frame, m/s, over the angular velocity of the link, rad/s, for each joint's speed. `None` as for [`pose`](Self::pose).
    ///
    /// Column of a joint that turns about `a` through `o`: `[a x (p - o); a]`; of one that slides: `[a; 0]` (Siciliano,
    /// Sciavicco, Villani, Oriolo 2009, DOI 10.1007/978-1-84628-642-1, eq. 3.30).
    pub fn jacobian(&self, base: usize, link: usize, point_m: Point3) -> Option<Matrix> {
        let point = self.pose(base, link)?.point(point_m);
        let mut jacobian = Matrix::zeros(6, self.kinematics.movable.len());
        let [above_base, above_link] = self.kinematics.joints_between(base, link);
        // Joints above the base move the base instead.
        let signed =
            above_base.into_iter().map(|joint| (joint, -1.0)).chain(above_link.into_iter().map(|joint| (joint, 1.0)));
        for (index, sign) in signed.filter(|(index, _)| self.kinematics.joints[*index].moves()) {
            let joint = &self.kinematics.joints[index];
            let (place, factor, _) = self.kinematics.source(index);
            let frame = self.pose(base, joint.parent)?.after(&joint.origin);
            let axis = scale(frame.vector(joint.axis), sign * factor);
            let (linear, angular) = match joint.kind {
                JointKind::Revolute { .. } => (cross(axis, sub(point, frame.translation_m)), axis),
                JointKind::Prismatic | JointKind::Fixed => (axis, [0.0; 3]),
            };
            for (row, value) in linear.into_iter().chain(angular).enumerate() {
                *jacobian.at_mut(row, place) += value;
            }
        }
        Some(jacobian)
    }
}
