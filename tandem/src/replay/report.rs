//! How a replay went: what was played, what was lost, how late it was.

use std::path::Path;
use std::time::Duration;

use serde_json::json;
use tandem_recorder::Recording;
use tandem_wire::{Nanos, seconds};

/// How it went.
pub(super) struct Report {
    pub(super) played: u64,
    pub(super) passes: u64,
    pub(super) is_paced: bool,
    pub(super) lost: u64,
    /// Whether the target was there to the end.
    pub(super) was_there: bool,
    /// How late each message was, sorted.
    pub(super) late: Vec<Nanos>,
}

impl Report {
    /// The time that this part of the messages was late at most, in milliseconds.
    fn late_ms(&self, per_mille: usize) -> Option<f64> {
        let index = (self.late.len() * per_mille / 1000).min(self.late.len().saturating_sub(1));
        let late = self.late.get(index).filter(|_| self.is_paced)?;
        Some(seconds(*late) * 1e3)
    }

    pub(super) fn print<B>(&self, as_json: bool, rrd: Option<&Path>, recording: &Recording<B>, wall: Duration) {
        let late = [500, 990, 1000].map(|part| self.late_ms(part));
        if as_json {
            let damage: Vec<_> = recording.damage.iter().map(ToString::to_string).collect();
            let object = json!({
                "messages_played": self.played,
                "passes": self.passes,
                "messages_lost": self.lost,
                "target_was_there": self.was_there,
                "wall_s": wall.as_secs_f64(),
                "pacing_error_p50_ms": late[0],
                "pacing_error_p99_ms": late[1],
                "pacing_error_max_ms": late[2],
                "damage": damage,
            });
            println!("{object}");
            return;
        }
        eprintln!(
            "replay: {} messages played; the target missed {}",
            self.played, self.lost
        );
        if let [Some(p50), Some(p99), Some(max)] = late {
            eprintln!("replay: late by p50 {p50:.2} ms, p99 {p99:.2} ms, at most {max:.2} ms");
        }
        if let Some(path) = rrd {
            println!("rerun {}", path.display());
        }
    }
}
