//! Dialling until somebody answers, and saying meanwhile why nobody does.

use std::time::{Duration, Instant};

use anyhow::bail;
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded, unbounded};
use tandem_link::{Link, LinkSettings, Reach};

use super::process::POLL;
use crate::keys;

/// Connects, for as long as it takes; `None` if the user gave up first, as `gave_up` tells.
pub(crate) fn connect(
    settings: &LinkSettings,
    reach: &Reach,
    gave_up: impl Fn() -> bool,
) -> anyhow::Result<Option<Link>> {
    let (sender, opened) = bounded(1);
    let (robot, dialled) = (settings.robot.parse()?, reach.clone());
    // Dialling blocks until somebody answers; meanwhile Ctrl-C must still work.
    std::thread::spawn(move || drop(sender.send(Link::open_at(robot, &dialled))));
    let mut knocking = Knocking::new(reach);
    loop {
        match opened.recv_timeout(POLL) {
            Ok(link) => return Ok(Some(link?)),
            Err(RecvTimeoutError::Disconnected) => bail!("the connection attempt ended without a result"),
            Err(RecvTimeoutError::Timeout) if gave_up() => return Ok(None),
            Err(RecvTimeoutError::Timeout) => knocking.tell(),
        }
    }
}

/// Says, while a process dials with certificates, why nobody lets it in.
struct Knocking<'a> {
    reach: &'a Reach,
    next: Instant,
    answers: (Sender<String>, Receiver<String>),
    said: Vec<String>,
}

impl<'a> Knocking<'a> {
    fn new(reach: &'a Reach) -> Self {
        Self {
            reach,
            next: Instant::now() + KNOCK,
            answers: unbounded(),
            said: Vec::new(),
        }
    }

    fn tell(&mut self) {
        if Instant::now() >= self.next {
            self.next = Instant::now() + KNOCK_AGAIN;
            let (reach, sender) = (self.reach.clone(), self.answers.0.clone());
            std::thread::spawn(move || {
                for door in reach.knock() {
                    let why = match door.answer {
                        Err(why) => why.to_string(),
                        Ok(None) => format!(
                            "somebody answers at {}, but not as Tandem without certificates does; if it has some, say --site",
                            door.endpoint
                        ),
                        Ok(Some(_)) => continue,
                    };
                    // Whoever got in meanwhile does not listen any more.
                    drop(sender.send(why));
                }
            });
        }
        for why in self.answers.1.try_iter() {
            if !self.said.contains(&why) {
                eprintln!("still dialling: {why}");
                self.said.push(why);
            }
        }
    }
}

/// How long dialling may take before somebody looks why.
const KNOCK: Duration = Duration::from_secs(2);
/// How often it is looked again.
const KNOCK_AGAIN: Duration = Duration::from_secs(10);

/// Whom it will talk to, in words.
pub(crate) fn describe(settings: &LinkSettings, reach: &Reach) -> String {
    let who = reach.secured.as_ref().map(|secured| {
        let (member, days) = (&secured.identity.member, secured.identity.certificate.days_left());
        let soon = if days < keys::SOON {
            format!(", whose certificate ENDS in {days} days")
        } else {
            String::new()
        };
        format!("as {}{soon}, ", member.common_name)
    });
    let who = who.unwrap_or_default();
    match (reach.listen.as_slice(), reach.connect.as_slice()) {
        ([], connect) if settings.connect.is_empty() => {
            format!(
                "{who}connecting to {} (no --listen or --connect given)",
                connect.join(", ")
            )
        }
        ([], connect) => format!("{who}connecting to {}", connect.join(", ")),
        (listen, []) => format!("{who}listening on {}", listen.join(", ")),
        (listen, connect) => format!(
            "{who}listening on {}, connecting to {}",
            listen.join(", "),
            connect.join(", ")
        ),
    }
}
