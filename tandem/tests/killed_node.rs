//! A node is killed and started again while five processes run; the recording still proves what each of them did.

mod process;

use std::process::Command;

use process::Process;
use process::loops::{Watch, free_port};
use serde_json::Value;
use tandem_wire::{Envelope, Forecast, NodeName, Proposal, Session, Topic};

/// Waits for so many proposals of any run but `not`, and says whose run the last one was.
fn until_proposed(watch: &Watch, count: usize, not: Option<Session>) -> Session {
    let mut seen = 0;
    let enough = |proposal: &Envelope<Proposal>| {
        seen += usize::from(Some(proposal.header.session) != not);
        seen >= count
    };
    watch.until("a proposal", Topic::Proposal, enough).header.session
}

#[test]
#[cfg(unix)]
fn a_killed_and_restarted_predictor_is_identical_up_to_its_last_entry() {
    let folder = tempfile::tempdir().expect("a folder");
    let session = folder.path().join("killed.mcap");
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let connect = ["--robot", "killed", "--connect", endpoint.as_str()];

    // The recorder is there before anybody has something to say, so that every journal is whole.
    let path = session.to_str().expect("a plain path");
    let recorder = Process::start(&["recorder", "--record", path, "--robot", "killed", "--listen", &endpoint]);
    let watch = Watch::new("killed", &endpoint);
    watch.until_alive(NodeName::Recorder);
    let start = |command: &str| Process::start(&[&[command], &connect[..]].concat());
    let predictor = start("predictor");
    // One that comes when the human is past the checkpoint forecasts nothing.
    watch.until_alive(NodeName::Predictor);
    let others = ["robot-sim", "arbiter", "operator"].map(|name| (name, start(name)));

    watch.until("a forecast", Topic::Forecast, |_: &Envelope<Forecast>| true);
    let first = until_proposed(&watch, 10, None);
    predictor.kill();
    let again = start("predictor");
    until_proposed(&watch, 50, Some(first));
    drop(watch);
    for (name, process) in [("predictor", again)]
        .into_iter()
        .chain(others)
        .chain([("recorder", recorder)])
    {
        assert_eq!(process.end(), Some(0), "{name} ends cleanly");
    }

    let verified = Command::new(env!("CARGO_BIN_EXE_tandem"))
        .args(["replay", "--verify", "--json", path])
        .output()
        .expect("tandem starts");
    let errors = String::from_utf8_lossy(&verified.stderr);
    let said: Value =
        serde_json::from_slice(&verified.stdout).unwrap_or_else(|error| panic!("no JSON ({error}): {errors}"));
    assert_eq!(verified.status.code(), Some(0), "{said}");
    let runs = said["nodes"].as_array().expect("runs");
    assert!(runs.iter().all(|run| run["verdict"] == "identical"), "{said}");
    let of = |node: &str| runs.iter().filter(|run| run["node"] == node).collect::<Vec<_>>();
    let (killed, stopped): (Vec<_>, Vec<_>) = of("predictor").into_iter().partition(|run| run["stopped"] == false);
    assert_eq!(
        (killed.len(), stopped.len()),
        (1, 1),
        "one was killed, one ended: {said}"
    );
    assert!(killed[0]["outputs"].as_u64() > Some(50), "{said}");
    for node in ["operator", "arbiter", "robot-sim"] {
        assert_eq!(of(node).len(), 1, "{node} ran once: {said}");
    }
}
