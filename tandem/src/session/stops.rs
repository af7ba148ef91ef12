//! How the robot of a session stopped, to the millisecond: a table for people, everything for scripts.

use serde_json::{Value, json};
use tandem_recorder::Evidence;
use tandem_trials::stops::{Again, RobotRun, Stop, stops};
use tandem_wire::{Nanos, Stamp, seconds};

/// Prints every stop of every run of the robot. Says whether all of the journal was there.
pub(super) fn print(evidence: &Evidence, as_json: bool) -> anyhow::Result<bool> {
    let runs = stops(evidence, |_| {});
    if as_json {
        println!(
            "{}",
            serde_json::to_string(&Value::from_iter(runs.iter().map(run_json)))?
        );
    } else {
        for run in &runs {
            println!("{}", text(run));
        }
    }
    for run in &runs {
        if let Some(missing) = &run.missing {
            eprintln!("session: of the robot's run {:016x}, {missing}", run.session.0);
        }
    }
    if runs.is_empty() {
        eprintln!("session: the file holds no journal of the robot");
    }
    Ok(!runs.is_empty() && runs.iter().all(|run| run.missing.is_none()))
}

fn run_json(run: &RobotRun) -> Value {
    json!({
        "session": format!("{:016x}", run.session.0),
        "stops": run.stops.iter().map(stop_json).collect::<Vec<_>>(),
        "first": run.first.map(again_json),
        "setpoints": run.setpoints,
        "setpoints_missed": run.setpoints_missed,
        "refused": run.refused,
        "span_s": seconds(run.span),
        "missing": run.missing.as_ref().map(ToString::to_string),
    })
}

fn stop_json(stop: &Stop) -> Value {
    json!({
        "reason": stop.reason.to_string(),
        "press": stop.press,
        "heard_ns": stop.heard.0,
        "noticed_ms": millis_since(stop.heard, Some(stop.noticed)),
        "began_ms": millis_since(stop.heard, stop.began),
        "at_rest_ms": millis_since(stop.heard, stop.at_rest),
        "speed_m_s": stop.speed_m_s,
        "way_m": stop.way_m,
        "drove_on": stop.drove_on,
        "again": stop.again.map(again_json),
    })
}

fn again_json(again: Again) -> Value {
    json!({"at_ns": again.at.0, "press": again.press, "fresh": again.fresh})
}

fn millis_since(from: Stamp, to: Option<Stamp>) -> Option<f64> {
    let millis = |nanos: Nanos| seconds(nanos) * 1e3;
    to.map(|to| millis(to.since(from)))
}

fn text(run: &RobotRun) -> String {
    let head = format!(
        "robot {:016x}: {} stops in {:.1} s; {} setpoints, {} missed; {} messages refused",
        run.session.0,
        run.stops.len(),
        seconds(run.span),
        run.setpoints,
        run.setpoints_missed,
        run.refused,
    );
    let columns =
        "   at s   brakes after ms   stands after ms   from m/s   within mm   moves again by   why".to_owned();
    let rows = run.stops.iter().map(row);
    let lines: Vec<String> = [head]
        .into_iter()
        .chain((!run.stops.is_empty()).then_some(columns))
        .chain(rows)
        .collect();
    lines.join("\n")
}

/// Times count from the last setpoint that let the arm move.
fn row(stop: &Stop) -> String {
    let millis = |to| millis_since(stop.heard, to).map_or_else(|| "–".to_owned(), |millis| format!("{millis:.1}"));
    let again = match stop.again {
        None => "–".to_owned(),
        Some(Again { press, fresh: true, .. }) => format!("press {press}"),
        Some(Again { press, .. }) => format!("OLD press {press}"),
    };
    let stands = if stop.drove_on {
        "DROVE ON".to_owned()
    } else {
        millis(stop.at_rest)
    };
    format!(
        "{:7.2}   {:>15}   {:>15}   {:8.3}   {:9.1}   {:>14}   {}",
        seconds(stop.heard.0),
        millis(stop.began),
        stands,
        stop.speed_m_s,
        stop.way_m * 1e3,
        again,
        stop.reason,
    )
}
