//! `tandem estop` and `tandem status` beside a loop that runs, as a script sees them: their JSON, and how they end.

#![cfg(unix)]

mod process;

use process::Process;
use process::loops::Loop;
use serde_json::Value;

/// Exit code, and the one JSON object that was printed.
fn told(robot: &str, endpoint: &str, arguments: &[&str]) -> (Option<i32>, Value) {
    let output = Process::output(&[arguments, &["--json", "--robot", robot, "--connect", endpoint]].concat());
    let why = String::from_utf8_lossy(&output.stderr);
    let said = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("no JSON: {why}"));
    (output.status.code(), said)
}

#[test]
fn an_emergency_stop_outlives_robot_and_arbiter_where_an_operator_saw_it() {
    let mut running = Loop::moving("outlived");
    let endpoint = running.endpoint.clone();
    let (code, said) = told("outlived", &endpoint, &["estop", "--by", "ada"]);
    assert_eq!(code, Some(0), "{said}");
    running.kill("arbiter");
    running.kill("robot-sim");
    running.restart_robot();
    running.start("arbiter");
    let stopped = running.watch.until_stopped_by("operator");
    assert!(stopped.at_rest, "{stopped:?}");
    let (code, said) = told("outlived", &endpoint, &["estop", "--clear"]);
    assert_eq!((code, &said["cleared"]), (Some(0), &Value::Bool(true)), "{said}");
}

#[test]
fn an_emergency_stop_is_acknowledged_by_both_and_holds_until_it_is_cleared() {
    let running = Loop::moving("stopped");
    let run = |arguments: &[&str]| told("stopped", &running.endpoint, arguments);
    let (code, said) = run(&["estop", "--by", "ada"]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said["stopped"] == true && said["at_rest"] == true, "{said}");
    assert!(said["robot_ms"].is_number() && said["arbiter_ms"].is_number(), "{said}");
    let (code, said) = run(&["status"]);
    assert_eq!(code, Some(0), "{said}");
    let robot = &said["robots"][0];
    for who in ["state", "setpoint"] {
        assert_eq!(robot[who]["reason"], "emergency stop by ada", "{robot}");
        assert_eq!(robot[who]["permitted"], false, "{robot}");
    }
    let (code, said) = run(&["estop", "--clear"]);
    assert_eq!((code, &said["cleared"]), (Some(0), &Value::Bool(true)), "{said}");
    assert_eq!(said["stopped_by"], "ada");
    let (code, said) = run(&["estop", "--clear"]);
    assert_eq!((code, &said["in_force"]), (Some(0), &Value::Bool(false)), "{said}");
    assert_eq!(said["cleared"], false);
    let nobody = Process::output(&["estop", "--robot", "nobody", "--connect", &running.endpoint]);
    assert_eq!(nobody.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&nobody.stderr).contains("NOT ACKNOWLEDGED by nobody"));
}

#[test]
fn status_tells_who_is_there_who_drives_how_fast_and_where_the_time_goes() {
    let running = Loop::moving("watched");
    let (mut seen, mut said) = (false, Value::Null);
    // The operator's journal and the clocks come once in a while; two seconds of one look may be too few on a busy machine.
    for _ in 0..10 {
        let (code, one) = told("watched", &running.endpoint, &["status"]);
        assert_eq!(code, Some(0), "{one}");
        seen = one["robots"][0]["hops"]
            .as_array()
            .is_some_and(|hops| hops.iter().any(|hop| hop["hop"] == "state"));
        said = one;
        if seen {
            break;
        }
    }
    let robot = &said["robots"][0];
    assert!(seen, "the way of a state to the operator is told: {robot}");
    assert_eq!(robot["hidden_hops"].as_array().map(Vec::len), Some(0), "{robot}");
    assert_eq!(robot["robot"], "watched");
    let alive: Vec<&str> = robot["alive"]
        .as_array()
        .expect("nodes")
        .iter()
        .filter_map(Value::as_str)
        .collect();
    assert_eq!(alive, ["operator", "predictor", "arbiter", "robot-sim"]);
    assert_eq!(robot["state"]["trial"], 1);
    assert_eq!(
        robot["state"]["permitted"] == false,
        robot["state"]["reason"].is_string(),
        "{robot}"
    );
    assert_eq!(robot["setpoint"]["lease"]["name"], "operator");
    assert!(
        robot["setpoint"]["weight"]
            .as_f64()
            .is_some_and(|weight| (0.0..=1.0).contains(&weight)),
        "{robot}"
    );
    for stream in ["command", "setpoint", "state"] {
        let hz = robot["streams"][stream]["hz"].as_f64().expect("a rate");
        assert!((20.0..=75.0).contains(&hz), "{stream}: {robot}");
        assert_eq!(robot["streams"][stream]["senders"], 1, "{stream}");
    }
    let (code, said) = told("nobody", &running.endpoint, &["status"]);
    assert_eq!(
        (code, said["robots"].as_array().map(Vec::len)),
        (Some(1), Some(0)),
        "{said}"
    );
}
