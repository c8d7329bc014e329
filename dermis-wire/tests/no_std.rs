//! The crate supports microcontrollers: neither it nor its dependencies use the standard library or an allocator.

use std::path::Path;
use std::process::Command;

/// A target without an operating system.
const BARE: &str = "thumbv7em-none-eabi";

fn cargo() -> Command {
    let mut command = Command::new(env!("CARGO"));
    command.current_dir(env!("CARGO_MANIFEST_DIR")).env_remove("RUSTFLAGS");
    command
}

/// `cargo tree` lists the features of each dependency for this crate alone.
#[test]
fn no_dependency_takes_std_or_alloc() {
    let words = ["tree", "--offline", "--package", "dermis-wire", "--edges", "features,normal,no-proc-macro"];
    let output = cargo().args(words).output().expect("cargo runs");
    let tree = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(tree.contains("cobs v") && tree.contains("crc v"), "{tree}");
    for feature in ["std", "alloc", "use_std"] {
        assert!(!tree.contains(&format!("feature \"{feature}\"")), "{tree}");
    }
}

/// Compiles the crate, if the core library of the target is installed (`rustup target add thumbv7em-none-eabi`).
#[test]
fn compiles_where_there_is_no_standard_library() {
    let libraries = Command::new("rustc").args(["--print", "target-libdir", "--target", BARE]).output();
    let installed = libraries.is_ok_and(|output| {
        Path::new(String::from_utf8_lossy(&output.stdout).trim())
            .read_dir()
            .is_ok_and(|mut files| files.next().is_some())
    });
    if !installed {
        eprintln!("skipped: {BARE} is not installed (rustup target add {BARE})");
        return;
    }
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bare");
    let words = ["check", "--release", "--offline", "--package", "dermis-wire", "--target", BARE, "--target-dir"];
    let output = cargo().args(words).arg(folder).output().expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
