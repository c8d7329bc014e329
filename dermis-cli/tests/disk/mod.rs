//! A small skin for tests of commands.

/// A design: 8 arcs on the rim of a disk, 8 x 5 = 40 values; of 8 x 8 pixels those outside the disk do not exist.
pub fn disk(max_edge_m: f64, electrode_edge_m: f64) -> String {
    format!(
        r#"
[body.disk]
diameter_m = 0.1
[sheet]
sheet_resistance_ohm = 1000
touch = "conductance_rises"
[electrodes]
shape.arc.length_m = 0.005
contact_impedance_ohm_m = 0.01
layout.rim.count = 8
[protocol]
pattern = "adjacent_undriven"
[image.grid]
rows = 8
columns = 8
[mesh]
max_edge_m = {max_edge_m}
electrode_edge_m = {electrode_edge_m}
"#
    )
}
