//! Views of a skin and its contacts: a ROS 2 launch file, a configuration of RViz, a layout of Foxglove. Their topics are
//! those of `dermis live --ros2`.

use crate::model::Fabrication;
use dermis::geom::vector::bounding_box;
use serde_json::{Value, json};

/// A launch file in Python: the robot's state publisher with the URDF beside it, RViz, and where asked for the program
/// that reads the skin.
pub(super) fn launch(fabrication: &Fabrication) -> String {
    // A string of JSON is one of Python.
    let design = json!(fabrication.design.name).to_string();
    format!(include_str!("skin.launch.py"), design = design, frame = fabrication.design.frame_id())
}

/// A configuration of RViz 2.
pub(super) fn rviz(fabrication: &Fabrication) -> String {
    let (frame, far_m) = (fabrication.design.frame_id(), 3.0 * extent_m(fabrication));
    let [x, y, z] = middle_m(fabrication);
    format!(include_str!("skin.rviz"), frame = frame, far_m = far_m, x = x, y = y, z = z)
}

/// A layout of Foxglove: the scene, and the total force.
pub(super) fn foxglove(fabrication: &Fabrication) -> String {
    let mut layout: Value = serde_json::from_str(include_str!("foxglove.json")).expect("the file is JSON");
    let scene = &mut layout["configById"]["3D!skin"];
    scene["followTf"] = json!(fabrication.design.frame_id());
    scene["cameraState"]["distance"] = json!(3.0 * extent_m(fabrication));
    scene["cameraState"]["targetOffset"] = json!(middle_m(fabrication));
    serde_json::to_string_pretty(&layout).expect("text and numbers are JSON") + "\n"
}

/// Box of the electrodes, m: lower and upper corner.
fn box_m(fabrication: &Fabrication) -> [[f64; 3]; 2] {
    bounding_box(fabrication.electrodes.iter().map(|one| one.centre_m))
}

fn extent_m(fabrication: &Fabrication) -> f64 {
    let [low, high] = box_m(fabrication);
    (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max)
}

fn middle_m(fabrication: &Fabrication) -> [f64; 3] {
    let [low, high] = box_m(fabrication);
    [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]) + 0.0)
}
