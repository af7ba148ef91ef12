//! The files under deploy/: read with the program's own settings, and two of them run, on loopback, with certificates.

#![cfg(unix)]

mod process;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use process::Process;
use tandem_link::net::free_port;
use tandem_link::{Link, LinkSettings, Network, Reach};
use tandem_settings::Document;
use tandem_site::{Authority, NewMember, Robots, Role, Validity};
use tandem_trials::Configuration;
use tandem_wire::{Scene, State, Topic, decode};

fn deploy() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy")
}

/// Every file below a folder whose name ends so.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|own| own == extension) {
            found.push(path);
        }
    }
    found
}

fn configuration(path: &Path, text: &str) -> Configuration {
    let document = Document::parse(&path.display().to_string(), text).expect("TOML");
    Configuration::from_document(&document).unwrap_or_else(|why| panic!("{why}"))
}

#[test]
fn every_file_is_read_by_the_real_settings_and_exposes_nothing() {
    let files = files(&deploy(), "toml");
    assert!(files.len() >= 11, "{files:?}");
    for path in files {
        let text = fs::read_to_string(&path).expect("text");
        let mut link = configuration(&path, &text).link;
        assert!(!link.insecure, "{}", path.display());
        assert!(!link.site.is_empty(), "{} uses certificates", path.display());
        // The same without its certificates must not be let out.
        link.site.clear();
        let reach = Reach::new(&link, None);
        assert_eq!(
            reach.is_err(),
            link.listen.iter().any(|at| at.contains("0.0.0.0")),
            "{}",
            path.display()
        );
    }
}

#[test]
fn every_unit_starts_a_command_that_there_is() {
    let units = files(&deploy(), "service");
    assert_eq!(units.len(), 2);
    for path in units {
        let text = fs::read_to_string(&path).expect("text");
        let start = text
            .lines()
            .find(|line| line.starts_with("ExecStart="))
            .expect("a command");
        let mut words = start
            .split_whitespace()
            .skip_while(|word| !word.ends_with("bin/tandem"))
            .skip(1);
        let command = words.next().expect("a subcommand");
        for command in if command == "%i" {
            vec!["router", "robot-sim", "arbiter", "predictor"]
        } else {
            vec![command]
        } {
            let help = Process::output(&[command, "--help"]);
            assert!(help.status.success(), "{command}");
            let help = String::from_utf8_lossy(&help.stdout).into_owned();
            for flag in start.split_whitespace().filter(|word| word.starts_with("--")) {
                assert!(help.contains(flag), "{command} has no {flag}");
            }
        }
    }
}

/// A site, and the files of deploy/ as they are on loopback.
struct Bench {
    folder: tempfile::TempDir,
    /// The port of whoever stands for a host of the files.
    ports: Vec<(&'static str, u16)>,
}

impl Bench {
    fn new(hosts: &[&'static str]) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let mut authority = Authority::new(&folder.path().join("lab"), "lab".parse().expect("a name")).expect("a site");
        for role in Role::ALL {
            let new = NewMember {
                name: role.as_str().parse().expect("a name"),
                role,
                robots: Robots::All,
                hosts: vec![],
                validity: Validity::days(1),
            };
            authority.issue(new).expect("a certificate");
        }
        let ports = hosts.iter().map(|host| (*host, free_port().expect("a port"))).collect();
        Self { folder, ports }
    }

    fn port(&self, host: &str) -> u16 {
        let found = self.ports.iter().find(|(known, _)| *known == host);
        found.unwrap_or_else(|| panic!("{host} stands for something")).1
    }

    /// A file with every address replaced: those in `listens` are what this file listens on.
    fn file(&self, name: &str, listens: &str) -> String {
        let mut text = fs::read_to_string(deploy().join(name)).expect("a file of deploy/");
        for (host, port) in &self.ports {
            text = text.replace(&format!("{host}:7447"), &format!("127.0.0.1:{port}"));
        }
        if !listens.is_empty() {
            let own = format!("127.0.0.1:{}", self.port(listens));
            text = text.replace("0.0.0.0:7447", &own);
        }
        let site = self.folder.path().join("lab");
        text = text.replace("/etc/tandem/lab", site.to_str().expect("a plain path"));
        assert!(!text.contains("7447\""), "every address was replaced: {text}");
        let path = self.folder.path().join(name.replace('/', "-"));
        fs::write(&path, text).expect("written");
        path.to_str().expect("a plain path").to_owned()
    }

    fn start(command: &str, config: &str) -> Process {
        Process::start(&[command, "--config", config])
    }

    /// Waits, as a viewer who dials `host`, until the simulated human has brought the tool to the goal.
    fn wait_for_the_goal(&self, host: &str) {
        let settings = LinkSettings {
            connect: vec![format!("tcp/127.0.0.1:{}", self.port(host))],
            site: self.folder.path().join("lab").to_str().expect("a plain path").into(),
            ..LinkSettings::default()
        };
        let link = Link::open_as(&settings, Some(Role::Viewer)).expect("a viewer is let in");
        let network = Network::watch(&link, &["*".into()], &[Topic::Scene, Topic::State]).expect("a watch");
        let limit = Instant::now() + Duration::from_secs(90);
        let (mut goal, mut last) = (None, None);
        while Instant::now() < limit {
            let Some(noticed) = network.next(Duration::from_secs(5)) else {
                continue;
            };
            match noticed.topic {
                Topic::Scene => {
                    goal = decode::<Scene>(&noticed.bytes)
                        .ok()
                        .map(|scene| (scene.body.goal, scene.body.goal_tolerance.0))
                }
                Topic::State => last = decode::<State>(&noticed.bytes).ok().map(|state| state.body),
                _ => {}
            }
            if let (Some((goal, tolerance)), Some(state)) = (goal, last)
                && state.at_rest
                && state.trial > 0
                && (state.tool.position - goal).norm() <= tolerance
            {
                link.close();
                return;
            }
        }
        panic!("not at the goal after 90 s; the last state was {last:?}");
    }
}

#[test]
fn on_one_local_network_the_robot_listens_and_the_others_dial_it() {
    let bench = Bench::new(&["192.0.2.10"]);
    let others = bench.file("lan/others.toml", "");
    let robot = bench.file("lan/robot.toml", "192.0.2.10");
    let mut processes = vec![Bench::start("robot-sim", &robot)];
    processes.extend(["arbiter", "predictor", "operator"].map(|node| Bench::start(node, &others)));
    bench.wait_for_the_goal("192.0.2.10");
    for process in processes.into_iter().rev() {
        assert_eq!(process.end(), Some(0));
    }
}

#[test]
fn through_a_router_in_the_middle_and_one_at_the_edge_the_operator_drives_from_afar() {
    let bench = Bench::new(&["router.example", "127.0.0.1"]);
    let middle = bench.file("router/router.toml", "router.example");
    let edge_router = bench.file("router/edge-router.toml", "");
    let edge = bench.file("nat/edge.toml", "");
    let operator = bench.file("router/operator.toml", "");
    let mut processes = vec![Bench::start("router", &middle), Bench::start("router", &edge_router)];
    processes.extend(["robot-sim", "arbiter", "predictor"].map(|node| Bench::start(node, &edge)));
    processes.push(Bench::start("operator", &operator));
    bench.wait_for_the_goal("router.example");
    for process in processes.into_iter().rev() {
        assert_eq!(process.end(), Some(0));
    }
}
