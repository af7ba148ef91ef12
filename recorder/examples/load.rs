//! What the recorder takes: messages at a rate for a time, from the node's step to the disk, and what it cost.
//!
//! `load [SECONDS=60] [RATE=20000] [PATH] [CONVERTED=0]`; after it, in the same run, the bare
//! mcap writer with the same payloads and compression. Processor time and memory are read from `/proc`. So many of a
//! hundred messages are states and setpoints in turns, which are converted to protobuf; the others are parts of journals,
//! written as they travel. The comparison is of parts only.

#![expect(clippy::disallowed_methods, reason = "a measurement reads the clock")]

#[path = "../tests/it/script/mixture.rs"]
mod mixture;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::sync::Arc;
use std::time::{Duration, Instant};

use mixture::Mixture;
use tandem_recorder::{
    Drops, Heard, Output, Provenance, Recorder, RecorderConfig, RecorderSettings, SessionFile, Sinks,
};
use tandem_wire::{
    Envelope, Happening, Header, Input, JournalBatch, JournalEntry, Node, NodeName, Outbox, Ports, Seq, Session, Stamp,
    Timing, Topic, encode,
};

/// What this adds to its entry's bytes: header, batch, entry.
const AROUND: usize = 32 + 24 + 20 + 4 + 8;

/// What one message carries: that of the requirement.
const BYTES: usize = 300;
/// Messages of one measurement of throughput.
const MESSAGES: u64 = 400_000;
/// The default of the recorder's settings.
const CHUNK_BYTES: u64 = 256 << 10;

/// Journals are the bulk of what a recorder hears.
const TOPIC: Topic = Topic::Journal(NodeName::Arbiter);

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let seconds: u64 = arguments.next().map_or(Ok(60), |text| text.parse())?;
    let rate: u64 = arguments.next().map_or(Ok(20_000), |text| text.parse())?;
    let path = arguments.next().unwrap_or_else(|| "load.mcap".to_owned());
    let converted: u64 = arguments.next().map_or(Ok(0), |text| text.parse())?;
    println!("one message    {} bytes", message(0).len());
    sustain(seconds, rate, &path, converted)?;
    compare(&path)
}

/// The whole recorder but Zenoh, at a rate.
fn sustain(seconds: u64, rate: u64, path: &str, converted: u64) -> Result<(), Failure> {
    let settings = RecorderSettings {
        path: path.to_owned(),
        overwrite: true,
        ..RecorderSettings::default()
    };
    let mut sinks = Sinks::open(&RecorderConfig::new(&settings)?, Timing::default(), &provenance()?)?;
    let mut recorder = Recorder::new(Timing::default());
    let (mut mixture, mut outbox) = (Mixture::new(converted), Outbox::default());
    let (began, cpu) = (Instant::now(), cpu_seconds());
    let mut feeding = Duration::ZERO;
    for number in 0..rate * seconds {
        // A thousand times a second, as many as are due: no finer than a system's timer.
        let due = Duration::from_nanos(number * 1_000_000_000 / rate);
        if number % (rate / 1000).max(1) == 0 && due > began.elapsed() {
            crossbeam_channel::after(due.saturating_sub(began.elapsed())).recv()?;
        }
        let now = Stamp(due.as_nanos().try_into()?);
        let (topic, bytes) = mixture.next(now).unwrap_or_else(|| (TOPIC, message(number)));
        let fed = Instant::now();
        let input = Input::Sample { topic, bytes: &bytes };
        recorder.step(now, Recorder::event(input), &mut outbox);
        outbox.drain().for_each(|output| sinks.handle(output));
        feeding += fed.elapsed();
    }
    let wall = began.elapsed().as_secs_f64();
    let closed = sinks.close(Duration::from_secs(30));
    let cpu = cpu_seconds() - cpu;
    println!(
        "at a rate      {} messages, {converted} of a hundred converted, in {wall:.1} s, {} dropped",
        rate * seconds,
        closed.drops.session_file.total()
    );
    println!(
        "               {:.0} % of one core, {:.1} µs a message to hand over",
        100.0 * cpu / wall,
        feeding.as_secs_f64() * 1e6 / (rate * seconds) as f64
    );
    println!(
        "               {} MB resident at most, {:?} ended",
        peak_megabytes(),
        closed.sinks.first()
    );
    Ok(())
}

