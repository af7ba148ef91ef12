//! Two sessions with a site's certificates send each other large messages at the same time, as fast as they can, and every
//! byte that arrives is compared with what was sent.
//!
//! This is what brought Zenoh's own TLS link down: patched/zenoh-link-tls says why, and how long it took. The keys of the
//! connection are renewed far more often than rustls would by itself (every 2^24 records), for at a renewal the side that
//! reads replaces what the side that writes is using. The short test runs always. The long one is asked for:
//!
//! ```sh
//! TANDEM_TLS_SECONDS=300 cargo test --release -p tandem-link --test tls_both_ways -- --ignored --nocapture
//! ```
//!
//! `TANDEM_TLS_BYTES` is the size of a message (1 000 000), `TANDEM_TLS_RECORDS` the number of records after which the keys
//! are renewed (50; 0: as rustls does by itself).

#![expect(clippy::unwrap_used, reason = "where a helper cannot go on, the test has failed")]

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rustls::crypto::{CryptoProvider, ring};
use rustls::{CipherSuiteCommon, SupportedCipherSuite, Tls13CipherSuite};
use tandem_link::net::free_port;
use tandem_link::{LinkSettings, Reach};
use tandem_site::{Authority, NewMember, Robots, Role, Validity};
use zenoh::Wait;
use zenoh::qos::CongestionControl;

const COMMAND: &str = "tandem/panda/command";
const SETPOINT: &str = "tandem/panda/setpoint";
/// How long a message may be on its way, on a machine that is busy with other things.
const LIMIT: Duration = Duration::from_secs(30);
/// A message is its number and then noise, which begins at another place for every message.
const HEAD: usize = 8;
const PLACES: u64 = 4096;

#[test]
fn what_two_members_send_each_other_at_the_same_time_arrives_whole() {
    renew_keys_after(50);
    let heard = both_ways(1_000_000, |sent, _| sent >= 8);
    assert!(heard.iter().all(|count| *count >= 8), "{heard:?}");
}

#[test]
#[ignore = "takes minutes: see the top of this file"]
fn it_does_so_for_minutes() {
    let asked = |name: &str, otherwise| std::env::var(name).map_or(otherwise, |text| text.parse().unwrap());
    let duration = Duration::from_secs(asked("TANDEM_TLS_SECONDS", 300));
    let bytes = usize::try_from(asked("TANDEM_TLS_BYTES", 1_000_000)).unwrap();
    renew_keys_after(asked("TANDEM_TLS_RECORDS", 50));
    let heard = both_ways(bytes, |_, since| since >= duration);
    println!("all {heard:?} messages of {bytes} bytes arrived whole and in order");
}

/// Tells rustls to renew a connection's keys after so many records; Zenoh takes the provider that it finds. Once for the
/// process, as rustls has it.
fn renew_keys_after(records: u64) {
    if records == 0 {
        return;
    }
    let usual = ring::default_provider();
    let impatient = usual.cipher_suites.iter().filter_map(|suite| {
        let SupportedCipherSuite::Tls13(suite) = suite else {
            return None;
        };
        let common = CipherSuiteCommon {
            confidentiality_limit: records,
            ..suite.common
        };
        let suite = Tls13CipherSuite { common, ..**suite };
        Some(SupportedCipherSuite::Tls13(Box::leak(Box::new(suite))))
    });
    let provider = CryptoProvider {
        cipher_suites: impatient.collect(),
        ..usual
    };
    // Whoever comes second finds the first one's.
    let _ = provider.install_default();
}

/// What arrived in one direction.
struct Heard {
    noise: Vec<u8>,
    count: AtomicU64,
    wrong: Mutex<Option<String>>,
}

impl Heard {
    fn take(&self, message: &[u8]) {
        let number = self.count.fetch_add(1, Ordering::Relaxed);
        let expected = message_of(&self.noise, number);
        if message != expected {
            let place = message.iter().zip(&expected).position(|(is, should)| is != should);
            let length = message.len();
            let wrong = format!("message {number} has {length} bytes and differs from byte {place:?} on");
            self.wrong.lock().unwrap().get_or_insert(wrong);
        }
    }
}

fn message_of(noise: &[u8], number: u64) -> Vec<u8> {
    let place = usize::try_from(number % PLACES).unwrap();
    let end = noise.len() - usize::try_from(PLACES).unwrap() + place;
    [&number.to_le_bytes(), &noise[place..end]].concat()
}

