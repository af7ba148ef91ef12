//! temporary
#[path = "../tests/script/mod.rs"]
mod script;
use std::time::{Duration, Instant};
use tandem_recorder::*;
use tandem_wire::*;
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let url = std::env::args().nth(1).unwrap();
    let rounds: u32 = std::env::args().nth(2).unwrap().parse()?;
    let mut settings = RecorderSettings {
        path: "/tmp/recorder/soak.mcap".into(),
        rrd: "/tmp/recorder/soak.rrd".into(),
        ..RecorderSettings::default()
    };
    match url.as_str() {
        "none" => {}
        "spawn" => settings.live = Live::Spawn,
        _ => {
            settings.live = Live::Connect;
            settings.viewer = url;
        }
    }
    let provenance = Provenance {
        robot: "panda".parse()?,
        build: "x".into(),
        epoch_unix_nanos: 1_760_000_000_000_000_000,
    };
    let timing = Timing::default();
    let mut sinks = Sinks::open(&RecorderConfig::new(&settings)?, timing, &provenance)?;
    let start = Instant::now();
    let samples = script::session();
    let mut slowest = Duration::ZERO;
    let mut outbox = Outbox::default();
    for round in 0..rounds {
        let mut recorder = Recorder::new(timing);
        for s in &samples {
            std::thread::sleep(Duration::from_millis(4));
            let now = Stamp(u64::try_from(start.elapsed().as_nanos())?);
            let t = Instant::now();
            recorder.step(
                now,
                Recorder::event(Input::Sample {
                    topic: s.topic,
                    bytes: &s.bytes,
                }),
                &mut outbox,
            );
            for o in outbox.drain() {
                sinks.handle(o);
            }
            slowest = slowest.max(t.elapsed());
        }
        let rss = std::fs::read_to_string("/proc/self/status")?
            .lines()
            .filter(|l| l.starts_with("VmRSS") || l.starts_with("VmHWM"))
            .collect::<Vec<_>>()
            .join(" ");
        println!(
            "{round} {:?} slowest {slowest:?} {:?} {rss}",
            start.elapsed(),
            sinks.drops()
        );
        for n in sinks.notices() {
            println!("  notice: {n}");
        }
    }
    let t = Instant::now();
    let c = sinks.close(Duration::from_secs(2));
    println!("closed in {:?} {c:#?}", t.elapsed());
    Ok(())
}
