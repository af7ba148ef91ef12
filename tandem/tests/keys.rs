//! `tandem keys` and its friends as a person at a shell meets them: what is printed, what is refused, how it ends.

#![cfg(unix)]

mod process;

use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use process::Process;
use serde_json::Value;
use tandem_link::net::free_port;
use tandem_link::{Link, LinkError, LinkSettings, Observer, Sighting};
use tandem_wire::{Envelope, Pace, Reason, Session, State, Topic, decode};

const LIMIT: Duration = Duration::from_secs(30);

/// A folder in which commands are run, with a site "lab".
struct Desk(tempfile::TempDir);

impl Desk {
    fn new() -> Self {
        let desk = Self(tempfile::tempdir().expect("a folder"));
        let (code, said, _) = desk.run(&["keys", "new", "--site", "lab", "--out", &desk.path("lab")]);
        assert_eq!(code, Some(0), "{said}");
        desk
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().expect("a plain path").to_owned()
    }

    /// Exit code, standard output, standard error.
    fn run(&self, arguments: &[&str]) -> (Option<i32>, String, String) {
        let output = Process::output(arguments);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.code(), text(&output.stdout), text(&output.stderr))
    }

    fn on_site(&self, arguments: &[&str]) -> (Option<i32>, String, String) {
        self.run(&[arguments, &["--site", &self.path("lab")]].concat())
    }

    fn json(&self, arguments: &[&str]) -> (Option<i32>, Value) {
        let (code, said, why) = self.on_site(arguments);
        (
            code,
            serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}{why}")),
        )
    }
}

#[test]
fn a_site_is_made_shown_added_to_and_never_overwritten() {
    let desk = Desk::new();
    let (code, _, why) = desk.run(&["keys", "new", "--site", "lab", "--out", &desk.path("lab")]);
    assert_eq!(code, Some(1));
    assert!(why.contains("never overwritten"), "{why}");
    let (code, said, _) = desk.on_site(&["keys", "issue", "operator", "--name", "desk", "--robots", "left,right"]);
    assert!(
        code == Some(0) && said.contains("desk is operator of left, right"),
        "{said}"
    );
    let (code, shown) = desk.json(&["keys", "show", "--json"]);
    assert_eq!(code, Some(0));
    let members = shown["members"].as_array().expect("members");
    let roles: Vec<&str> = members.iter().filter_map(|member| member["role"].as_str()).collect();
    let all = [
        "operator",
        "supervisor",
        "predictor",
        "arbiter",
        "robot-sim",
        "recorder",
        "viewer",
        "router",
        "operator",
    ];
    assert_eq!(roles, all);
    assert!(
        members.iter().all(|member| member["condition"] == "good"
            && member["fingerprint"].as_str().is_some_and(|text| text.len() == 64))
    );
    assert_ne!(
        members[2]["common_name"], members[3]["common_name"],
        "arbiter and robot are told apart"
    );
    for (arguments, words) in [
        (&["keys", "issue", "king"][..], "is no role"),
        (
            &["keys", "issue", "operator", "--name", "a/b"],
            "cannot name a site or a member",
        ),
        (
            &["keys", "issue", "operator", "--name", "ca"],
            "cannot name a site or a member",
        ),
        (
            &["keys", "issue", "viewer", "--name", "v", "--days", "0"],
            "0 is not in 1..=3650",
        ),
    ] {
        let (code, _, why) = desk.on_site(arguments);
        assert_eq!(code, Some(2), "{why}");
        assert!(why.contains(words), "{why}");
    }
    let (code, _, why) = desk.on_site(&["keys", "issue", "operator", "--name", "b", "--robots", "a*"]);
    assert!(code == Some(1) && why.contains("cannot name a robot"), "{why}");
}

