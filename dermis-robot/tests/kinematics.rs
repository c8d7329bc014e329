//! Kinematics against exact solutions and finite differences. The Python package compares them with MuJoCo.

use dermis::geom::vector::{cross, dot};
use dermis_robot::{Kinematics, Pose, Shape, link_triangles};
use std::f64::consts::PI;

/// Two links of 0.3 and 0.2 m that turn about z, a slide along their end, and a gripper whose second finger follows the first.
const ARM: &str = r#"<robot name="arm">
  <!-- <xacro:arm/> --><link name="base"/><link name="upper"/><link name="lower"/><link name="slide"/><link name="left"/><link name="right"/>
  <link name="cart"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 2"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="rail" type="prismatic"><parent link="lower"/><child link="slide"/><origin xyz="0.2 0 0" rpy="0 0.4 0.1"/></joint>
  <joint name="grip" type="revolute"><parent link="slide"/><child link="left"/><origin xyz="0 0.02 0"/><axis xyz="0 0.6 0.8"/></joint>
  <joint name="follow" type="revolute"><parent link="slide"/><child link="right"/><origin xyz="0 -0.02 0"/>
    <axis xyz="0 0.6 0.8"/><mimic joint="grip" multiplier="-0.5" offset="0.1"/></joint>
  <joint name="free" type="floating"><parent link="base"/><child link="cart"/></joint>
</robot>"#;

fn arm() -> Kinematics {
    Kinematics::parse(ARM, "arm.urdf").unwrap()
}

fn link(arm: &Kinematics, name: &str) -> usize {
    arm.link(name).unwrap()
}

#[test]
fn a_planar_arm_is_where_trigonometry_puts_it() {
    let (arm, [a, b]) = (arm(), [0.4_f64, -1.1]);
    assert_eq!(arm.joint_names().collect::<Vec<_>>(), ["shoulder", "elbow", "rail", "grip"]);
    let posture = arm.posture(&[a, b, f64::NAN, f64::NAN]);
    let [base, lower] = [link(&arm, "base"), link(&arm, "lower")];
    let point = [0.2, 0.0, 0.0];
    let [x, y, z] = posture.pose(base, lower).unwrap().point(point);
    let expected = [0.3 * a.cos() + 0.2 * (a + b).cos(), 0.3 * a.sin() + 0.2 * (a + b).sin()];
    assert!((x - expected[0]).abs() < 1e-15 && (y - expected[1]).abs() < 1e-15 && z == 0.0);
    let jacobian = posture.jacobian(base, lower, point).unwrap();
    let columns = [[-expected[1], expected[0]], [-0.2 * (a + b).sin(), 0.2 * (a + b).cos()]];
    for (joint, column) in columns.into_iter().enumerate() {
        assert!((0..2).all(|row| (jacobian.at(row, joint) - column[row]).abs() < 1e-15));
        assert_eq!([3, 4, 5].map(|row| jacobian.at(row, joint)), [0.0, 0.0, 1.0]);
    }
    assert!((0..6).all(|row| jacobian.at(row, 2) == 0.0), "the rail does not move the lower link");
    // The slide depends on a joint that is not known, the cart on none.
    assert!(posture.pose(base, link(&arm, "slide")).is_none());
    assert!(posture.pose(base, link(&arm, "cart")).is_none());
}

/// The Jacobian between any two links is the difference quotient of the pose, in both directions through the tree.
#[test]
fn jacobians_are_those_of_differences() {
    const STEP: f64 = 1e-6;
    let arm = arm();
    let positions = [0.3, -0.8, 0.05, 0.4];
    let point = [0.03, -0.02, 0.01];
    for [base, of] in [["base", "right"], ["right", "left"], ["left", "base"], ["slide", "upper"], ["base", "left"]] {
        let [base, of] = [base, of].map(|name| link(&arm, name));
        let pose = |joint: usize, step: f64| -> Pose {
            let mut moved = positions;
            moved[joint] += step;
            arm.posture(&moved).pose(base, of).unwrap()
        };
        let jacobian = arm.posture(&positions).jacobian(base, of, point).unwrap();
        for joint in 0..4 {
            let [low, high] = [-STEP, STEP].map(|step| pose(joint, step));
            let [p, q] = [low, high].map(|pose| pose.point(point));
            // The angular velocity is the axis of R(high) R(low)'.
            let turn = Pose { translation_m: [0.0; 3], ..high }
                .after(&Pose { translation_m: [0.0; 3], ..low }.inverse())
                .rotation;
            let axis = [turn[2][1] - turn[1][2], turn[0][2] - turn[2][0], turn[1][0] - turn[0][1]];
            for row in 0..3 {
                let linear = (q[row] - p[row]) / (2.0 * STEP);
                let angular = axis[row] / (4.0 * STEP);
                assert!((jacobian.at(row, joint) - linear).abs() < 1e-8, "{joint} {row}");
                assert!((jacobian.at(3 + row, joint) - angular).abs() < 1e-8, "{joint} {row}");
            }
        }
    }
}

