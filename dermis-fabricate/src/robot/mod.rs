//! Robot descriptions: the base with a frame for each electrode, as URDF, xacro and MJCF, and views of it with its contacts.

mod views;

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::{FabricatedElectrode, Fabrication};
use dermis::text::escaped;
use std::fmt::Write as _;

/// The base and its electrodes for a robot's model, and views for ROS 2 and Foxglove.
///
/// # Errors
/// None; the type is that of all kinds of outputs.
pub fn files(fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    Ok(vec![
        OutputFile::new("robot/skin.urdf", "base and electrode frames for a robot (URDF)", urdf(fabrication)),
        OutputFile::new(
            "robot/skin.urdf.xacro",
            "the same as a macro with prefix and parent (xacro)",
            xacro(fabrication),
        ),
        OutputFile::new("robot/skin.xml", "base and electrode sites for MuJoCo (MJCF)", mjcf(fabrication)),
        OutputFile::new("robot/skin.launch.py", "skin and contacts in RViz (ROS 2 launch)", views::launch(fabrication)),
        OutputFile::new("robot/skin.rviz", "view of skin and contacts (RViz 2)", views::rviz(fabrication)),
        OutputFile::new(
            "robot/foxglove.json",
            "view of skin and contacts (Foxglove layout)",
            views::foxglove(fabrication),
        ),
    ])
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(|value| format!("{:.9}", value + 0.0)).collect::<Vec<_>>().join(" ")
}

/// The frame of an electrode: its z axis is the outward normal. Yaw and pitch turn z there, `Rz(yaw) Ry(pitch)`.
fn yaw_and_pitch(one: &FabricatedElectrode) -> [f64; 2] {
    let [x, y, z] = one.normal;
    [y.atan2(x), x.hypot(y).atan2(z)]
}

/// Links and joints of the base and its electrodes, with a prefix of their names; indented.
fn links(fabrication: &Fabrication, prefix: &str, mesh: &str, indent: &str) -> String {
    let frame = fabrication.design.frame_id();
    let geometry = format!("<geometry><mesh filename=\"{mesh}\" scale=\"0.001 0.001 0.001\"/></geometry>");
    let mut text = format!(
        "{indent}<link name=\"{prefix}{frame}\">\n{indent}  <visual>{geometry}</visual>\n{indent}  \
         <collision>{geometry}</collision>\n{indent}</link>\n"
    );
    for one in &fabrication.electrodes {
        let [yaw, pitch] = yaw_and_pitch(one);
        let (place, turn) = (numbers(&one.centre_m), numbers(&[0.0, pitch, yaw]));
        let name = format!("{prefix}{frame}_electrode_{}", one.number);
        let _ = writeln!(
            text,
            "{indent}<link name=\"{name}\"/>\n{indent}<joint name=\"{name}_joint\" type=\"fixed\">\n\
             {indent}  <parent link=\"{prefix}{frame}\"/>\n{indent}  <child link=\"{name}\"/>\n\
             {indent}  <origin xyz=\"{place}\" rpy=\"{turn}\"/>\n{indent}</joint>"
        );
    }
    text
}

fn urdf(fabrication: &Fabrication) -> String {
    let name = escaped(&fabrication.design.name);
    let links = links(fabrication, "", "../base.stl", "  ");
    format!("<?xml version=\"1.0\"?>\n<robot name=\"{name}\">\n{links}</robot>\n")
}

/// A macro: the skin on a link of a robot. The block is the pose of the skin's frame in the parent's.
fn xacro(fabrication: &Fabrication) -> String {
    let frame = fabrication.design.frame_id();
    format!(
        "<?xml version=\"1.0\"?>\n\
         <!-- <xacro:include filename=\"skin.urdf.xacro\"/>\n     \
         <xacro:dermis_{frame} prefix=\"left_\" parent=\"forearm\" mesh=\"package://my_robot/meshes/base.stl\">\n       \
         <origin xyz=\"0 0 0.1\" rpy=\"0 0 0\"/>\n     </xacro:dermis_{frame}>\n     \
         The frame of its contacts is then left_{frame}: give this name to dermis live as its frame-id. -->\n\
         <robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\">\n  \
         <xacro:macro name=\"dermis_{frame}\" params=\"prefix:='' parent mesh *origin\">\n    \
         <joint name=\"${{prefix}}{frame}_mount\" type=\"fixed\">\n      <parent link=\"${{parent}}\"/>\n      \
         <child link=\"${{prefix}}{frame}\"/>\n      <xacro:insert_block name=\"origin\"/>\n    </joint>\n{}  \
         </xacro:macro>\n</robot>\n",
        links(fabrication, "${prefix}", "${mesh}", "    ")
    )
}

fn mjcf(fabrication: &Fabrication) -> String {
    let frame = fabrication.design.frame_id();
    let mut text = format!(
        "<mujoco model=\"{}\">\n  <compiler meshdir=\"..\"/>\n  <asset>\n    <mesh name=\"base\" file=\"base.stl\" \
         scale=\"0.001 0.001 0.001\"/>\n  </asset>\n  <worldbody>\n    <body name=\"{frame}\">\n      <geom name=\"base\" \
         type=\"mesh\" mesh=\"base\"/>\n",
        escaped(&fabrication.design.name)
    );
    for one in &fabrication.electrodes {
        let (place, axis) = (numbers(&one.centre_m), numbers(&one.normal));
        let _ = writeln!(
            text,
            "      <site name=\"{frame}_electrode_{}\" type=\"sphere\" size=\"0.002\" pos=\"{place}\" zaxis=\"{axis}\"/>",
            one.number
        );
    }
    text + "    </body>\n  </worldbody>\n</mujoco>\n"
}