#[test]
fn a_key_that_others_can_read_and_a_folder_that_lacks_a_file_are_refused_like_ssh_does() {
    let desk = Desk::new();
    let key = PathBuf::from(desk.path("lab/operator.key"));
    std::fs::set_permissions(&key, std::fs::Permissions::from_mode(0o644)).expect("chmod");
    let (code, _, why) = desk.on_site(&["operator", "--connect", "tcp/127.0.0.1:9"]);
    assert_eq!(code, Some(1));
    assert!(
        why.contains("permissions 0644") && why.contains("too open") && why.contains("chmod 600"),
        "{why}"
    );
    assert_eq!(desk.on_site(&["keys", "show"]).0, Some(1));
    let (code, told) = desk.json(&["doctor", "--json", "--connect", "tcp/127.0.0.1:9"]);
    assert!(code == Some(1) && told["ok"] == false, "{told}");
    let findings = told["checks"].as_array().expect("checks");
    let bad: Vec<&Value> = findings.iter().filter(|check| check["verdict"] == "bad").collect();
    assert!(
        bad.iter()
            .any(|check| check["todo"].as_str().is_some_and(|todo| todo.contains("chmod 600"))),
        "{bad:?}"
    );
    assert!(
        bad.iter().all(|check| check["todo"].is_string()),
        "each says what to do: {bad:?}"
    );

    std::fs::remove_file(&key).expect("removed");
    let (code, _, why) = desk.on_site(&["operator", "--member", "operator"]);
    assert!(code == Some(1) && why.contains("operator.key is missing"), "{why}");
    let (code, _, why) = desk.run(&["arbiter", "--site", &desk.path("nowhere")]);
    assert!(code == Some(2) && why.contains("tandem keys new"), "{why}");
}

#[test]
fn nothing_listens_beyond_this_machine_without_certificates_wherever_it_is_written() {
    let desk = Desk::new();
    let config = desk.path("tandem.toml");
    for endpoint in ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "udp/192.0.2.1:7447"] {
        std::fs::write(&config, format!("[link]\nlisten = [{endpoint:?}]\n")).expect("written");
        for node in ["robot-sim", "arbiter", "router"] {
            let (code, _, why) = desk.run(&[node, "--config", &config]);
            assert_eq!(code, Some(2), "{node}: {why}");
            assert!(why.contains("refusing to listen") && why.contains("--site"), "{why}");
        }
    }
    let (code, _, why) = desk.on_site(&["operator", "--listen", "tcp/127.0.0.1:7447"]);
    assert!(code == Some(2) && why.contains("may not listen"), "{why}");
}

#[test]
fn what_zenoh_is_told_denies_by_default_and_names_no_secret() {
    let desk = Desk::new();
    let (code, told) = desk.json(&["keys", "config", "router", "--listen", "tcp/0.0.0.0:7447"]);
    assert_eq!(code, Some(0));
    assert_eq!(told["access_control"]["default_permission"], "deny");
    assert_eq!(told["transport"]["link"]["tls"]["enable_mtls"], true);
    assert_eq!(told["transport"]["link"]["tls"]["verify_name_on_connect"], true);
    assert_eq!(told["listen"]["endpoints"][0], "tls/0.0.0.0:7447");
    assert!(!told.to_string().contains("PRIVATE KEY"));
    let (_, told) = desk.json(&["keys", "config", "viewer"]);
    assert_eq!(told["mode"], "client");
}

fn link(site: &Path, port: u16, member: &str) -> Result<Link, LinkError> {
    Link::open(&LinkSettings {
        site: site.to_str().expect("a plain path").into(),
        connect: vec![format!("tcp/127.0.0.1:{port}")],
        member: member.into(),
        ..LinkSettings::default()
    })
}

/// Says a command as `speaker` and an emergency stop as `viewer` again and again. Whether the command is heard, or only the
/// emergency stop in twenty rounds in which both were connected.
fn is_heard(speaker: &Link, viewer: &Link, observer: &Observer, patience: u32) -> bool {
    let limit = Instant::now() + LIMIT;
    let mut rounds = 0;
    while rounds < patience {
        assert!(Instant::now() < limit, "the viewer itself is heard through the router");
        speaker.publish(Topic::Command, b"x".to_vec()).expect("published");
        viewer.publish(Topic::Emergency, b"x".to_vec()).expect("published");
        let mut through = false;
        while let Some(sighting) = observer.next(Duration::from_millis(50)) {
            match sighting {
                Sighting::Sample {
                    topic: Topic::Command, ..
                } => return true,
                Sighting::Sample {
                    topic: Topic::Emergency,
                    ..
                } => through = true,
                _ => {}
            }
        }
        rounds += u32::from(through && speaker.is_connected());
    }
    false
}

