//! What lies on this machine: certificates, ports, disk, viewer.

use std::net::{TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tandem_link::reach::{is_loopback, place};
use tandem_link::{LinkSettings, Reach};
use tandem_recorder::{Live, RecorderSettings};
use tandem_site::{CA_KEY, Certificate, Member, Role, Site, SiteError};
use tandem_trials::Configuration;

use super::check::Check;
use crate::keys::SOON;

/// Less than this, and a recording will not come far.
const LEAST_MIB: u64 = 256;
/// Less than this is worth a word.
const LITTLE_MIB: u64 = 4096;
/// The Rerun that the recordings are made for.
const RERUN: &str = "0.36";

/// The certificates of this machine: whole, closed to others, good for how long.
pub(super) fn certificates(settings: &LinkSettings, role: Option<Role>) -> Vec<Check> {
    const NAME: &str = "certificates";
    if settings.site.is_empty() {
        return vec![match settings.insecure {
            true => Check::worth(
                NAME,
                "none, and link.insecure is set: whoever reaches a port can command the robot",
                "make some with tandem keys new, and start every node with --site",
            ),
            false if settings.connect.iter().any(|endpoint| !is_loopback(endpoint)) => Check::worth(
                NAME,
                "none: what is said to other machines can be read on the way, and forged",
                "tandem keys new, on the machine that listens; then --site everywhere",
            ),
            false => Check::good(NAME, "none: nothing listens beyond this machine"),
        }];
    }
    let site = match Site::open(Path::new(&settings.site)) {
        Ok(site) => site,
        Err(why) => return vec![refused(&why)],
    };
    let mut checks = vec![authority(&site)];
    if let Some(role) = role
        && site.folder().join(CA_KEY).exists()
    {
        checks.push(Check::worth(
            NAME,
            format!("{CA_KEY} lies here: whoever breaks into this {role} can make anybody anything"),
            format!("tandem keys copy makes a folder without it; keep {CA_KEY} elsewhere"),
        ));
    }
    let here = |member: &&Member| site.file(member, "key").exists() || site.file(member, "pem").exists();
    let members: Vec<&Member> = site.roster().members.iter().filter(here).collect();
    if members.is_empty() {
        let says = format!("{} holds no member's certificate", site.folder().display());
        checks.push(Check::bad(
            NAME,
            says,
            "tandem keys copy MEMBER makes a folder for one machine",
        ));
    }
    checks.extend(members.into_iter().map(|member| certificate(&site, member)));
    checks
}

fn authority(site: &Site) -> Check {
    let read = site.ca_pem().map(|pem| Certificate::from_pem(pem.as_bytes()));
    match read {
        Err(why) => refused(&why),
        Ok(None) => Check::bad("certificates", "ca.pem holds no certificate", "copy it again"),
        Ok(Some(certificate)) if certificate.days_left() < SOON => Check::bad(
            "certificates",
            format!(
                "the authority of site {} ends on {}",
                site.roster().site,
                certificate.expires()
            ),
            "make a new site with tandem keys new, and give everybody new certificates",
        ),
        Ok(Some(certificate)) => Check::good(
            "certificates",
            format!("site {}, authority until {}", site.roster().site, certificate.expires()),
        ),
    }
}

fn certificate(site: &Site, member: &Member) -> Check {
    match site.check(member.clone()) {
        Err(why) => refused(&why),
        Ok(identity) => {
            let says = format!(
                "{} is {} of {}, good until {}",
                member.common_name, member.role, member.robots, member.expires
            );
            match identity.certificate.days_left() {
                days if days < SOON => Check::worth(
                    "certificates",
                    format!("{says}: {days} days"),
                    format!(
                        "tandem keys revoke {0}, then tandem keys issue {1} --name {0}",
                        member.name, member.role
                    ),
                ),
                _ => Check::good("certificates", says),
            }
        }
    }
}

/// A site's refusal says what to do after its last colon or semicolon.
fn refused(why: &SiteError) -> Check {
    let said = why.to_string();
    match said.rsplit_once("; ").or_else(|| said.rsplit_once(": ")) {
        Some((says, todo)) => Check::bad("certificates", says, todo),
        None => Check::bad("certificates", said, "tandem keys show lists what there is"),
    }
}

/// Whether the ports are free on which this machine shall listen.
pub(super) fn ports(reach: &Reach) -> Vec<Check> {
    let places = reach
        .listen
        .iter()
        .filter_map(|endpoint| Some((endpoint, place(endpoint)?)));
    places
        .map(|(endpoint, place)| {
            let bound = match endpoint.starts_with("udp/") {
                true => UdpSocket::bind(place).map(drop),
                false => TcpListener::bind(place).map(drop),
            };
            match bound {
                Ok(()) => Check::good("port", format!("{endpoint} is free")),
                Err(error) if error.kind() == std::io::ErrorKind::AddrInUse => Check::worth(
                    "port",
                    format!("{endpoint} is taken"),
                    "right if a node of yours runs there now; else end that program or choose another port",
                ),
                Err(error) => Check::bad(
                    "port",
                    format!("cannot listen on {endpoint}: {error}"),
                    "use an address of this machine (0.0.0.0 for all), and a port from 1024 on",
                ),
            }
        })
        .collect()
}

/// Room where recordings and journals go.
pub(super) fn disk(configuration: &Configuration) -> Vec<Check> {
    let recordings = Path::new(&configuration.recorder.path).parent();
    let recordings = recordings.filter(|folder| !folder.as_os_str().is_empty());
    let recordings = recordings.map_or_else(|| PathBuf::from("."), Path::to_path_buf);
    let spool = match configuration.link.spool.as_str() {
        "" => std::env::temp_dir(),
        folder => PathBuf::from(folder),
    };
    let mut checks = vec![room("recordings", &recordings)];
    if configuration.link.spool_mib > 0 {
        checks.push(room("journals", &spool));
    }
    checks
}

fn room(what: &str, folder: &Path) -> Check {
    let shown = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let shown = shown.display();
    match free_mib(folder) {
        None => Check::skipped("disk", format!("cannot tell how much room {shown} has for {what}")),
        Some(Err(error)) => Check::bad(
            "disk",
            format!("{shown} cannot be used for {what}: {error}"),
            "create the folder",
        ),
        Some(Ok(free)) => {
            let says = format!("{free} MiB free for {what} in {shown}");
            match free {
                ..LEAST_MIB => Check::bad("disk", says, "free some, or record elsewhere"),
                LEAST_MIB..LITTLE_MIB => {
                    Check::worth("disk", says, "recorder.split_mb keeps parts small; move old ones away")
                }
                _ => Check::good("disk", says),
            }
        }
    }
}

#[cfg(unix)]
fn free_mib(folder: &Path) -> Option<std::io::Result<u64>> {
    let found = rustix::fs::statvfs(folder).map_err(std::io::Error::from);
    Some(found.map(|found| found.f_bavail.saturating_mul(found.f_frsize) >> 20))
}

#[cfg(not(unix))]
fn free_mib(_: &Path) -> Option<std::io::Result<u64>> {
    None
}

/// The Rerun viewer: the one that the recorder shall stream to, or the one on PATH.
pub(super) fn viewer(recorder: &RecorderSettings) -> Check {
    if recorder.live == Live::Connect {
        let url = &recorder.viewer;
        return match tandem_recorder::is_viewer_listening(url) {
            true => Check::good("viewer", format!("somebody answers at {url}")),
            false => Check::worth(
                "viewer",
                format!("nobody answers at {url}, recorder.viewer: the session is recorded, and not seen live"),
                "start rerun there and let its port through, or set recorder.viewer; the recorder goes on trying",
            ),
        };
    }
    on_path()
}

fn on_path() -> Check {
    let get = format!("pip install rerun-sdk=={RERUN}.3, where somebody wants to watch");
    let Some(program) = tandem_recorder::find_viewer() else {
        return Check::worth("viewer", "no rerun on PATH", get);
    };
    let asked = Command::new(&program).arg("--version").stdin(Stdio::null()).output();
    let said = asked
        .map(|output| String::from_utf8_lossy(&output.stdout).into_owned())
        .unwrap_or_default();
    let first = said
        .lines()
        .next()
        .unwrap_or("it does not tell its version")
        .trim()
        .to_owned();
    let says = format!("{}: {first}", program.display());
    // A viewer reads its own version's recordings, and those before it.
    match first.split([' ', 'v']).any(|word| word.starts_with(RERUN)) {
        true => Check::good("viewer", says),
        false => Check::worth("viewer", says, get),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::check::Verdict;

    #[test]
    fn a_viewer_that_the_recorder_shall_stream_to_is_knocked_at() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let port = listener.local_addr().expect("an address").port();
        let recorder = RecorderSettings {
            live: Live::Connect,
            viewer: format!("rerun+http://127.0.0.1:{port}/proxy"),
            ..RecorderSettings::default()
        };
        assert_eq!(viewer(&recorder).verdict, Verdict::Good);
        drop(listener);
        let absent = viewer(&recorder);
        assert_eq!(absent.verdict, Verdict::Worth);
        assert!(absent.todo.expect("advice").contains("start rerun there"));
    }

    #[test]
    fn a_port_that_is_taken_is_said_and_no_obstacle() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let endpoint = format!("tcp/{}", listener.local_addr().expect("an address"));
        let reach = Reach {
            listen: vec![endpoint],
            connect: vec![],
            secured: None,
        };
        let [taken] = &ports(&reach)[..] else {
            panic!("one port");
        };
        assert_eq!(taken.verdict, Verdict::Worth);
        assert!(taken.todo.as_ref().expect("advice").contains("end that program"));
        drop(listener);
        assert_eq!(ports(&reach)[0].verdict, Verdict::Good);
    }
}
