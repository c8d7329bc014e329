//! The Rust files of a workspace, parsed.

use std::collections::BTreeSet;
use std::error::Error;
use std::path::{Path, PathBuf};
use syn::spanned::Spanned;
use syn::visit::Visit;

/// A function with a body, outside tests.
pub struct Function {
    pub name: String,
    pub line: usize,
    pub lines: usize,
}

/// A file and its measures.
pub struct SourceFile {
    pub krate: String,
    /// Relative to the workspace.
    pub path: PathBuf,
    /// Whether all of it belongs to tests or examples.
    pub test: bool,
    /// Lines of the file.
    pub length: usize,
    /// Lines outside tests, neither blank nor of an item under `#[cfg(test)]`.
    pub lines: usize,
    /// The number of these lines that contain more than a comment.
    pub code: usize,
    /// Lines of tests, not blank.
    pub test_lines: usize,
    pub functions: Vec<Function>,
    pub syntax: syn::File,
}

/// All Rust files of the crates in a workspace; a folder with its own `[workspace]` is excluded.
pub fn files(root: &Path) -> Result<Vec<SourceFile>, Box<dyn Error>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(root)? {
        let folder = entry?.path();
        let Ok(manifest) = std::fs::read_to_string(folder.join("Cargo.toml")) else { continue };
        if manifest.lines().any(|line| line.trim() == "[workspace]") {
            continue;
        }
        let krate = folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        for part in ["src", "tests", "examples", "benches"] {
            read_folder(root, &folder.join(part), &krate, part != "src", &mut found)?;
        }
    }
    if found.is_empty() {
        return Err(format!("{}: no Rust files in the crates below it", root.display()).into());
    }
    mark_test_modules(&mut found);
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found.iter_mut().for_each(|file| file.measure(root));
    Ok(found)
}

fn read_folder(
    root: &Path,
    folder: &Path,
    krate: &str,
    test: bool,
    found: &mut Vec<SourceFile>,
) -> Result<(), Box<dyn Error>> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Ok(()) };
    for entry in entries {
        let path = entry?.path();
        if path.is_dir() {
            read_folder(root, &path, krate, test, found)?;
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = std::fs::read_to_string(&path)?;
            let syntax = syn::parse_file(&text).map_err(|error| format!("{}: {error}", path.display()))?;
            let path = path.strip_prefix(root)?.to_path_buf();
            let (krate, length) = (krate.to_string(), text.lines().count());
            let functions = Vec::new();
            found.push(SourceFile { krate, path, test, length, lines: 0, code: 0, test_lines: 0, functions, syntax });
        }
    }
    Ok(())
}

/// Files and folders of modules that are declared under `#[cfg(test)]`.
fn mark_test_modules(files: &mut [SourceFile]) {
    let mut modules = BTreeSet::new();
    for file in files.iter() {
        for item in &file.syntax.items {
            if let syn::Item::Mod(module) = item
                && module.content.is_none()
                && is_test(&module.attrs)
            {
                modules.insert(module_folder(&file.path).join(module.ident.to_string()));
            }
        }
    }
    for file in files {
        let own = file.path.with_extension("");
        file.test |= own.ancestors().any(|folder| modules.contains(folder));
    }
}

/// The folder of a file's submodules.
fn module_folder(path: &Path) -> PathBuf {
    let name = path.file_stem().unwrap_or_default();
    if name == "mod" || name == "lib" || name == "main" {
        path.parent().unwrap_or(path).to_path_buf()
    } else {
        path.with_extension("")
    }
}

/// Whether attributes contain `#[cfg(test)]` or `#[test]`.
pub fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("test")
            || attribute.path().is_ident("cfg")
                && attribute.parse_args::<syn::Ident>().is_ok_and(|argument| argument == "test")
    })
}

impl SourceFile {
    fn measure(&mut self, root: &Path) {
        let text = std::fs::read_to_string(root.join(&self.path)).unwrap_or_default();
        let mut visitor = Visitor::default();
        if !self.test {
            visitor.visit_file(&self.syntax);
        }
        for (number, line) in text.lines().map(str::trim).enumerate().filter(|(_, line)| !line.is_empty()) {
            if self.test || visitor.test_lines.contains(&(number + 1)) {
                self.test_lines += 1;
            } else {
                self.lines += 1;
                self.code += usize::from(!line.starts_with("//"));
            }
        }
        self.functions = visitor.functions;
    }
}

#[derive(Default)]
struct Visitor {
    functions: Vec<Function>,
    test_lines: BTreeSet<usize>,
}

impl Visitor {
    fn function(&mut self, signature: &syn::Signature, block: &syn::Block) {
        let line = signature.fn_token.span.start().line;
        let lines = block.span().end().line + 1 - line;
        self.functions.push(Function { name: signature.ident.to_string(), line, lines });
    }

    /// Whether an item belongs to tests; its lines are recorded.
    fn skip(&mut self, attributes: &[syn::Attribute], item: &impl Spanned) -> bool {
        let test = is_test(attributes);
        if test {
            let span = item.span();
            self.test_lines.extend(span.start().line..=span.end().line);
        }
        test
    }
}

impl<'a> Visit<'a> for Visitor {
    fn visit_item(&mut self, item: &'a syn::Item) {
        let attributes = match item {
            syn::Item::Mod(item) => &item.attrs,
            syn::Item::Fn(item) => &item.attrs,
            syn::Item::Impl(item) => &item.attrs,
            syn::Item::Use(item) => &item.attrs,
            syn::Item::Struct(item) => &item.attrs,
            _ => &Vec::new(),
        };
        if !self.skip(attributes, item) {
            syn::visit::visit_item(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'a syn::ItemFn) {
        self.function(&item.sig, &item.block);
        syn::visit::visit_item_fn(self, item);
    }

    fn visit_impl_item_fn(&mut self, item: &'a syn::ImplItemFn) {
        if !self.skip(&item.attrs, item) {
            self.function(&item.sig, &item.block);
            syn::visit::visit_impl_item_fn(self, item);
        }
    }

    fn visit_trait_item_fn(&mut self, item: &'a syn::TraitItemFn) {
        if let Some(block) = &item.default {
            self.function(&item.sig, block);
        }
        syn::visit::visit_trait_item_fn(self, item);
    }
}
