//! `tandem estop`: stops a robot at once, whoever drives it, and on purpose lets it go again.

use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use clap::Args;
use serde_json::json;
use tandem_link::{Clock, Link, LinkSettings, Observer, Reach, Sighting, fresh_session};
use tandem_site::Role;
use tandem_wire::{
    Emergency, Label, MessageId, Motion, Numbering, Pace, Reason, Session, Setpoint, State, Topic, decode, encode,
};

use crate::Outcome;
use crate::nodes::{self, NodeFlags};

/// How long the network may take to answer a dial.
const DIAL: Duration = Duration::from_secs(5);
/// How long robot and arbiter may take to acknowledge, and the arm to come to rest.
const PATIENCE: Duration = Duration::from_secs(3);
/// How often it is said again until it is acknowledged.
const REPEAT: Duration = Duration::from_millis(50);
/// So long the arbiter is waited for once the robot has acknowledged: it is the robot that stops.
const ARBITER: Duration = Duration::from_millis(500);

#[derive(Args)]
pub(crate) struct EstopFlags {
    /// Clears the emergency stop that is in force. The operator then has to press afresh.
    #[arg(long)]
    clear: bool,
    /// Who stops or clears, for others to read; at most 24 bytes.
    #[arg(long, value_name = "NAME", default_value = "tandem estop")]
    by: String,
    /// Prints the outcome as one JSON object.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    node: NodeFlags,
}

pub(crate) fn run(flags: &EstopFlags) -> anyhow::Result<Outcome> {
    let settings = nodes::as_tool(&flags.node.configuration(&[])?.link);
    // Anybody may stop; who may let go again is an operator.
    let role = flags.clear.then_some(Role::Operator);
    let link = dial(&settings, role).context(if flags.clear { "NOT CLEARED" } else { "NOT STOPPED" })?;
    let session = fresh_session();
    let mut scene = Scene {
        observer: Observer::of_topics(&link, Pace::Real, &[Topic::State, Topic::Setpoint])?,
        numbering: Numbering::new(session),
        robot: Witness::default(),
        arbiter: Witness::default(),
        at_rest: false,
        began: Instant::now(),
        link: &link,
    };
    let by = Label::new(&flags.by);
    let told = if flags.clear {
        scene.clear(by)
    } else {
        scene.stop(by, session)
    };
    link.close();
    let told = told?;
    if flags.json {
        println!("{}", told.json);
    } else {
        println!("{}", told.text);
    }
    Ok(told.outcome)
}

/// Dials, but not for ever: whoever wants to stop must know soon that nobody hears it.
fn dial(settings: &LinkSettings, role: Option<Role>) -> anyhow::Result<Link> {
    let reach = Reach::new(settings, role)?;
    let link = nodes::connect_within(DIAL, settings, &reach, || false)?;
    Ok(link.expect("nobody gives up but for the limit, which is an error"))
}

/// What somebody last said about motion.
#[derive(Clone, Copy, Default)]
struct Witness {
    motion: Option<Motion>,
    /// When it first told of what is waited for.
    after: Option<Duration>,
}

impl Witness {
    fn stop(&self) -> Option<(MessageId, Label)> {
        match self.motion {
            Some(Motion::Held(Reason::EmergencyStop { stop, by })) => Some((stop, by)),
            _ => None,
        }
    }

    fn is_free(&self) -> bool {
        self.motion.is_some() && self.stop().is_none()
    }
}

struct Told {
    text: String,
    json: serde_json::Value,
    outcome: Outcome,
}

struct Scene<'a> {
    link: &'a Link,
    observer: Observer,
    numbering: Numbering,
    robot: Witness,
    arbiter: Witness,
    at_rest: bool,
    began: Instant,
}

