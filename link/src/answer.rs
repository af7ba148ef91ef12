//! Questions for a journal: put by a recorder that lacks entries, answered from the spool.
//!
//! A question is a query on the journal's key with the parameters `session`, `first` and `last`. Its answer is one
//! [`JournalBatch`] with sequence number 0, which no message of a stream has; see [`Spool::answer`] for what is in it.
//! Both travel in the journal's own class, bulk, and wait for nobody.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use crossbeam_channel::{Sender, bounded};
use tandem_wire::{Envelope, Header, JournalBatch, NodeName, Question, RobotName, Seq, Session, Topic, encode};
use zenoh::Wait;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{ConsolidationMode, Query, Queryable};

use crate::Clock;
use crate::entrance::Entrance;
use crate::net::{Link, LinkError, QUERY_TIMEOUT, declare};
use crate::running::Item;
use crate::spool::Spool;

/// Questions that may wait for their answers.
const QUESTIONS: usize = 16;

/// Answers whoever asks for entries of a journal, on a thread of its own. `asked` hears from which entry on each
/// question goes: whoever asks from the end has the rest.
pub(crate) fn answer_journal(
    link: &Link,
    node: NodeName,
    session: Session,
    spool: Arc<Mutex<Spool>>,
    asked: Sender<u64>,
) -> Result<Queryable<()>, LinkError> {
    let key = Topic::Journal(node).key(&link.robot);
    let (put, questions) = bounded::<Query>(QUESTIONS);
    let reply_key = key.clone();
    let answer = move || {
        for query in questions {
            let Some((first, last)) = range(&query, session) else {
                continue;
            };
            // A disk that fails answers nothing; whoever asked asks again, and gives up in the end.
            let found = spool.lock().ok().and_then(|mut spool| spool.answer(first, last).ok());
            if let Some(batch) = found {
                // Whoever asked and went away needs no answer.
                let _ = query.reply(&reply_key, message(session, batch)).wait();
            }
            // A node that ends has an ear for this; the others need not know.
            let _ = asked.try_send(first);
        }
    };
    let thread = std::thread::Builder::new().name("journal-answers".into()).spawn(answer);
    thread.map_err(|error| LinkError::Declare {
        key: key.clone(),
        reason: error.to_string(),
    })?;
    let queryable = link.session.declare_queryable(&key).callback(move |query| {
        // Where so many are waiting, one more may ask again.
        let _ = put.try_send(query);
    });
    queryable.wait().map_err(|error| declare(&key, &error))
}

/// What is asked for, if it is about this run.
fn range(query: &Query, session: Session) -> Option<(u64, u64)> {
    let number = |name| query.parameters().get(name)?.parse::<u64>().ok();
    (number("session")? == session.0).then_some(())?;
    Some((number("first")?, number("last")?))
}

fn message(session: Session, body: JournalBatch) -> Vec<u8> {
    let header = Header {
        tick: 0,
        session,
        seq: Seq(0),
        sent: Clock::of_process().now(),
    };
    let mut bytes = Vec::new();
    encode(&Envelope { header, body }, &mut bytes);
    bytes
}

/// Puts a node's questions.
pub(crate) struct Asker {
    session: zenoh::Session,
    robot: RobotName,
    entrance: Entrance,
}

impl Asker {
    pub(crate) fn new(link: &Link, entrance: Entrance) -> Self {
        Self {
            session: link.session.clone(),
            robot: link.robot.clone(),
            entrance,
        }
    }

    /// Asks without waiting. The answer arrives like a part of the journal; where there is none, an empty one does.
    pub(crate) fn ask(&self, question: Question) {
        let Question {
            node,
            session,
            first,
            last,
        } = question;
        let key = Topic::Journal(node).key(&self.robot);
        let selector = format!("{key}?first={first};last={last};session={}", session.0);
        let answered = Answered {
            entrance: self.entrance.clone(),
            question,
            any: AtomicBool::new(false),
        };
        let get = self
            .session
            .get(selector)
            .consolidation(ConsolidationMode::None)
            .timeout(QUERY_TIMEOUT)
            .priority(Priority::DataLow)
            .congestion_control(CongestionControl::Drop);
        // A session that is closed gives no answer, and says so by dropping the callback.
        let _ = get
            .callback(move |reply| {
                if let Ok(sample) = reply.result() {
                    answered.any.store(true, Ordering::Relaxed);
                    answered.entrance.sample(Topic::Journal(node), sample);
                }
            })
            .wait();
    }
}

/// Whether anybody answered; the node is told when nobody did.
struct Answered {
    entrance: Entrance,
    question: Question,
    any: AtomicBool,
}

impl Drop for Answered {
    fn drop(&mut self) {
        if !self.any.load(Ordering::Relaxed) {
            let nothing = JournalBatch {
                first: self.question.first,
                ..JournalBatch::default()
            };
            let item = Item::Sample {
                topic: Topic::Journal(self.question.node),
                bytes: message(self.question.session, nothing),
                arrived: Clock::of_process().now(),
            };
            // This may be the node's own thread, which must not wait for itself; a full queue makes it wait a little
            // longer for the answer.
            let _ = self.entrance.door.offer(item);
        }
    }
}
