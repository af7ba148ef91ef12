//! `tandem replay --drive`: a live robot along the recorded path, with a person's hand on the deadman.
//!
//! The only place of a replay from which anything is commanded. It runs an operator like any other, with its own
//! session, whose hand is moved by the [`Driver`]: arbiter and robot check it as they check everybody.

mod grip;

use std::io;
use std::time::{Duration, Instant};

use anyhow::bail;
use crossbeam_channel::{Receiver, TryRecvError};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;
use tandem_link::{Clock, Link, Observer, Player, Reach, Running, Sighting};
use tandem_operator::keyboard::{KeyboardError, RawTerminal};
use tandem_operator::{PlayedSample, SAMPLE_PERIOD};
use tandem_recorder::{Recorded, Recording};
use tandem_site::Role;
use tandem_trials::drive::{Driver, End, Phase, Track};
use tandem_wire::{Nanos, NodeName, Pace, SECOND, Stamp, State, Topic, Trial, decode, seconds};

use super::keyboard::Keyboard;
use super::player::Speed;
use super::{ReplayFlags, target};
use crate::configuration::BadConfiguration;
use crate::parts::Parts;
use crate::trial::TrialMarks;
use crate::{Outcome, nodes};
use grip::{DriveKey, Grip};

/// How a drive ended.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Ending {
    /// By itself.
    Ended(End),
    /// The person left.
    Left,
}

/// Drives along the states among `messages`.
pub(super) fn run(
    flags: &ReplayFlags,
    recording: &Recording,
    messages: &[&Recorded],
    interrupted: &Receiver<()>,
) -> anyhow::Result<Outcome> {
    let per_mille = per_mille(flags.speed)?;
    let replayed = [("operator.source", "replayed".to_owned())];
    let configuration = flags.node.configuration(&replayed)?;
    if configuration.rates.timing().pace == Pace::Lockstep {
        let why = "a robot is driven in real time: loop.pace = \"max\" cannot be used with --drive".to_owned();
        return Err(BadConfiguration::Conflict(why).into());
    }
    let track = Track::recorded(messages.iter().copied())?;
    let terminal = terminal()?;
    introduce(&track, recording, &configuration.link.robot, &terminal);
    let grip = Grip::new(terminal.tells_releases());
    let keyboard = Keyboard::listen(terminal, grip);
    let settings = configuration.replay.clone();
    let parts = Parts::new(configuration, None)?;
    let reach = Reach::new(parts.link_settings(), Some(Role::Operator))?;
    let Some(link) = nodes::connect(parts.link_settings(), &reach, || hung_up(&keyboard, interrupted))? else {
        return Ok(Outcome::Failed);
    };
    let mut driver = Driver::new(track, settings, per_mille, Clock::of_process().now());
    let mut screen = Screen::new(&driver);
    let ending = drive(
        &parts,
        &link,
        &mut driver,
        keyboard.keys(),
        interrupted,
        &mut |driver| screen.show(driver),
    );
    screen.bar.finish_and_clear();
    drop(keyboard);
    link.close();
    report(&driver, ending?, flags.json)
}

/// A robot goes no faster than it went.
fn per_mille(speed: Option<Speed>) -> Result<u32, BadConfiguration> {
    match speed {
        None => Ok(1000),
        Some(Speed::PerMille(speed)) if speed <= 1000 => Ok(speed),
        Some(_) => {
            let why = "a robot is driven at most at the recorded speed: use --speed 0.1 to 1 with --drive".to_owned();
            Err(BadConfiguration::Conflict(why))
        }
    }
}

/// A person's terminal. Its standard output may be a file: what is shown goes to standard error.
fn terminal() -> anyhow::Result<RawTerminal<io::Stderr>> {
    RawTerminal::open_to_hold(io::stderr()).map_err(|error| match error {
        KeyboardError::NotATerminal => {
            let why = "--drive needs a terminal: somebody must hold the deadman".to_owned();
            BadConfiguration::Conflict(why).into()
        }
        KeyboardError::Terminal { .. } => error.into(),
    })
}

