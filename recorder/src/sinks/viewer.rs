//! A live viewer as a sink: found, or started, and watched from a thread that may hang with it.

use std::any::Any;
use std::net::{SocketAddr, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

use rerun::sink::{GrpcSink, GrpcSinkConnectionState};
use tandem_wire::Timing;

use super::feed::{Shared, Sink};
use super::rerun_stream::StreamSink;
use super::{Drops, Notice};
use crate::heard::Heard;
use crate::session_file::Provenance;

/// Where a viewer of this machine listens.
const LOCAL: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 9876);
/// A local port answers or refuses at once.
const PROBE: Duration = Duration::from_millis(200);
/// The viewer's executable.
const RERUN: &str = if cfg!(windows) { "rerun.exe" } else { "rerun" };

/// How many flushes nobody may answer before we say so; the SDK goes on trying.
const PATIENCE: u32 = 4;

/// ```text
///            begin                    first answer             connection lost
///   Wanted ─────────▶ Connecting ───────────────────▶ Connected ──────────────▶ Gone: a Notice, and no more tries
///      │                 │    ▲
///      │                 └────┘ nobody answers: a Notice
///      └─ none to start: a Notice
/// ```
///
/// A viewer that is frozen stays `Connected`: the SDK's buffers fill, this thread hangs, the queue overflows.
pub(super) struct ViewerSink {
    wanted: Wanted,
    timing: Timing,
    provenance: Provenance,
    shared: Arc<Shared>,
    connection: Option<Connection>,
}

enum Wanted {
    At(String),
    OnThisMachine,
}

struct Connection {
    url: String,
    sink: StreamSink,
    status: Arc<AtomicU8>,
    unanswered: u32,
    shared: Arc<Shared>,
    /// The viewer that we started, until it has answered.
    child: Option<Child>,
}

impl ViewerSink {
    /// A viewer at this address.
    pub(super) const fn connect(url: String, timing: Timing, provenance: Provenance, shared: Arc<Shared>) -> Self {
        Self {
            wanted: Wanted::At(url),
            timing,
            provenance,
            shared,
            connection: None,
        }
    }

    /// The viewer of this machine, started if need be.
    pub(super) const fn spawn(timing: Timing, provenance: Provenance, shared: Arc<Shared>) -> Self {
        Self {
            wanted: Wanted::OnThisMachine,
            timing,
            provenance,
            shared,
            connection: None,
        }
    }
}

impl Sink for ViewerSink {
    fn begin(&mut self) -> Result<(), Notice> {
        let (url, child) = match &self.wanted {
            Wanted::At(url) => (url.clone(), None),
            Wanted::OnThisMachine => (format!("rerun+http://{LOCAL}/proxy"), find_or_start()?),
        };
        let sink = StreamSink::connect(&url, self.timing, &self.provenance).map_err(|error| Notice::Failed {
            sink: "the live view".to_owned(),
            why: error.to_string(),
        })?;
        let connection = self.connection.insert(Connection {
            url,
            sink,
            status: Arc::new(AtomicU8::new(CONNECTING)),
            unanswered: 0,
            shared: Arc::clone(&self.shared),
            child,
        });
        connection.sink.begin()
    }

    fn take(&mut self, heard: &Heard, drops: Drops) -> Result<(), Notice> {
        match &mut self.connection {
            Some(connection) => connection.sink.take(heard, drops),
            None => Ok(()),
        }
    }

    fn flush(&mut self) -> Result<(), Notice> {
        match &mut self.connection {
            Some(connection) => connection.watch(),
            None => Ok(()),
        }
    }

    fn close(self) -> Result<(), Notice> {
        match self.connection {
            Some(connection) => connection.sink.close(),
            None => Ok(()),
        }
    }
}

const CONNECTING: u8 = 0;
const CONNECTED: u8 = 1;
const GONE: u8 = 2;

impl Connection {
    /// Looks at what the SDK's thread last said about the connection, and asks it anew.
    fn watch(&mut self) -> Result<(), Notice> {
        match self.status.load(Ordering::Relaxed) {
            CONNECTED => self.child = None,
            GONE => return Err(Notice::ViewerGone { url: self.url.clone() }),
            _ => self.wait_for_answer()?,
        }
        let status = Arc::clone(&self.status);
        let asked = move |sink: &dyn rerun::sink::LogSink| {
            let sink: &dyn Any = sink;
            if let Some(grpc) = sink.downcast_ref::<GrpcSink>() {
                status.store(
                    match grpc.status() {
                        GrpcSinkConnectionState::Connecting { .. } => CONNECTING,
                        GrpcSinkConnectionState::Connected => CONNECTED,
                        GrpcSinkConnectionState::Disconnected(_) => GONE,
                    },
                    Ordering::Relaxed,
                );
            }
        };
        self.sink.stream().inspect_sink(asked);
        Ok(())
    }

    fn wait_for_answer(&mut self) -> Result<(), Notice> {
        self.unanswered += 1;
        if self.unanswered == PATIENCE && self.child.is_none() {
            let url = self.url.clone();
            self.shared.say(Notice::ViewerSilent { url });
        }
        let ended = self.child.as_mut().and_then(|child| child.try_wait().ok().flatten());
        match ended {
            // The `rerun` command may hand over to another process and end well.
            Some(status) if !status.success() => Err(Notice::ViewerFailed {
                why: status.to_string(),
            }),
            _ => Ok(()),
        }
    }
}

/// Starts a viewer unless one listens already.
fn find_or_start() -> Result<Option<Child>, Notice> {
    if TcpStream::connect_timeout(&LOCAL, PROBE).is_ok() {
        return Ok(None);
    }
    let program = find_on_path().ok_or(Notice::NoViewer)?;
    let mut command = Command::new(program);
    command
        .arg("--port")
        .arg(LOCAL.port().to_string())
        .arg("--bind")
        .arg(LOCAL.ip().to_string());
    command.args(["--hide-welcome-screen", "--expect-data-soon"]);
    // What the viewer prints would land in the middle of our own screen.
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    #[cfg(unix)]
    {
        // Ctrl-C ends us, not the window in which one still looks at what happened.
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
    }
    let started = command
        .spawn()
        .map_err(|error| Notice::ViewerFailed { why: error.to_string() })?;
    Ok(Some(started))
}

fn find_on_path() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|folder| folder.join(RERUN))
        .find(|program| program.is_file())
}
