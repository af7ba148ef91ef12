//! What whoever listens says of a certificate, in words: Zenoh's access control drops messages without a word, so a member
//! that was revoked would otherwise only see silence.

use std::time::Duration;

use tandem_site::Roster;
use tandem_site::policy::verdict_key;
use zenoh::Wait;
use zenoh::query::Queryable;

use crate::net::{LinkError, declare};
use crate::reach::{Reach, Secured};

/// How long whoever listens may take to answer. A zenohd has no answer.
const PATIENCE: Duration = Duration::from_secs(2);
/// What an answer begins with if the certificate is good.
const GOOD: &str = "good: ";

/// Answers whoever asks about a common name.
pub(crate) fn give(session: &zenoh::Session, roster: &Roster) -> Result<Queryable<()>, LinkError> {
    let key = verdict_key(roster.site.as_str(), "*");
    let roster = roster.clone();
    let queryable = session.declare_queryable(&key).callback(move |query| {
        let asked = query.key_expr().as_str().to_owned();
        let common_name = asked.rsplit('/').next().unwrap_or_default();
        let answer = match roster.verdict(common_name) {
            Ok(role) => format!("{GOOD}{role}"),
            Err(why) => why,
        };
        // Whoever asked and went away needs no answer.
        let _ = query.reply(&asked, answer).wait();
    });
    queryable.wait().map_err(|error| declare(&key, &error))
}

/// Asks whoever listens about ourselves; `Err` says why we may do nothing.
pub(crate) fn ask(session: &zenoh::Session, secured: &Secured, reach: &Reach) -> Result<(), String> {
    let key = verdict_key(
        secured.site.roster().site.as_str(),
        &secured.identity.certificate.common_name,
    );
    let replies = session.get(&key).timeout(PATIENCE).wait();
    let answers = replies.into_iter().flat_map(|replies| replies.into_iter());
    let answer = answers
        .filter_map(|reply| reply.into_result().ok())
        .find_map(|sample| sample.payload().try_to_string().ok().map(|text| text.into_owned()));
    match answer {
        Some(answer) if answer.starts_with(GOOD) => Ok(()),
        Some(answer) => Err(answer),
        // Nobody said anything: is it because our own link does not let whoever listens speak?
        None => match reach.knock().into_iter().find_map(|door| door.answer.err()) {
            Some(why) => Err(why.to_string()),
            None => Ok(()),
        },
    }
}
