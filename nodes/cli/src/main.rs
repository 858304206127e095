//! `tandem`: plan gaits, simulate them, look at what happened — without ROS, DDS or a robot; and walk them with the
//! nodes.

#[macro_use]
mod output;

#[cfg(feature = "network")]
mod adapt;
mod bag;
mod doctor;
#[cfg(feature = "network")]
mod drive;
mod interrupt;
mod library;
#[cfg(feature = "network")]
mod operator_input;
mod plan;
mod progress;
mod report;
mod robot;
mod robots;
mod shell;
#[cfg(feature = "network")]
mod show;
mod simulate;
#[cfg(feature = "network")]
mod stop_button;
#[cfg(feature = "network")]
mod walk;

use clap::{CommandFactory, Parser, Subcommand};
use std::process::ExitCode;

/// Plan a quadruped's gait as two bipeds walking in tandem, and walk it in simulation.
///
/// Start here:
///
///   tandem plan amble -o amble.json      plan the paper's amble and write the gait file
///   tandem simulate amble.json           walk it in MuJoCo under the paper's PD law
///   launch-scripts/demo                  the same over ROS 2: planner, controller and simulation as nodes
#[derive(Parser)]
#[command(name = "tandem", version, about, verbatim_doc_comment, max_term_width = 110)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Plan(plan::Arguments),
    Library(library::Arguments),
    Simulate(simulate::Arguments),
    #[cfg(feature = "network")]
    Walk(walk::Arguments),
    Bag(bag::Arguments),
    Report(report::Arguments),
    #[cfg(feature = "network")]
    Show(show::Arguments),
    #[cfg(feature = "network")]
    Adapt(adapt::Arguments),
    Robot(robot::Arguments),
    Doctor(doctor::Arguments),
    #[cfg(feature = "network")]
    Drive(drive::Arguments),
    #[cfg(feature = "network")]
    StopButton(stop_button::Arguments),
    Completions(shell::CompletionsArguments),
    Man(shell::ManArguments),
}

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(refusal) => return output::answer(&refusal),
    };
    let result = match arguments.command {
        Command::Plan(a) => plan::run(&a),
        Command::Library(a) => library::run(&a),
        Command::Simulate(a) => simulate::run(&a),
        #[cfg(feature = "network")]
        Command::Walk(a) => walk::run(&a),
        Command::Bag(a) => bag::run(&a),
        Command::Report(a) => report::run(&a),
        #[cfg(feature = "network")]
        Command::Show(a) => show::run(&a),
        #[cfg(feature = "network")]
        Command::Adapt(a) => adapt::run(&a),
        Command::Robot(a) => robot::run(&a),
        Command::Doctor(a) => doctor::run(&a),
        #[cfg(feature = "network")]
        Command::Drive(a) => drive::run(&a),
        #[cfg(feature = "network")]
        Command::StopButton(a) => stop_button::run(&a),
        Command::Completions(a) => shell::completions(&a, &mut Arguments::command()),
        Command::Man(a) => shell::man(&a, Arguments::command()),
    };
    result.unwrap_or_else(|error| output::failed(&error))
}
