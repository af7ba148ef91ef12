//! `tandem router`: what everybody dials, where no node shall listen: carries messages, checks certificates and roles.

use std::time::{Duration, Instant};

use anyhow::Context as _;
use clap::Args;
use crossbeam_channel::{Receiver, RecvTimeoutError};
use tandem_link::reach::DEFAULT_ENDPOINT;
use tandem_link::{Link, LinkSettings, Reach, refusals};
use tandem_site::{Role, Roster};

use crate::nodes::NodeFlags;
use crate::{Outcome, interrupt};

/// How often the roster is read, and refusals are told.
const LOOK: Duration = Duration::from_secs(1);
/// How long a port may take to become free again.
const REOPEN: Duration = Duration::from_secs(10);
/// How often the same refusal is told.
const REPEAT: Duration = Duration::from_secs(60);

#[derive(Args)]
pub(crate) struct RouterFlags {
    #[command(flatten)]
    node: NodeFlags,
}

pub(crate) fn run(flags: &RouterFlags) -> anyhow::Result<Outcome> {
    let mut settings = flags.node.configuration(&[])?.link;
    if settings.listen.is_empty() {
        settings.listen.push(DEFAULT_ENDPOINT.to_owned());
    }
    let interrupted = interrupt::catch()?;
    let refused = refusals::hear();
    let mut told = Told::default();
    let mut reach = Reach::new(&settings, Some(Role::Router))?;
    let mut link = Link::open_at(settings.robot.parse()?, &reach)?;
    eprintln!("router: {}; Ctrl-C ends it", describe(&reach));
    while let Err(RecvTimeoutError::Timeout) = interrupted.recv_timeout(LOOK) {
        refused.try_iter().for_each(|why| told.tell(why));
        if let Some(newer) = newer(&settings, &reach) {
            eprintln!(
                "router: site.toml has changed, so all connections begin anew: {}",
                describe(&newer)
            );
            link.close();
            drop(link);
            reach = newer;
            let Some(opened) = reopen(&settings, &reach, &interrupted)? else {
                return Ok(Outcome::Done);
            };
            link = opened;
        }
    }
    link.close();
    eprintln!("router: ended");
    Ok(Outcome::Done)
}

/// Refusals that were told: whoever dials on and on is worth one line a minute.
#[derive(Default)]
struct Told(Vec<(String, Instant, u64)>);

impl Told {
    fn tell(&mut self, why: String) {
        let now = Instant::now();
        match self.0.iter_mut().find(|(said, ..)| *said == why) {
            Some((_, at, more)) if now.duration_since(*at) < REPEAT => *more += 1,
            Some((_, at, more)) => {
                eprintln!("router: refused {} more connections: {why}", *more + 1);
                (*at, *more) = (now, 0);
            }
            None => {
                eprintln!("router: refused a connection: {why}");
                self.0.push((why, now, 0));
            }
        }
    }
}

/// Zenoh reads its rules when a session opens. A roster that cannot be used changes nothing, but is worth a word; it is
/// told once, for the next look finds the same.
fn newer(settings: &LinkSettings, reach: &Reach) -> Option<Reach> {
    let roster = roster(reach)?;
    match Reach::new(settings, Some(Role::Router)) {
        Ok(newer) if self::roster(&newer) != Some(roster) => Some(newer),
        Ok(_) => None,
        Err(why) => {
            complain(&why.to_string());
            None
        }
    }
}

/// Says a thing unless it was the last thing said.
fn complain(why: &str) {
    static SAID: std::sync::Mutex<String> = std::sync::Mutex::new(String::new());
    if let Ok(mut said) = SAID.lock()
        && *said != why
    {
        eprintln!("router: the site's files have changed and are refused, so the rules stay as they were: {why}");
        why.clone_into(&mut said);
    }
}

fn roster(reach: &Reach) -> Option<&Roster> {
    reach.secured.as_ref().map(|secured| secured.site.roster())
}

/// Opens it again; the system may keep the port for a moment.
fn reopen(settings: &LinkSettings, reach: &Reach, interrupted: &Receiver<()>) -> anyhow::Result<Option<Link>> {
    let until = Instant::now() + REOPEN;
    loop {
        match Link::open_at(settings.robot.parse()?, reach) {
            Ok(link) => return Ok(Some(link)),
            Err(error) if Instant::now() > until => return Err(error).context("the router cannot listen again"),
            Err(_) if interrupted.recv_timeout(LOOK / 4).is_ok() => return Ok(None),
            Err(_) => {}
        }
    }
}

fn describe(reach: &Reach) -> String {
    let who = match roster(reach) {
        None => "anybody who reaches it may say anything".to_owned(),
        Some(roster) => {
            let revoked = roster.members.len() - roster.all_trusted().count();
            format!(
                "site {}, {} members, {revoked} revoked",
                roster.site,
                roster.all_trusted().count()
            )
        }
    };
    let dials = match reach.connect.is_empty() {
        true => String::new(),
        false => format!(", connecting to {}", reach.connect.join(", ")),
    };
    format!("listening on {}{dials}; {who}", reach.listen.join(", "))
}
