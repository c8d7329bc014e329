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
    let file = |path: &str, purpose: &str, text: String| OutputFile::new(path, purpose, text);
    Ok(vec![
        file("robot/skin.urdf", "base and electrode frames for a robot (URDF)", urdf(fabrication)),
        file("robot/skin.urdf.xacro", "the same as a macro with prefix and parent (xacro)", xacro(fabrication)),
        file("robot/skin.xml", "base and electrode sites for MuJoCo (MJCF)", mjcf(fabrication)),
        file("robot/skin.launch.py", "skin and contacts in RViz (ROS 2 launch)", views::launch(fabrication)),
        file("robot/skin.rviz", "view of skin and contacts (RViz 2)", views::rviz(fabrication)),
        file("robot/foxglove.json", "view of skin and contacts (Foxglove layout)", views::foxglove(fabrication)),
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
    format!(
        include_str!("skin.urdf.xacro"),
        frame = fabrication.design.frame_id(),
        links = links(fabrication, "${prefix}", "${mesh}", "    ")
    )
}

/// Density of PLA, which is most often printed, kg/m3; makers of filament state 1,240.
const PLA_KG_PER_M3: f64 = 1240.0;

fn mjcf(fabrication: &Fabrication) -> String {
    let (name, frame) = (escaped(&fabrication.design.name), fabrication.design.frame_id());
    let site = |one: &FabricatedElectrode| {
        let (number, place, axis) = (one.number, numbers(&one.centre_m), numbers(&one.normal));
        let name = format!("{frame}_electrode_{number}");
        format!("      <site name=\"{name}\" type=\"sphere\" size=\"0.002\" pos=\"{place}\" zaxis=\"{axis}\"/>\n")
    };
    let sites: String = fabrication.electrodes.iter().map(site).collect();
    format!(include_str!("skin.xml"), name = name, frame = frame, sites = sites, density = PLA_KG_PER_M3)
}
