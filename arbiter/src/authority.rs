//! Who is in charge: the states, and the legal moves between them.

use std::mem::discriminant;

use bincode::{Decode, Encode};
use tandem_wire::{Deadman, Malformed, Memory, Motion, Rearm, Reason, Remember};

/// Who is in charge.
///
/// ```text
///             fresh press             a forecast's guidance
///   Held(why) ───────────▶ Human(press) ──────────────────▶ Shared(press)
///       ▲                   │     ▲                           │   │
///       └─ release or loss ─┘     └─ proposals lost ──────────┘   │
///       └──────────────────────── release or loss ────────────────┘
///   any of them ── stop ──▶ Closed
/// ```
///
/// There is no move from `Held` to `Shared`: whoever presses first drives alone for as long as it takes to look
/// whether there is guidance, which is part of the same decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum Authority {
    /// Nobody: motion is held.
    Held(Reason),
    /// The human alone, by this press of the deadman.
    Human {
        /// Which press permits motion.
        press: u32,
    },
    /// Human and robot together.
    Shared {
        /// Which press permits motion.
        press: u32,
    },
    /// The arbiter is shutting down and answers no more.
    Closed,
}

impl Authority {
    /// What the setpoint says about motion.
    #[must_use]
    pub const fn motion(self) -> Motion {
        match self {
            Self::Held(reason) => Motion::Held(reason),
            Self::Human { press } | Self::Shared { press } => Motion::Permitted { press },
            Self::Closed => Motion::Held(Reason::ShuttingDown),
        }
    }
}

/// The authority and the memory of presses that its moves depend on. Only this file moves either.
#[derive(Clone, Debug)]
pub(crate) struct Helm {
    authority: Authority,
    rearm: Rearm,
}

impl Helm {
    pub(crate) fn new() -> Self {
        Self {
            authority: Authority::Held(Reason::NoCommandYet),
            rearm: Rearm::default(),
        }
    }

    pub(crate) fn authority(&self) -> Authority {
        self.authority
    }

    /// A stream is lost: whatever is pressed by now does not count any more. Says whether anything changed.
    ///
    /// A loss that goes on keeps its first reason, so that it tells the silence after which motion was stopped.
    pub(crate) fn stop(&mut self, reason: Reason) -> bool {
        self.rearm.spend();
        // Of two emergency stops the newer is told, for it is the one to be cleared.
        let stopped = matches!(reason, Reason::EmergencyStop { .. }) && self.authority != Authority::Held(reason);
        let goes_on =
            !stopped && matches!(self.authority, Authority::Held(old) if discriminant(&old) == discriminant(&reason));
        if !goes_on {
            self.authority = Authority::Held(reason);
        }
        !goes_on
    }

    /// Another operator is heard from now on: what the one before pressed does not count.
    pub(crate) fn change_hands(&mut self) {
        self.rearm.spend();
    }

    /// Another operator is heard from now on, by a press that was made while nobody drove: it counts.
    pub(crate) fn hand_over(&mut self) {
        self.rearm = Rearm::Open;
    }

    /// A command was admitted while no stream is lost.
    pub(crate) fn hear(&mut self, deadman: Deadman) {
        self.authority = match (self.rearm.see(deadman), deadman) {
            (Some(press), _) => Authority::Human { press },
            (None, Deadman::Released) => Authority::Held(Reason::DeadmanReleased),
            (None, Deadman::Held { .. }) => Authority::Held(Reason::AwaitingPress),
        };
    }

    /// There is guidance from the robot's side, or there is none.
    pub(crate) fn guide(&mut self, guided: bool) {
        self.authority = match self.authority {
            Authority::Human { press } | Authority::Shared { press } if guided => Authority::Shared { press },
            Authority::Human { press } | Authority::Shared { press } => Authority::Human { press },
            other => other,
        };
    }

    /// The process ends.
    pub(crate) fn close(&mut self) {
        self.rearm.spend();
        self.authority = Authority::Closed;
    }
}

impl Remember for Helm {
    fn remember(&mut self, memory: &mut Memory<'_>) -> Result<(), Malformed> {
        let Self { authority, rearm } = self;
        memory.part(authority)?;
        memory.part(rearm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn driving() -> Helm {
        let mut helm = Helm::new();
        helm.hear(Deadman::Released);
        helm.hear(Deadman::Held { press: 1 });
        helm
    }

    #[test]
    fn a_press_gives_the_human_the_helm_and_guidance_shares_it() {
        let mut helm = driving();
        assert_eq!(helm.authority(), Authority::Human { press: 1 });
        helm.guide(true);
        assert_eq!(helm.authority(), Authority::Shared { press: 1 });
        helm.guide(false);
        assert_eq!(helm.authority(), Authority::Human { press: 1 });
    }

    #[test]
    fn guidance_alone_moves_nothing() {
        let mut helm = Helm::new();
        helm.guide(true);
        assert_eq!(helm.authority(), Authority::Held(Reason::NoCommandYet));
    }

    #[test]
    fn after_a_loss_the_press_that_is_still_held_does_not_count() {
        let mut helm = driving();
        assert!(helm.stop(Reason::CommandLost { silent: 101 }));
        assert!(!helm.stop(Reason::CommandLost { silent: 300 }));
        assert_eq!(helm.authority(), Authority::Held(Reason::CommandLost { silent: 101 }));
        helm.hear(Deadman::Held { press: 1 });
        assert_eq!(helm.authority(), Authority::Held(Reason::AwaitingPress));
        helm.hear(Deadman::Held { press: 2 });
        assert_eq!(helm.authority(), Authority::Human { press: 2 });
    }

    #[test]
    fn another_operator_does_not_inherit_a_press() {
        let mut helm = driving();
        helm.change_hands();
        helm.hear(Deadman::Held { press: 9 });
        assert_eq!(helm.authority(), Authority::Held(Reason::AwaitingPress));
    }
}
