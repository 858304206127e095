//! `tandem`: plan gaits, simulate them, look at what happened — without ROS, DDS or a robot; and walk them with the nodes.

mod bag;
mod doctor;
mod library;
mod plan;
mod report;
mod robot;
mod robots;
mod show;
mod simulate;
mod stop_button;
mod walk;

use clap::{Parser, Subcommand};
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
    Walk(walk::Arguments),
    Bag(bag::Arguments),
    Report(report::Arguments),
    Show(show::Arguments),
    Robot(robot::Arguments),
    Doctor(doctor::Arguments),
    StopButton(stop_button::Arguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let result = match arguments.command {
        Command::Plan(a) => plan::run(&a),
        Command::Library(a) => library::run(&a),
        Command::Simulate(a) => simulate::run(&a),
        Command::Walk(a) => walk::run(&a),
        Command::Bag(a) => bag::run(&a),
        Command::Report(a) => report::run(&a),
        Command::Show(a) => show::run(&a),
        Command::Robot(a) => robot::run(&a),
        Command::Doctor(a) => doctor::run(&a),
        Command::StopButton(a) => stop_button::run(&a),
    };
    match result {
        Ok(code) => code,
        Err(e) => {
            // It may repeat what others answered; one line, whatever stands in it.
            eprintln!("tandem: {}", tandem_msgs::text::printable(&format!("{e:#}"), 4000));
            ExitCode::FAILURE
        }
    }
}
