//! What a node declares to Zenoh.

use crossbeam_channel::bounded;
use tandem_wire::{Envelope, NodeInfo, Numbering, Ports, Topic, encode, keys};
use zenoh::Wait;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::query::{Query, Queryable};
use zenoh::sample::{Sample, SampleKind};

use crate::Clock;
use crate::entrance::Entrance;
use crate::net::{Link, LinkError, QUERY_TIMEOUT, declare};
use crate::running::{Item, ShellOptions};

/// Questions for a node's configuration that may wait for their answers.
const QUERIES: usize = 16;

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
