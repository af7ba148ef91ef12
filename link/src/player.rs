//! A replay on the network. It is no node, so it stands under a key of its own, where other replays look for it.

use std::time::Duration;

use tandem_wire::keys;
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;

use crate::net::{Link, LinkError, declare};

/// How long the others have to answer: on one machine they take a millisecond.
const ANSWER: Duration = Duration::from_millis(500);

/// The presence of a replay under a robot's name, for as long as this value lives and up to Zenoh's lease longer.
pub struct Player {
    link: Link,
    own: String,
    _token: LivelinessToken,
}

impl Player {
    /// Announces a replay.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn announce(link: &Link) -> Result<Self, LinkError> {
        let own = keys::player(&link.robot, &link.session.zid().to_string());
        let token = link.session.liveliness().declare_token(&own).wait();
        Ok(Self {
            link: link.clone(),
            _token: token.map_err(|error| declare(&own, &error))?,
            own,
        })
    }

    /// How many other replays play under this name. Of two that begin together, at least one sees the other, for each
    /// announces itself before it looks.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn others(&self) -> Result<usize, LinkError> {
        count(&self.link, |key| key != self.own)
    }

    /// How many replays play under this link's name.
    ///
    /// # Errors
    /// If Zenoh refuses.
    pub fn playing(link: &Link) -> Result<usize, LinkError> {
        count(link, |_| true)
    }
}

fn count(link: &Link, is_meant: impl Fn(&str) -> bool) -> Result<usize, LinkError> {
    let all = keys::player(&link.robot, "*");
    let asked = link.session.liveliness().get(&all).timeout(ANSWER).wait();
    let replies = asked.map_err(|error| declare(&all, &error))?;
    let keys = replies.into_iter().filter_map(|reply| {
        let sample = reply.result().ok()?;
        Some(sample.key_expr().as_str().to_owned())
    });
    Ok(keys.filter(|key| is_meant(key)).count())
}
