//! Robot descriptions: the base with a frame for each electrode, as URDF and MJCF.

use crate::error::FabricateError;
use crate::folder::OutputFile;
use crate::model::{FabricatedElectrode, Fabrication};
use crate::sheet::escaped;
use std::fmt::Write as _;

/// The base and its electrodes for a robot's model.
///
/// # Errors
/// None; the type is that of all kinds of outputs.
pub fn files(fabrication: &Fabrication) -> Result<Vec<OutputFile>, FabricateError> {
    Ok(vec![
        OutputFile::new("robot/skin.urdf", "base and electrode frames for a robot (URDF)", urdf(fabrication)),
        OutputFile::new("robot/skin.xml", "base and electrode sites for MuJoCo (MJCF)", mjcf(fabrication)),
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

fn urdf(fabrication: &Fabrication) -> String {
    let geometry = "<geometry><mesh filename=\"../base.stl\" scale=\"0.001 0.001 0.001\"/></geometry>";
    let mut text = format!(
        "<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n  <link name=\"skin\">\n    <visual>{geometry}</visual>\n    \
         <collision>{geometry}</collision>\n  </link>\n",
        escaped(&fabrication.design.name)
    );
    for one in &fabrication.electrodes {
        let [yaw, pitch] = yaw_and_pitch(one);
        let (place, turn) = (numbers(&one.centre_m), numbers(&[0.0, pitch, yaw]));
        let _ = writeln!(
            text,
            "  <link name=\"electrode_{0}\"/>\n  <joint name=\"skin_to_electrode_{0}\" type=\"fixed\">\n    \
             <parent link=\"skin\"/>\n    <child link=\"electrode_{0}\"/>\n    <origin xyz=\"{place}\" rpy=\"{turn}\"/>\n  \
             </joint>",
            one.number
        );
    }
    text + "</robot>\n"
}

fn mjcf(fabrication: &Fabrication) -> String {
    let mut text = format!(
        "<mujoco model=\"{}\">\n  <compiler meshdir=\"..\"/>\n  <asset>\n    <mesh name=\"base\" file=\"base.stl\" \
         scale=\"0.001 0.001 0.001\"/>\n  </asset>\n  <worldbody>\n    <body name=\"skin\">\n      <geom name=\"base\" \
         type=\"mesh\" mesh=\"base\"/>\n",
        escaped(&fabrication.design.name)
    );
    for one in &fabrication.electrodes {
        let (place, axis) = (numbers(&one.centre_m), numbers(&one.normal));
        let _ = writeln!(
            text,
            "      <site name=\"electrode_{}\" type=\"sphere\" size=\"0.002\" pos=\"{place}\" zaxis=\"{axis}\"/>",
            one.number
        );
    }
    text + "    </body>\n  </worldbody>\n</mujoco>\n"
}