/// Xorshift, by Marsaglia: nothing in it repeats within a message.
fn noise(bytes: usize) -> Vec<u8> {
    let mut word = 0x9e37_79b9_7f4a_7c15_u64;
    let mut noise = Vec::with_capacity(bytes + 8);
    while noise.len() < bytes {
        word ^= word << 13;
        word ^= word >> 7;
        word ^= word << 17;
        noise.extend(word.to_le_bytes());
    }
    noise.truncate(bytes);
    noise
}

/// An operator and the arbiter that it dialled send each other messages until `enough`, asked with the number sent and the
/// time since the start, says so. How many arrived each way: all of them, in order, and none that differs.
fn both_ways(bytes: usize, enough: impl Fn(u64, Duration) -> bool + Sync) -> [u64; 2] {
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("lab");
    let mut authority = Authority::new(&site, "lab".parse().unwrap()).unwrap();
    for role in [Role::Arbiter, Role::Operator] {
        let new = NewMember {
            name: role.as_str().parse().unwrap(),
            role,
            robots: Robots::All,
            hosts: vec![],
            validity: Validity::days(1),
        };
        authority.issue(new).unwrap();
    }
    let endpoint = vec![format!("tcp/127.0.0.1:{}", free_port().unwrap())];
    let settings = LinkSettings {
        site: site.to_str().unwrap().into(),
        ..LinkSettings::default()
    };
    let listening = LinkSettings {
        listen: endpoint.clone(),
        ..settings.clone()
    };
    let dialling = LinkSettings {
        connect: endpoint,
        ..settings
    };
    let arbiter = open(&listening, Role::Arbiter);
    let operator = open(&dialling, Role::Operator);

    let lines = [(&operator, COMMAND, &arbiter), (&arbiter, SETPOINT, &operator)];
    let noise = noise(bytes.saturating_sub(HEAD) + usize::try_from(PLACES).unwrap());
    let heard = lines.map(|(_, key, ear)| {
        let heard = Arc::new(Heard {
            noise: noise.clone(),
            count: AtomicU64::new(0),
            wrong: Mutex::new(None),
        });
        let take = Arc::clone(&heard);
        let subscriber = ear.declare_subscriber(key);
        let subscriber = subscriber.callback(move |sample| take.take(&sample.payload().to_bytes()));
        subscriber.background().wait().unwrap();
        heard
    });
    let began = Instant::now();
    let stop = AtomicBool::new(false);
    let send = |mouth: &zenoh::Session, key: &'static str, heard: &Heard| {
        let publisher = mouth
            .declare_publisher(key)
            .congestion_control(CongestionControl::Block);
        let publisher = publisher.wait().unwrap();
        while !publisher.matching_status().wait().unwrap().matching() {
            assert!(began.elapsed() < LIMIT, "whoever dials gets in");
            std::thread::sleep(Duration::from_millis(10));
        }
        let started = Instant::now();
        let mut sent = 0;
        while !enough(sent, started.elapsed()) && !stop.load(Ordering::Relaxed) {
            publisher.put(message_of(&noise, sent)).wait().unwrap();
            sent += 1;
            let arrived = heard.count.load(Ordering::Relaxed);
            if heard.wrong.lock().unwrap().is_some() {
                stop.store(true, Ordering::Relaxed);
            } else if sent % 5000 == 0 {
                println!("{:.0?}: {key} {arrived} arrived of {sent}", started.elapsed());
            }
        }
        sent
    };
    let sent = std::thread::scope(|scope| {
        let heard = heard.each_ref();
        let threads = [0, 1].map(|line| {
            let (mouth, key, _) = lines[line];
            let send = &send;
            let heard = heard[line];
            scope.spawn(move || send(mouth, key, heard))
        });
        threads.map(|thread| thread.join().unwrap())
    });
    let arrived = || heard.each_ref().map(|heard| heard.count.load(Ordering::Relaxed));
    let limit = Instant::now() + LIMIT;
    while arrived() != sent && Instant::now() < limit {
        std::thread::sleep(Duration::from_millis(10));
    }
    for heard in &heard {
        assert_eq!(*heard.wrong.lock().unwrap(), None);
    }
    assert_eq!(arrived(), sent, "everything that was sent arrives");
    for session in [operator, arbiter] {
        session.close().wait().unwrap();
    }
    sent
}

fn open(settings: &LinkSettings, role: Role) -> zenoh::Session {
    let told = Reach::new(settings, Some(role)).unwrap().zenoh();
    let config = zenoh::Config::from_json5(&told.to_string()).unwrap();
    zenoh::open(config).wait().unwrap()
}
