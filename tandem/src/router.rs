//! `tandem router`: what everybody dials, where no node shall listen: carries messages, checks certificates and roles.

use clap::Args;
use crossbeam_channel::RecvTimeoutError;
use tandem_link::reach::DEFAULT_ENDPOINT;
use tandem_site::Role;

use crate::gate::{Gate, LOOK};
use crate::nodes::NodeFlags;
use crate::{Outcome, interrupt};

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
    let mut gate = Gate::new(&settings, Role::Router)?;
    let Some(mut link) = gate.open(&interrupted)? else {
        return Ok(Outcome::Done);
    };
    eprintln!("router: {}; Ctrl-C ends it", describe(&gate));
    while let Err(RecvTimeoutError::Timeout) = interrupted.recv_timeout(LOOK) {
        if gate.look() {
            eprintln!(
                "router: site.toml has changed, so all connections begin anew: {}",
                describe(&gate)
            );
            link.close();
            drop(link);
            let Some(opened) = gate.reopen(&interrupted)? else {
                return Ok(Outcome::Done);
            };
            link = opened;
        }
    }
    link.close();
    eprintln!("router: ended");
    Ok(Outcome::Done)
}

fn describe(gate: &Gate) -> String {
    let reach = gate.reach();
    let dials = match reach.connect.is_empty() {
        true => String::new(),
        false => format!(", connecting to {}", reach.connect.join(", ")),
    };
    format!("listening on {}{dials}; {}", reach.listen.join(", "), gate.admits())
}
