//! Views of a skin and its contacts: a ROS 2 launch file, a configuration of RViz, a layout of Foxglove.

use crate::model::Fabrication;
use dermis::geom::vector::bounding_box;
use serde_json::{Value, json};

/// The topics of contacts (`dermis live --ros2`).
const MARKERS: &str = "/dermis/markers";
const WRENCH: &str = "/dermis/wrench";

/// A launch file in Python: the robot's state publisher with the URDF beside it, RViz, and where asked for the program
/// that reads the skin.
pub(super) fn launch(fabrication: &Fabrication) -> String {
    // A string of JSON is one of Python.
    let design = json!(fabrication.design.name).to_string();
    let frame = fabrication.design.frame_id();
    format!(
        r#"# The skin with its contacts in RViz: ros2 launch robot/skin.launch.py
# With the reader: ros2 launch robot/skin.launch.py design:=my-skin.toml source:=serial:/dev/ttyACM0
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node

FOLDER = Path(__file__).resolve().parent
FRAME = "{frame}"


def generate_launch_description():
    base = (FOLDER.parent / "base.stl").as_uri()
    description = (FOLDER / "skin.urdf").read_text(encoding="utf-8").replace("../base.stl", base)
    source = LaunchConfiguration("source")
    return LaunchDescription([
        DeclareLaunchArgument("design", default_value={design}, description="design of the skin, a file or a shipped name"),
        DeclareLaunchArgument("source", default_value="", description="source of `dermis live`; empty: it runs elsewhere"),
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[{{"robot_description": description}}],
        ),
        Node(package="rviz2", executable="rviz2", arguments=["-d", str(FOLDER / "skin.rviz"), "-f", FRAME]),
        ExecuteProcess(
            cmd=["dermis", "live", LaunchConfiguration("design"), "--ros2", "--frame-id", FRAME, "--source", source],
            output="screen",
            condition=IfCondition(PythonExpression(["'", source, "' != ''"])),
        ),
    ])
"#
    )
}

/// A configuration of RViz 2.
pub(super) fn rviz(fabrication: &Fabrication) -> String {
    let frame = fabrication.design.frame_id();
    let far_m = 3.0 * extent_m(fabrication);
    let [x, y, z] = middle_m(fabrication);
    format!(
        "Panels:\n  - Class: rviz_common/Displays\n    Name: Displays\n  - Class: rviz_common/Views\n    Name: Views\n\
         Visualization Manager:\n  Class: \"\"\n  Displays:\n    \
         - Class: rviz_default_plugins/Grid\n      Name: Grid\n      Enabled: true\n      Cell Size: 0.1\n      \
         Plane Cell Count: 10\n    \
         - Class: rviz_default_plugins/RobotModel\n      Name: Skin\n      Enabled: true\n      Alpha: 0.6\n      \
         Description Source: Topic\n      Description Topic:\n        Value: /robot_description\n        \
         Durability Policy: Transient Local\n        Reliability Policy: Reliable\n        History Policy: Keep Last\n        \
         Depth: 5\n    \
         - Class: rviz_default_plugins/MarkerArray\n      Name: Contacts\n      Enabled: true\n      Topic:\n        \
         Value: {MARKERS}\n        Reliability Policy: Reliable\n        Durability Policy: Volatile\n        \
         History Policy: Keep Last\n        Depth: 5\n    \
         - Class: rviz_default_plugins/Wrench\n      Name: Total force\n      Enabled: false\n      Topic:\n        \
         Value: {WRENCH}\n        Reliability Policy: Best Effort\n        Durability Policy: Volatile\n        \
         History Policy: Keep Last\n        Depth: 5\n  \
         Enabled: true\n  Global Options:\n    Background Color: 48; 48; 48\n    Fixed Frame: {frame}\n    Frame Rate: 30\n  \
         Name: root\n  Tools:\n    - Class: rviz_default_plugins/MoveCamera\n    - Class: rviz_default_plugins/Select\n  \
         Views:\n    Current:\n      Class: rviz_default_plugins/Orbit\n      Name: Current View\n      \
         Distance: {far_m:.3}\n      Focal Point:\n        X: {x:.4}\n        Y: {y:.4}\n        Z: {z:.4}\n      \
         Pitch: 0.5\n      Yaw: 0.8\n      Target Frame: {frame}\n      Value: Orbit (rviz_default_plugins)\n    Saved: ~\n"
    )
}

/// A layout of Foxglove: the scene, and the total force.
pub(super) fn foxglove(fabrication: &Fabrication) -> String {
    let layout = json!({
        "configById": { "3D!skin": scene(fabrication), "Plot!force": plot() },
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": { "speed": 1 },
        "layout": { "direction": "row", "first": "3D!skin", "second": "Plot!force", "splitPercentage": 70 }
    });
    serde_json::to_string_pretty(&layout).expect("text and numbers are JSON") + "\n"
}

/// Foxglove's panel of the skin and its contacts.
fn scene(fabrication: &Fabrication) -> Value {
    json!({
        "cameraState": {
            "perspective": true,
            "distance": 3.0 * extent_m(fabrication),
            "phi": 60,
            "thetaOffset": 45,
            "targetOffset": middle_m(fabrication),
            "target": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.01,
            "far": 100
        },
        "followMode": "follow-pose",
        "followTf": fabrication.design.frame_id(),
        "layers": {
            "skin": {
                "layerId": "foxglove.Urdf",
                "instanceId": "skin",
                "label": "Skin",
                "visible": true,
                "sourceType": "topic",
                "topic": "/robot_description",
                "opacity": 0.6
            }
        },
        "topics": { MARKERS: { "visible": true } }
    })
}

/// Foxglove's panel of the total force over time.
fn plot() -> Value {
    let paths = ["x", "y", "z"].map(|axis| {
        json!({
            "value": format!("{WRENCH}.wrench.force.{axis}"),
            "label": format!("force {axis}, N"),
            "enabled": true,
            "timestampMethod": "headerStamp"
        })
    });
    json!({
        "paths": paths,
        "showLegend": true,
        "isSynced": true,
        "xAxisVal": "timestamp",
        "followingViewWidth": 10
    })
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
