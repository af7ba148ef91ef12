//! Where a replay goes: the Rerun view, or the network under another robot's name.

mod network;
mod screen;

use tandem_recorder::Recorded;
use tandem_wire::Topic;

pub(super) use network::{Network, present};
pub(super) use screen::Screen;

/// What may be published: nothing that a robot obeys.
pub(super) const SHOWN: [Topic; 5] = [
    Topic::State,
    Topic::Proposal,
    Topic::Forecast,
    Topic::Scene,
    Topic::Trial,
];

pub(super) enum Target {
    View(Box<Screen>),
    Network(Network),
}

impl Target {
    pub(super) fn play(&mut self, message: Recorded) -> anyhow::Result<()> {
        match self {
            Self::View(screen) => screen.play(message),
            Self::Network(network) => network.play(message),
        }
    }

    /// Whether it is still there.
    pub(super) fn look(&mut self) -> anyhow::Result<()> {
        match self {
            Self::View(screen) => screen.hear(),
            Self::Network(network) => network.look(),
        }
    }

    /// What follows does not continue what was played.
    pub(super) fn begin_again(&mut self) -> anyhow::Result<()> {
        match self {
            Self::View(screen) => screen.begin_again(),
            Self::Network(network) => {
                network.begin_again();
                Ok(())
            }
        }
    }

    /// Ends it, and says what became of it.
    pub(super) fn close(self) -> Closing {
        match self {
            Self::View(screen) => screen.close(),
            Self::Network(network) => network.close(),
        }
    }
}

/// How a target ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Closing {
    /// Messages that were lost on the way.
    pub(super) lost: u64,
    /// Whether the target was there to the end.
    pub(super) was_there: bool,
}
