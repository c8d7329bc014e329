//! Module layers and crate dependencies: a module imports only from lower layers, a crate depends only on the crates in
//! its row.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The layers of each layered crate, lowest first. `ARCHITECTURE.md` describes them; this table is enforced by the
/// test.
const LAYERED: &[(&str, &[&[&str]])] = &[
    (
        "dermis",
        &[
            &["files", "geom", "linalg", "stats", "text"],
            &["contact", "finding", "protocol"],
            &["design", "frame"],
            &["mesh"],
            &["fem", "image"],
            &["forward"],
            &["estimate"],
            &["detect", "fit", "identify", "refine", "track"],
            &["reconstruct"],
            &["skin"],
            &["method", "plausibility"],
            &["pipeline"],
        ],
    ),
    (
        "dermis-sim",
        &[
            &["elementary"],
            &["quadrature", "random"],
            &["touch"],
            &["noise"],
            &["twin"],
            &["bound", "dataset", "experiment"],
            &["evaluate", "optimise"],
        ],
    ),
];

/// Modules outside the layers: the crate's error has one variant per module, and `lib.rs` declares them all.
const EXEMPT: &[&str] = &["lib", "error"];

/// The workspace crates that each crate may depend on.
const CRATES: &[(&str, &[&str])] = &[
    ("dermis", &[]),
    ("dermis-plot", &["dermis"]),
    ("dermis-calibrate", &["dermis"]),
    ("dermis-fabricate", &["dermis", "dermis-plot", "dermis-sim"]),
    ("dermis-sim", &["dermis"]),
    ("dermis-learn", &["dermis", "dermis-calibrate", "dermis-sim"]),
    ("dermis-study", &["dermis", "dermis-learn", "dermis-plot", "dermis-sim"]),
    ("dermis-wire", &[]),
    ("dermis-firmware", &["dermis-wire"]),
    ("dermis-robot", &["dermis"]),
    ("dermis-live", &["dermis", "dermis-robot", "dermis-wire"]),
    ("dermis-emulate", &["dermis", "dermis-firmware", "dermis-live", "dermis-robot", "dermis-sim", "dermis-wire"]),
    (
        "dermis-cli",
        &[
            "dermis",
            "dermis-calibrate",
            "dermis-emulate",
            "dermis-fabricate",
            "dermis-learn",
            "dermis-live",
            "dermis-plot",
            "dermis-robot",
            "dermis-sim",
            "dermis-study",
            "dermis-wire",
        ],
    ),
    (
        "dermis-python",
        &[
            "dermis",
            "dermis-calibrate",
            "dermis-cli",
            "dermis-emulate",
            "dermis-learn",
            "dermis-live",
            "dermis-plot",
            "dermis-robot",
            "dermis-sim",
        ],
    ),
    ("dermis-bench", &["dermis", "dermis-learn", "dermis-sim"]),
    ("paper-study", &["dermis", "dermis-cli", "dermis-learn", "dermis-plot", "dermis-sim", "dermis-study"]),
];

type Layers = &'static [&'static [&'static str]];

fn layers_of(crate_name: &str) -> Layers {
    let row = LAYERED.iter().find(|(name, _)| *name == crate_name);
    row.unwrap_or_else(|| panic!("crate `{crate_name}` is not in the table of layers")).1
}

fn layer_of(layers: Layers, module: &str) -> Option<usize> {
    layers.iter().position(|layer| layer.contains(&module))
}

fn workspace_root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the crate lies in the workspace").to_owned()
}

/// The source without comments, strings and character literals, so that only code is searched for paths.
fn code_only(source: &str) -> String {
    let mut code = String::with_capacity(source.len());
    let mut rest = source;
    while let Some(next) = rest.chars().next() {
        let skipped = match next {
            '/' if rest.starts_with("//") => rest.find('\n').unwrap_or(rest.len()),
            '/' if rest.starts_with("/*") => rest.find("*/").map_or(rest.len(), |end| end + 2),
            'r' if rest.starts_with("r\"") || rest.starts_with("r#") => raw_string_length(rest),
            '"' => string_length(rest),
            '\'' if rest.starts_with("'\"'") => 3,
            '\'' if rest.starts_with("'\\") => rest[2..].find('\'').map_or(rest.len(), |end| end + 3),
            _ => 0,
        };
        if skipped == 0 {
            code.push(next);
            rest = &rest[next.len_utf8()..];
        } else {
            code.push(' ');
            rest = &rest[skipped..];
        }
    }
    code
}

