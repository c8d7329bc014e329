//! Definitions of the messages, for ROS 2 tools and for recordings.

use std::fmt::Write;

/// All types used here: a line with the name, then its fields.
const DEFINITIONS: &str = include_str!("definitions.msg");

/// The definition of a type such as `sensor_msgs/msg/Image`, followed by the definitions that it needs, each after a
/// line of 80 equality signs and a line with its name: the encoding `ros2msg` of a recording.
///
/// # Panics
/// If the type is not defined here.
pub fn definition(type_name: &str) -> String {
    let wanted = type_name.replacen("/msg/", "/", 1);
    let mut needed = vec![wanted.clone()];
    let mut text = fields(&wanted).to_owned();
    let mut next = 0;
    while next < needed.len() {
        for part in parts(fields(&needed[next])) {
            if !needed.iter().any(|name| name == part) {
                writeln!(text, "{}\nMSG: {part}\n{}", "=".repeat(80), fields(part).trim_end())
                    .expect("a string can be written");
                needed.push(part.to_owned());
            }
        }
        next += 1;
    }
    text
}

fn fields(name: &str) -> &'static str {
    let mut definitions = DEFINITIONS.split("MSG: ").filter_map(|definition| definition.split_once('\n'));
    let found = definitions.find(|(defined, _)| *defined == name);
    found.unwrap_or_else(|| panic!("the definition of `{name}` is not here")).1
}

/// The types that a definition refers to: those with a package.
fn parts(definition: &'static str) -> impl Iterator<Item = &'static str> {
    let types = definition.lines().filter_map(|line| line.split(' ').next());
    types.map(|name| name.trim_end_matches("[]")).filter(|name| name.contains('/'))
}