#[test]
fn wrong_descriptions_are_named_with_the_line() {
    let wrong = |from: &str, to: &str| {
        let text = ARM.replace(from, to);
        assert_ne!(text, ARM, "{from}");
        Kinematics::parse(&text, "arm.urdf").unwrap_err().to_string()
    };
    for (from, to, expected) in [
        ("<robot name=\"arm\">", "<mujoco>", "expected"),
        ("type=\"prismatic\"", "type=\"linear\"", "arm.urdf:6: the joint `rail` has the type `linear`"),
        ("<parent link=\"upper\"/>", "<parent link=\"uper\"/>", "did you mean `upper`?"),
        ("<child link=\"lower\"/>", "<child link=\"upper\"/>", "`upper` is the child of two joints"),
        ("<child link=\"upper\"/>", "<child link=\"base\"/>", "the joints form a cycle"),
        ("xyz=\"0.3 0 0\"", "xyz=\"300 0 0\"", "lengths in URDF are in metres"),
        ("xyz=\"0.3 0 0\"", "xyz=\"0.3 0\"", "is not three numbers"),
        ("xyz=\"0 0 2\"", "xyz=\"0 0 0\"", "has no direction"),
        ("<origin xyz=\"0.3 0 0\"", "<orgin xyz=\"0.3 0 0\"", "did you mean <origin>?"),
        ("<origin xyz=\"0.3 0 0\"", "<Origin xyz=\"0.3 0 0\"", "did you mean <origin>?"),
        ("xyz=\"0.3 0 0\"", "xzy=\"0.3 0 0\"", "<origin> has no attribute `xzy`"),
        ("xyz=\"0.3 0 0\"", "quat_xyzw=\"0 0 1 0\"", "has no attribute `quat_xyzw`"),
        ("xyz=\"0.3 0 0\"", "rpy=\"0 90 0\"", "angles are in radians"),
        ("xyz=\"0.3 0 0\"", "xyz=\"0 0 0\"/><origin xyz=\"0.3 0 0\"", "a second <origin>"),
        ("multiplier=\"-0.5\"", "multipler=\"-0.5\"", "has no attribute `multipler`"),
        ("multiplier=\"-0.5\"", "multiplier=\"half\"", "is not a number"),
        ("mimic joint=\"grip\"", "mimic joint=\"follow\"", "fixed or mimics another"),
        ("<link name=\"upper\"/>", "<link name=\"upper\"/><link name=\"upper\"/>", "two links are called `upper`"),
        (
            "<link name=\"cart\"/>",
            "<xacro:arm xmlns:xacro=\"http://www.ros.org/wiki/xacro\"/>",
            "expand it first: xacro FILE.urdf.xacro",
        ),
    ] {
        let error = wrong(from, to);
        assert!(error.contains(expected), "{to}: {error}");
    }
}

/// A chain of as many links as are read, and one more.
#[test]
fn long_chains_are_read_and_longer_ones_refused() {
    let chain = |links: usize| {
        let link = |k: usize| format!("<link name=\"l{k}\"/>");
        let joint = |k: usize| {
            let next = k + 1;
            format!(
                "<joint name=\"j{k}\" type=\"revolute\"><parent link=\"l{k}\"/><child link=\"l{next}\"/><origin xyz=\"0 0 0.01\"/></joint>"
            )
        };
        let parts: String = (0..links).map(link).chain((0..links - 1).map(joint)).collect();
        Kinematics::parse(&format!("<robot name=\"chain\">{parts}</robot>"), "chain.urdf")
    };
    let robot = chain(2_000).unwrap();
    let pose = robot.posture(&[0.0; 1_999]).pose(0, 1_999).unwrap();
    assert!((pose.translation_m[2] - 19.99).abs() < 1e-9);
    assert!(chain(10_001).unwrap_err().to_string().contains("10001 links: at most 10000"));
}

/// Boxes, cylinders and spheres are shapes of a link as meshes are: their volumes and places are exact but for flat sides.
#[test]
fn solids_of_a_link_are_read() {
    let shape = |text: &str| format!("<collision><origin xyz=\"0 0 1\"/><geometry>{text}</geometry></collision>");
    let volume_m3 = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("arm.urdf");
        std::fs::write(&path, format!("<robot name=\"arm\"><link name=\"a\">{}</link></robot>", shape(text))).unwrap();
        let (triangles, _) = link_triangles(&path, "a", Shape::Collision).map_err(|error| error.to_string())?;
        // About a point inside, so that the place counts: the origin is below.
        let volume = |[a, b, c]: &[[f64; 3]; 3]| dot(*a, cross(*b, *c)) / 6.0;
        assert!(triangles.iter().flatten().all(|corner| corner[2] > 0.5));
        Ok::<f64, String>(triangles.iter().map(volume).sum())
    };
    for (text, expected) in [
        ("<box size=\"0.1 0.2 0.3\"/>", 0.006),
        ("<cylinder radius=\"0.1\" length=\"0.2\"/>", 0.002 * PI),
        ("<sphere radius=\"0.3\"/>", 0.036 * PI),
    ] {
        let volume = volume_m3(text).unwrap();
        assert!((volume / expected - 1.0).abs() < 0.01, "{text}: {volume} and {expected}");
    }
    let error = volume_m3("<box size=\"0.1 0 0.3\"/>").unwrap_err();
    assert!(error.contains("a <box> without an extent"), "{error}");
}
