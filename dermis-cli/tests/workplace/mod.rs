//! A folder to run commands in, with a small skin.

// Every test program compiles its own copy and uses a part of it.
#![allow(dead_code)]

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use tempfile::TempDir;

/// The design `disk.toml`: 8 arcs on the rim of a disk, 8 x 5 = 40 values; of 8 x 8 pixels, those outside the disk are
/// omitted.
pub const DISK: &str = r#"
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
max_edge_m = 0.01
electrode_edge_m = 0.0025
"#;

/// The commands that `dermis --help` lists.
pub fn listed_commands(help: &str) -> Vec<String> {
    let rows = help.lines().filter_map(|line| line.strip_prefix("  "));
    let rows = rows.filter(|row| row.starts_with(|first: char| first.is_ascii_lowercase()));
    let names = rows.filter_map(|row| row.split_whitespace().next());
    // The examples begin with the program's own name.
    names.filter(|name| *name != "dermis").map(str::to_owned).collect()
}

/// All commands, those of commands too, as in `robot check`; `help` gives the help of a command.
pub fn all_commands(help: impl Fn(&str) -> String) -> Vec<String> {
    let own = |name: String| {
        let text = help(&format!("{name} -h"));
        let Some((_, rows)) = text.split_once("\nCommands:\n") else { return vec![name] };
        let rows = rows.split("\n\n").next().unwrap_or_default();
        let names = listed_commands(rows).into_iter().filter(|own| own != "help");
        names.map(|own| format!("{name} {own}")).collect()
    };
    listed_commands(&help("--help")).into_iter().flat_map(own).collect()
}

/// A temporary working folder, removed when dropped.
pub struct Workplace {
    folder: TempDir,
}

impl Workplace {
    /// A folder with the design `disk.toml`.
    pub fn new() -> Self {
        let workplace = Workplace::empty();
        workplace.write("disk.toml", DISK);
        workplace
    }

    /// An empty folder.
    pub fn empty() -> Self {
        Workplace { folder: tempfile::tempdir().unwrap() }
    }

    /// A folder with the files of a case of the field; `None` where the data are missing.
    pub fn of_field_case(name: &str) -> Option<Self> {
        let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
        let data = PathBuf::from(std::env::var("DERMIS_DATA").unwrap_or(beside.into()));
        let folder = data.join("field_cases").join(name);
        if !folder.is_dir() {
            println!("skipped: there is no {} (DERMIS_DATA names the folder of the data)", folder.display());
            return None;
        }
        let at = Workplace::empty();
        for file in std::fs::read_dir(folder).unwrap() {
            let file = file.unwrap().path();
            std::fs::copy(&file, at.path(file.file_name().and_then(|name| name.to_str()).unwrap())).unwrap();
        }
        Some(at)
    }

    /// A plate of 0.1 m in each format of a surface, and the designs with these bodies.
    pub fn plates(&self) {
        const SIDE: usize = 9;
        let points: Vec<[f64; 3]> =
            (0..SIDE * SIDE).map(|k| [0.0125 * (k % SIDE) as f64, 0.0125 * (k / SIDE) as f64, 0.0]).collect();
        let corners = (0..SIDE * (SIDE - 1)).filter(|k| k % SIDE + 1 < SIDE);
        let triangles: Vec<[usize; 3]> =
            corners.flat_map(|k| [[k, k + 1, k + SIDE], [k + 1, k + 1 + SIDE, k + SIDE]]).collect();
        let (mut obj, mut stl) = (String::new(), "solid plate\n".to_string());
        let mut ply = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\n\
             property list uchar int vertex_indices\nend_header\n",
            points.len(),
            triangles.len()
        );
        for [x, y, z] in &points {
            obj += &format!("v {x} {y} {z}\n");
            ply += &format!("{x} {y} {z}\n");
        }
        for triangle @ [a, b, c] in &triangles {
            obj += &format!("f {} {} {}\n", a + 1, b + 1, c + 1);
            ply += &format!("3 {a} {b} {c}\n");
            let corners =
                triangle.map(|k| format!("vertex {} {} {}\n", points[k][0], points[k][1], points[k][2])).concat();
            stl += &format!("facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n");
        }
        self.write("plate.obj", obj);
        self.write("plate.ply", ply);
        self.write("plate.stl", stl + "endsolid plate\n");
        let design = std::fs::read_to_string(self.path("disk.toml")).unwrap();
        let design = design[..design.find("[image.grid]").unwrap()].replace("contact_impedance_ohm_m = 0.01\n", "");
        let points = "layout.positions = [{ x_m = 0.01, y_m = 0.01, z_m = 0 }, { x_m = 0.06, y_m = 0.01, z_m = 0 }, \
                      { x_m = 0.01, y_m = 0.06, z_m = 0 }, { x_m = 0.04, y_m = 0.04, z_m = 0 }]";
        let design =
            design.replace("layout.rim.count = 8", points).replace("shape.arc.length_m = 0.005", "shape = \"point\"");
        for format in ["obj", "ply", "stl"] {
            let body = format!("[body.mesh]\npath = \"plate.{format}\"\nunit_m = 1.0");
            self.write(&format!("{format}.toml"), design.replace("[body.disk]\ndiameter_m = 0.1", &body));
        }
    }

    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        std::fs::write(self.path(name), content).unwrap();
        self.path(name)
    }

    /// A command that is not started yet.
    pub fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_dermis"));
        command.args(arguments.split_whitespace()).current_dir(self.folder.path());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        // Colours and line wrapping would depend on the terminal.
        command.env("NO_COLOR", "1");
        command
    }

    pub fn run(&self, arguments: &str) -> Output {
        self.command(arguments).output().unwrap()
    }

    /// Runs a command that must succeed; returns its output.
    pub fn good(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "dermis {arguments}: {stderr}");
        let said: Vec<&str> = stderr.lines().filter(|line| !line.ends_with(" left")).collect();
        assert!(said.is_empty(), "nothing but results and progress is said where no terminal listens: {said:?}");
        String::from_utf8(output.stdout).unwrap()
    }

    /// Runs a command that must print JSON.
    pub fn json(&self, arguments: &str) -> serde_json::Value {
        serde_json::from_str(&self.good(arguments)).unwrap()
    }

    /// Runs a command that must fail with exit code 2; returns its message on one line.
    pub fn refused(&self, arguments: &str) -> String {
        let output = self.run(arguments);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "dermis {arguments}: {stderr}");
        let words: Vec<&str> = stderr.split_whitespace().filter(|word| *word != "│").collect();
        words.join(" ")
    }
}

/// A running command, killed when dropped, and its first line of output.
pub struct Running {
    pub child: Child,
    pub line: String,
}

impl Running {
    pub fn start(at: &Workplace, arguments: &str) -> Self {
        let mut child = at.command(arguments).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        Running { child, line: line.trim().into() }
    }

    /// The same with the first line of what it says that has some words.
    pub fn start_said(at: &Workplace, arguments: &str, words: &str) -> Self {
        let mut child = at.command(arguments).spawn().unwrap();
        let mut said = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
        let line = said.find(|line| line.contains(words)).unwrap_or_default();
        std::thread::spawn(move || said.for_each(drop));
        Running { child, line }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have exited already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