#[test]
fn a_router_at_work_takes_a_revocation_up_and_the_others_come_back() {
    let desk = Desk::new();
    let port = free_port().expect("a port");
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let (code, _, why) = desk.on_site(&["keys", "copy", "operator", "--out", &desk.path("laptop")]);
    assert_eq!(code, Some(0), "{why}");
    let lab = PathBuf::from(desk.path("lab"));
    let laptop = PathBuf::from(desk.path("laptop"));
    let router = Process::start(&["router", "--site", &desk.path("lab"), "--listen", &endpoint]);
    let viewer = link(&lab, port, "viewer").expect("the router answers");
    let observer = Observer::new(&viewer, Pace::Real).expect("an observer");
    let operator = link(&laptop, port, "operator").expect("it is let in");
    assert!(is_heard(&operator, &viewer, &observer, u32::MAX));

    let (code, said, why) = desk.on_site(&["keys", "revoke", "operator", "--why", "laptop lost"]);
    assert!(
        code == Some(0) && said.contains("every machine that listens"),
        "{said}{why}"
    );
    let limit = Instant::now() + LIMIT;
    let refused = loop {
        assert!(Instant::now() < limit, "the router takes it up");
        match link(&laptop, port, "operator") {
            // While the router opens anew, nobody answers.
            Err(why) if why.to_string().contains("nobody answers") => {}
            Err(why) => break why.to_string(),
            Ok(link) => link.close(),
        }
    };
    assert!(
        refused.contains("revoked on") && refused.contains("laptop lost"),
        "{refused}"
    );
    // The session that was there before comes back as everybody's does, and is not heard.
    assert!(!is_heard(&operator, &viewer, &observer, 20));
    operator.close();
    viewer.close();
    assert_eq!(router.end(), Some(0));
}

/// Waits for a state that is wanted, and gives the run of the robot that it is of.
fn until_state(observer: &Observer, what: &str, mut wanted: impl FnMut(&Envelope<State>) -> bool) -> Session {
    let limit = Instant::now() + 2 * LIMIT;
    let mut last = None;
    while Instant::now() < limit {
        let Some(Sighting::Sample {
            topic: Topic::State,
            bytes,
            ..
        }) = observer.next(Duration::from_secs(1))
        else {
            continue;
        };
        let state = decode::<State>(&bytes).expect("a state");
        if wanted(&state) {
            return state.header.session;
        }
        last = Some(state.body.motion);
    }
    panic!("{what} does not come; the last state says {last:?}");
}

fn is_moving(state: &Envelope<State>) -> bool {
    state.body.motion.is_permitted() && state.body.tool_velocity.norm() > 0.03
}

#[test]
fn an_operator_that_is_revoked_while_it_drives_is_stopped_by_a_robot_that_listens_and_another_may_drive() {
    let desk = Desk::new();
    let port = free_port().expect("a port");
    let (lab, endpoint) = (desk.path("lab"), format!("tcp/127.0.0.1:{port}"));
    for arguments in [
        &["keys", "copy", "operator", "--out", &desk.path("laptop")][..],
        &["keys", "issue", "operator", "--name", "second"],
    ] {
        let (code, _, why) = desk.on_site(arguments);
        assert_eq!(code, Some(0), "{why}");
    }
    let dialling = |node: &str, more: &[&str]| Process::start(&[&[node, "--connect", &endpoint], more].concat());
    let robot = Process::start(&["robot-sim", "--site", &lab, "--listen", &endpoint]);
    let others = ["arbiter", "predictor"].map(|node| dialling(node, &["--site", &lab]));
    let operator = dialling("operator", &["--source", "simulated", "--site", &desk.path("laptop")]);
    let viewer = link(Path::new(&lab), port, "viewer").expect("the robot answers");
    let observer = Observer::new(&viewer, Pace::Real).expect("an observer");
    let before = until_state(&observer, "motion", is_moving);

    let (code, said, why) = desk.on_site(&["keys", "revoke", "operator", "--why", "laptop lost"]);
    assert!(
        code == Some(0) && said.contains("takes it up within seconds"),
        "{said}{why}"
    );
    until_state(&observer, "the end, at rest", |state| {
        state.header.session == before && state.body.at_rest && state.body.motion.reason() == Some(Reason::ShuttingDown)
    });
    let began = Instant::now();
    // It is there again by itself. The revoked operator's program runs on, and is not heard.
    let after = until_state(&observer, "the robot's next run", |state| {
        assert!(
            state.header.session == before || !state.body.motion.is_permitted(),
            "{state:?}"
        );
        state.header.session != before && state.header.seq.0 > 200
    });
    assert!(began.elapsed() < LIMIT, "{:?}", began.elapsed());
    let second = dialling(
        "operator",
        &["--source", "simulated", "--site", &lab, "--member", "second"],
    );
    assert_eq!(until_state(&observer, "motion", is_moving), after);
    viewer.close();
    assert_eq!(second.end(), Some(0));
    operator.kill();
    for process in others.into_iter().chain([robot]) {
        assert_eq!(process.end(), Some(0));
    }
}

