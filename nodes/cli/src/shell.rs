//! What shells and `man` know of the commands: written from the commands themselves.

use crate::output;
use anyhow::{Context, Result};
use clap::Command;
use clap_complete::Shell;
use std::path::PathBuf;
use std::process::ExitCode;

/// Print completions for a shell
///
/// launch-scripts/install-ros installs them.
///
///   tandem completions bash > tandem.bash
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct CompletionsArguments {
    /// The shell
    shell: Shell,
}

/// Write manual pages, one for each command
///
/// launch-scripts/install-ros installs them.
///
///   tandem man man1
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct ManArguments {
    /// Folder for the pages
    #[arg(value_parser = output::folder)]
    folder: PathBuf,
}

/// Runs the subcommand.
pub fn completions(arguments: &CompletionsArguments, command: &mut Command) -> Result<ExitCode> {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell, command, "tandem", &mut text);
    output::part(format_args!("{}", String::from_utf8(text).context("completions are text")?))?;
    Ok(ExitCode::SUCCESS)
}

/// Runs the subcommand.
pub fn man(arguments: &ManArguments, mut command: Command) -> Result<ExitCode> {
    let folder = &arguments.folder;
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    // Gives every command its whole name, such as tandem-bag-info.
    command.build();
    let mut waiting = vec![command];
    let mut pages = 0;
    while let Some(command) = waiting.pop() {
        waiting.extend(command.get_subcommands().filter(|command| command.get_name() != "help").cloned());
        let name = command.get_display_name().unwrap_or(command.get_name()).to_owned();
        let mut page = Vec::new();
        clap_mangen::Man::new(command).render(&mut page).context("a page cannot be made")?;
        output::write_file(&folder.join(format!("{name}.1")), &page)?;
        pages += 1;
    }
    say!("{}: {pages} pages", folder.display())?;
    Ok(ExitCode::SUCCESS)
}
