//! The files and folders that a command writes, checked before it computes.

use crate::output::Output;
use clap::{Arg, ArgMatches, Command};
use dermis::files::check_writable;
use std::any::TypeId;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// The arguments with the name of a file or folder to write.
const WRITTEN: [&str; 16] = [
    "output",
    "map",
    "force_map",
    "separation_map",
    "separation_curve",
    "given_map",
    "curve",
    "slots_curve",
    "picture",
    "realign",
    "transcript",
    "readings",
    "onnx",
    "offsets",
    "record",
    "latency",
];

/// The arguments with files that are read if they exist, and written.
const KEPT: [&str; 1] = ["state"];

/// Why what a command is to write cannot be written, or would overwrite what it reads.
pub fn refusal(command: &Command, matches: &ArgMatches) -> Option<String> {
    if let Some((name, inner)) = matches.subcommand() {
        return refusal(command.find_subcommand(name)?, inner);
    }
    let written = WRITTEN.iter().chain(&KEPT).flat_map(|id| values(matches, id).map(move |path| (id, path)));
    let read: Vec<PathBuf> = (matches.ids().map(|id| id.as_str()))
        .filter(|id| !WRITTEN.contains(id) && !KEPT.contains(id))
        .flat_map(|id| values(matches, id).filter_map(of_file))
        .collect();
    let refused = |(id, path): (&&str, &Path)| {
        let option = command.get_arguments().find(|argument| argument.get_id() == *id)?;
        let name = format!("--{} {}", option.get_long().unwrap_or(id), path.display());
        if of_file(path).is_some_and(|file| read.contains(&file)) {
            return Some(format!("{name}: the command reads this file, and it would be lost. Choose another name"));
        }
        let is_standard_output = path == Path::new("-");
        if is_standard_output && option.get_value_parser().type_id() != TypeId::of::<Output>() {
            return Some(format!("{name}: it is not written to standard output. Name a file or folder"));
        }
        // The demonstration makes the folder of its page.
        let is_free = is_standard_output || command.get_name() == "demo";
        let found = if is_free { Ok(()) } else { check_writable(path, is_folder(option)) };
        found.err().map(|error| format!("{name}: {error}"))
    };
    let mut refusals = written.filter_map(refused);
    refusals.next()
}

/// The values of an argument as they were typed.
fn values<'a>(matches: &'a ArgMatches, id: &str) -> impl Iterator<Item = &'a Path> {
    let raw = matches.try_get_raw(id).ok().flatten();
    raw.into_iter().flatten().map(|value: &OsStr| Path::new(value))
}

/// The file at a path, by its only name; `None` for what is not there, a folder or a device.
fn of_file(path: &Path) -> Option<PathBuf> {
    path.is_file().then(|| path.canonicalize().ok()).flatten()
}

/// Whether an argument names a folder: by the name of its value.
fn is_folder(argument: &Arg) -> bool {
    argument.get_value_names().is_some_and(|names| names.iter().any(|name| name == "FOLDER"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arguments(command: &Command) -> Vec<Arg> {
        let own = command.get_arguments().cloned();
        own.chain(command.get_subcommands().flat_map(arguments)).collect()
    }

    /// Every argument whose help says that it is written is among them.
    #[test]
    fn all_outputs_are_known() {
        let program = crate::program();
        let all = arguments(&program);
        let is_path = |argument: &&Arg| {
            let names = argument.get_value_names().unwrap_or_default();
            names.iter().any(|name| name == "FILE" || name == "FOLDER")
        };
        let mut count = 0;
        for argument in all.iter().filter(is_path) {
            let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
            let is_written = ["Write", "Draw", "Record"].iter().any(|verb| help.starts_with(verb))
                || ["to write", "Folder for the"].iter().any(|words| help.contains(words));
            let id = argument.get_id().as_str();
            let is_known = WRITTEN.contains(&id) || KEPT.contains(&id);
            assert_eq!(is_written || KEPT.contains(&id), is_known, "{id}: {help}");
            count += usize::from(is_written);
        }
        assert!(count > 30, "{count}");
    }
}
