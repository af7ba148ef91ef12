//! The operator's part in an emergency stop: it calls until it is heard, and keeps one for a robot that is started anew.

use bincode::{Decode, Encode};
use tandem_wire::{Motion, Reason, Session};

use crate::sight::Seen;

/// Whether an emergency stop has to be said, and which robot was last seen to obey one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Encode, Decode)]
pub(crate) struct Alarm {
    /// No state has told of our own stop yet.
    calls: bool,
    /// The robot's run that last told of a stop in force, whoever's it was.
    in_force: Option<Session>,
}

impl Alarm {
    /// Somebody pressed here.
    pub(crate) const fn press(&mut self) {
        self.calls = true;
    }

    /// Whether it has to be said (again). However long the line is down, for that may be why somebody stops.
    pub(crate) const fn calls(&self) -> bool {
        self.calls
    }

    /// Looks at a state. Only our own stop counts as heard, for another one may be cleared while ours never came through.
    /// Robot and arbiter keep a stop for each other; if both were started anew, it is called again in our name.
    pub(crate) fn see(&mut self, own: Session, seen: &Seen) {
        match seen.motion {
            Motion::Held(Reason::EmergencyStop { stop, .. }) => {
                self.in_force = Some(seen.id.session);
                self.calls &= stop.session != own;
            }
            // It has heard no arbiter yet, and that one may know.
            Motion::Held(Reason::NoSetpointYet) => {}
            Motion::Held(_) | Motion::Permitted { .. } => {
                let obeyed = self.in_force.take();
                self.calls |= obeyed.is_some_and(|robot| robot != seen.id.session);
            }
        }
    }
}
