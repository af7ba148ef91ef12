//! The files under deploy/: read with the program's own settings, and every topology run, on loopback, with certificates.

#![cfg(unix)]

mod process;

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use process::Process;
use process::goal::wait_for_the_goal;
use tandem_link::net::free_port;
use tandem_link::{Link, LinkSettings, Reach};
use tandem_settings::Document;
use tandem_site::{Authority, NewMember, Robots, Role, Validity};
use tandem_trials::Configuration;

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
        // Among the temporary files, which are the unit's own, the journals of a node that was killed would go with it.
        let spool = start
            .split("link.spool=")
            .nth(1)
            .and_then(|rest| rest.split_whitespace().next());
        let kept = spool.is_some_and(|spool| spool.starts_with("/var/lib/tandem/"))
            || path.ends_with("tandem-recorder.service");
        assert!(
            kept && text.contains("StateDirectory=tandem"),
            "{}: {spool:?}",
            path.display()
        );
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
        let sites = format!("{}/", self.folder.path().display());
        text = text.replace("/etc/tandem/", &sites);
        assert!(!text.contains("7447\""), "every address was replaced: {text}");
        let path = self.folder.path().join(name.replace('/', "-"));
        fs::write(&path, text).expect("written");
        path.to_str().expect("a plain path").to_owned()
    }

    fn start(command: &str, config: &str) -> Process {
        Process::start(&[command, "--config", config])
    }

    /// Waits, as a viewer who dials `host`, until the simulated human has brought the robot's tool to the goal.
    fn wait_for_the_goal(&self, host: &str, robot: &str) {
        let settings = LinkSettings {
            connect: vec![format!("tcp/127.0.0.1:{}", self.port(host))],
            site: self.folder.path().join("lab").to_str().expect("a plain path").into(),
            ..LinkSettings::default()
        };
        let link = Link::open_as(&settings, Some(Role::Viewer)).expect("a viewer is let in");
        wait_for_the_goal(&link, robot);
        link.close();
    }

    /// Issues a certificate for one robot alone.
    fn issue(&self, role: Role, name: &str, robot: &str) {
        let mut authority = Authority::open(&self.folder.path().join("lab")).expect("the site");
        let new = NewMember {
            name: name.parse().expect("a name"),
            role,
            robots: vec![robot.to_owned()].try_into().expect("a robot"),
            hosts: vec![],
            validity: Validity::days(1),
        };
        authority.issue(new).expect("a certificate");
    }

    /// A folder as it lies on the machine of these members.
    fn carry(&self, to: &str, members: &[&str]) {
        let (lab, folder) = (self.folder.path().join("lab"), self.folder.path().join(to));
        fs::create_dir(&folder).expect("a folder");
        fs::set_permissions(&folder, fs::Permissions::from_mode(0o700)).expect("chmod");
        let own = members
            .iter()
            .flat_map(|name| [format!("{name}.pem"), format!("{name}.key")]);
        for file in own.chain(["site.toml".to_owned(), "ca.pem".to_owned()]) {
            fs::copy(lab.join(&file), folder.join(&file)).expect("copied");
        }
    }
}

/// One site after the other: up to nine processes share the machine as it is.
fn alone() -> MutexGuard<'static, ()> {
    static MACHINE: Mutex<()> = Mutex::new(());
    // Another test's failure is told there.
    MACHINE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// All end by themselves. 3: on a machine that is busy with other things some samples came too late, which is not the matter here.
fn end(processes: Vec<Process>) {
    for process in processes.into_iter().rev() {
        let code = process.end();
        assert!(matches!(code, Some(0 | 3)), "{code:?}");
    }
}

#[test]
fn on_one_local_network_the_robot_listens_and_the_others_dial_it() {
    let _alone = alone();
    let bench = Bench::new(&["192.0.2.10"]);
    let others = bench.file("lan/others.toml", "");
    let robot = bench.file("lan/robot.toml", "192.0.2.10");
    let mut processes = vec![Bench::start("robot-sim", &robot)];
    processes.extend(["arbiter", "predictor", "operator"].map(|node| Bench::start(node, &others)));
    bench.wait_for_the_goal("192.0.2.10", "panda");
    end(processes);
}

#[test]
fn through_a_router_in_the_middle_and_one_at_the_edge_the_operator_drives_from_afar() {
    let _alone = alone();
    let bench = Bench::new(&["router.example", "127.0.0.1"]);
    let middle = bench.file("router/router.toml", "router.example");
    let edge_router = bench.file("router/edge-router.toml", "");
    let edge = bench.file("nat/edge.toml", "");
    let operator = bench.file("router/operator.toml", "");
    let mut processes = vec![Bench::start("router", &middle), Bench::start("router", &edge_router)];
    processes.extend(["robot-sim", "arbiter", "predictor"].map(|node| Bench::start(node, &edge)));
    processes.push(Bench::start("operator", &operator));
    bench.wait_for_the_goal("router.example", "panda");
    end(processes);
}

#[test]
fn an_operator_behind_nat_dials_a_router_at_the_edge() {
    let _alone = alone();
    let mut bench = Bench::new(&["edge.example"]);
    // The edge's own nodes dial the same router on loopback.
    bench.ports.push(("127.0.0.1", bench.port("edge.example")));
    let router = bench.file("nat/edge-router.toml", "edge.example");
    let edge = bench.file("nat/edge.toml", "");
    let operator = bench.file("nat/operator.toml", "");
    let mut processes = vec![Bench::start("router", &router)];
    processes.extend(["robot-sim", "arbiter", "predictor"].map(|node| Bench::start(node, &edge)));
    processes.push(Bench::start("operator", &operator));
    bench.wait_for_the_goal("edge.example", "panda");
    end(processes);
}

#[test]
fn two_operators_of_a_fleet_drive_each_a_robot_of_its_own_and_no_other() {
    let _alone = alone();
    let bench = Bench::new(&["192.0.2.10"]);
    for (robot, desk) in [("left", "desk"), ("right", "second-desk")] {
        bench.issue(Role::Operator, desk, robot);
        for role in [Role::RobotSim, Role::Arbiter, Role::Predictor] {
            bench.issue(role, &format!("{robot}-{role}"), robot);
        }
    }
    let mut processes = vec![Bench::start("router", &bench.file("fleet/router.toml", "192.0.2.10"))];
    for (robot, desk) in [("left", "desk"), ("right", "second-desk")] {
        let nodes = ["robot-sim", "arbiter", "predictor"];
        bench.carry(
            robot,
            &nodes
                .map(|node| format!("{robot}-{node}"))
                .each_ref()
                .map(String::as_str),
        );
        let config = bench.file(&format!("fleet/{robot}.toml"), "");
        processes.extend(nodes.map(|node| Bench::start(node, &config)));
        processes.push(Bench::start("operator", &bench.file(&format!("fleet/{desk}.toml"), "")));
    }
    let astray = [
        "operator",
        "--robot",
        "right",
        "--config",
        &bench.file("fleet/desk.toml", ""),
    ];
    let refused = Process::output(&astray);
    assert_eq!(refused.status.code(), Some(2));
    let why = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(why.contains("right") && why.contains("desk"), "{why}");
    for robot in ["left", "right"] {
        bench.wait_for_the_goal("192.0.2.10", robot);
    }
    end(processes);
}
