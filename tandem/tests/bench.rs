//! `tandem bench` measures with real processes and tells what it found. How quick this machine is, no test says.

use std::process::Command;

use serde_json::Value;

/// Runs a measurement and reads its lines; whether it reached its target is the machine's affair.
fn measured(arguments: &[&str]) -> Vec<Value> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_tandem"));
    let output = command.arg("bench").args(arguments).output().expect("tandem runs");
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(matches!(output.status.code(), Some(0 | 1)), "{words}");
    let text = String::from_utf8(output.stdout).expect("text");
    let lines: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).expect("JSON"))
        .collect();
    assert!(!lines.is_empty(), "{words}");
    lines
}

#[test]
fn both_chains_pass_commands_and_their_ratio_has_an_interval() {
    let told = &measured(&["latency", "--seconds", "1", "--rounds", "3", "--hz", "100", "--json"])[0];
    for chain in ["tandem", "bare_zenoh"] {
        assert!(told[chain]["messages"].as_u64() > Some(5), "{told}");
        assert!(told[chain]["p50_ms"].as_f64() > Some(0.0), "{told}");
    }
    for ratio in ["ratio_p50", "ratio_p99"] {
        assert!(told[ratio]["low"].as_f64() <= told[ratio]["value"].as_f64(), "{told}");
        assert!(told[ratio]["value"].as_f64() <= told[ratio]["high"].as_f64(), "{told}");
    }
}

#[test]
fn a_fleet_of_each_size_is_counted_tick_by_tick() {
    let told = measured(&["fleet", "--seconds", "1", "--robots", "1,3", "--hz", "50", "--json"]);
    assert_eq!(
        (told[0]["robots"].as_u64(), told[1]["robots"].as_u64()),
        (Some(1), Some(3))
    );
    for fleet in &told {
        assert!(fleet["ticks"].as_u64() >= fleet["messages"].as_u64(), "{fleet}");
        assert!(fleet["messages"].as_u64() > Some(0), "{fleet}");
    }
}
