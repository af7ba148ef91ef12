//! Round trip and clock offset to every peer, continuously: a thread per node that pings, answers and reports.
//!
//! A ping is a query on `tandem/<robot>/ping/*`; every node of the robot answers on its own `ping/<node>` with when it
//! heard it and when it answered ([`Pong`]). Once a second the node publishes what it knows on `clock/<node>`
//! ([`ClockReport`]). All of it travels in Zenoh's background class and may be dropped, so that it never delays a stream;
//! arrivals are stamped on Zenoh's thread, answers are made on ours. See [`Estimator`] for the arithmetic.
//!
//! Nothing that moves the robot looks at any of this: ages are by the receiver's own clock.

mod estimator;
mod peers;
mod probe;

use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError, bounded};
use tandem_wire::{
    ClockReport, Envelope, MILLISECOND, Nanos, NodeName, Numbering, Pong, RobotName, SECOND, Session, Stamp, Topic,
    decode, encode, keys,
};
use zenoh::Wait;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::{ConsolidationMode, Query, QueryTarget, Queryable};

use crate::Clock;
use crate::config::ClockSettings;
use crate::entrance::at_most;
use crate::net::{Link, LinkError, declare};
pub use estimator::{DRIFT_PPM, Estimate, Estimator, Exchange, Taken, WINDOW};
use peers::Peers;
pub use probe::measure_clocks;

/// Pings and answers that may wait; more are dropped, and show as fewer samples.
const QUEUE: usize = 256;
/// How long an answer is waited for.
const TIMEOUT: Duration = Duration::from_secs(2);
/// How often a node says what it knows.
const REPORT_EVERY: Nanos = SECOND;
/// A peer that has not answered for so many pings, and five seconds, is gone.
const PATIENCE: u64 = 4;
/// A peer that has just come is pinged so many times as often, until it is known.
const HURRY: u64 = 4;

/// A node's clock keeper. Dropping it ends its thread.
pub(crate) struct Clocks {
    sender: Sender<Event>,
    queryable: Option<Queryable<()>>,
    thread: Option<JoinHandle<()>>,
}

enum Event {
    /// A peer's ping, and when it arrived.
    Ping(Query, Stamp),
    /// An answer to ours.
    Pong(Answer),
    /// The node ends.
    Stop,
}

/// An answer as it came.
struct Answer {
    node: NodeName,
    bytes: Vec<u8>,
    asked: Stamp,
    arrived: Stamp,
}

impl Clocks {
    /// Begins to answer pings and, unless the settings say otherwise, to ping.
    pub(crate) fn start(
        link: &Link,
        node: NodeName,
        session: Session,
        settings: &ClockSettings,
    ) -> Result<Self, LinkError> {
        let key = Topic::Ping(node).key(&link.robot);
        let (sender, receiver) = bounded(QUEUE);
        let keeper = Keeper::new(link, node, session, settings, sender.clone());
        let thread = std::thread::Builder::new().name("clock".into());
        let thread = thread.spawn(move || keeper.live(&receiver));
        let thread = thread.map_err(|error| LinkError::Declare {
            key: key.clone(),
            reason: error.to_string(),
        })?;
        let (clock, entrance) = (Clock::of_process(), sender.clone());
        let queryable = link.session.declare_queryable(&key).callback(move |query| {
            let heard = clock.now();
            // Whoever gets no answer asks again.
            let _ = entrance.try_send(Event::Ping(query, heard));
        });
        let mut clocks = Self {
            sender,
            queryable: None,
            thread: Some(thread),
        };
        clocks.queryable = Some(queryable.wait().map_err(|error| declare(&key, &error))?);
        Ok(clocks)
    }
}

impl Drop for Clocks {
    fn drop(&mut self) {
        drop(self.queryable.take());
        // Where the queue is full the thread is at work, and takes one up in a moment.
        let mut stop = Event::Stop;
        while let Err(TrySendError::Full(refused)) = self.sender.try_send(stop) {
            stop = refused;
            std::thread::yield_now();
        }
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has ended.
            let _ = thread.join();
        }
    }
}

/// What the thread owns.
struct Keeper {
    session: zenoh::Session,
    robot: RobotName,
    node: NodeName,
    run: Session,
    /// The numbers of answers, and of reports.
    numbering: [Numbering; 2],
    every: Option<Nanos>,
    peers: Peers,
    sender: Sender<Event>,
    clock: Clock,
    bytes: Vec<u8>,
}

