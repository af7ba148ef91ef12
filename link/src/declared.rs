//! What a node declares to Zenoh, and the way in for what comes of it.

use crossbeam_channel::{Receiver, SendError, Sender, TrySendError, bounded};
use tandem_wire::{Envelope, NodeInfo, Numbering, Pace, Ports, Topic, encode, keys};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::query::{Query, Queryable};
use zenoh::sample::{Sample, SampleKind};

use crate::Clock;
use crate::dropped::Dropped;
use crate::net::{Link, LinkError, QUERY_TIMEOUT, declare};
use crate::running::{Item, ShellOptions};

/// Questions for a node's configuration that may wait for their answers.
const QUERIES: usize = 16;

/// Where Zenoh's callbacks put what arrives.
#[derive(Clone)]
pub(crate) struct Entrance {
    pub(crate) sender: Sender<Item>,
    /// The node's end of the queue, to make room at its front.
    pub(crate) oldest: Receiver<Item>,
    pub(crate) dropped: Dropped,
    pub(crate) pace: Pace,
}

impl Entrance {
    fn put(&self, item: Item) {
        match self.pace {
            Pace::Lockstep => {
                if let Err(SendError(lost)) = self.sender.send(item) {
                    self.dropped.count(&lost);
                }
            }
            Pace::Real => put_newest(&self.sender, &self.oldest, item, &self.dropped),
        }
    }

    pub(crate) fn sample(&self, topic: Topic, sample: &Sample) {
        let bytes = sample.payload().to_bytes().into_owned();
        let arrived = Clock::of_process().now();
        self.put(Item::Sample { topic, bytes, arrived });
    }
}

/// Puts an item into a queue, at the cost of the oldest ones where it is full: a node that is far behind must act on what
/// is, not on what was. What is lost is counted. The wish to end is never one of them.
fn put_newest(sender: &Sender<Item>, oldest: &Receiver<Item>, item: Item, dropped: &Dropped) {
    let mut next = item;
    loop {
        match sender.try_send(next) {
            Ok(()) => return,
            Err(TrySendError::Disconnected(lost)) => return dropped.count(&lost),
            Err(TrySendError::Full(refused)) => next = refused,
        }
        // The wish to end goes to the back, in the place of what came: nothing that comes now matters any more.
        match oldest.try_recv() {
            Ok(Item::Stop) => dropped.count(&std::mem::replace(&mut next, Item::Stop)),
            Ok(lost) => dropped.count(&lost),
            // The node has just made room.
            Err(_) => {}
        }
    }
}

/// What a node has declared, kept until it ends. The token comes last: who sees it can reach the subscribers.
pub(crate) struct Declared {
    _subscribers: Vec<Subscriber<()>>,
    _info: Queryable<()>,
    _token: LivelinessToken,
}

impl Declared {
    pub(crate) fn new<N: Ports>(link: &Link, entrance: &Entrance, options: &ShellOptions) -> Result<Self, LinkError> {
        let mut subscribers = Vec::new();
        for &topic in N::INPUTS
            .iter()
            .filter(|topic| !matches!(topic, Topic::Device | Topic::Info(_)))
        {
            let (key, entrance) = (topic.key(&link.robot), entrance.clone());
            let declared = link.session.declare_subscriber(&key);
            let subscriber = declared.callback(move |sample| entrance.sample(topic, &sample)).wait();
            subscribers.push(subscriber.map_err(|error| declare(&key, &error))?);
        }
        let info = answer_info::<N>(link, options)?;
        let key = Topic::Alive(N::NAME).key(&link.robot);
        let token = link
            .session
            .liveliness()
            .declare_token(&key)
            .wait()
            .map_err(|error| declare(&key, &error))?;
        subscribers.push(watch_presence::<N>(link, entrance)?);
        Ok(Self {
            _subscribers: subscribers,
            _info: info,
            _token: token,
        })
    }
}