/// What the person does next, or nothing yet.
fn next_key(keys: &Receiver<DriveKey>) -> anyhow::Result<Option<DriveKey>> {
    match keys.try_recv() {
        Ok(key) => Ok(Some(key)),
        Err(TryRecvError::Empty) => Ok(None),
        Err(TryRecvError::Disconnected) => bail!("the terminal has gone, and nobody holds the deadman any more"),
    }
}

fn hung_up(keyboard: &Keyboard<DriveKey>, interrupted: &Receiver<()>) -> bool {
    let mut has_left = interrupted.try_recv().is_ok();
    while !has_left {
        match next_key(keyboard.keys()) {
            Ok(None) => break,
            Ok(Some(DriveKey::Quit)) | Err(_) => has_left = true,
            Ok(Some(DriveKey::Wish(_))) => {}
        }
    }
    has_left
}

fn introduce(track: &Track, recording: &Recording, robot: &str, terminal: &RawTerminal<io::Stderr>) {
    let of = recording.robot.as_ref().map_or("unknown", |robot| robot.as_str());
    eprintln!(
        "replay: {:.1} s of {of}'s path are ready to be driven with {robot}\r",
        seconds(track.duration())
    );
    if track.broken().is_some() {
        eprintln!(
            "replay: the recording goes on elsewhere after that, as when a trial begins; use --from to drive the rest\r"
        );
    }
    eprint!("{}\r\n{}", grip::HELP, terminal.how_keys_count());
}

/// Runs an operator whose hand the driver moves, until either ends or the person leaves.
fn drive(
    parts: &Parts,
    link: &Link,
    driver: &mut Driver,
    keys: &Receiver<DriveKey>,
    interrupted: &Receiver<()>,
    show: &mut dyn FnMut(&Driver),
) -> anyhow::Result<Ending> {
    // A replay under its name would tell us where that robot's tool was, not where this one's is.
    if Player::playing(link)? > 0 {
        bail!(
            "a replay plays as {:?}, which would be taken for the robot itself: end that one first",
            link.robot().as_str()
        );
    }
    if target::present(link)?.contains(&NodeName::Operator) {
        bail!(
            "an operator is alive on {:?}, and only one may command it: end that one first",
            link.robot().as_str()
        );
    }
    let observer = Observer::new(link, Pace::Real)?;
    let operator = parts.operator(link, |_| {})?;
    let mut stage = Stage::new(link);
    let ending = steer(&operator, &observer, &mut stage, driver, keys, interrupted, show);
    let marked = stage.end(&ending);
    // Whatever went wrong, the operator says goodbye with the deadman released.
    operator.stop();
    if operator.join().is_none() {
        bail!("the operator panicked: please report this with the session file");
    }
    marked?;
    ending
}

/// The trial in which it is driven: motion belongs to one. If none runs, one is begun, which puts a simulated arm at its
/// start, and ended again.
struct Stage {
    marks: TrialMarks,
    said: Option<Stamp>,
}

/// How often the beginning is said again, until the robot has heard it.
const REPEAT: Nanos = SECOND;

impl Stage {
    fn new(link: &Link) -> Self {
        Self {
            marks: TrialMarks::new(link.clone()),
            said: None,
        }
    }

    /// Whether a trial runs; begins one otherwise.
    fn is_set(&mut self, now: Stamp, state: &State) -> anyhow::Result<bool> {
        let is_due = self.said.is_none_or(|said| now.since(said) >= REPEAT);
        if state.trial == 0 && is_due {
            self.said = Some(now);
            self.marks.mark(Trial::Begin {
                number: 1,
                label: "replay".to_owned(),
            })?;
        }
        Ok(state.trial != 0)
    }

    fn end(&mut self, ending: &anyhow::Result<Ending>) -> anyhow::Result<()> {
        if self.said.is_none() {
            return Ok(());
        }
        let outcome = match ending {
            Ok(Ending::Ended(end)) => end.to_string(),
            Ok(Ending::Left) => "left before the end of the path".to_owned(),
            Err(why) => why.to_string(),
        };
        self.marks.mark(Trial::End { number: 1, outcome })
    }
}

