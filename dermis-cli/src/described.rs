//! The commands and their arguments as data, for programs that call them.

use clap::{Arg, ArgAction, Command};
use serde::Serialize;

/// A command of the program.
#[derive(Debug, Clone, Serialize)]
pub struct DescribedCommand {
    /// Its name, as on the command line; two words as in `robot check`.
    pub name: String,
    /// What it does.
    pub about: String,
    /// Its arguments in the order of its help.
    pub arguments: Vec<DescribedArgument>,
}

/// An argument of a command.
#[derive(Debug, Clone, Serialize)]
pub struct DescribedArgument {
    /// The name of an option without its hyphens, or of a positional argument.
    pub name: String,
    /// Whether it has no option's name on the command line.
    pub is_positional: bool,
    /// Whether the command needs it.
    pub is_required: bool,
    /// The values that it takes: `none`, `one`, `optional` (none or one), `several`, or `repeated` (one each time that it
    /// is given).
    pub takes: &'static str,
    /// Its help.
    pub help: String,
    /// The value without it, as on the command line; empty if there is none.
    pub default: String,
    /// The only values that it takes; empty if there are others.
    pub choices: Vec<String>,
}

impl DescribedCommand {
    /// A command, or each of its own commands, as in `robot check`.
    pub(crate) fn all_of(command: &Command) -> Vec<Self> {
        let mut own = command.get_subcommands().filter(|own| own.get_name() != "help").peekable();
        if own.peek().is_none() {
            return vec![Self::of(command)];
        }
        let named = |own: &Command| {
            let described = Self::of(own);
            DescribedCommand { name: format!("{} {}", command.get_name(), described.name), ..described }
        };
        own.map(named).collect()
    }

    fn of(command: &Command) -> Self {
        let is_help = |argument: &Arg| matches!(argument.get_action(), ArgAction::Help | ArgAction::HelpLong);
        let is_own = |argument: &&Arg| !is_help(argument) && !argument.is_global_set();
        DescribedCommand {
            name: command.get_name().to_string(),
            about: command.get_about().map(ToString::to_string).unwrap_or_default(),
            arguments: command.get_arguments().filter(is_own).map(DescribedArgument::of).collect(),
        }
    }
}

impl DescribedArgument {
    fn of(argument: &Arg) -> Self {
        let choices = if argument.get_action().takes_values() { argument.get_possible_values() } else { Vec::new() };
        let defaults = if argument.is_hide_default_value_set() { &[] } else { argument.get_default_values() };
        let default: Vec<_> = defaults.iter().map(|value| value.to_string_lossy()).collect();
        DescribedArgument {
            name: argument.get_long().unwrap_or(argument.get_id().as_str()).to_string(),
            is_positional: argument.is_positional(),
            is_required: argument.is_required_set(),
            takes: takes(argument),
            help: argument.get_help().map(ToString::to_string).unwrap_or_default(),
            default: if argument.get_action().takes_values() { default.join(" ") } else { String::new() },
            choices: choices.iter().map(|value| value.get_name().to_string()).collect(),
        }
    }
}

fn takes(argument: &Arg) -> &'static str {
    match (argument.get_action(), argument.get_num_args()) {
        (action, _) if !action.takes_values() => "none",
        (_, Some(values)) if values.max_values() > 1 => "several",
        (_, Some(values)) if values.min_values() == 0 => "optional",
        (ArgAction::Append, _) => "repeated",
        _ => "one",
    }
}
