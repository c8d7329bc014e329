//! The crate supports microcontrollers: neither it nor its dependencies use the standard library or an allocator.

use std::process::Command;

/// `cargo tree` lists the features of each dependency for this crate alone.
#[test]
fn no_dependency_takes_std_or_alloc() {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.current_dir(env!("CARGO_MANIFEST_DIR")).env_remove("RUSTFLAGS");
    let words = ["tree", "--offline", "--package", "dermis-firmware", "--edges", "features,normal,no-proc-macro"];
    let output = cargo.args(words).output().expect("cargo runs");
    let tree = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(tree.contains("dermis-wire v") && tree.contains("heapless v"), "{tree}");
    for feature in ["std", "alloc", "use_std"] {
        assert!(!tree.contains(&format!("feature \"{feature}\"")), "{tree}");
    }
}