/// Length of the string literal that `text` begins with.
fn string_length(text: &str) -> usize {
    let mut escaped = false;
    for (position, byte) in text.bytes().enumerate().skip(1) {
        match byte {
            _ if escaped => escaped = false,
            b'\\' => escaped = true,
            b'"' => return position + 1,
            _ => {}
        }
    }
    text.len()
}

/// Length of the raw string literal that `text` begins with, or 0 for a raw identifier.
fn raw_string_length(text: &str) -> usize {
    let hashes = text[1..].bytes().take_while(|&byte| byte == b'#').count();
    if text.as_bytes().get(1 + hashes) != Some(&b'"') {
        return 0;
    }
    let close = format!("\"{}", "#".repeat(hashes));
    let body = hashes + 2;
    text[body..].find(&close).map_or(text.len(), |end| body + end + close.len())
}

fn identifier(text: &str) -> &str {
    let end = text.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(text.len());
    &text[..end]
}

/// First names of a path's tail: `mesh::Mesh` gives `mesh`, `{mesh::Mesh, fem}` gives both.
fn first_names(tail: &str) -> Vec<&str> {
    let tail = tail.trim_start();
    let Some(group) = tail.strip_prefix('{') else {
        return vec![identifier(tail)];
    };
    let (mut depth, mut names, mut at_start) = (0, Vec::new(), true);
    for (position, character) in group.char_indices() {
        match character {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => at_start = true,
            c if at_start && !c.is_whitespace() => {
                names.push(identifier(&group[position..]));
                at_start = false;
            }
            _ => {}
        }
    }
    names
}

/// Top-level modules that `source` uses by `crate::...`, or by a chain of `super::` up to the crate root.
fn imports(source: &str, file_depth: usize) -> BTreeSet<String> {
    let code = code_only(source);
    let mut found = BTreeSet::new();
    let starts_path =
        |at: usize| !code[..at].ends_with(|before: char| before.is_alphanumeric() || before == '_' || before == ':');
    for (at, _) in code.match_indices("crate::").filter(|&(at, _)| starts_path(at)) {
        found.extend(first_names(&code[at + "crate::".len()..]).into_iter().map(str::to_owned));
    }
    for (at, _) in code.match_indices("super::").filter(|&(at, _)| starts_path(at)) {
        let (mut tail, mut climbs) = (&code[at..], 0);
        while let Some(above) = tail.strip_prefix("super::") {
            (tail, climbs) = (above, climbs + 1);
        }
        if climbs >= file_depth {
            found.extend(first_names(tail).into_iter().map(str::to_owned));
        }
    }
    found
}

/// Imports of `source`, a file of `module`, from the module's own layer or a higher one.
fn violations(layers: Layers, module: &str, file_depth: usize, source: &str) -> Vec<String> {
    let own = layer_of(layers, module).unwrap_or_else(|| panic!("module `{module}` is in no layer of the table"));
    let imported = imports(source, file_depth);
    let violates = |name: &&String| name.as_str() != module && layer_of(layers, name).is_some_and(|layer| layer >= own);
    imported.iter().filter(violates).cloned().collect()
}

