//! `tandem`: the whole stack behind one command. One module per subcommand, nothing clever.

// First: its macros stand in for the ones of std in all modules that follow.
#[macro_use]
mod speaking;

mod bench;
mod configuration;
mod demo;
mod doctor;
mod estop;
mod forecast;
mod gate;
mod interrupt;
mod keys;
mod nodes;
mod parts;
mod replay;
mod router;
mod session;
mod shipped;
mod status;
mod summary;
mod sweep;
mod table;
mod train;
mod trial;
mod trial_report;
mod verify;
mod what_if;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use tandem_link::LinkError;

use crate::configuration::CommonFlags;

/// The program's version, the revision it was built from, and the hash of the bytes that messages are pinned to.
pub(crate) const BUILD: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    " (",
    env!("TANDEM_REVISION"),
    ", wire ",
    env!("TANDEM_WIRE"),
    ")"
);

/// Shared control of a robot arm: a human and a forecast, blended by confidence.
#[derive(Parser)]
#[command(name = "tandem", version = BUILD)]
struct Arguments {
    #[command(subcommand)]
    command: Subcommands,
}

#[derive(Subcommand)]
enum Subcommands {
    /// Runs the whole loop in this process: a simulated human and CESN+ steer a Panda around two obstacles.
    Demo(demo::DemoFlags),
    /// Stops a robot at once, whoever drives it; --clear lets it go again.
    Estop(estop::EstopFlags),
    /// Runs the operator's node: where commands come from.
    Operator(nodes::OperatorFlags),
    /// Runs the predictor's node: what the robot would do, and how sure it is.
    Predictor(nodes::PredictorFlags),
    /// Runs the arbiter's node: who drives.
    Arbiter(nodes::ArbiterFlags),
    /// Runs the simulated robot's node.
    RobotSim(nodes::RobotSimFlags),
    /// Runs the recorder's node: session file and live view.
    Recorder(nodes::RecorderFlags),
    /// Shows every robot of the network: who is there, who drives, rates, latency, drops, why one stands.
    Status(status::StatusFlags),
    /// Looks into everything that keeps a session from working, and says what to do.
    Doctor(doctor::DoctorFlags),
    /// Carries messages between all who dial it, where no node shall listen.
    Router(router::RouterFlags),
    /// Makes and manages certificates: who belongs to a site, and may do what.
    Keys {
        #[command(subcommand)]
        command: keys::KeysCommands,
    },
    /// Plays a recorded session, into Rerun or onto the network under another name.
    Replay(replay::ReplayFlags),
    /// Lets the human of a recorded session meet another law or model.
    WhatIf(what_if::WhatIfFlags),
    /// Works with session files.
    Session {
        #[command(subcommand)]
        command: session::SessionCommands,
    },
    /// Plans and runs experiments.
    Trial {
        #[command(subcommand)]
        command: trial::TrialCommands,
    },
    /// Trains a model from demonstrations.
    Train(train::TrainFlags),
    /// Prints a model's forecast for a context.
    Forecast(forecast::ForecastFlags),
    /// Measures latency and load on this machine, over loopback.
    Bench {
        #[command(subcommand)]
        command: bench::BenchCommands,
    },
    /// Works with the configuration.
    Config {
        #[command(subcommand)]
        command: ConfigCommands,
    },
}

#[derive(Subcommand)]
enum ConfigCommands {
    /// Prints the effective configuration with an explanation of every key.
    Show(CommonFlags),
}

/// How a command ended, as its exit code promises.
pub(crate) enum Outcome {
    /// 0: done.
    Done,
    /// 1: it ran, but did not do what it was for; the output says why.
    Failed,
    /// 3: done, but samples were lost on the way to the file.
    SamplesLost,
    /// 3: nothing wrong was found, but not everything could be looked at.
    Incomplete,
}

fn main() -> ExitCode {
    set_zenoh_threads();
    let code = run();
    if speaking::kept() {
        code
    } else {
        eprintln!("tandem: the output could not be written whole");
        ExitCode::from(1)
    }
}

/// Zenoh reads how many threads it shall have from the environment, when the first session opens, and nowhere else. What the
/// user has set stays.
#[expect(
    unsafe_code,
    reason = "the environment is Zenoh's only door for this, and no thread runs yet that could read it"
)]
fn set_zenoh_threads() {
    let (name, value) = tandem_link::net::ZENOH_THREADS;
    if std::env::var_os(name).is_none() {
        // SAFETY: the first thing that `main` does; the process has one thread.
        unsafe { std::env::set_var(name, value) };
    }
}

fn run() -> ExitCode {
    let result = match Arguments::parse().command {
        Subcommands::Demo(flags) => demo::run(&flags),
        Subcommands::Estop(flags) => estop::run(&flags),
        Subcommands::Operator(flags) => nodes::operator(&flags),
        Subcommands::Predictor(flags) => nodes::predictor(&flags),
        Subcommands::Arbiter(flags) => nodes::arbiter(&flags),
        Subcommands::RobotSim(flags) => nodes::robot_sim(&flags),
        Subcommands::Recorder(flags) => nodes::recorder(&flags),
        Subcommands::Status(flags) => status::run(&flags),
        Subcommands::Doctor(flags) => doctor::run(&flags),
        Subcommands::Router(flags) => router::run(&flags),
        Subcommands::Keys { command } => keys::run(&command),
        Subcommands::Replay(flags) => replay::run(&flags),
        Subcommands::WhatIf(flags) => what_if::run(&flags),
        Subcommands::Session { command } => session::run(&command),
        Subcommands::Trial { command } => trial::run(&command),
        Subcommands::Bench { command } => bench::run(&command),
        Subcommands::Train(flags) => train::run(&flags),
        Subcommands::Forecast(flags) => forecast::run(&flags),
        Subcommands::Config {
            command: ConfigCommands::Show(flags),
        } => configuration::print(&flags),
    };
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Failed) => ExitCode::from(1),
        Ok(Outcome::SamplesLost | Outcome::Incomplete) => ExitCode::from(3),
        Err(error) => {
            eprintln!("tandem: {error:#}");
            let bad_usage = error.is::<configuration::BadConfiguration>()
                || error.is::<trial_report::BadRequest>()
                || error.downcast_ref::<LinkError>().is_some_and(LinkError::is_bad_usage);
            ExitCode::from(if bad_usage { 2 } else { 1 })
        }
    }
}