impl Keeper {
    fn new(link: &Link, node: NodeName, run: Session, settings: &ClockSettings, sender: Sender<Event>) -> Self {
        let every = settings.every_ms.saturating_mul(MILLISECOND);
        Self {
            session: link.session.clone(),
            robot: link.robot.clone(),
            node,
            run,
            numbering: [Numbering::new(run), Numbering::new(run)],
            every: (every > 0).then_some(every),
            peers: Peers::new(settings.skew_alarm_ms, every.saturating_mul(PATIENCE).max(5 * SECOND)),
            sender,
            clock: Clock::of_process(),
            bytes: Vec::new(),
        }
    }

    fn live(mut self, receiver: &Receiver<Event>) {
        let (mut ping_due, mut report_due) = (self.clock.now(), self.clock.now().after(REPORT_EVERY));
        loop {
            let received = match self.every {
                Some(_) => receiver.recv_deadline(self.clock.instant(ping_due.min(report_due))),
                None => receiver.recv().map_err(RecvTimeoutError::from),
            };
            match received {
                Ok(Event::Ping(query, heard)) => self.answer(&query, heard),
                Ok(Event::Pong(answer)) => self.hear(&answer),
                Ok(Event::Stop) | Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => {}
            }
            let Some(every) = self.every else { continue };
            let now = self.clock.now();
            if now >= ping_due {
                ping(&self.session, &self.robot, &self.sender);
                let is_known = self.peers.are_known();
                ping_due = now.after(if is_known { every } else { every / HURRY });
            }
            if now >= report_due {
                self.report(now);
                report_due = now.after(REPORT_EVERY);
            }
        }
    }

    /// The answer travels in the class of its question.
    fn answer(&mut self, query: &Query, heard: Stamp) {
        let unix_nanos = unix_nanos();
        let pong = self.numbering[0].envelope(self.clock.now(), 0, Pong { heard, unix_nanos });
        encode(&pong, &mut self.bytes);
        // Whoever asked and went away needs no answer.
        let _ = query
            .reply(Topic::Ping(self.node).key(&self.robot), self.bytes.as_slice())
            .express(true)
            .wait();
    }

    fn hear(&mut self, answer: &Answer) {
        let Ok(pong) = decode::<Pong>(&answer.bytes) else {
            return;
        };
        // A wildcard asks oneself, too.
        if (answer.node, pong.header.session) != (self.node, self.run) {
            self.peers.hear(answer.node, answer.asked, &pong, answer.arrived);
        }
    }

    fn report(&mut self, now: Stamp) {
        let report = self.peers.report(now, unix_nanos());
        let message: Envelope<ClockReport> = self.numbering[1].envelope(now, 0, report);
        encode(&message, &mut self.bytes);
        let put = self
            .session
            .put(Topic::Clock(self.node).key(&self.robot), self.bytes.as_slice());
        // A session that is closed has nobody to tell.
        let _ = put
            .priority(Priority::Background)
            .congestion_control(CongestionControl::Drop)
            .wait();
    }
}

/// Asks every node of a robot for the time; answers arrive at `sender`.
fn ping(session: &zenoh::Session, robot: &RobotName, sender: &Sender<Event>) {
    let clock = Clock::of_process();
    let get = session
        .get(format!("{}/{robot}/{}", keys::ROOT, keys::PINGS))
        .target(QueryTarget::All)
        .consolidation(ConsolidationMode::None)
        .timeout(TIMEOUT)
        .priority(Priority::Background)
        .congestion_control(CongestionControl::Drop)
        .express(true);
    let sender = sender.clone();
    let asked = clock.now();
    // A session that is closed gives no answer.
    let _ = get
        .callback(move |reply| {
            let arrived = clock.now();
            let Ok(sample) = reply.result() else { return };
            let Some((_, topic @ Topic::Ping(node))) = keys::parse(sample.key_expr().as_str()) else {
                return;
            };
            // Where so many wait, one more tells little.
            let _ = sender.try_send(Event::Pong(Answer {
                node,
                bytes: at_most(topic.max_bytes(), sample.payload()),
                asked,
                arrived,
            }));
        })
        .wait();
}

fn unix_nanos() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}