impl Scene<'_> {
    fn say(&mut self, emergency: Emergency) -> anyhow::Result<()> {
        let mut bytes = Vec::new();
        encode(
            &self.numbering.envelope(Clock::of_process().now(), 0, emergency),
            &mut bytes,
        );
        Ok(self.link.publish(emergency.topic(), bytes)?)
    }

    /// Looks at what is said for a while, noting when `is_so` first holds of robot and arbiter.
    fn look(&mut self, limit: Duration, is_so: impl Fn(&Witness) -> bool) {
        let end = Instant::now() + limit;
        while let Some(sighting) = self.observer.next(end.saturating_duration_since(Instant::now())) {
            let Sighting::Sample { topic, bytes, .. } = sighting else {
                continue;
            };
            let witness = match topic {
                Topic::State => decode::<State>(&bytes).ok().map(|state| {
                    self.at_rest = state.body.at_rest;
                    self.robot.motion = Some(state.body.motion);
                    &mut self.robot
                }),
                Topic::Setpoint => decode::<Setpoint>(&bytes).ok().map(|setpoint| {
                    self.arbiter.motion = Some(setpoint.body.motion);
                    &mut self.arbiter
                }),
                _ => None,
            };
            if let Some(witness) = witness {
                witness.after = match witness.after {
                    _ if !is_so(witness) => None,
                    None => Some(self.began.elapsed()),
                    known => known,
                };
            }
            if Instant::now() >= end {
                return;
            }
        }
    }

    /// Says it again and again until robot and arbiter have answered, or patience ends.
    fn insist(&mut self, emergency: Emergency, is_so: impl Fn(&Witness) -> bool + Copy) -> anyhow::Result<()> {
        self.began = Instant::now();
        (self.robot.after, self.arbiter.after) = (None, None);
        while self.began.elapsed() < PATIENCE {
            let heard_by_all = self.robot.after.is_some() && self.arbiter.after.is_some();
            if !heard_by_all {
                self.say(emergency)?;
            }
            self.look(REPEAT, is_so);
            let robot = self
                .robot
                .after
                .is_some_and(|after| heard_by_all || self.began.elapsed() > after + ARBITER);
            if robot && self.at_rest {
                return Ok(());
            }
        }
        Ok(())
    }

    fn stop(&mut self, by: Label, session: Session) -> anyhow::Result<Told> {
        let mine = move |witness: &Witness| witness.stop().is_some_and(|(stop, _)| stop.session == session);
        self.insist(Emergency::Stop { by }, mine)?;
        let robot = self.link.robot();
        let Some(after) = self.robot.after else {
            bail!("NOT ACKNOWLEDGED by {robot}: no state of it says that it has stopped within 3 s; use another way");
        };
        let rest = if self.at_rest { "at rest" } else { "STILL MOVING" };
        Ok(Told {
            text: format!(
                "{robot}: stopped, {rest}; acknowledged by the robot after {}, by the arbiter {}\n\
                 it stays so until: tandem estop --clear",
                millis(Some(after)),
                millis(self.arbiter.after),
            ),
            json: json!({
                "stopped": true, "at_rest": self.at_rest,
                "robot_ms": as_millis(Some(after)), "arbiter_ms": as_millis(self.arbiter.after),
            }),
            outcome: if self.at_rest { Outcome::Done } else { Outcome::Failed },
        })
    }

    fn clear(&mut self, by: Label) -> anyhow::Result<Told> {
        let limit = Instant::now() + PATIENCE;
        while self.robot.motion.is_none() && Instant::now() < limit {
            self.look(REPEAT, Witness::is_free);
        }
        let robot = self.link.robot();
        if self.robot.motion.is_none() {
            bail!("{robot} does not publish its state, so nobody can tell whether it is stopped");
        }
        let Some((stop, stopped_by)) = self.robot.stop().or_else(|| self.arbiter.stop()) else {
            return Ok(Told {
                text: format!("{robot}: no emergency stop is in force"),
                json: json!({ "cleared": false, "in_force": false }),
                outcome: Outcome::Done,
            });
        };
        self.insist(Emergency::Clear { stop, by }, Witness::is_free)?;
        if let Some((_, by)) = self.robot.stop() {
            bail!("NOT CLEARED: {robot} is still stopped, by {by}; if that is another stop, clear it in turn");
        }
        Ok(Told {
            text: format!("{robot}: the emergency stop by {stopped_by} is cleared; motion needs a fresh press"),
            json: json!({ "cleared": true, "in_force": false, "stopped_by": stopped_by.to_string() }),
            outcome: Outcome::Done,
        })
    }
}

fn as_millis(after: Option<Duration>) -> Option<f64> {
    after.map(|after| after.as_secs_f64() * 1e3)
}

fn millis(after: Option<Duration>) -> String {
    as_millis(after).map_or("NOT".into(), |millis| format!("{millis:.0} ms"))
}
