//! What the recorder's process takes over real Zenoh: messages of 300 bytes at a rate for a time, and what it cost.
//!
//! `recorder_load TANDEM [SECONDS=60] [RATE=20000] [stalled | CONVERTED=0]`, where TANDEM is the program to be measured.
//! This process sends parts of four journals over TCP on loopback, in a class that waits where the line is full rather
//! than drop; processor time and memory of the recorder's process are read from `/proc`, what arrived from its file. With
//! `stalled` its disk is a pipe that nobody reads and its viewer accepts connections and never answers: then memory and
//! exit code are what matters. With a number, so many of a hundred messages are states and setpoints in turns, which the
//! recorder converts to protobuf. Linux only.

#[path = "../../recorder/tests/it/script/mixture.rs"]
mod mixture;

use std::fs::File;
use std::net::TcpListener;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use mixture::Mixture;
use tandem_link::{Clock, Link, LinkSettings, Observer, Sighting};
use tandem_wire::{
    Delivery, Envelope, Happening, Header, JournalBatch, JournalEntry, NodeName, Pace, Seq, Session, Stamp, Topic,
    encode,
};

type Failure = Box<dyn std::error::Error>;

/// The length of a message, header included.
const BYTES: usize = 300;
/// What a batch of one entry adds to its entry's bytes.
const AROUND: usize = 32 + 24 + 20 + 4 + 8;
const STREAMS: [NodeName; 4] = [
    NodeName::Operator,
    NodeName::Predictor,
    NodeName::Arbiter,
    NodeName::RobotSim,
];
/// The flag that opens a pipe for reading although nobody writes yet.
const NONBLOCKING: i32 = 0o4000;

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let program = arguments
        .next()
        .ok_or("usage: recorder_load TANDEM [SECONDS] [RATE] [stalled | CONVERTED]")?;
    let seconds: u64 = arguments.next().map_or(Ok(60), |text| text.parse())?;
    let rate: u64 = arguments.next().map_or(Ok(20_000), |text| text.parse())?;
    let word = arguments.next().unwrap_or_else(|| "0".to_owned());
    let load = Load {
        seconds,
        rate,
        is_stalled: word == "stalled",
        converted: if word == "stalled" { 0 } else { word.parse()? },
    };
    let folder = std::env::temp_dir().join(format!("recorder-load-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let measured = measure(&program, &load, &folder);
    std::fs::remove_dir_all(&folder)?;
    measured
}

/// What is sent, and to what.
struct Load {
    seconds: u64,
    rate: u64,
    is_stalled: bool,
    /// So many of a hundred messages are converted.
    converted: u64,
}

fn measure(program: &str, load: &Load, folder: &Path) -> Result<(), Failure> {
    let is_stalled = load.is_stalled;
    let session = folder.join("load.mcap");
    let viewer = TcpListener::bind("127.0.0.1:0")?;
    let _pipe = is_stalled.then(|| stall(&session)).transpose()?;
    let port = TcpListener::bind("127.0.0.1:0")?.local_addr()?.port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let path = session.to_string_lossy();
    let mut command = Command::new(program);
    command.args(["recorder", "--robot", "load", "--listen", &endpoint, "--record", &path]);
    if is_stalled {
        let url = format!("connect=rerun+http://{}/proxy", viewer.local_addr()?);
        command.args(["--view", &url]);
    }
    let mut recorder = command.stdin(Stdio::null()).spawn()?;
    let sent = drive(&mut recorder, &endpoint, load);
    Command::new("kill")
        .args(["-s", "INT", &recorder.id().to_string()])
        .status()?;
    let code = recorder.wait()?.code();
    println!("exit code      {code:?}");
    if !is_stalled {
        let Kept { messages, dropped } = kept(&session)?;
        let sent = sent?;
        let missing = sent.saturating_sub(messages);
        println!("in the file    {messages} of {sent} sent, {missing} missing");
        println!("               of these {dropped} dropped by the recorder");
    } else {
        sent?;
    }
    Ok(())
}

/// A disk that takes some kilobytes and then nothing more.
fn stall(path: &Path) -> Result<File, Failure> {
    let made = Command::new("mkfifo").arg(path).status()?;
    if !made.success() {
        return Err("mkfifo failed".into());
    }
    Ok(std::fs::OpenOptions::new()
        .read(true)
        .custom_flags(NONBLOCKING)
        .open(path)?)
}

fn drive(recorder: &mut Child, endpoint: &str, load: &Load) -> Result<u64, Failure> {
    let rate = load.rate;
    let link = Link::open(&LinkSettings {
        robot: "load".into(),
        connect: vec![endpoint.to_owned()],
        ..LinkSettings::default()
    })?;
    wait_for(&link)?;
    let before = cpu_seconds(recorder.id())?;
    let began = Instant::now();
    let count = rate * load.seconds;
    let names = STREAMS.map(|node| Topic::Journal(node).suffix());
    let mut mixture = Mixture::new(load.converted);
    let (step, mut parts) = ((rate / 1000).max(1), 0_u64);
    for number in 0..count {
        // A thousand times a second, as many as are due: no finer than a system's timer.
        if number % step == 0 {
            let due = Duration::from_nanos(number * 1_000_000_000 / rate);
            std::thread::sleep(due.saturating_sub(began.elapsed()));
        }
        if let Some((topic, bytes)) = mixture.next(Clock::of_process().now()) {
            link.publish_as(&topic.suffix(), Delivery::Event, Pace::Real, bytes)?;
            continue;
        }
        let stream = usize::try_from(parts)? % names.len();
        let of_stream = parts / names.len() as u64;
        parts += 1;
        link.publish_as(&names[stream], Delivery::Event, Pace::Real, message(stream, of_stream))?;
    }
    let wall = began.elapsed().as_secs_f64();
    // What is still on its way.
    std::thread::sleep(Duration::from_secs(1));
    let cpu = cpu_seconds(recorder.id())? - before;
    println!(
        "sent           {count} messages, {parts} of them parts of {} bytes, in {wall:.1} s",
        message(0, 0).len()
    );
    println!("processor      {:.1} % of one core", 100.0 * cpu / wall);
    println!(
        "memory         {} MB resident at most",
        peak_kilobytes(recorder.id())? / 1024
    );
    link.close();
    Ok(count)
}

fn wait_for(link: &Link) -> Result<(), Failure> {
    let presence = Observer::of_presence(link)?;
    while let Some(sighting) = presence.next(Duration::from_secs(20)) {
        if let Sighting::Presence {
            peer: NodeName::Recorder,
            alive: true,
        } = sighting
        {
            return Ok(());
        }
    }
    Err("the recorder does not come up".into())
}

/// What became of what was sent.
struct Kept {
    messages: u64,
    dropped: u64,
}

fn kept(session: &Path) -> Result<Kept, Failure> {
    let bytes = std::fs::read(session)?;
    let summary = mcap::Summary::read(&bytes)?.ok_or("the file has no index")?;
    let statistics = summary.stats.ok_or("the file has no statistics")?;
    // One message on one of these channels for each that was sent; a state has others besides.
    let sent = summary.channels.values().filter(|channel| {
        let is_part = channel.topic.contains("/journal/") && !channel.topic.ends_with("/recorder");
        is_part || channel.topic.ends_with("/state") || channel.topic.ends_with("/setpoint")
    });
    let counts = sent.filter_map(|channel| statistics.channel_message_counts.get(&channel.id));
    let messages = counts.sum();
    let counts = summary
        .metadata_indexes
        .iter()
        .rfind(|index| index.name == "tandem.counts");
    let counts = mcap::read::metadata(&bytes, counts.ok_or("the file has no counts")?)?;
    let dropped = counts
        .metadata
        .get("dropped.session_file")
        .ok_or("the counts do not say")?;
    let dropped = dropped.parse()?;
    Ok(Kept { messages, dropped })
}

/// A journal's part of exactly so many bytes; half of them are like a number's, which do not compress.
fn message(stream: usize, number: u64) -> Vec<u8> {
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
    let now = Clock::of_process().now();
    let entry = JournalEntry {
        at: Stamp(number),
        wall: now,
        what,
    };
    let header = Header {
        tick: 0,
        session: Session(1 + stream as u64),
        seq: Seq(number + 1),
        sent: now,
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

/// User and system time; Linux counts them in hundredths.
fn cpu_seconds(process: u32) -> Result<f64, Failure> {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat"))?;
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    let ticks: f64 = fields
        .skip(11)
        .take(2)
        .filter_map(|field| field.parse::<f64>().ok())
        .sum();
    Ok(ticks / 100.0)
}

fn peak_kilobytes(process: u32) -> Result<u64, Failure> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status"))?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let number = line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok());
    Ok(number.ok_or("no VmHWM")?)
}
