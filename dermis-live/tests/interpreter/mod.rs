//! A Python with packages from PyPI, in a virtual environment under `target/`.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The interpreter with the packages of a file installed. If that is not possible, a message is printed, and `None`
/// returned; with `DERMIS_REQUIRE_PYTHON` the test fails.
pub fn with(requirements: &Path) -> Option<PathBuf> {
    match install(requirements) {
        Ok(python) => Some(python),
        Err(why) if std::env::var_os("DERMIS_REQUIRE_PYTHON").is_some() => panic!("{why}"),
        Err(why) => {
            eprintln!("skipped: {why} (set DERMIS_REQUIRE_PYTHON to make this a failure)");
            None
        }
    }
}

fn install(requirements: &Path) -> Result<PathBuf, String> {
    let content = std::fs::read(requirements).expect("the requirements are in the repository");
    // A separate folder for each version of the requirements.
    let name = format!("peers-{:08x}", crc32fast::hash(&content));
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let python = folder.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    let done = folder.join("installed");
    if !done.exists() {
        run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder))?;
        let mut pip = Command::new(&python);
        pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--requirement"]);
        run(pip.arg(requirements))?;
        std::fs::write(done, "").map_err(|error| error.to_string())?;
    }
    Ok(python)
}

/// Runs a command; what it said, or how it failed.
pub fn run(command: &mut Command) -> Result<String, String> {
    let output = command.output().map_err(|error| format!("{:?}: {error}", command.get_program()))?;
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    if output.status.success() { Ok(said) } else { Err(format!("{command:?}: {}\n{said}", output.status)) }
}
