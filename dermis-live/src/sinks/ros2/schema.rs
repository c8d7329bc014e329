//! Definitions of the messages, for ROS 2 tools and for recordings.

use crate::sinks::ros2::message::fields;
use std::fmt::Write;

/// The constants of a type, which stand before its fields.
fn constants(name: &str) -> &'static str {
    match name {
        "sensor_msgs/PointField" => {
            "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\nuint8 FLOAT32=7\n\
             uint8 FLOAT64=8\n"
        }
        "visualization_msgs/Marker" => {
            "int32 ARROW=0\nint32 CUBE=1\nint32 SPHERE=2\nint32 CYLINDER=3\nint32 LINE_STRIP=4\nint32 LINE_LIST=5\n\
             int32 CUBE_LIST=6\nint32 SPHERE_LIST=7\nint32 POINTS=8\nint32 TEXT_VIEW_FACING=9\nint32 MESH_RESOURCE=10\n\
             int32 TRIANGLE_LIST=11\nint32 ARROW_STRIP=12\nint32 ADD=0\nint32 MODIFY=0\nint32 DELETE=2\nint32 DELETEALL=3\n"
        }
        "diagnostic_msgs/DiagnosticStatus" => "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\n",
        _ => "",
    }
}

/// The definition of a type such as `sensor_msgs/msg/Image`, followed by the definitions that it needs, each after a
/// line of 80 equality signs and a line with its name: the encoding `ros2msg` of a recording.
///
/// # Panics
/// If the type is not defined here.
pub fn definition(type_name: &str) -> String {
    let mut needed = vec![type_name.replacen("/msg/", "/", 1)];
    let mut text = String::new();
    let mut next = 0;
    while next < needed.len() {
        let lines = lines(&needed[next]);
        if next > 0 {
            writeln!(text, "{}\nMSG: {}", "=".repeat(80), needed[next]).expect("a string can be written");
        }
        text += &lines;
        for part in lines.lines().filter_map(|line| line.split(' ').next()).map(|part| part.trim_end_matches("[]")) {
            // The types with a package.
            if part.contains('/') && !needed.iter().any(|name| name == part) {
                needed.push(part.to_owned());
            }
        }
        next += 1;
    }
    text
}

/// The constants and the fields of a type, a line for each.
fn lines(name: &str) -> String {
    let line = |(kind, field): (String, &str)| match (name, field) {
        ("diagnostic_msgs/DiagnosticStatus", "level") => "byte level\n".into(),
        ("geometry_msgs/Quaternion", "w") => format!("{kind} w 1\n"),
        ("geometry_msgs/Quaternion", _) => format!("{kind} {field} 0\n"),
        _ => format!("{kind} {field}\n"),
    };
    let fields = fields(&name.replacen('/', "/msg/", 1)).into_iter().map(line);
    [constants(name).to_owned()].into_iter().chain(fields).collect()
}