/// From what the queue holds to disk, against the bare writer.
fn compare(path: &str) -> Result<(), Failure> {
    let payloads: Vec<_> = (0..1000).map(message).collect();
    let heards = heard(&payloads);
    for round in 1..=3 {
        let began = Instant::now();
        let mut file = SessionFile::begin(create(path)?, CHUNK_BYTES, provenance()?)?;
        for number in 0..MESSAGES {
            file.write(&heards[usize::try_from(number)? % heards.len()], Drops::default())?;
        }
        file.close(&tandem_recorder::Counts::default(), Drops::default())?;
        let ours = MESSAGES as f64 / began.elapsed().as_secs_f64();
        let bare = MESSAGES as f64 / bare(path, &payloads)?.as_secs_f64();
        println!(
            "round {round}        {ours:.0} messages/s; bare mcap writer {bare:.0}; {:.0} %",
            100.0 * ours / bare
        );
    }
    Ok(())
}

fn bare(path: &str, payloads: &[Vec<u8>]) -> Result<Duration, Failure> {
    let began = Instant::now();
    let options = mcap::WriteOptions::new()
        .compression(Some(mcap::Compression::Zstd))
        .compression_threads(0)
        .chunk_size(Some(CHUNK_BYTES));
    let mut writer = options.create(create(path)?)?;
    let channel = writer.add_channel(0, "bare", "raw", &BTreeMap::new())?;
    for number in 0..MESSAGES {
        let bytes = &payloads[usize::try_from(number)? % payloads.len()];
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: u32::try_from(number)?,
            log_time: number,
            publish_time: number,
        };
        writer.write_to_known_channel(&header, bytes)?;
    }
    writer.finish()?;
    Ok(began.elapsed())
}

/// A journal's part of exactly so many bytes; half of them are like a number's, which do not compress.
fn message(number: u64) -> Vec<u8> {
    let mut noise = number.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let bytes = (0..BYTES - AROUND).map(|index| {
        noise ^= noise << 13;
        noise ^= noise >> 7;
        noise ^= noise << 17;
        if index % 2 == 0 { noise.to_le_bytes()[3] } else { 0 }
    });
    let what = Happening::Output {
        topic: Topic::Setpoint,
        bytes: bytes.collect(),
    };
    let entry = JournalEntry {
        at: Stamp(number),
        wall: Stamp(number),
        what,
    };
    let header = Header {
        tick: 0,
        session: Session(1),
        seq: Seq(number + 1),
        sent: Stamp(number),
    };
    let body = JournalBatch {
        first: number,
        lost: 0,
        entries: vec![entry],
    };
    let mut bytes = Vec::with_capacity(BYTES);
    encode(&Envelope { header, body }, &mut bytes);
    bytes
}

fn heard(payloads: &[Vec<u8>]) -> Vec<Arc<Heard>> {
    let mut recorder = Recorder::new(Timing::default());
    let mut outbox = Outbox::default();
    for bytes in payloads {
        let input = Input::Sample { topic: TOPIC, bytes };
        recorder.step(Stamp(0), Recorder::event(input), &mut outbox);
    }
    let written = |output| match output {
        Output::Write(heard) => Some(heard),
        Output::Show(_) | Output::Ask(_) | Output::Say(_) => None,
    };
    outbox.drain().filter_map(written).take(payloads.len()).collect()
}

fn create(path: &str) -> Result<BufWriter<File>, Failure> {
    Ok(BufWriter::new(File::create(path)?))
}

fn provenance() -> Result<Provenance, Failure> {
    Ok(Provenance {
        robot: "panda".parse()?,
        build: String::new(),
        epoch_unix_nanos: 0,
    })
}

/// Processor time of this process; Linux counts it in hundredths.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    let ticks: f64 = fields
        .skip(11)
        .take(2)
        .filter_map(|field| field.parse::<f64>().ok())
        .sum();
    ticks / 100.0
}

fn peak_megabytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok());
    kilobytes.unwrap_or_default() / 1024
}
