//! `dermis completions` and `dermis man`: shell completions and manual pages.

use crate::console::print;
use crate::failure::{Failure, Outcome};
use clap::{Args, Command};
use clap_complete::Shell;
use clap_mangen::Man;
use dermis::frame::write_whole;
use std::path::PathBuf;

/// The arguments of `dermis completions`.
#[derive(Debug, Args)]
pub struct CompletionArguments {
    /// Shell to complete in.
    shell: Shell,
}

impl CompletionArguments {
    /// Prints the script.
    pub fn run(self) -> Outcome {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut crate::program(), "dermis", &mut script);
        print(&String::from_utf8_lossy(&script))
    }
}

/// The arguments of `dermis man`.
#[derive(Debug, Args)]
pub struct ManArguments {
    /// Folder for the pages of the program and of every command; without it the program's page is printed.
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

impl ManArguments {
    /// Prints or writes the pages.
    pub fn run(self) -> Outcome {
        let mut program = crate::program().disable_help_subcommand(true);
        program.build();
        let Some(folder) = self.output else {
            return print(&String::from_utf8_lossy(&page(program)?));
        };
        let cannot = |error| Failure::given(format!("{}: {error}", folder.display()), None);
        std::fs::create_dir_all(&folder).map_err(cannot)?;
        for command in program.get_subcommands().cloned().chain([program.clone()]) {
            // The built name of a command: `dermis-mesh` for `dermis mesh`.
            let name = command.get_display_name().unwrap_or("dermis").to_string();
            let page = page(command)?;
            write_whole(&folder.join(format!("{name}.1")), |out| out.write_all(&page))?;
        }
        Ok(())
    }
}

/// A page, as `man` reads it.
fn page(command: Command) -> Outcome<Vec<u8>> {
    let mut page = Vec::new();
    Man::new(command).render(&mut page).map_err(|error| Failure::Ours(error.to_string()))?;
    Ok(page)
}
