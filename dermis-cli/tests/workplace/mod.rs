//! A folder to run commands in, with a small skin.

// Every test program compiles its own copy and uses a part of it.
#![allow(dead_code)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
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