#[test]
fn an_emergency_stop_says_what_keeps_it_out_and_comes_through_with_the_sites_certificates() {
    let desk = Desk::new();
    let port = free_port().expect("a port");
    let (lab, endpoint) = (desk.path("lab"), format!("tcp/127.0.0.1:{port}"));
    let robot = Process::start(&["robot-sim", "--site", &lab, "--listen", &endpoint]);
    let viewer = link(Path::new(&lab), port, "viewer").expect("the robot answers");
    let other = desk.path("other");
    assert_eq!(
        desk.run(&["keys", "new", "--site", "other", "--out", &other]).0,
        Some(0)
    );
    for (site, words) in [(&[][..], "--site"), (&["--site", &other], "certificate")] {
        let (code, _, why) = desk.run(&[&["estop", "--connect", &endpoint], site].concat());
        assert_eq!(code, Some(1), "{why}");
        assert!(why.contains("NOT STOPPED") && why.contains(words), "{why}");
    }
    // On the robot's own machine its own file is enough: what listens there is dialled.
    let config = desk.path("robot.toml");
    std::fs::write(&config, format!("[link]\nlisten = [{endpoint:?}]\nsite = {lab:?}\n")).expect("written");
    let (code, said, why) = desk.run(&["estop", "--json", "--config", &config]);
    let told: Value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}{why}"));
    assert_eq!(code, Some(0), "{told}");
    assert!(
        told["at_rest"] == true && told["robot_ms"].is_number() && told["arbiter_ms"].is_null(),
        "{told}"
    );
    let (_, told) = desk.json(&["doctor", "--json", "--config", &config, "--role", "robot-sim"]);
    let checks = told["checks"].as_array().expect("checks");
    for (name, words) in [
        ("port", "taken"),
        ("reach", "robot-sim"),
        ("nodes", "robot-sim"),
        ("versions", "as this one"),
    ] {
        let says = |check: &&Value| check["says"].as_str().is_some_and(|says| says.contains(words));
        assert!(
            checks
                .iter()
                .filter(|check| check["name"] == name)
                .any(|check| says(&check)),
            "{name}: {told}"
        );
    }
    a_roster_that_changes_waits_until_the_stop_is_cleared(&desk, &endpoint, &viewer);
    viewer.close();
    assert_eq!(robot.end(), Some(0));
    let (_, told) = desk.json(&["doctor", "--json", "--config", &config, "--role", "robot-sim"]);
    assert!(told.to_string().contains("nothing runs here yet"), "{told}");
}

/// A run that began anew would not know of the stop.
fn a_roster_that_changes_waits_until_the_stop_is_cleared(desk: &Desk, endpoint: &str, viewer: &Link) {
    let observer = Observer::new(viewer, Pace::Real).expect("an observer");
    let is_stopped = |state: &Envelope<State>| matches!(state.body.motion.reason(), Some(Reason::EmergencyStop { .. }));
    let mut newest = 0;
    let stopped = until_state(&observer, "the stop", |state| {
        newest = state.header.seq.0;
        is_stopped(state)
    });
    let (code, _, why) = desk.on_site(&["keys", "issue", "operator", "--name", "late"]);
    assert_eq!(code, Some(0), "{why}");
    let still = until_state(&observer, "four more seconds of it", |state| {
        assert!(is_stopped(state), "{:?}", state.body.motion);
        state.header.seq.0 > newest + 200
    });
    assert_eq!(still, stopped);
    let clear = |member: &str| {
        let site = desk.path("lab");
        desk.run(&[
            "estop",
            "--clear",
            "--connect",
            endpoint,
            "--site",
            &site,
            "--member",
            member,
        ])
    };
    let (code, _, why) = clear("viewer");
    assert!(
        code != Some(0) && why.contains("operator"),
        "who watches lets nothing go: {why}"
    );
    let (code, _, why) = clear("operator");
    assert_eq!(code, Some(0), "{why}");
    until_state(&observer, "the next run", |state| state.header.session != stopped);
}
