//! Dialling until somebody answers, and saying meanwhile why nobody does.

use std::cell::Cell;
use std::net::IpAddr;
use std::time::{Duration, Instant};

use anyhow::bail;
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded, unbounded};
use tandem_link::reach::place;
use tandem_link::{Link, LinkError, LinkSettings, Reach};

use super::process::POLL;
use crate::keys;

/// Connects, for as long as it takes; `None` if the user gave up first, as `gave_up` tells.
pub(crate) fn connect(
    settings: &LinkSettings,
    reach: &Reach,
    gave_up: impl Fn() -> bool,
) -> anyhow::Result<Option<Link>> {
    let opened = dial(settings, reach)?;
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

/// Dials on a thread of its own, for dialling blocks until somebody answers.
pub(crate) fn dial(settings: &LinkSettings, reach: &Reach) -> Result<Receiver<Result<Link, LinkError>>, LinkError> {
    let (sender, opened) = bounded(1);
    let (robot, reach) = (settings.robot.parse()?, reach.clone());
    // Whoever gave up meanwhile has no use for it.
    std::thread::spawn(move || drop(sender.send(Link::open_at(robot, &reach))));
    Ok(opened)
}

/// Connects within a time, for whoever must know soon that nobody answers; `None` if the user gave up before.
pub(crate) fn connect_within(
    limit: Duration,
    settings: &LinkSettings,
    reach: &Reach,
    gave_up: impl Fn() -> bool,
) -> anyhow::Result<Option<Link>> {
    let until = Instant::now() + limit;
    let late = Cell::new(false);
    let link = connect(settings, reach, || {
        late.set(Instant::now() > until);
        late.get() || gave_up()
    })?;
    if link.is_none() && late.get() {
        let site = match reach.secured {
            Some(_) => "",
            None => ", and --site where certificates are used",
        };
        bail!(
            "nobody lets this program in at {} within {} s: say where with --connect{site}; tandem doctor looks into it",
            reach.connect.join(", "),
            limit.as_secs()
        );
    }
    Ok(link)
}

/// The settings as a tool uses them, which never listens: where this machine's own file says to listen and nothing else,
/// it dials whoever listens there.
pub(crate) fn as_tool(settings: &LinkSettings) -> LinkSettings {
    let mut tool = settings.clone();
    let listen = std::mem::take(&mut tool.listen);
    if tool.connect.is_empty() {
        tool.connect = listen.iter().map(|endpoint| dialled(endpoint)).collect();
    }
    tool
}

/// How a program of the same machine dials an endpoint on which another one listens.
fn dialled(endpoint: &str) -> String {
    let everywhere = |host: &str| host.parse::<IpAddr>().is_ok_and(|ip| ip.is_unspecified());
    match (endpoint.split_once('/'), place(endpoint)) {
        (Some((protocol, _)), Some((host, port))) if everywhere(host) => format!("{protocol}/127.0.0.1:{port}"),
        _ => endpoint.to_owned(),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tool_dials_whoever_listens_on_this_machine_and_listens_itself_nowhere() {
        let settings = |listen: &[&str], connect: &[&str]| LinkSettings {
            listen: listen.iter().map(|&endpoint| endpoint.to_owned()).collect(),
            connect: connect.iter().map(|&endpoint| endpoint.to_owned()).collect(),
            ..LinkSettings::default()
        };
        let robot = as_tool(&settings(
            &["tcp/0.0.0.0:7447", "tcp/[::]:7448", "tcp/192.0.2.10:1"],
            &[],
        ));
        assert_eq!(
            robot.connect,
            ["tcp/127.0.0.1:7447", "tcp/127.0.0.1:7448", "tcp/192.0.2.10:1"]
        );
        assert!(robot.listen.is_empty());
        let router = as_tool(&settings(&["tcp/0.0.0.0:7447"], &["tcp/192.0.2.11:7447"]));
        assert_eq!(router.connect, ["tcp/192.0.2.11:7447"]);
        assert!(router.listen.is_empty());
    }
}
