//! Shell completions and manual pages.

use crate::workplace::{Workplace, listed_commands};

#[test]
fn completions_of_every_shell_name_commands_and_options() {
    let at = Workplace::empty();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = at.good(&format!("completions {shell}"));
        for word in ["reconstruct", "scan-table", "baseline"] {
            assert!(script.contains(word), "{shell}: no `{word}`");
        }
    }
    assert!(at.refused("completions basic").contains("[possible values: bash"), "the shells to choose from");
}

#[test]
fn bash_accepts_its_script_and_completes_a_command() {
    let at = Workplace::empty();
    at.write("dermis.bash", at.good("completions bash"));
    let complete = "source dermis.bash; COMP_WORDS=(dermis recon); COMP_CWORD=1; _dermis dermis recon dermis; echo ${COMPREPLY[*]}";
    let Ok(output) = std::process::Command::new("bash").args(["-c", complete]).current_dir(at.folder()).output() else {
        return; // There is no bash here.
    };
    assert_eq!(String::from_utf8_lossy(&output.stdout).trim(), "reconstruct", "{output:?}");
}

#[test]
fn manual_pages_are_written_for_the_program_and_every_command() {
    let at = Workplace::empty();
    let page = at.good("man");
    assert!(page.contains(".TH dermis 1") && page.contains("Exit codes"), "{page}");
    at.good("man -o pages/man1");
    let program = std::fs::read_to_string(at.path("pages/man1/dermis.1")).unwrap();
    assert_eq!(program, page);
    let command = std::fs::read_to_string(at.path("pages/man1/dermis-reconstruct.1")).unwrap();
    assert!(command.contains("\\-\\-baseline") && command.contains("dermis reconstruct"), "{command}");
    let pages = std::fs::read_dir(at.path("pages/man1")).unwrap().count();
    let help = at.good("--help");
    let commands = listed_commands(&help).len();
    assert_eq!(pages, commands + 1, "a page for the program and for every command that its help lists");
    at.write("file", "");
    assert!(at.refused("man -o file/pages").contains("file/pages"));
}