fn steer(
    operator: &Running,
    observer: &Observer,
    stage: &mut Stage,
    driver: &mut Driver,
    keys: &Receiver<DriveKey>,
    interrupted: &Receiver<()>,
    show: &mut dyn FnMut(&Driver),
) -> anyhow::Result<Ending> {
    let clock = Clock::of_process();
    let device = operator.device();
    let mut due = clock.now();
    loop {
        if operator.is_finished() {
            bail!("the operator ended by itself");
        }
        while let Some(key) = next_key(keys)? {
            match key {
                DriveKey::Quit => return Ok(Ending::Left),
                DriveKey::Wish(wish) => driver.wish(clock.now(), wish),
            }
            due = clock.now();
        }
        if interrupted.try_recv().is_ok() {
            return Ok(Ending::Left);
        }
        let now = clock.now();
        if now >= due {
            due = now.after(SAMPLE_PERIOD);
            let hand = driver.step(now);
            let sample = PlayedSample {
                held: hand.held,
                presses: hand.presses,
                velocity: hand.velocity,
            };
            // A full queue drops the sample; the node counts a silent device as released.
            let _ = device.send(sample.to_bytes());
            show(driver);
        }
        if let Phase::Ended(end) = driver.phase() {
            return Ok(Ending::Ended(end));
        }
        let wait = clock.instant(due).saturating_duration_since(Instant::now());
        if let Some(Sighting::Sample {
            topic: Topic::State,
            bytes,
            ..
        }) = observer.next(wait.min(Duration::from_millis(20)))
            && let Ok(state) = decode::<State>(&bytes)
        {
            let is_set = driver.phase() != Phase::Looking || stage.is_set(clock.now(), &state.body)?;
            if is_set {
                driver.see(clock.now(), &state);
            }
        }
    }
}

struct Screen {
    bar: ProgressBar,
    said: String,
}

impl Screen {
    fn new(driver: &Driver) -> Self {
        let bar = ProgressBar::new(driver.track().duration() / 1_000_000);
        let style = ProgressStyle::with_template("{bar:40} {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        let said = String::new();
        Self { bar, said }
    }

    fn show(&mut self, driver: &Driver) {
        let (at, all) = (seconds(driver.position()), seconds(driver.track().duration()));
        self.bar.set_position(driver.position() / 1_000_000);
        self.bar
            .set_message(format!("{at:.1} of {all:.1} s  {}", driver.phase()));
        // A stop stays to be read.
        if let Phase::Waiting(pause) = driver.phase() {
            let said = pause.to_string();
            if said != self.said {
                self.bar.suspend(|| eprintln!("replay: {said}\r"));
                self.said = said;
            }
        } else {
            self.said.clear();
        }
    }
}

fn report(driver: &Driver, ending: Ending, as_json: bool) -> anyhow::Result<Outcome> {
    let (deviation, all) = (driver.deviation(), driver.track().duration());
    if as_json {
        let millimetres = |metres: f64| metres * 1e3;
        println!(
            "{}",
            json!({
                "arrived": ending == Ending::Ended(End::Arrived),
                "driven_s": seconds(driver.position()),
                "path_s": seconds(all),
                "off_path_mean_mm": deviation.mean().map(millimetres),
                "off_path_max_mm": deviation.mean().map(|_| millimetres(deviation.largest)),
                "off_in_time_max_mm": deviation.mean().map(|_| millimetres(deviation.largest_in_time)),
            })
        );
    } else if let Some(mean) = deviation.mean() {
        eprintln!(
            "replay: {:.1} of {:.1} s driven; the tool was off the path by {:.1} mm on average and {:.1} mm at most, and \
             by {:.1} mm at most from where the recording had it at that moment",
            seconds(driver.position()),
            seconds(all),
            mean * 1e3,
            deviation.largest * 1e3,
            deviation.largest_in_time * 1e3
        );
    }
    match ending {
        Ending::Ended(End::Arrived) => Ok(Outcome::Done),
        Ending::Ended(end) => bail!("{end}"),
        Ending::Left => {
            eprintln!("replay: left before the end of the path");
            Ok(Outcome::Failed)
        }
    }
}

#[cfg(test)]
mod tests;
