//! Whom whoever listens has refused, in words: Zenoh says it in its log and nowhere else.

use std::fmt::{self, Write as _};

use crossbeam_channel::{Receiver, Sender, bounded};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::{Event, Level, Metadata, Subscriber};

/// Refusals that may wait to be told; whoever is knocked at faster need not hear each.
const QUEUE: usize = 64;
/// Where Zenoh accepts TLS connections.
const SOURCE: &str = "zenoh_link_tls";
/// What Zenoh adds to every failure there.
const HINT: &str = ". Hint: increase the system open file limit.";

/// Hears of every TLS connection that this process refuses, from now on. Only the first call of a process hears
/// anything.
#[must_use]
pub fn hear() -> Receiver<String> {
    let (sender, receiver) = bounded(QUEUE);
    // Somebody else who listens to the log hears it instead.
    let _ = tracing::subscriber::set_global_default(Ear(sender));
    receiver
}

struct Ear(Sender<String>);

impl Subscriber for Ear {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        *metadata.level() <= Level::WARN && metadata.target().starts_with(SOURCE)
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let mut said = Said::default();
        event.record(&mut said);
        // A full queue has enough of the same.
        let _ = self.0.try_send(in_words(&said.0));
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

#[derive(Default)]
struct Said(String);

impl Visit for Said {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            // Writing to a text does not fail.
            let _ = write!(self.0, "{value:?}");
        }
    }
}

/// What Zenoh said, and what it means to whoever reads it here.
fn in_words(said: &str) -> String {
    let said = said.trim_end_matches(HINT);
    let means = [
        ("Expired", "its certificate has expired; issue it again"),
        ("UnknownIssuer", "its certificate is not this site's"),
        (
            "peer sent no certificates",
            "it showed no certificate: it was started without --site",
        ),
        (
            "InvalidContentType",
            "it does not speak TLS: it was started without --site",
        ),
        (
            "corrupt message",
            "it does not speak TLS: it was started without --site",
        ),
        ("CertificateUnknown", "it does not trust this machine's certificate"),
        (
            "UnknownCA",
            "it does not trust this machine's certificate: it belongs to another site",
        ),
        (
            "BadCertificate",
            "it does not trust this machine's certificate: does it name the host that was dialled?",
        ),
        (
            "CertificateExpired",
            "this machine's certificate has expired; issue it again",
        ),
    ];
    // The longest match says most: "CertificateExpired" is another matter than "Expired".
    let found = means
        .iter()
        .filter(|(sign, _)| said.contains(sign))
        .max_by_key(|(sign, _)| sign.len());
    match found {
        Some((_, meaning)) => format!("{meaning} ({said})"),
        None => said.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_zenoh_says_is_told_with_what_it_means() {
        let told = in_words("invalid peer certificate: Expired. Hint: increase the system open file limit.");
        assert_eq!(
            told,
            "its certificate has expired; issue it again (invalid peer certificate: Expired)"
        );
        assert!(in_words("received fatal alert: CertificateExpired").starts_with("this machine's certificate"));
        assert_eq!(in_words("os error 24"), "os error 24");
    }
}
