//! The docstrings of the module, from its stubs: `help()` and editors show the same.

use std::fmt::Write as _;
use std::path::Path;

const STUBS: &str = "python/dermis/_dermis.pyi";

fn main() -> std::io::Result<()> {
    println!("cargo::rerun-if-changed={STUBS}");
    let mut macros = String::from("macro_rules! stub_doc {\n");
    for (name, text) in docs(&std::fs::read_to_string(STUBS)?) {
        let _ = writeln!(macros, "    ({name}) => {{ {text:?} }};");
    }
    macros.push_str("}\n");
    let folder = std::env::var_os("OUT_DIR").expect("cargo sets it");
    std::fs::write(Path::new(&folder).join("docs.rs"), macros)
}

/// The docstrings by name: `Skin`, `Skin.method`.
fn docs(stubs: &str) -> Vec<(String, String)> {
    let (mut class, mut function, mut found) = (String::new(), String::new(), Vec::new());
    let mut lines = stubs.lines();
    while let Some(line) = lines.next() {
        let word = line.trim_start();
        let name = |keyword: &str| {
            let rest = word.strip_prefix(keyword)?;
            Some(rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default().to_string())
        };
        if let Some(name) = name("class ") {
            class.clone_from(&name);
            function = name;
        } else if let Some(name) = name("def ") {
            if !line.starts_with(' ') {
                class.clear();
            }
            function = if class.is_empty() { name } else { format!("{class}.{name}") };
        } else if let Some(mut text) = word.strip_prefix("\"\"\"").map(str::to_string)
            && !function.is_empty()
        {
            let indent = line.len() - word.len();
            while !text.contains("\"\"\"") {
                let next = lines.next().expect("a docstring ends");
                text += "\n";
                text += next.get(indent..).unwrap_or_default();
            }
            text.truncate(text.find("\"\"\"").expect("its end"));
            found.push((std::mem::take(&mut function), text.trim_end().to_string()));
        }
    }
    found
}