fn source_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("the sources are readable") {
        let path = entry.expect("the sources are readable").path();
        if path.is_dir() {
            source_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Violations in all source files of a crate, with the file's path.
fn violations_in_crate(crate_name: &str, layers: Layers) -> Vec<String> {
    let source_root = workspace_root().join(crate_name).join("src");
    let mut files = Vec::new();
    source_files(&source_root, &mut files);
    assert!(files.len() > layers.len(), "{crate_name}: only {} source files found", files.len());
    let mut found = Vec::new();
    for file in &files {
        let inside = file.strip_prefix(&source_root).expect("found under it").with_extension("");
        let names: Vec<&str> = inside.iter().map(|name| name.to_str().expect("ASCII file names")).collect();
        if EXEMPT.contains(&names[0]) {
            continue;
        }
        let depth = names.len() - usize::from(names.last() == Some(&"mod"));
        let source = fs::read_to_string(file).expect("the sources are readable");
        for imported in violations(layers, names[0], depth, &source) {
            found.push(format!("{crate_name}/src/{}.rs ({}) imports `{imported}`", inside.display(), names[0]));
        }
    }
    found
}

#[test]
fn every_module_imports_only_from_lower_layers() {
    let found: Vec<String> =
        LAYERED.iter().flat_map(|(crate_name, layers)| violations_in_crate(crate_name, layers)).collect();
    assert!(found.is_empty(), "imports from the same or a higher layer:\n{}", found.join("\n"));
}

#[test]
fn the_table_lists_the_modules_that_exist() {
    for (crate_name, layers) in LAYERED {
        let lib = workspace_root().join(crate_name).join("src/lib.rs");
        let lib = fs::read_to_string(lib).expect("the sources are readable");
        let mut layer = None;
        let mut declared = BTreeSet::new();
        for line in lib.lines().map(str::trim) {
            if let Some(number) = line.strip_prefix("// Layer ") {
                layer = number.parse::<usize>().ok();
                continue;
            }
            let module = line.strip_prefix("pub ").unwrap_or(line).strip_prefix("mod ");
            if let Some(name) = module.and_then(|rest| rest.strip_suffix(';')).filter(|name| !EXEMPT.contains(name)) {
                assert_eq!(layer_of(layers, name), layer, "layer of `{name}` here and in {crate_name}/src/lib.rs");
                declared.insert(name);
            }
        }
        let tabled: BTreeSet<&str> = layers.iter().flat_map(|layer| layer.iter().copied()).collect();
        assert_eq!(declared, tabled, "modules of {crate_name}/src/lib.rs and of the table");
    }
}

#[test]
fn a_planted_violation_is_caught() {
    let layers = layers_of("dermis");
    let cases = [
        ("mesh", 1, "use crate::forward::ForwardModel;", vec!["forward"]),
        ("image", 1, "fn f(m: &crate::fem::Stiffness) {}", vec!["fem"]),
        ("mesh", 2, "use crate::{geom::Point, reconstruct, fem::{a, b}};", vec!["fem", "reconstruct"]),
        ("mesh", 2, "use super::super::detect::detect;", vec!["detect"]),
        ("mesh", 1, "use super::detect::detect;", vec!["detect"]),
        ("mesh", 2, "use super::detect;", vec![]),
        ("forward", 1, "use crate::mesh::Mesh; use crate::{Error, forward::network};", vec![]),
        ("mesh", 1, "// crate::forward\nlet text = \"crate::forward\"; /* crate::detect */", vec![]),
    ];
    for (module, depth, source, expected) in cases {
        assert_eq!(violations(layers, module, depth, source), expected, "{module}: {source}");
    }
}

#[test]
fn every_crate_depends_only_on_what_its_row_allows() {
    let root = workspace_root();
    let workspace: toml::Table = read_manifest(&root.join("Cargo.toml"));
    let members = workspace["workspace"]["members"].as_array().expect("a list of members");
    for member in members.iter().map(|member| member.as_str().expect("a folder")) {
        let manifest = read_manifest(&root.join(member).join("Cargo.toml"));
        let name = manifest["package"]["name"].as_str().expect("a name");
        let row = CRATES.iter().find(|(listed, _)| *listed == name);
        let (_, allowed) = row.unwrap_or_else(|| panic!("crate `{name}` is in no row of the table"));
        let dependencies = manifest.get("dependencies").and_then(toml::Value::as_table);
        for dependency in dependencies.into_iter().flat_map(toml::Table::keys) {
            let ours = dependency == "dermis" || dependency.starts_with("dermis-");
            assert!(!ours || allowed.contains(&dependency.as_str()), "crate `{name}` may not depend on `{dependency}`");
        }
    }
}

fn read_manifest(path: &Path) -> toml::Table {
    let text = fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    text.parse().unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The roots of test programs that a manifest names: files of `tests/`, without their extension.
fn test_programs(manifest: &str) -> Vec<&str> {
    manifest.lines().filter_map(|line| line.strip_prefix("path = \"tests/")?.strip_suffix(".rs\"")).collect()
}

/// Cargo looks for no tests itself (`autotests = false`): a file that no program declares would never run.
#[test]
fn every_test_file_belongs_to_one_test_program() {
    let mut files = 0;
    for folder in fs::read_dir(workspace_root()).unwrap().map(|entry| entry.unwrap().path()) {
        let (tests, manifest) = (folder.join("tests"), folder.join("Cargo.toml"));
        let Ok(manifest) = fs::read_to_string(manifest) else { continue };
        let programs = test_programs(&manifest);
        if !tests.is_dir() || !manifest.contains("autotests = false") {
            continue;
        }
        let roots: Vec<String> =
            programs.iter().map(|program| fs::read_to_string(tests.join(format!("{program}.rs"))).unwrap()).collect();
        for file in fs::read_dir(&tests).unwrap().map(|entry| entry.unwrap().path()) {
            let stem = file.file_stem().unwrap().to_str().unwrap();
            let has_tests = file.extension().is_some_and(|extension| extension == "rs") && !programs.contains(&stem);
            if has_tests {
                let declared = roots.iter().filter(|root| root.contains(&format!("mod {stem};\n"))).count();
                assert_eq!(declared, 1, "{}: a test program must declare it, and only one", file.display());
                files += 1;
            }
        }
    }
    assert!(files > 50, "only {files} files of tests found");
}
