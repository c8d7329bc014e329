//! Public items, and whether their names occur outside their crate.

use crate::source::{SourceFile, is_test};
use proc_macro2::{TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use syn::Visibility;
use syn::visit::Visit;

/// The places outside an item's crate where its name occurs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// In another crate, outside tests.
    Crates,
    /// Only in tests and examples, including those of its own crate.
    Tests,
    Nowhere,
}

/// A public item.
pub struct Public {
    pub krate: String,
    pub path: PathBuf,
    pub name: String,
    pub used: Use,
}

/// The public items of all libraries.
pub fn public(files: &[SourceFile]) -> Vec<Public> {
    let libraries: BTreeSet<&str> =
        files.iter().filter(|file| file.path.ends_with("src/lib.rs")).map(|file| file.krate.as_str()).collect();
    let names = names_of_crates(files);
    let mut found = Vec::new();
    for file in files.iter().filter(|file| !file.test && libraries.contains(file.krate.as_str())) {
        let mut visitor = PublicNames::default();
        visitor.visit_file(&file.syntax);
        for name in visitor.names {
            let used = use_of(&name, &file.krate, &names);
            found.push(Public { krate: file.krate.clone(), path: file.path.clone(), name, used });
        }
    }
    found
}

/// Identifiers of each crate, separately for files of tests and other files.
type Names<'a> = BTreeMap<(&'a str, bool), BTreeSet<String>>;

fn names_of_crates(files: &[SourceFile]) -> Names<'_> {
    let mut names = Names::new();
    for file in files {
        let tokens = quote::ToTokens::to_token_stream(&file.syntax);
        collect(tokens, names.entry((&file.krate, file.test)).or_default());
    }
    names
}

fn collect(tokens: TokenStream, names: &mut BTreeSet<String>) {
    for token in tokens {
        match token {
            TokenTree::Group(group) => collect(group.stream(), names),
            TokenTree::Ident(name) => drop(names.insert(name.to_string())),
            TokenTree::Punct(_) | TokenTree::Literal(_) => {}
        }
    }
}

fn use_of(name: &str, krate: &str, names: &Names<'_>) -> Use {
    let occurs = |test: bool| {
        names
            .iter()
            .any(|(&(other, in_test), names)| in_test == test && (other != krate || test) && names.contains(name))
    };
    if occurs(false) {
        Use::Crates
    } else if occurs(true) {
        Use::Tests
    } else {
        Use::Nowhere
    }
}

#[derive(Default)]
struct PublicNames {
    names: Vec<String>,
}

impl PublicNames {
    fn note(&mut self, visibility: &Visibility, name: &syn::Ident) {
        if matches!(visibility, Visibility::Public(_)) {
            self.names.push(name.to_string());
        }
    }
}

impl<'a> Visit<'a> for PublicNames {
    fn visit_item(&mut self, item: &'a syn::Item) {
        match item {
            syn::Item::Mod(item) if is_test(&item.attrs) => return,
            syn::Item::Const(item) => self.note(&item.vis, &item.ident),
            syn::Item::Enum(item) => self.note(&item.vis, &item.ident),
            syn::Item::Fn(item) => self.note(&item.vis, &item.sig.ident),
            syn::Item::Static(item) => self.note(&item.vis, &item.ident),
            syn::Item::Struct(item) => self.note(&item.vis, &item.ident),
            syn::Item::Trait(item) => self.note(&item.vis, &item.ident),
            syn::Item::Type(item) => self.note(&item.vis, &item.ident),
            _ => {}
        }
        syn::visit::visit_item(self, item);
    }

    fn visit_impl_item(&mut self, item: &'a syn::ImplItem) {
        match item {
            syn::ImplItem::Fn(item) => self.note(&item.vis, &item.sig.ident),
            syn::ImplItem::Const(item) => self.note(&item.vis, &item.ident),
            _ => {}
        }
    }
}
