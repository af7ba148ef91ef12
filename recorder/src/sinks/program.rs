//! The `rerun` program of this machine, and who listens where.

use std::net::{SocketAddr, TcpStream, ToSocketAddrs as _};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use rerun::external::re_uri::ProxyUri;

use super::Notice;

/// Where a viewer of this machine listens.
const LOCAL: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 9876);
/// A local port answers or refuses at once; a distant one has this long.
const PROBE: Duration = Duration::from_millis(500);
/// The viewer's executable.
const RERUN: &str = if cfg!(windows) { "rerun.exe" } else { "rerun" };

/// Started with a window.
pub(super) const WINDOW: &[&str] = &["--hide-welcome-screen", "--expect-data-soon"];
/// Started as a server, which viewers and browsers come to; it forgets the oldest beyond its memory.
pub(super) const SERVER: &[&str] = &["--serve-web", "--server-memory-limit", "256MB"];

/// The address of this machine's viewer.
pub(super) fn local_url() -> String {
    format!("rerun+http://{LOCAL}/proxy")
}

/// Whether somebody accepts connections at a viewer's address.
#[must_use]
pub fn is_viewer_listening(url: &str) -> bool {
    let Ok(uri) = url.parse::<ProxyUri>() else {
        return false;
    };
    let host = uri.origin.host.to_string();
    let host = host.trim_matches(['[', ']']);
    let found = (host, uri.origin.port).to_socket_addrs();
    found.is_ok_and(|mut addresses| addresses.any(|address| TcpStream::connect_timeout(&address, PROBE).is_ok()))
}

/// Starts the program unless one listens already.
pub(super) fn find_or_start(flags: &[&str]) -> Result<Option<Child>, Notice> {
    if TcpStream::connect_timeout(&LOCAL, PROBE).is_ok() {
        return Ok(None);
    }
    let program = find_viewer().ok_or(Notice::NoViewer)?;
    let mut command = Command::new(program);
    command
        .arg("--port")
        .arg(LOCAL.port().to_string())
        .arg("--bind")
        .arg(LOCAL.ip().to_string())
        .args(flags);
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

/// The `rerun` program on PATH.
#[must_use]
pub fn find_viewer() -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|folder| folder.join(RERUN))
        .find(|program| program.is_file())
}
