//! Other programs read what a workshop gets: trimesh, ezdxf, xacro and MuJoCo from PyPI, admesh, ngspice, check_urdf and a C
//! compiler where they are installed. Scripts check the folder against the design's file with formulas of their own, the
//! tables against each other, and the robot descriptions.
//!
//! The programs are installed into a virtual environment under `target/`, at the versions in `python/requirements.txt`.
//! If that is not possible, the tests print a message and pass, unless `DERMIS_REQUIRE_PYTHON` is set.

#[path = "../../dermis-live/tests/interpreter/mod.rs"]
mod interpreter;

use dermis::design::SkinDesign;
use dermis_fabricate::{Fabrication, Manifest, PARTS, notes, write_folder};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

fn scripts() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python")
}

/// The interpreter with the programs installed; `None` if it is not available.
fn python() -> Option<&'static Path> {
    static PYTHON: OnceLock<Option<PathBuf>> = OnceLock::new();
    PYTHON.get_or_init(|| interpreter::with(&scripts().join("requirements.txt"))).as_deref()
}

/// Writes the folder of a design's file, and has it checked.
fn check(design: &Path) {
    let made = Fabrication::new(&SkinDesign::load(&design.to_string_lossy()).unwrap()).unwrap();
    let files: Vec<_> = PARTS.into_iter().flat_map(|(_, make)| make(&made).unwrap()).collect();
    let at = tempfile::tempdir().unwrap();
    let folder = at.path().join("workshop");
    write_folder(&folder, false, &Manifest::new(&made.design, notes(&made), &files), &files).unwrap();
    let Some(python) = python() else { return };
    for (script, needs_design) in [("check_folder.py", true), ("check_tables.py", false), ("check_robot.py", false)] {
        let mut command = Command::new(python);
        command.arg(scripts().join(script)).arg(&folder);
        let said = interpreter::run(if needs_design { command.arg(design) } else { &mut command });
        println!("{}", said.unwrap_or_else(|why| panic!("{why}")));
    }
}

fn shipped(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis/designs").join(name).with_extension("toml")
}

fn template(body: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../dermis-cli/src/command/new").join(body).with_extension("toml")
}

/// A file of a template or a shipped design with other sizes.
fn changed(path: &Path, changes: &[(&str, &str)]) -> (tempfile::TempDir, PathBuf) {
    let at = tempfile::tempdir().unwrap();
    let mut text = std::fs::read_to_string(path).unwrap();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    let file = at.path().join("changed.toml");
    std::fs::write(&file, text).unwrap();
    (at, file)
}

#[test]
fn the_papers_skin() {
    check(&shipped("cylinder30"));
}

#[test]
fn a_cylinder_with_flanges_an_overlap_and_no_channels() {
    let changes = [
        ("patch_gap_m = 0.001", "patch_gap_m = 0.001\nflange_m = 0.012\noverlap_m = 0.015"),
        ("channel_depth_m = 0.002", "channel_depth_m = 0.0"),
        ("seam_theta_rad = 0.314159", "seam_theta_rad = 0.0"),
    ];
    let (_at, file) = changed(&shipped("cylinder30"), &changes);
    check(&file);
}

#[test]
fn a_sleeve_from_a_mesh_file() {
    check(&shipped("forearm"));
}

#[test]
fn a_disk() {
    check(&shipped("skin16"));
}

#[test]
fn a_rectangle() {
    check(&template("rectangle"));
}