/// Answers whoever asks who this node is, on a thread of its own: a model takes its time on a thin line, and Zenoh's
/// thread, on which a query arrives, is the one that brings states and commands.
fn answer_info<N: Ports>(link: &Link, options: &ShellOptions) -> Result<Queryable<()>, LinkError> {
    let key = Topic::Info(N::NAME).key(&link.robot);
    let mut bytes = Vec::new();
    let mut numbering = Numbering::new(options.info.session);
    let envelope: Envelope<NodeInfo> = numbering.envelope(Clock::of_process().now(), 0, options.info.clone());
    encode(&envelope, &mut bytes);
    let reply_key = key.clone();
    let (asked, queries) = bounded::<Query>(QUERIES);
    let answer = move || {
        for query in queries {
            // Whoever asked and went away needs no answer.
            let _ = query.reply(&reply_key, bytes.as_slice()).wait();
        }
    };
    // It ends with the queryable, which drops the sender.
    let thread = std::thread::Builder::new().name("info".into()).spawn(answer);
    thread.map_err(|error| LinkError::Declare {
        key: key.clone(),
        reason: error.to_string(),
    })?;
    let queryable = link.session.declare_queryable(&key).callback(move |query| {
        // Where so many are waiting, one more may ask again.
        let _ = asked.try_send(query);
    });
    queryable.wait().map_err(|error| declare(&key, &error))
}

/// Reports peers that come and go; asks those for their configuration whose answer this node listens to.
fn watch_presence<N: Ports>(link: &Link, entrance: &Entrance) -> Result<Subscriber<()>, LinkError> {
    let key = format!("{}/{}/alive/*", keys::ROOT, link.robot);
    let (entrance, session, robot) = (entrance.clone(), link.session.clone(), link.robot.clone());
    let report = move |sample: Sample| {
        let Some((_, Topic::Alive(peer))) = keys::parse(sample.key_expr().as_str()) else {
            return;
        };
        let alive = sample.kind() == SampleKind::Put;
        entrance.put(Item::Presence { peer, alive });
        let topic = Topic::Info(peer);
        if alive && N::INPUTS.contains(&topic) {
            let entrance = entrance.clone();
            let query = session.get(topic.key(&robot)).timeout(QUERY_TIMEOUT);
            // A peer that vanishes again before it answers will be asked when it comes back.
            let _ = query
                .callback(move |reply| {
                    reply
                        .result()
                        .into_iter()
                        .for_each(|sample| entrance.sample(topic, sample))
                })
                .wait();
        }
    };
    let subscriber = link
        .session
        .liveliness()
        .declare_subscriber(&key)
        .history(true)
        .callback(report);
    subscriber.wait().map_err(|error| declare(&key, &error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_wire::NodeName;

    fn presence(alive: bool) -> Item {
        let peer = NodeName::Operator;
        Item::Presence { peer, alive }
    }

    #[test]
    fn a_full_queue_loses_its_oldest_and_keeps_the_newest() {
        let (sender, receiver) = bounded(2);
        let dropped = Dropped::default();
        put_newest(&sender, &receiver, presence(false), &dropped);
        put_newest(&sender, &receiver, presence(false), &dropped);
        assert_eq!(dropped.total(), 0);
        put_newest(&sender, &receiver, presence(true), &dropped);
        assert_eq!(dropped.total(), 1);
        let kept: Vec<Item> = receiver.try_iter().collect();
        assert!(matches!(
            kept.as_slice(),
            [Item::Presence { alive: false, .. }, Item::Presence { alive: true, .. }]
        ));
    }

    #[test]
    fn the_wish_to_end_survives_a_full_queue() {
        let (sender, receiver) = bounded(2);
        let dropped = Dropped::default();
        put_newest(&sender, &receiver, Item::Stop, &dropped);
        for _ in 0..10 {
            put_newest(&sender, &receiver, presence(true), &dropped);
        }
        assert!(receiver.try_iter().any(|item| matches!(item, Item::Stop)));
    }

    #[test]
    fn what_is_lost_is_counted_by_what_it_was_about() {
        let (sender, receiver) = bounded(2);
        let dropped = Dropped::default();
        let sample = |topic| Item::Sample {
            topic,
            bytes: Vec::new(),
            arrived: tandem_wire::Stamp(0),
        };
        for topic in [Topic::State, Topic::State, Topic::Scene, Topic::Scene, Topic::Scene] {
            put_newest(&sender, &receiver, sample(topic), &dropped);
        }
        let lost: Vec<_> = dropped.by_topic().into_iter().collect();
        assert_eq!(lost, [(Topic::State, 2), (Topic::Scene, 1)]);
    }
}
